"""Checks a run on disk: every file by its hash, every stage by its counts."""

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from rfca_rig.errors import BadInput
from rfca_rig.recording.journal import block_size, read_blocks
from rfca_rig.recording.layout import (
    ENDING,
    EVENTS,
    HEADER,
    OVERLAYS,
    PHOTOS,
    RECORDING,
    STAGES,
    SUMS,
    journals,
    read_sums,
    refuse_links,
    sha256_of,
    stage_files,
)
from rfca_rig.recording.model import Recording
from rfca_rig.recording.run_text import (
    INTERRUPTED,
    Ending,
    ending_bytes,
    events_of,
    events_text,
    read_ending,
    read_header,
)
from rfca_rig.recording.store import RecordingSummary, add_up, read_texts, summarize
from rfca_rig.suggestions import not_there

# What `recover` makes again from the other files of a run.
REMADE = (RECORDING, SUMS)


@dataclass(frozen=True)
class FileFinding:
    """One file by its path in the run's folder, what was found, and whether it is as it should
    be.
    """

    file: str
    words: str
    is_sound: bool = True


def describe_damage(folder: Path, findings: Sequence[FileFinding]) -> str:
    """What is damaged and what helps, as check and recover say it, from all findings of a run."""
    damaged = [finding.file for finding in findings if not finding.is_sound]
    # A recording alone has no stages beside it to be made of.
    lost = [name for name in damaged if name not in REMADE or not is_run_folder(folder)]
    made = [name for name in damaged if name in REMADE]
    what = f"{folder}: damaged: {', '.join(damaged)}"
    if not lost:
        return (
            f"{what}; rfca-rig recover {folder} makes {_them(made)} again from the files of "
            "the stages"
        )
    restore = f"restore {', '.join(lost)} from a copy: recover cannot make {_them(lost)} again"
    if can_recover(folder, findings):
        return (
            f"{what}; {restore}; rfca-rig recover {folder} makes the rest whole without "
            f"{_them(lost)}"
        )
    return f"{what}; {restore}"


def _them(names: Sequence[str]) -> str:
    if len(names) == 1:
        return "it"
    return "them"


def can_recover(folder: Path, findings: Sequence[FileFinding]) -> bool:
    """Whether recover has something to do, and may do it: damaged files of other kinds must not get
    new checksums.

    A stage or photo that is gone does not prevent recovery of the others.
    """
    unsound = [finding for finding in findings if not finding.is_sound]
    lost = [finding for finding in unsound if finding.file not in REMADE]
    if not lost:
        return not needs_no_recovery(folder, findings)
    has_work = len(lost) < len(unsound) or not all((folder / name).is_file() for name in REMADE)
    return has_work and all(
        "/" in finding.file and not (folder / finding.file).is_file() for finding in lost
    )


def is_run_folder(folder: Path) -> bool:
    """Whether a run wrote the folder, by any of its files: also one that has lost its header."""
    return any((folder / name).exists() for name in (HEADER, EVENTS, STAGES))


def needs_no_recovery(folder: Path, findings: Iterable[FileFinding]) -> bool:
    """Whether nothing needs recovery: no stage is unfinished, `run.h5` exists, and every file is
    as it was written.
    """
    has_all = all((folder / name).is_file() for name in (ENDING, RECORDING, SUMS))
    # An end that is damaged is a finding that is not sound.
    return (
        has_all
        and not journals(folder)
        and all(finding.is_sound for finding in findings)
        and _is_closed(_read_whole_ending(folder)) is not False
    )


def check_run(folder: Path) -> Iterator[FileFinding]:
    """A finding per file, in the order in which a run writes them. Raises BadInput where
    `folder` holds no run, or files of others.
    """
    refuse_links(folder)
    if not is_run_folder(folder):
        yield from _check_older_run(folder)
        return
    sums = _Sums(folder)
    recorded = _Recorded(folder)
    texts = recorded.texts
    yield sums.finding(HEADER, partial(_title, folder, texts))
    if _is_unbegun(folder):
        words = "is not there: nothing was recorded before the run ended, or it begins right now"
        yield FileFinding(EVENTS, f"{words}; rfca-rig resume {folder} does its whole plan")
        return
    # Damaged events are reported once; the stages are then checked without them.
    events = sums.finding(EVENTS, partial(_events, folder, texts))
    yield events
    stages = _Stages(folder)
    happened = []
    if events.is_sound:
        happened = events_of(folder)
    yield from stages.check(sums, happened)
    yield from (_check_journal(folder, journal) for journal in journals(folder))
    has_ending = (folder / ENDING).is_file()
    has_recording = (folder / RECORDING).is_file()
    ending = _read_whole_ending(folder)
    closed = _is_closed(ending)
    if has_ending or ENDING in sums or _has_ended(folder, texts):
        yield sums.finding_of_end(ending, partial(_ending, folder, texts))
    elif not has_recording and not journals(folder):
        missing = _describe_missing_end(happened)
        yield FileFinding(ENDING, f"{missing} type rfca-rig recover {folder}")
    if has_recording or RECORDING in sums or closed:
        yield sums.finding(RECORDING, partial(recorded.like, stages))
    elif has_ending:
        yield FileFinding(RECORDING, f"is not made yet; type rfca-rig recover {folder}")
    # Versions that do not say whether a run was closed made the checksums right after `run.h5`.
    yield from sums.rest(is_finished=has_recording if closed is None else closed)
    yield from _check_photos(folder, ending, sums)
    if closed is False and has_recording:
        yield FileFinding(
            SUMS, f"the run was cut off while it was closed; type rfca-rig recover {folder}"
        )


