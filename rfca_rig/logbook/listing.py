"""The logbook of a folder: every run below it, newest first, from the index where it is still
valid.

One SQLite file in the folder of all runs. It is never changed: a process that has read something
new writes another one beside it, which replaces it at once and whole. So any number of processes
may use it, on any disk, without waiting for each other. What one of them overwrites of another's is
merely read once more.
"""

import json
import os
import sqlite3
import threading
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from stat import S_ISREG
from typing import Any
from urllib.parse import quote

from rfca_rig.errors import BadInput
from rfca_rig.logbook.entry import Entry, Verdict, entry_of
from rfca_rig.logbook.reading import read_entry
from rfca_rig.progress import ProgressCount, ignore_progress, iterate_with_progress
from rfca_rig.recording.layout import (
    DIAGNOSIS,
    ENDING,
    EVENTS,
    EXPERIMENT,
    HEADER,
    PENDULUM,
    RECORDING,
)

MARKER_FILES = (HEADER, ENDING, EVENTS, RECORDING, PENDULUM, EXPERIMENT)
# Levels of folders that are searched below the folder of all runs.
MAX_DEPTH = 6

NAME = ".rfca-rig-index.sqlite3"
# Of the rows' content; an index of another version is not read.
VERSION = 2

OF_DIAGNOSIS = "diagnosis:"


@dataclass(frozen=True)
class FoundRun:
    """A run's folder, as a path from the folder of all runs, and a stamp that changes whenever one
    of its files does.

    `diagnoses` are paths in it where a diagnosis may be.
    """

    folder: str
    stamp: str
    diagnoses: tuple[str, ...] = ()


def find_runs(runs: Path) -> Iterator[FoundRun]:
    """Every folder with a run, at any depth up to MAX_DEPTH; folders inside a run are not
    searched.
    """
    yield from _below(str(runs), "", MAX_DEPTH)


def _below(runs: str, folder: str, deeper: int) -> Iterator[FoundRun]:
    try:
        with os.scandir(os.path.join(runs, folder)) as listing:  # noqa: PTH118  (thousands of folders: paths as objects take as long again)
            inside = list(listing)
    except OSError:  # taken away meanwhile, or not ours to read
        return
    # One listing per folder serves both questions: is it a run, and has it changed.
    files = {file.name: file for file in inside if file.name in MARKER_FILES}
    if {HEADER, RECORDING, PENDULUM, EXPERIMENT} & set(files):
        telling = [files[name] for name in MARKER_FILES if name in files]
        if EXPERIMENT in files:  # any file in the folder may be a recording
            telling += sorted(
                (file for file in inside if file.name not in MARKER_FILES and _is_file(file)),
                key=lambda file: file.name,
            )
        yield FoundRun(folder or ".", "|".join(map(_stamp, telling)), tuple(_diagnoses(inside)))
        return
    for entry in inside:
        if (
            deeper
            and not entry.name.startswith(".")
            and _is_folder(entry)
            and not _leads_back(entry)
        ):
            yield from _below(runs, f"{folder}/{entry.name}" if folder else entry.name, deeper - 1)


def _is_folder(entry: "os.DirEntry[str]") -> bool:
    """A link that leads to itself is neither a folder nor a file."""
    try:
        return entry.is_dir()
    except OSError:
        return False


def _is_file(entry: "os.DirEntry[str]") -> bool:
    try:
        return entry.is_file()
    except OSError:
        return False


def _leads_back(entry: "os.DirEntry[str]") -> bool:
    """Whether it is a link to a folder that contains it: following it would list every run again
    and again.
    """
    return entry.is_symlink() and Path(entry.path).parent.resolve().is_relative_to(
        Path(entry.path).resolve()
    )


def _diagnoses(inside: "list[os.DirEntry[str]]") -> Iterator[str]:
    for entry in inside:
        if entry.name == DIAGNOSIS:
            yield entry.path
        elif entry.name.startswith("diag") and _is_folder(entry):
            yield f"{entry.path}/{DIAGNOSIS}"


def _stamp(file: "os.DirEntry[str]") -> str:
    """Name, time, size and inode: a file that replaced another has another inode, even with the
    same age and size.
    """
    try:
        status = file.stat()
    except OSError:
        return f"{file.name}:gone"
    return f"{file.name}:{status.st_mtime_ns}:{status.st_size}:{status.st_ino}"


