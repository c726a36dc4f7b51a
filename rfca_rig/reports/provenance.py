"""Provenance at the foot of every page: the command that makes it again, the recordings with their
hashes, the version.

The hash identifies a recording, whatever its form on disk.
"""

import hashlib
import shlex
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path, PurePath

from rfca_rig import __version__
from rfca_rig.bench.provenance import NOT_A_CHECKOUT, UNKNOWN, source_state
from rfca_rig.campaign.pendulum import FILE_NAME as PENDULUM
from rfca_rig.clock import TwinClock
from rfca_rig.description.sections import AboutSection
from rfca_rig.recording.layout import (
    CAMPAIGN,
    ENDING,
    EXPERIMENT,
    HEADER,
    RECORDING,
    list_described_files,
    sha256_of,
    stage_files,
    sum_line,
)
from rfca_rig.recording.model import Recording

PROGRAM = "rfca-rig"
NOT_STATED = "Not stated"
SIMULATED_TIME = "simulated time, which has no date"
# Different dates, operators ... of several recordings that the head of a page lists.
MOST_FACTS = 3
# Pages on the same recordings: words of a link, usual folder, and the command that makes one.
PAGES = {
    "report.html": ("Compared with the model", "report", "report"),
    "run.html": ("How the run went", "report", ""),
    "diagnosis.html": ("Diagnosis", "diagnosis", "diagnose"),
}


@dataclass(frozen=True)
class Fingerprint:
    """SHA-256 of `of`: of one file, or, for several files, of the lines of sha256sum for them,
    ordered by name.
    """

    of: str
    sha256: str


def fingerprint(path: Path) -> Fingerprint:
    """Fingerprint of what `open_recordings` opens at `path`. Raises OSError."""
    if path.is_file():
        return Fingerprint(path.name, sha256_of(path))
    if (path / RECORDING).is_file():
        return Fingerprint(RECORDING, sha256_of(path / RECORDING))
    files = _files(path)
    # Text in the format of sha256sum: the fingerprint can be verified without this program.
    lines = "".join(f"{sum_line(file, path)}\n" for file in files)
    return Fingerprint(
        f"the lines of sha256sum for {len(files)} files", hashlib.sha256(lines.encode()).hexdigest()
    )


def _files(folder: Path) -> list[Path]:
    """For a campaign its description and tables; for an unmerged run its header, its stages and
    its end.
    """
    if any((folder / name).is_file() for name in (CAMPAIGN, PENDULUM, EXPERIMENT)):
        return list_described_files(folder)
    named = [file for file in (folder / HEADER, folder / ENDING) if file.is_file()]
    return sorted([*named, *stage_files(folder), *folder.glob(f"{RECORDING}.partial/*.h5")])


# Attributes of an origin's recordings, by their names at the head of a page.
RECORDING_FACTS = {"Date": "date", "Operator": "operator", "Specimen": "specimen", "Rig": "rig"}


@dataclass(frozen=True)
class Origin:
    """Origin of a page.

    `command` is the command line, "" where no command made the page. `again` states what it
    reproduces, by default the same bytes. `paths` are those of the recordings, as they were typed.
    """

    command: str = ""
    recordings: tuple["RecordingSource", ...] = ()
    version: str = __version__
    again: str = "to the same bytes"
    paths: tuple[Path, ...] = ()

    @property
    def facts(self) -> list[tuple[str, str]]:
        """What the head of every page states: when, who, on which specimen and rig, and the
        version. Several recordings are joined.
        """
        facts = []
        absent = []
        for name, field in RECORDING_FACTS.items():
            values = dict.fromkeys(getattr(recording, field) for recording in self.recordings)
            text = ", ".join(filter(None, list(values)[:MOST_FACTS]))
            if len(values) > MOST_FACTS and text:
                text += " ..."
            if text:
                facts.append((name, text))
            else:
                absent.append(name.lower())
        if absent and self.recordings:
            facts.append((NOT_STATED, ", ".join(absent)))
        return [*facts, ("Version", f"rfca-rig {self.version}")]


@dataclass(frozen=True)
class RecordingSource:
    """One recording: SIM, REAL or IMPORT (`mark`), where it was read, and a hash; `hashed` names
    the files that the hash covers.

    `date`, `operator`, `specimen` and `rig` are as recorded, "" where not stated.
    """

    mark: str
    title: str
    path: str = ""
    hashed: str = ""
    sha256: str = ""
    date: str = ""
    operator: str = ""
    specimen: str = ""
    rig: str = ""


@dataclass(frozen=True)
class PageLink:
    """Link to a page at a relative path; where there is none yet, `file` is "" and `command`
    makes it.
    """

    file: str
    words: str
    command: str = ""


@dataclass(frozen=True)
class PageContext:
    """Origin of a page, the pages beside it, and the model.

    `model_file` names the model that all recordings were compared with; None where each was
    compared with its own nominal model.
    """

    origin: Origin
    links: tuple[PageLink, ...] = ()
    model_file: str | None = None


