"""Recordings of the static experiment with the folders that hold their photos."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rfca_rig.recording.model import Recording


@dataclass(frozen=True)
class StaticSource:
    """One recording of static stages; paths of its photos are relative to `folder`."""

    name: str
    folder: Path
    recording: Recording


def static_sources(paths: Sequence[Path], recordings: Sequence[Recording]) -> tuple[StaticSource, ...]:
    """One source for each recording, read at the path of the same place; equal titles are numbered in their order."""
    titles = [recording.title for recording in recordings]
    names = [f"{title} ({titles[: i + 1].count(title)})" if titles.count(title) > 1 else title for i, title in enumerate(titles)]
    folders = [path if path.is_dir() else path.parent for path in paths]
    return tuple(StaticSource(*each) for each in zip(names, folders, recordings, strict=True))
