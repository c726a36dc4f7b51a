"""Recordings of the static experiment with the folders that hold their photos."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rfca_rig.recording.model import Recording


@dataclass(frozen=True)
class StaticSource:
    """`folder` is what paths of photos count from."""

    name: str
    folder: Path
    recording: Recording


def static_sources(paths: Sequence[Path], recordings: Sequence[Recording]) -> tuple[StaticSource, ...]:
    """One for each recording; equal titles are numbered in their order."""
    titles = [recording.title for recording in recordings]
    names = [f"{title} ({titles[: i + 1].count(title)})" if titles.count(title) > 1 else title for i, title in enumerate(titles)]
    folders = [path if path.is_dir() else path.parent for path in paths]
    return tuple(StaticSource(*each) for each in zip(names, folders, recordings, strict=True))
