"""Provenance at the foot of every page: the command that makes it again, the recordings with their hashes, the version."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath

from rfca_rig import __version__
from rfca_rig.bench.provenance import NOT_A_CHECKOUT, UNKNOWN, source_state
from rfca_rig.campaign.fingerprint import fingerprint
from rfca_rig.recording.model import Recording

PROGRAM = "rfca-rig"


@dataclass(frozen=True)
class Origin:
    """Origin of a page.

    `command` is the command line, "" where no command made the page. `again` states what it reproduces, by default the same bytes.
    """

    command: str = ""
    recordings: tuple["RecordingSource", ...] = ()
    version: str = __version__
    again: str = "to the same bytes"


@dataclass(frozen=True)
class RecordingSource:
    """One recording: SIM, REAL or IMPORT (`mark`), where it was read, and a hash; `hashed` names the files that the hash covers."""

    mark: str
    title: str
    path: str = ""
    hashed: str = ""
    sha256: str = ""


@dataclass(frozen=True)
class PageLink:
    """Link to a page in the same folder."""

    file: str
    words: str


@dataclass(frozen=True)
class PageContext:
    """Origin of a page, the pages beside it, and the model.

    `model_file` names the model that all recordings were compared with; None where each was compared with its own nominal model.
    """

    origin: Origin
    links: tuple[PageLink, ...] = ()
    model_file: str | None = None


def command_line(*words: str | PurePath, options: Mapping[str, object] | None = None) -> str:
    """The command line: `words` first, then `options` that are not None or False; True stands for a bare option.

    Only the last part of an absolute path is shown: pages are passed on, and need not show the folders of their author.
    """
    given = [path_text(word) if isinstance(word, PurePath) else word for word in words]
    for name, value in (options or {}).items():
        if value is not None and value is not False:
            given += [name] if value is True else [name, path_text(value) if isinstance(value, PurePath) else f"{value}"]
    return shlex.join([PROGRAM, *given])


def path_text(path: PurePath) -> str:
    """A path as a page shows it: only the last part of an absolute one."""
    return path.name if path.is_absolute() else path.as_posix()


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
    found = tuple(_recording_source(path, recording.source, recording.title) for path, recording in zip(paths, recordings, strict=False))
    later = tuple(RecordingSource(recording.source, recording.title) for recording in recordings[len(paths) :])
    return Origin(command, (*found, *later), version_text())


def origin_of_import(command: str, path: Path, title: str) -> Origin:
    """Origin of a page about imported data, read at `path`. Raises OSError."""
    return Origin(command, (_recording_source(path, "IMPORT", title),), version_text())


def origin_in_memory(recordings: Sequence[Recording]) -> Origin:
    """Origin of a page about recordings in memory, which have neither path nor hash."""
    return Origin("", tuple(RecordingSource(recording.source, recording.title) for recording in recordings))


def version_text() -> str:
    """Version of the program, with the git revision where it runs from a checkout."""
    state = source_state()
    revision = state["git_revision"]
    if revision in (NOT_A_CHECKOUT, UNKNOWN):
        return __version__
    return f"{__version__}, git {revision[:12]}{', changed since' if state['git_dirty'] == 'yes' else ''}"


def _recording_source(path: Path, mark: str, title: str) -> RecordingSource:
    known = fingerprint(path)
    return RecordingSource(mark, title, path_text(path), known.of, known.sha256)
