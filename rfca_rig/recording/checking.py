"""Checks a run on disk: every file by its hash, every stage by its counts."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from rfca_rig.errors import BadInput
from rfca_rig.recording.journal import block_size, read_blocks
from rfca_rig.recording.layout import ENDING, EVENTS, HEADER, RECORDING, STAGES, SUMS, journals, stage_files
from rfca_rig.recording.model import Recording
from rfca_rig.recording.run_text import INTERRUPTED, events_of, events_text, read_ending, read_header
from rfca_rig.recording.store import read_texts
from rfca_rig.recording.summary import RecordingSummary, add_up, summarize
from rfca_rig.recording.sums import read_sums, sha256_of
from rfca_rig.suggestions import not_there

# What `recover` makes again from the other files of a run.
REMADE = (RECORDING, SUMS)


@dataclass(frozen=True)
class FileFinding:
    """One file by its path in the run's folder, what was found, and whether it is as it should be."""

    file: str
    words: str
    is_sound: bool = True


def describe_damage(folder: Path, findings: Iterable[FileFinding]) -> str:
    """What is damaged and what helps, as check and recover say it, from findings that are not sound."""
    damaged = [finding.file for finding in findings]
    lost = [name for name in damaged if name not in REMADE]
    if lost:
        return f"{folder}: damaged: {', '.join(damaged)}; restore {', '.join(lost)} from a copy: recover cannot make {_them(lost)} again"
    return f"{folder}: damaged: {', '.join(damaged)}; rfca-rig recover {folder} makes {_them(damaged)} again from the files of the stages"


def _them(names: Sequence[str]) -> str:
    return "it" if len(names) == 1 else "them"


def is_run_folder(folder: Path) -> bool:
    """Whether a run wrote the folder, by any of its files: also one that has lost its header."""
    return any((folder / name).exists() for name in (HEADER, EVENTS, STAGES))


def needs_no_recovery(folder: Path, findings: Iterable[FileFinding]) -> bool:
    """Whether nothing needs recovery: no stage is unfinished, `run.h5` exists, and every file is as it was written."""
    has_all = all((folder / name).is_file() for name in (ENDING, RECORDING, SUMS))
    return has_all and not journals(folder) and all(finding.is_sound for finding in findings)


def check_run(folder: Path) -> Iterator[FileFinding]:
    """A finding per file, in the order in which a run writes them. Raises BadInput where `folder` holds no run."""
    if not is_run_folder(folder):
        yield from _check_older(folder)
        return
    sums = _Sums(folder)
    texts = _recorded_texts(folder)
    yield sums.finding(HEADER, partial(_title, folder, texts))
    # Damaged events are reported once; the stages are then checked without them.
    events = sums.finding(EVENTS, partial(_events, folder, texts))
    yield events
    yield from _check_stages(folder, sums, events_of(folder) if events.is_sound else [])
    yield from (_check_journal(folder, journal) for journal in journals(folder))
    has_ending, has_recording = (folder / ENDING).is_file(), (folder / RECORDING).is_file()
    if has_ending or ENDING in sums or _has_ended(folder, texts):
        yield sums.finding(ENDING, partial(_ending, folder, texts))
    elif not has_recording and not journals(folder):
        yield FileFinding(ENDING, f"is not there: the run goes on, or was not finished; then type rfca-rig recover {folder}")
    if has_recording or RECORDING in sums:
        yield sums.finding(RECORDING, partial(_like_its_stages, folder))
    elif has_ending:
        yield FileFinding(RECORDING, f"is not made yet; type rfca-rig recover {folder}")
    yield from sums.rest(is_finished=has_recording)


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
        self._is_summed_up = bool(self._sums)
        self._unlisted: list[str] = []

    def __contains__(self, name: str) -> bool:
        return name in self._sums

    def finding(self, name: str, look: Callable[[], str]) -> FileFinding:
        """What `look` finds in a file, provided that its hash is right."""
        if not (self._folder / name).is_file():
            # Taken off the list, so that a missing file is reported once, and not again by `rest`.
            self._sums.pop(name, None)
            return FileFinding(name, "is missing", False)
        expected = self._sums.pop(name, "")
        if not expected and self._is_summed_up:
            self._unlisted.append(name)
        if expected and expected != sha256_of(self._folder / name):
            return FileFinding(name, "is not what was written: its SHA-256 is another", False)
        return _finding_of(name, look)

    def rest(self, is_finished: bool) -> Iterator[FileFinding]:
        """Files with a hash that nothing else checks, for example photos. A finished run has hashes."""
        if self._damage:
            yield self._damage
        elif is_finished and not self._is_summed_up:
            yield FileFinding(SUMS, "is missing or empty, though the run was finished", False)
        # A copy, because `finding` takes names out of the dictionary.
        for name in list(self._sums):
            yield self.finding(name, lambda: "as it was written")
        if self._unlisted:
            yield FileFinding(SUMS, f"has no line for {', '.join(self._unlisted)}", False)


