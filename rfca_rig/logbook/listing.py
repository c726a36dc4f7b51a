"""The logbook of a folder: every run below it, newest first, from the index where that still holds."""

import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from stat import S_ISREG
from typing import Any

from rfca_rig.errors import BadInput
from rfca_rig.logbook.entry import Entry, Verdict, entry_of
from rfca_rig.logbook.finding import FoundRun, runs_below
from rfca_rig.logbook.index import IndexRow, read_index, write_index
from rfca_rig.logbook.reading import entry_in
from rfca_rig.progress import Watcher, counted, unwatched
from rfca_rig.recording.layout import DIAGNOSIS

OF_DIAGNOSIS = "diagnosis:"


def diagnoses_near(runs: Path, found: Iterable[FoundRun]) -> Iterator[tuple[Path, os.stat_result]]:
    """The files of diagnoses beside the folder of all runs, where the user stands, and in the folders of runs; each once."""
    seen: set[Path] = set()
    around = (file for place in (runs.absolute().parent, Path.cwd()) for way in (DIAGNOSIS, f"*/{DIAGNOSIS}") for file in place.glob(way))
    within = (Path(file).absolute() for one in found for file in one.diagnoses)
    for file in (*around, *within):
        if file not in seen and (stat := _stat(file)) is not None:
            seen.add(file)
            yield file, stat


def _stat(file: Path) -> os.stat_result | None:
    """None for what is no file, or not any more."""
    try:
        stat = file.stat()
    except OSError:
        return None
    return stat if S_ISREG(stat.st_mode) else None


def stamp_of(stat: os.stat_result) -> str:
    """Changes whenever the file does."""
    return f"{stat.st_mtime_ns}:{stat.st_size}:{stat.st_ino}"


GRADED = ("mostly", "family")  # grades that the words of rfca-diagnosis/1 do not tell from "unexplained"


def verdict_in(file: Path) -> dict[str, Any]:
    """What the file says, as plain data: its verdict, and the identities of its recordings; none where it is no diagnosis."""
    try:
        said = json.loads(file.read_bytes())
        named = [one["identity"] for one in said.get("recordings", [])]
        effects = [str(effect["id"]) for effect in said["effects"]]
        sure = [effect["probability"] for effect in said["effects"] if effect["probability"] is not None]
        words = said["grade"] if said.get("grade") in GRADED else said["verdict"]
        return {"identities": named, "words": str(words), "effects": effects, "probability": max(sure, default=None)}
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return {"identities": []}


def by_identity(said: Iterable[tuple[str, float, Mapping[str, Any]]]) -> dict[str, Verdict]:
    """The newest verdict on each recording, from (file, when it was written, what `verdict_in` gave)."""
    verdicts: dict[str, Verdict] = {}
    for file, _, one in sorted(said, key=lambda each: each[1]):
        for identity in one["identities"]:
            verdicts[identity] = Verdict(one["words"], tuple(one["effects"]), one["probability"], file)
    return verdicts


def list_runs(runs: Path, told: Watcher = unwatched, measure_s: Callable[[Path], float | None] = lambda _: None) -> list[Entry]:
    """Newest first. `told` hears how many of those that are not in the index have been read, of how many.

    `measure_s` reads how long the recordings in a folder with experiment.toml last, None where they cannot be read.

    Raises BadInput where there is no such folder.
    """
    if not runs.is_dir():
        raise BadInput(f"{runs}: is no folder; name the one that your runs are in with --runs, or record one: rfca-rig dynamic run")
    known = read_index(runs)
    found = list(runs_below(runs))
    rows = _rows(runs, found, known, told, measure_s)
    verdicts, diagnoses = _verdicts(runs, found, known)
    rows |= diagnoses
    if rows != known and not is_run(found):
        write_index(runs, rows)
    entries = [_entry(rows[one.folder], verdicts) for one in found]
    return sorted(entries, key=lambda entry: (-entry.began_s, entry.folder))


def is_run(found: list[FoundRun]) -> bool:
    """Whether the folder is itself a run's, which nothing is added to."""
    return [one.folder for one in found] == ["."]


def _rows(
    runs: Path, found: list[FoundRun], known: dict[str, IndexRow], told: Watcher, measure_s: Callable[[Path], float | None]
) -> dict[str, IndexRow]:
    """Of every run, read anew where its folder is not as it was."""
    rows = {one.folder: known[one.folder] for one in found if one.folder in known and known[one.folder].stamp == one.stamp}
    new = [one for one in found if one.folder not in rows]
    for one in counted(new, told):
        rows[one.folder] = IndexRow(one.stamp, entry_in(runs, one.folder, measure_s).plain())
    return rows


def _verdicts(runs: Path, found: list[FoundRun], known: dict[str, IndexRow]) -> tuple[dict[str, Verdict], dict[str, IndexRow]]:
    """The verdict on each recording, and the rows of the diagnoses that say so."""
    rows, said = {}, []
    for file, stat in diagnoses_near(runs, found):
        stamp, path = stamp_of(stat), f"{OF_DIAGNOSIS}{file}"
        row = known[path] if path in known and known[path].stamp == stamp else IndexRow(stamp, verdict_in(file))
        rows[path] = row
        said.append((_shown(file), stat.st_mtime, row.said))
    return by_identity(said), rows


def _shown(file: Path) -> str:
    """From where the user stands, if it lies below."""
    return str(file.relative_to(Path.cwd()) if file.is_relative_to(Path.cwd()) else file)


def _entry(row: IndexRow, verdicts: dict[str, Verdict]) -> Entry:
    entry = entry_of(row.said)
    return entry.with_verdict(verdicts.get(entry.identity))