def _describe_missing_end(happened: Iterable[Mapping[str, object]]) -> str:
    if any(event.get("event") == "run ends" for event in happened):
        return (
            "is not there, though the run ended: it was cut off while it was closed, or "
            f"{ENDING} was removed;"
        )
    return "is not there: the run goes on, or was not finished; then"


def _check_photos(folder: Path, ending: Ending | None, sums: "_Sums") -> Iterator[FileFinding]:
    """Photos that the run's end names, where neither they nor their hashes are there."""
    if ending is None or ending.static is None:
        return
    for stage in ending.static:
        for name in filter(None, (stage.photo, stage.overlay)):
            if not (folder / name).is_file() and not sums.has_listed(name):
                yield FileFinding(name, "is missing", False)


def _check_older_run(folder: Path) -> Iterator[FileFinding]:
    """A run of an older version is one recording, or parts of one."""
    files = sorted((*folder.glob("*.h5"), *folder.glob("*.h5.partial/*.h5")))
    if not files and folder.exists():
        raise BadInput(f"{folder}: holds no run; rfca-rig runs lists those there are")
    if not files:
        raise BadInput(not_there(folder))
    for file in files:
        yield _finding_of(file.relative_to(folder).as_posix(), partial(_describe, file))


def _is_unbegun(folder: Path) -> bool:
    """Whether a run has no more than its header. Its recorder makes the file of events first, so
    none has been lost.
    """
    made = (EVENTS, ENDING, RECORDING, SUMS, PHOTOS, OVERLAYS)
    return (
        not any((folder / name).exists() for name in made)
        and not stage_files(folder)
        and not journals(folder)
    )


def _read_whole_ending(folder: Path) -> Ending | None:
    """The run's end; None where it is damaged or missing, which is a finding of its own."""
    try:
        return read_ending(folder)
    except BadInput:
        return None


def _is_closed(ending: Ending | None) -> bool | None:
    """Whether the run's end says that the run was closed; None where it says nothing."""
    if ending is None:
        return None
    return ending.is_closed


class _Sums:
    """The hashes from the run's end, each used once; a run that has not ended has none."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._damage: FileFinding | None = None
        try:
            self._sums = read_sums(folder)
        except BadInput as error:
            self._sums = {}
            self._damage = FileFinding(SUMS, str(error), False)
        self._is_summed_up = bool(self._sums)
        self._listed = set(self._sums)
        self._unlisted: list[str] = []

    def __contains__(self, name: str) -> bool:
        return name in self._sums

    def has_listed(self, name: str) -> bool:
        """Whether the file had a line, and so a finding."""
        return name in self._listed

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

    def finding_of_end(self, ending: Ending | None, look: Callable[[], str]) -> FileFinding:
        """Of the run's end, which is written once more after the checksums: a crash between the
        two is no damage.
        """
        if ending is not None and ending.is_closed is False:
            closed = hashlib.sha256(ending_bytes(replace(ending, is_closed=True))).hexdigest()
            if self._sums.get(ENDING) == closed:
                # The hash of what it would have become shows that nothing else in it was changed.
                self._sums[ENDING] = sha256_of(self._folder / ENDING)
        return self.finding(ENDING, look)

    def rest(self, is_finished: bool) -> Iterator[FileFinding]:
        """Files with a hash that nothing else checks, for example photos. A finished run has
        hashes.
        """
        if self._damage:
            yield self._damage
        elif is_finished and not self._is_summed_up:
            yield FileFinding(SUMS, "is missing or empty, though the run was finished", False)
        # A copy, because `finding` takes names out of the dictionary.
        for name in list(self._sums):
            yield self.finding(name, lambda: "as it was written")
        pictures = (
            f"{subfolder}/{file.name}"
            for subfolder in (PHOTOS, OVERLAYS)
            for file in sorted((self._folder / subfolder).glob("*.*"))
        )
        if self._is_summed_up:
            self._unlisted += [
                name
                for name in pictures
                if name not in self._listed and name.endswith((".png", ".jpg"))
            ]
        if self._unlisted:
            yield FileFinding(SUMS, f"has no line for {', '.join(self._unlisted)}", False)


class _Stages:
    """The files of a run's stages, each read once."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._summaries: dict[str, RecordingSummary] = {}
        self._has_damage = False

    def check(self, sums: _Sums, events: Sequence[Mapping[str, Any]]) -> Iterator[FileFinding]:
        """The stages that the events name, and other stage files that exist."""
        events_by_file = {event["file"]: event for event in events if "file" in event}
        on_disk = {f"{STAGES}/{file.name}" for file in stage_files(self._folder)}
        for name in sorted(on_disk | set(events_by_file)):
            finding = sums.finding(name, partial(self._as_recorded, name, events_by_file.get(name)))
            self._has_damage |= not finding.is_sound
            yield finding

    def _as_recorded(self, name: str, event: Mapping[str, Any] | None) -> str:
        path = self._folder / name
        stage = summarize(path)
        # The counts come first: they say how much is wrong, a hash only that something is.
        if event is not None and event["samples"] != stage.samples:
            raise BadInput(
                f"{path}: holds {dict(stage.samples)} samples, where {event['samples']} "
                "were recorded"
            )
        if event is not None and event["sha256"] != sha256_of(path):
            raise BadInput(f"{path}: is not what was recorded: its SHA-256 is another")
        self._summaries[name] = stage
        lost = "".join(f", {missing} records missing on the way" for missing in stage.missing)
        return f"{stage.text()}{lost}"

    def summary(self) -> RecordingSummary | None:
        """All stages together, after `check`; None where some are damaged."""
        if self._has_damage:
            return None
        stages = add_up(self._summaries.values())
        ending = read_ending(self._folder)
        if ending is None or ending.static is None:
            return stages
        return replace(stages, static=len(ending.static))