def _check_stages(folder: Path, sums: _Sums, events: Sequence[Mapping[str, Any]]) -> Iterator[FileFinding]:
    """The stages that the events name, and other stage files that exist."""
    events_by_file = {event["file"]: event for event in events if "file" in event}
    on_disk = {f"{STAGES}/{file.name}" for file in stage_files(folder)}
    for name in sorted(on_disk | set(events_by_file)):
        yield sums.finding(name, partial(_as_said, folder / name, events_by_file.get(name)))


def _as_said(path: Path, event: Mapping[str, Any] | None) -> str:
    stage = summarize(path)
    # The counts come first: they say how much is wrong, a hash only that something is.
    if event is not None and event["samples"] != stage.samples:
        raise BadInput(f"{path}: holds {dict(stage.samples)} samples, where {event['samples']} were recorded")
    if event is not None and event["sha256"] != sha256_of(path):
        raise BadInput(f"{path}: is not what was recorded: its SHA-256 is another")
    lost = "".join(f", {missing} records missing on the way" for missing in stage.missing)
    return f"{stage.text()}{lost}"


def _check_journal(folder: Path, journal: Path) -> FileFinding:
    sizes = [block_size(block) for block in read_blocks(journal)]
    behind = journal.stat().st_size - sum(sizes)
    words = f"a stage in progress, {len(sizes)} whole blocks; {behind} bytes behind them; type rfca-rig recover {folder}"
    return FileFinding(f"{STAGES}/{journal.name}", words)


def _like_its_stages(folder: Path) -> str:
    found = summarize(folder / RECORDING).text()
    try:
        stages = _in_stages(folder).text()
    except BadInput:
        return f"{found}; not compared with its stages, of which some are damaged"
    if found != stages:
        raise BadInput(f"{folder / RECORDING}: holds {found}, its stages {stages}")
    return found


def _in_stages(folder: Path) -> RecordingSummary:
    stages, ending = add_up(summarize(file) for file in stage_files(folder)), read_ending(folder)
    return stages if ending is None or ending.static is None else replace(stages, static=len(ending.static))


def _recorded_texts(folder: Path) -> Recording | None:
    """What `run.h5` holds of the other files; None where it is missing or damaged itself."""
    try:
        return read_texts(folder / RECORDING)
    except BadInput:
        return None


def _title(folder: Path, texts: Recording | None) -> str:
    header = read_header(folder)
    if texts is not None:
        for name in ("title", "source", "nominal", "known_to"):
            _compare(folder / HEADER, name, getattr(header, name), getattr(texts, name))
        # What the end says takes the place of what the header said, such as the devices' counters.
        said_later = _provenance_of_ending(folder)
        first = {name: text for name, text in header.provenance.items() if name not in said_later}
        _compare(folder / HEADER, "provenance", first, {name: texts.provenance.get(name) for name in first})
    return f"{header.source} {header.title}"


def _provenance_of_ending(folder: Path) -> Mapping[str, str]:
    """Nothing where the end is missing or damaged, which is a finding of its own."""
    try:
        ending = read_ending(folder)
    except BadInput:
        return {}
    return {} if ending is None else ending.provenance


def _has_ended(folder: Path, texts: Recording | None) -> bool:
    """Whether `run.h5` holds the end of a run, so that the file it came from must be there."""
    try:
        known = {*read_header(folder).provenance, "events", INTERRUPTED}
    except BadInput:
        return False
    return texts is not None and not known.issuperset(texts.provenance)


def _events(folder: Path, texts: Recording | None) -> str:
    if texts is not None:
        _compare(folder / EVENTS, "text", events_text(folder), texts.provenance.get("events"))
    return f"{len(events_of(folder))} events"


def _ending(folder: Path, texts: Recording | None) -> str:
    ending = read_ending(folder)
    if ending is None:
        return ""
    if texts is not None:
        _compare(folder / ENDING, "provenance", ending.provenance, {name: texts.provenance.get(name) for name in ending.provenance})
    return ending.provenance.get("ended", "recovered")


def _compare(path: Path, name: str, here: object, recorded: object) -> None:
    """Raises BadInput where a file and `run.h5`, which was made of it and has a checksum, differ."""
    if json.dumps(here, sort_keys=True) != json.dumps(recorded, sort_keys=True):
        raise BadInput(f"{path}: its {name} is not what {RECORDING} was made of: it was edited since")


def _describe(file: Path) -> str:
    return summarize(file).text()


def _finding_of(name: str, look: Callable[[], str]) -> FileFinding:
    try:
        return FileFinding(name, look())
    except BadInput as error:
        return FileFinding(name, str(error), False)
