"""The logbook of a folder: every run below it, newest first, from the index where it is still valid."""

import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from stat import S_ISREG
from typing import Any

from rfca_rig.errors import BadInput
from rfca_rig.logbook.entry import Entry, Verdict, entry_of
from rfca_rig.logbook.finding import FoundRun, find_runs
from rfca_rig.logbook.index import IndexRow, read_index, write_index
from rfca_rig.logbook.reading import read_entry
from rfca_rig.progress import ProgressCount, ignore_progress, iterate_with_progress
from rfca_rig.recording.layout import DIAGNOSIS

OF_DIAGNOSIS = "diagnosis:"


def find_diagnoses(runs: Path, found: Iterable[FoundRun]) -> Iterator[tuple[Path, os.stat_result]]:
    """Files of diagnoses beside the folder of all runs, in the working directory and in the folders of runs; each once."""
    listed: set[Path] = set()
    around = (
        file for place in (runs.absolute().parent, Path.cwd()) for pattern in (DIAGNOSIS, f"*/{DIAGNOSIS}") for file in place.glob(pattern)
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
    return stat if S_ISREG(stat.st_mode) else None


def stamp_of(stat: os.stat_result) -> str:
    """A text that changes whenever the file does."""
    return f"{stat.st_mtime_ns}:{stat.st_size}:{stat.st_ino}"


# Grades that the verdicts of rfca-diagnosis/1 do not distinguish from "unexplained".
GRADED = ("mostly", "family")


def read_verdict(file: Path) -> dict[str, Any]:
    """A diagnosis file as plain data: its verdict and the identities of its recordings; no identities where it is no diagnosis."""
    try:
        content = json.loads(file.read_bytes())
        identities = [one["identity"] for one in content.get("recordings", [])]
        effects = [str(effect["id"]) for effect in content["effects"]]
        probabilities = [effect["probability"] for effect in content["effects"] if effect["probability"] is not None]
        words = content["grade"] if content.get("grade") in GRADED else content["verdict"]
        return {"identities": identities, "words": str(words), "effects": effects, "probability": max(probabilities, default=None)}
    # Any JSON file of that name may lie about; a foreign one is no error of the listing.
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return {"identities": []}


def verdicts_by_identity(verdicts_of_files: Iterable[tuple[str, float, Mapping[str, Any]]]) -> dict[str, Verdict]:
    """The newest verdict on each recording, from triples (file, time of writing, data of `read_verdict`)."""
    verdicts: dict[str, Verdict] = {}
    for file, _, verdict in sorted(verdicts_of_files, key=lambda each: each[1]):
        for identity in verdict["identities"]:
            # In order of time, so that the newest verdict replaces older ones.
            verdicts[identity] = Verdict(verdict["words"], tuple(verdict["effects"]), verdict["probability"], file)
    return verdicts


def list_runs(runs: Path, told: ProgressCount = ignore_progress, measure_s: Callable[[Path], float | None] = lambda _: None) -> list[Entry]:
    """All runs below a folder, newest first. Raises BadInput where there is no such folder.

    Parameters
    ----------
    runs : Path
        The folder of all runs.
    told : callable
        Called with the number of runs read so far that were not in the index, and their total.
    measure_s : callable
        Returns how long the recordings in a folder with experiment.toml last, None where they cannot be read.
    """
    if not runs.is_dir():
        raise BadInput(f"{runs}: is no folder; name the one that your runs are in with --runs, or record one: rfca-rig dynamic run")
    known = read_index(runs)
    found = list(find_runs(runs))
    rows = _rows(runs, found, known, told, measure_s)
    verdicts, diagnoses = _verdicts(runs, found, known)
    rows |= diagnoses
    # Nothing is added to a run's own folder, whose files are covered by its checksums.
    if rows != known and not is_run(found):
        write_index(runs, rows)
    entries = [_entry(rows[one.folder], verdicts) for one in found]
    return sorted(entries, key=lambda entry: (-entry.began_s, entry.folder))


def is_run(found: list[FoundRun]) -> bool:
    """Whether the folder is itself a run's."""
    return [one.folder for one in found] == ["."]


def _rows(
    runs: Path, found: list[FoundRun], known: dict[str, IndexRow], told: ProgressCount, measure_s: Callable[[Path], float | None]
) -> dict[str, IndexRow]:
    """A row of every run, read again where its folder has changed."""
    # Rows of folders that no longer exist are dropped with this.
    rows = {one.folder: known[one.folder] for one in found if one.folder in known and known[one.folder].stamp == one.stamp}
    new = [one for one in found if one.folder not in rows]
    for one in iterate_with_progress(new, told):
        rows[one.folder] = IndexRow(one.stamp, read_entry(runs, one.folder, measure_s).plain())
    return rows


def _verdicts(runs: Path, found: list[FoundRun], known: dict[str, IndexRow]) -> tuple[dict[str, Verdict], dict[str, IndexRow]]:
    """The verdict on each recording, and the rows of the diagnoses that they come from."""
    rows, verdicts_of_files = {}, []
    for file, stat in find_diagnoses(runs, found):
        stamp, path = stamp_of(stat), f"{OF_DIAGNOSIS}{file}"
        row = known[path] if path in known and known[path].stamp == stamp else IndexRow(stamp, read_verdict(file))
        rows[path] = row
        verdicts_of_files.append((_display_path(file), stat.st_mtime, row.said))
    return verdicts_by_identity(verdicts_of_files), rows


def _display_path(file: Path) -> str:
    """Relative to the working directory, if it lies below."""
    return str(file.relative_to(Path.cwd()) if file.is_relative_to(Path.cwd()) else file)


def _entry(row: IndexRow, verdicts: dict[str, Verdict]) -> Entry:
    entry = entry_of(row.said)
    return entry.with_verdict(verdicts.get(entry.identity))