def _check_journal(folder: Path, journal: Path) -> FileFinding:
    sizes = [block_size(block) for block in read_blocks(journal)]
    behind = journal.stat().st_size - sum(sizes)
    words = (
        f"a stage in progress, {len(sizes)} whole blocks; {behind} bytes behind them; type "
        f"rfca-rig recover {folder}"
    )
    return FileFinding(f"{STAGES}/{journal.name}", words)


class _Recorded:
    """What `run.h5` holds. Its checksum, which takes as long as all the rest, is compared once."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / RECORDING
        self._damage: BadInput | None = None
        # Its texts, of which the other files are copies; None where it is missing or damaged
        # itself.
        self.texts: Recording | None = None
        try:
            self.texts = read_texts(self._path)
        except BadInput as error:
            self._damage = error

    def like(self, stages: _Stages) -> str:
        """What it holds. Raises BadInput where it is damaged, or holds other than its stages."""
        if self._damage is not None:
            raise self._damage
        summary = summarize(self._path, has_right_seal=True).text()
        try:
            expected = stages.summary()
        except BadInput:
            expected = None
        if expected is None:
            return f"{summary}; not compared with its stages, of which some are damaged"
        if summary != expected.text():
            raise BadInput(f"{self._path}: holds {summary}, its stages {expected.text()}")
        return summary


def _title(folder: Path, texts: Recording | None) -> str:
    header = read_header(folder)
    if texts is not None:
        for name in ("title", "source", "nominal", "known_to"):
            _compare(folder / HEADER, name, getattr(header, name), getattr(texts, name))
        # What the end says takes the place of what the header states, such as the devices'
        # counters.
        of_ending = _provenance_of_ending(folder)
        first = {name: text for name, text in header.provenance.items() if name not in of_ending}
        _compare(
            folder / HEADER,
            "provenance",
            first,
            {name: texts.provenance.get(name) for name in first},
        )
    title = f"{header.source} {header.title}"
    if header.is_listening:
        title += ", recorded without motion"
    return title


def _provenance_of_ending(folder: Path) -> Mapping[str, str]:
    """Nothing where the end is missing or damaged, which is a finding of its own."""
    try:
        ending = read_ending(folder)
    except BadInput:
        return {}
    if ending is None:
        return {}
    return ending.provenance


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
        _compare(
            folder / ENDING,
            "provenance",
            ending.provenance,
            {name: texts.provenance.get(name) for name in ending.provenance},
        )
    return ending.provenance.get("ended", "recovered")


def _compare(path: Path, name: str, content: object, recorded: object) -> None:
    """Raises BadInput where a file and `run.h5`, which was made of it and has a checksum,
    differ.
    """
    if json.dumps(content, sort_keys=True) != json.dumps(recorded, sort_keys=True):
        raise BadInput(
            f"{path}: its {name} is not what {RECORDING} was made of: it was edited since"
        )


def _describe(file: Path) -> str:
    words = summarize(file).text()
    read_texts(file, has_right_seal=True)
    return words


def _finding_of(name: str, look: Callable[[], str]) -> FileFinding:
    try:
        return FileFinding(name, look())
    except BadInput as error:
        return FileFinding(name, str(error), False)