@dataclass(frozen=True)
class IndexRow:
    """What was read from a file or folder when it had that stamp; `content` is plain data."""

    stamp: str
    content: Mapping[str, Any]


def read_index(runs: Path) -> dict[str, IndexRow]:
    """The rows by path; of a missing or damaged index those that are sound."""
    # immutable: SQLite then takes no locks and writes nothing beside the file, which network disks
    # may not bear.
    uri = f"file:{quote(str((runs / NAME).absolute()))}?mode=ro&immutable=1"
    rows: dict[str, IndexRow] = {}
    with suppress(sqlite3.Error, OSError), closing(sqlite3.connect(uri, uri=True)) as base:
        if base.execute("PRAGMA user_version").fetchone()[0] == VERSION:
            for path, stamp, text, check in base.execute("SELECT path, stamp, said, sum FROM rows"):
                # A damaged row is skipped; its run is read again.
                if check == _sum(path, stamp, text):
                    rows[path] = IndexRow(stamp, json.loads(text))
    return rows


def write_index(runs: Path, rows: Mapping[str, IndexRow]) -> bool:
    """Replaces the index by one with these rows; False where the folder is not writable, so that
    all will be read again.
    """
    # A name of its own for each process and thread: two may write at the same time.
    new_file = runs / f"{NAME}.{os.getpid()}-{threading.get_ident()}"
    try:
        with suppress(FileNotFoundError):
            new_file.unlink()
        with closing(sqlite3.connect(new_file)) as base:
            _fill(base, ((path, row.stamp, json.dumps(row.content)) for path, row in rows.items()))
        new_file.replace(runs / NAME)
    # A name that is no UTF-8 is no text of SQLite.
    except (sqlite3.Error, OSError, UnicodeError):
        with suppress(OSError):
            new_file.unlink()
        return False
    return True


def _fill(base: sqlite3.Connection, rows: Iterable[tuple[str, str, str]]) -> None:
    # Neither journal nor sync: no other process knows the file yet, and a lost cache costs only
    # time.
    base.execute("PRAGMA journal_mode = OFF")
    base.execute("PRAGMA synchronous = OFF")
    base.execute(f"PRAGMA user_version = {VERSION}")
    base.execute(
        "CREATE TABLE rows (path TEXT PRIMARY KEY, stamp TEXT, said TEXT, sum INTEGER) "
        "WITHOUT ROWID"
    )
    base.executemany("INSERT INTO rows VALUES (?, ?, ?, ?)", ((*row, _sum(*row)) for row in rows))
    base.commit()


def _sum(path: object, stamp: object, text: object) -> int:
    """Checksum of a row: SQLite takes flipped bits in it for data."""
    return zlib.crc32(f"{path}\0{stamp}\0{text}".encode(errors="surrogatepass"))


def find_diagnoses(runs: Path, found: Iterable[FoundRun]) -> Iterator[tuple[Path, os.stat_result]]:
    """Files of diagnoses beside the folder of all runs, in the working directory and in the
    folders of runs; each once.
    """
    listed: set[Path] = set()
    around = (
        file
        for folder in (runs.absolute().parent, Path.cwd())
        for pattern in (DIAGNOSIS, f"*/{DIAGNOSIS}")
        for file in folder.glob(pattern)
    )
    within = (Path(file).absolute() for run in found for file in run.diagnoses)
    for file in (*around, *within):
        if file not in listed and (stat := _stat(file)) is not None:
            listed.add(file)
            yield file, stat


def _stat(file: Path) -> os.stat_result | None:
    """None where it is no file, or has been removed."""
    try:
        stat = file.stat()
    except OSError:
        return None
    if S_ISREG(stat.st_mode):
        return stat
    return None


def stamp_of(stat: os.stat_result) -> str:
    """A text that changes whenever the file does."""
    return f"{stat.st_mtime_ns}:{stat.st_size}:{stat.st_ino}"


# Grades that the verdicts of rfca-diagnosis/1 do not distinguish from "unexplained".
GRADED = ("mostly", "family")


