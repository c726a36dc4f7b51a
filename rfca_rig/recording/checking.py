"""Checks a run on disk: every file by its hash, every stage by its counts."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from rfca_rig.errors import BadInput
from rfca_rig.recording.journal import blocks_in, size_of
from rfca_rig.recording.layout import ENDING, EVENTS, HEADER, RECORDING, STAGES, SUMS, journals, stage_files
from rfca_rig.recording.run_text import events_of, read_ending, read_header
from rfca_rig.recording.summary import RecordingSummary, tally_of, together
from rfca_rig.recording.sums import read_sums, sha256_of
from rfca_rig.suggestions import not_there


@dataclass(frozen=True)
class FileFinding:
    """One file by its path in the run's folder, what was found, and whether it is as it should be."""

    file: str
    words: str
    is_sound: bool = True


def check_run(folder: Path) -> Iterator[FileFinding]:
    """A finding per file, in the order in which a run writes them. Raises BadInput where `folder` holds no run."""
    if not (folder / HEADER).is_file():
        yield from _check_older(folder)
        return
    sums = _Sums(folder)
    yield sums.finding(HEADER, partial(_title, folder))
    # Damaged events are reported once; the stages are then checked without them.
    events = sums.finding(EVENTS, lambda: f"{len(events_of(folder))} events")
    yield events
    yield from _check_stages(folder, sums, events_of(folder) if events.is_sound else [])
    yield from (_check_journal(folder, journal) for journal in journals(folder))
    if (folder / ENDING).is_file():
        yield sums.finding(ENDING, partial(_ending, folder))
    if (folder / RECORDING).is_file():
        yield sums.finding(RECORDING, partial(_like_its_stages, folder))
    yield from sums.rest()


def _check_older(folder: Path) -> Iterator[FileFinding]:
    """A run of an older version is one recording, or parts of one."""
    files = sorted((*folder.glob("*.h5"), *folder.glob("*.h5.partial/*.h5")))
    if not files:
        raise BadInput(f"{folder}: holds no run; rfca-rig runs lists those there are" if folder.exists() else not_there(folder))
    for file in files:
        yield _finding_of(file.relative_to(folder).as_posix(), partial(_describe, file))


class _Sums:
    """The hashes from the run's end, each used once; a run that has not ended has none."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._damage: FileFinding | None = None
        try:
            self._sums = read_sums(folder)
        except BadInput as error:
            self._sums, self._damage = {}, FileFinding(SUMS, str(error), False)

    def finding(self, name: str, look: Callable[[], str]) -> FileFinding:
        """What `look` finds in a file, provided that its hash is right."""
        if not (self._folder / name).is_file():
            # Taken off the list, so that a missing file is reported once, and not again by `rest`.
            self._sums.pop(name, None)
            return FileFinding(name, "is missing", False)
        expected = self._sums.pop(name, "")
        if expected and expected != sha256_of(self._folder / name):
            return FileFinding(name, "is not what was written: its SHA-256 is another", False)
        return _finding_of(name, look)

    def rest(self) -> Iterator[FileFinding]:
        """Files with a hash that nothing else checks, for example photos."""
        if self._damage:
            yield self._damage
        # A copy, because `finding` takes names out of the dictionary.
        for name in list(self._sums):
            yield self.finding(name, lambda: "as it was written")


def _check_stages(folder: Path, sums: _Sums, events: Sequence[Mapping[str, Any]]) -> Iterator[FileFinding]:
    """The stages that the events name, and other stage files that exist."""
    events_by_file = {event["file"]: event for event in events if "file" in event}
    on_disk = {f"{STAGES}/{file.name}" for file in stage_files(folder)}
    for name in sorted(on_disk | set(events_by_file)):
        yield sums.finding(name, partial(_as_said, folder / name, events_by_file.get(name)))


def _as_said(path: Path, event: Mapping[str, Any] | None) -> str:
    stage = tally_of(path)
    # The counts come first: they say how much is wrong, a hash only that something is.
    if event is not None and event["samples"] != stage.samples:
        raise BadInput(f"{path}: holds {dict(stage.samples)} samples, where {event['samples']} were recorded")
    if event is not None and event["sha256"] != sha256_of(path):
        raise BadInput(f"{path}: is not what was recorded: its SHA-256 is another")
    lost = "".join(f", {missing} records missing on the way" for missing in stage.missing)
    return f"{stage.text()}{lost}"


def _check_journal(folder: Path, journal: Path) -> FileFinding:
    sizes = [size_of(block) for block in blocks_in(journal)]
    behind = journal.stat().st_size - sum(sizes)
    words = f"a stage in progress, {len(sizes)} whole blocks; {behind} bytes behind them; type rfca-rig recover {folder}"
    return FileFinding(f"{STAGES}/{journal.name}", words)


def _like_its_stages(folder: Path) -> str:
    found = tally_of(folder / RECORDING).text()
    try:
        stages = _in_stages(folder).text()
    except BadInput:
        return f"{found}; not held against its stages, of which some are damaged"
    if found != stages:
        raise BadInput(f"{folder / RECORDING}: holds {found}, its stages {stages}")
    return found


def _in_stages(folder: Path) -> RecordingSummary:
    stages, ending = together(tally_of(file) for file in stage_files(folder)), read_ending(folder)
    return stages if ending is None or ending.static is None else replace(stages, static=len(ending.static))


def _title(folder: Path) -> str:
    header = read_header(folder)
    return f"{header.source} {header.title}"


def _ending(folder: Path) -> str:
    ending = read_ending(folder)
    return "" if ending is None else ending.provenance.get("ended", "recovered")


def _describe(file: Path) -> str:
    return tally_of(file).text()


def _finding_of(name: str, look: Callable[[], str]) -> FileFinding:
    try:
        return FileFinding(name, look())
    except BadInput as error:
        return FileFinding(name, str(error), False)
