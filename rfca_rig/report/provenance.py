"""What stands at the end of every page: the command that makes it again, the recordings with their hashes, the version."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath

from rfca_rig import __version__
from rfca_rig.bench.checkout import NOT_A_CHECKOUT, UNKNOWN, source_state
from rfca_rig.campaign.fingerprint import fingerprint
from rfca_rig.recording.model import Recording

PROGRAM = "rfca-rig"


@dataclass(frozen=True)
class Origin:
    """`command` as it is to be typed, "" where no command made the page; `again` says what of the page it brings."""

    command: str = ""
    recordings: tuple["RecordingSource", ...] = ()
    version: str = __version__
    again: str = "to the same bytes"


@dataclass(frozen=True)
class RecordingSource:
    """One recording: SIM, REAL or IMPORT, where it was found, and a hash of what it is made of."""

    mark: str
    title: str
    path: str = ""
    hashed: str = ""
    sha256: str = ""


@dataclass(frozen=True)
class PageLink:
    """A page that stands beside this one."""

    file: str
    words: str


@dataclass(frozen=True)
class Told:
    """What a page says of itself, and which stand beside it.

    `model_file` names the one model that all was held against; None for what was believed of each.
    """

    origin: Origin
    links: tuple[PageLink, ...] = ()
    model_file: str | None = None


def typed(*words: str | PurePath, options: Mapping[str, object] | None = None) -> str:
    """The command line: `words` first, then those `options` that are not None or False; True stands for a bare option.

    Of an absolute path only the last part is told: a page is sent on, and need not say where its maker keeps things.
    """
    given = [shown_path(word) if isinstance(word, PurePath) else word for word in words]
    for name, value in (options or {}).items():
        if value is not None and value is not False:
            given += [name] if value is True else [name, shown_path(value) if isinstance(value, PurePath) else f"{value}"]
    return shlex.join([PROGRAM, *given])


def shown_path(path: PurePath) -> str:
    return path.name if path.is_absolute() else path.as_posix()


def origin_of(command: str, paths: Sequence[Path], recordings: Sequence[Recording]) -> Origin:
    """Of a page about the recordings that were found at the paths, and of more that were recorded meanwhile. Raises OSError."""
    found = tuple(_recorded(path, recording.source, recording.title) for path, recording in zip(paths, recordings, strict=False))
    later = tuple(RecordingSource(recording.source, recording.title) for recording in recordings[len(paths) :])
    return Origin(command, (*found, *later), version_text())


def imported(command: str, path: Path, title: str) -> Origin:
    """Of a page about data of another kind, which came from elsewhere. Raises OSError."""
    return Origin(command, (_recorded(path, "IMPORT", title),), version_text())


def untold(recordings: Sequence[Recording]) -> Origin:
    """Of recordings that were not read from anywhere."""
    return Origin("", tuple(RecordingSource(recording.source, recording.title) for recording in recordings))


def version_text() -> str:
    """With the state of the source where this program runs from a checkout."""
    state = source_state()
    revision = state["git_revision"]
    if revision in (NOT_A_CHECKOUT, UNKNOWN):
        return __version__
    return f"{__version__}, git {revision[:12]}{', changed since' if state['git_dirty'] == 'yes' else ''}"


def _recorded(path: Path, mark: str, title: str) -> RecordingSource:
    known = fingerprint(path)
    return RecordingSource(mark, title, shown_path(path), known.of, known.sha256)