def command_line(*words: str | PurePath, options: Mapping[str, object] | None = None) -> str:
    """The command line: `words` first, then `options` that are not None or False; True stands for a
    bare option.

    Only the last part of an absolute path is shown: pages are passed on, and need not show the
    folders of their author.
    """
    given = [_argument(word) for word in words]
    for name, value in (options or {}).items():
        if value is None or value is False:
            continue
        given.append(name)
        if value is not True:
            given.append(_argument(value))
    return shlex.join([PROGRAM, *given])


def _argument(value: object) -> str:
    if isinstance(value, PurePath):
        return path_text(value)
    return f"{value}"


def path_text(path: PurePath) -> str:
    """A path as a page shows it: only the last part of an absolute one."""
    if path.is_absolute():
        return path.name
    return path.as_posix()


def origin_of(command: str, paths: Sequence[Path], recordings: Sequence[Recording]) -> Origin:
    """Origin of a page about recordings.

    Parameters
    ----------
    command
        The command line, from `command_line`.
    paths
        Where the first recordings were read.
    recordings
        All recordings; those beyond `paths` were made by the command itself, and have no path.

    Raises
    ------
    OSError
        Where a recording cannot be read for its hash.
    """
    sources = tuple(
        recording_source(recording, path)
        for path, recording in zip(paths, recordings, strict=False)
    )
    later = tuple(recording_source(recording) for recording in recordings[len(paths) :])
    return Origin(command, (*sources, *later), version_text(), paths=tuple(paths))


def origin_of_import(command: str, path: Path, title: str, about: AboutSection) -> Origin:
    """Origin of a page about imported data, read at `path`. Raises OSError."""
    return Origin(
        command,
        (_with_hash(RecordingSource("IMPORT", title, **about.model_dump()), path),),
        version_text(),
    )


def origin_in_memory(recordings: Sequence[Recording]) -> Origin:
    """Origin of a page about recordings in memory, which have neither path nor hash."""
    return Origin("", tuple(recording_source(recording) for recording in recordings))


def version_text() -> str:
    """Version of the program, with the git revision where it runs from a checkout."""
    state = source_state()
    revision = state["git_revision"]
    if revision in (NOT_A_CHECKOUT, UNKNOWN):
        return __version__
    version = f"{__version__}, git {revision[:12]}"
    if state["git_dirty"] == "yes":
        return f"{version}, changed since"
    return version


def recording_source(recording: Recording, path: Path | None = None) -> RecordingSource:
    """What a recording states of itself, and where it was read. Raises OSError where it cannot
    be read for its hash.
    """
    known = recording.provenance
    source = RecordingSource(
        recording.source,
        recording.title,
        date=date_text(known.get("started_at", "")),
        operator=known.get("operator", ""),
        specimen=known.get("sample", ""),
        rig=known.get("rig", ""),
    )
    if path is None:
        return source
    return _with_hash(source, path)


def _with_hash(source: RecordingSource, path: Path) -> RecordingSource:
    known = fingerprint(path)
    return replace(source, path=path_text(path), hashed=known.of, sha256=known.sha256)


def date_text(started_at: str) -> str:
    """Date and time of an ISO 8601 text, to the minute, or a date alone; on the clock of
    simulated time, which has no date, that.
    """
    if started_at.startswith(f"{TwinClock().start_time():%Y-%m-%dT%H:%M}"):
        return SIMULATED_TIME
    try:
        if len(started_at) == len("2026-03-14"):
            return f"{datetime.fromisoformat(started_at):%Y-%m-%d}"
        return f"{datetime.fromisoformat(started_at):%Y-%m-%d %H:%M %Z}".strip()
    except ValueError:
        return started_at


def find_pages(out: Path, origin: Origin, own: Collection[str]) -> tuple[PageLink, ...]:
    """Links to pages on the same recordings: beside `out`, or in the usual folders next to it.
    Where there is none, the command for it.

    Parameters
    ----------
    out
        Folder of the new page.
    origin
        Origin of the new page; another one is on the same recordings if it holds one of their
        hashes.
    own
        File names that the same command writes.
    """
    hashes = [recording.sha256 for recording in origin.recordings if recording.sha256]
    paths = " ".join(
        shlex.quote(recording.path) for recording in origin.recordings if recording.path
    )
    links = []
    for name, (words, folder, command) in PAGES.items():
        candidates = [
            candidate
            for candidate in (out / name, out.parent / folder / name)
            if name not in own and candidate.is_file()
        ]
        page_file = _find_page_with_hash(candidates, hashes)
        if page_file is not None:
            address = f"../{folder}/{name}"
            if page_file.parent == out:
                address = page_file.name
            links.append(PageLink(address, words))
        elif (
            command
            and paths
            and not any(page in own for page in PAGES if PAGES[page][2] == command)
        ):
            links.append(PageLink("", words, f"{PROGRAM} {command} {paths}"))
    return tuple(links)


def _find_page_with_hash(pages: Sequence[Path], hashes: Sequence[str]) -> Path | None:
    for page in pages:
        if any(sha256 in page.read_text("utf-8") for sha256 in hashes):
            return page
    return None