def read_verdict(file: Path) -> dict[str, Any]:
    """A diagnosis file as plain data: its verdict and the identities of its recordings; no
    identities where it is no diagnosis.
    """
    try:
        content = json.loads(file.read_bytes())
        identities = [recording["identity"] for recording in content.get("recordings", [])]
        effects = [str(effect["id"]) for effect in content["effects"]]
        probabilities = [
            effect["probability"]
            for effect in content["effects"]
            if effect["probability"] is not None
        ]
        if content.get("grade") in GRADED:
            words = content["grade"]
        else:
            words = content["verdict"]
        return {
            "identities": identities,
            "words": str(words),
            "effects": effects,
            "probability": max(probabilities, default=None),
        }
    # Any JSON file of that name may lie about; a foreign one is no error of the listing.
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return {"identities": []}


def verdicts_by_identity(
    verdicts_of_files: Iterable[tuple[str, float, Mapping[str, Any]]],
) -> dict[str, Verdict]:
    """The newest verdict on each recording, from triples (file, time of writing, data of
    `read_verdict`).
    """
    verdicts: dict[str, Verdict] = {}
    for file, _, verdict in sorted(verdicts_of_files, key=lambda triple: triple[1]):
        for identity in verdict["identities"]:
            # In order of time, so that the newest verdict replaces older ones.
            verdicts[identity] = Verdict(
                verdict["words"], tuple(verdict["effects"]), verdict["probability"], file
            )
    return verdicts


def list_runs(
    runs: Path,
    report_progress: ProgressCount = ignore_progress,
    measure_s: Callable[[Path], float | None] = lambda _: None,
) -> list[Entry]:
    """All runs below a folder, newest first. Raises BadInput where there is no such folder.

    Parameters
    ----------
    runs : Path
        The folder of all runs.
    report_progress : callable
        Called with the number of runs read so far that were not in the index, and their total.
    measure_s : callable
        Returns how long the recordings in a folder with experiment.toml last, None where they
        cannot be read.
    """
    if not runs.is_dir():
        raise BadInput(
            f"{runs}: is no folder; name the one that your runs are in with --runs, or "
            "record one: rfca-rig dynamic run"
        )
    known = read_index(runs)
    found_runs = list(find_runs(runs))
    rows = _rows(runs, found_runs, known, report_progress, measure_s)
    verdicts, diagnoses = _verdicts(runs, found_runs, known)
    rows |= diagnoses
    # Nothing is added to a run's own folder, whose files are covered by its checksums.
    if rows != known and not is_run(found_runs):
        write_index(runs, rows)
    entries = [_entry(rows[run.folder], verdicts) for run in found_runs]
    return sorted(entries, key=lambda entry: (-entry.began_s, entry.folder))


def is_run(found: list[FoundRun]) -> bool:
    """Whether the folder is itself a run's."""
    return [run.folder for run in found] == ["."]


def _rows(
    runs: Path,
    found_runs: list[FoundRun],
    known: dict[str, IndexRow],
    report_progress: ProgressCount,
    measure_s: Callable[[Path], float | None],
) -> dict[str, IndexRow]:
    """A row of every run, read again where its folder has changed."""
    # Rows of folders that no longer exist are dropped with this.
    rows = {
        run.folder: known[run.folder]
        for run in found_runs
        if run.folder in known and known[run.folder].stamp == run.stamp
    }
    new = [run for run in found_runs if run.folder not in rows]
    for run in iterate_with_progress(new, report_progress):
        rows[run.folder] = IndexRow(run.stamp, read_entry(runs, run.folder, measure_s).plain())
    return rows


def _verdicts(
    runs: Path, found_runs: list[FoundRun], known: dict[str, IndexRow]
) -> tuple[dict[str, Verdict], dict[str, IndexRow]]:
    """The verdict on each recording, and the rows of the diagnoses that they come from."""
    rows = {}
    verdicts_of_files = []
    for file, stat in find_diagnoses(runs, found_runs):
        stamp = stamp_of(stat)
        path = f"{OF_DIAGNOSIS}{file}"
        if path in known and known[path].stamp == stamp:
            row = known[path]
        else:
            row = IndexRow(stamp, read_verdict(file))
        rows[path] = row
        # Relative to the working directory, if it lies below.
        if file.is_relative_to(Path.cwd()):
            shown = file.relative_to(Path.cwd())
        else:
            shown = file
        verdicts_of_files.append((str(shown), stat.st_mtime, row.content))
    return verdicts_by_identity(verdicts_of_files), rows


def _entry(row: IndexRow, verdicts: dict[str, Verdict]) -> Entry:
    entry = entry_of(row.content)
    return entry.with_verdict(verdicts.get(entry.identity))
