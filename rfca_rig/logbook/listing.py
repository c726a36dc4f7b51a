"""The logbook of a folder: every run below it, newest first, from the index where that still holds."""

from collections.abc import Callable
from pathlib import Path

from rfca_rig.errors import BadInput
from rfca_rig.logbook.entry import Entry, Verdict, entry_of
from rfca_rig.logbook.finding import Found, runs_below
from rfca_rig.logbook.index import Row, read_index, write_index
from rfca_rig.logbook.reading import entry_in
from rfca_rig.logbook.verdicts import by_identity, diagnoses_near, stamp_of, verdict_in
from rfca_rig.progress import Watcher, counted, unwatched

OF_DIAGNOSIS = "diagnosis:"


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


def is_run(found: list[Found]) -> bool:
    """Whether the folder is itself a run's, which nothing is added to."""
    return [one.folder for one in found] == ["."]


def _rows(
    runs: Path, found: list[Found], known: dict[str, Row], told: Watcher, measure_s: Callable[[Path], float | None]
) -> dict[str, Row]:
    """Of every run, read anew where its folder is not as it was."""
    rows = {one.folder: known[one.folder] for one in found if one.folder in known and known[one.folder].stamp == one.stamp}
    new = [one for one in found if one.folder not in rows]
    for one in counted(new, told):
        rows[one.folder] = Row(one.stamp, entry_in(runs, one.folder, measure_s).plain())
    return rows


def _verdicts(runs: Path, found: list[Found], known: dict[str, Row]) -> tuple[dict[str, Verdict], dict[str, Row]]:
    """The verdict on each recording, and the rows of the diagnoses that say so."""
    rows, said = {}, []
    for file, stat in diagnoses_near(runs, found):
        stamp, path = stamp_of(stat), f"{OF_DIAGNOSIS}{file}"
        row = known[path] if path in known and known[path].stamp == stamp else Row(stamp, verdict_in(file))
        rows[path] = row
        said.append((_shown(file), stat.st_mtime, row.said))
    return by_identity(said), rows


def _shown(file: Path) -> str:
    """From where the user stands, if it lies below."""
    return str(file.relative_to(Path.cwd()) if file.is_relative_to(Path.cwd()) else file)


def _entry(row: Row, verdicts: dict[str, Verdict]) -> Entry:
    entry = entry_of(row.said)
    return entry.with_verdict(verdicts.get(entry.identity))
