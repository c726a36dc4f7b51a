"""A recording that grows while the rig runs, and that a crash cannot take back.

Until the run is finished it is a folder `run.h5.partial` with one small file per stroke or stage, each written, forced to disk
and renamed before the next begins. A single HDF5 file that is flushed after each stroke would be lost whole when the process
dies inside a flush, which is where it spends its time; separate files lose only what was not yet handed over.
"""

import dataclasses
from collections.abc import Mapping
from pathlib import Path

from rfca_rig.errors import BadInput
from rfca_rig.recording.atomic import sync_folder
from rfca_rig.recording.form import Recording, StaticStage, Stroke
from rfca_rig.recording.store import read_recording, write_recording

PARTIAL = ".partial"
INTERRUPTED = "interrupted"


class RunFile:
    """Writes a recording piece by piece; what `add_stroke` and `add_static_stage` have returned from is safe on disk."""

    def __init__(self, path: Path, header: Recording) -> None:
        """Use `create`."""
        self._path = path
        self._bare = dataclasses.replace(header, believed={}, known_to={}, strokes=(), static=(), provenance={})
        self._parts = 0

    @classmethod
    def create(cls, path: Path, header: Recording) -> "RunFile":
        """Begins the recording that will be `path`, in a folder beside it named `path` + ".partial".

        `header` gives title, source, believed, known_to and provenance; strokes and stages that it holds come first. Raises
        BadInput where `path` or its partial folder is there already: recordings are never written over.
        """
        partial = partial_of(path)
        for there in (path, partial):
            if there.exists():
                raise BadInput(f"{there}: is there already; recordings are never written over, choose another place")
        try:
            partial.mkdir(parents=True)
            sync_folder(partial.parent)
        except OSError as error:
            raise BadInput(f"{partial}: cannot be made: {error.strerror}") from None
        run = cls(path, header)
        run._add(header)
        return run

    def add_stroke(self, stroke: Stroke) -> None:
        """Returns when the stroke is on disk. Raises RigError when the disk refuses; what was added before stays."""
        self._add(dataclasses.replace(self._bare, strokes=(stroke,)))

    def add_static_stage(self, stage: StaticStage) -> None:
        """Returns when the stage is on disk. Raises RigError when the disk refuses; what was added before stays."""
        self._add(dataclasses.replace(self._bare, static=(stage,)))

    def finish(self, provenance: Mapping[str, str] | None = None) -> Path:
        """Puts the parts together into `path` and takes the partial folder away. Returns `path`.

        `provenance` adds what only the end of a run knows: how it ended, when, counters.
        """
        whole = _merged(self._path)
        return _replace_partial(self._path, dataclasses.replace(whole, provenance={**whole.provenance, **(provenance or {})}))

    def discard(self) -> None:
        """Takes everything away again; for a run that ended before it recorded anything."""
        _remove(partial_of(self._path))

    def _add(self, part: Recording) -> None:
        write_recording(part, partial_of(self._path) / f"{self._parts:05d}.h5")
        self._parts += 1


def partial_of(path: Path) -> Path:
    """The folder that holds the recording while it is not finished."""
    return path.with_name(path.name + PARTIAL)


def read_partial(path: Path) -> Recording:
    """What was recorded of a run that never finished; its provenance says so. `path` is where the finished file would be."""
    found = _merged(path)
    said = f"the run ended without being finished, after {len(found.strokes)} strokes and {len(found.static)} static stages"
    return dataclasses.replace(found, provenance={**found.provenance, INTERRUPTED: said})


def recover(path: Path) -> Path:
    """Makes `path` from its partial folder after a crash, with everything that had been added. Returns `path`.

    Where the crash came when `path` was whole already, only the leftovers go: a recording is never written over. Not for a run that
    is still going on. Raises BadInput where there is nothing to recover.
    """
    if not partial_of(path).is_dir():
        raise BadInput(f"{path}: {'is whole' if path.is_file() else 'is not there'}, and there is no interrupted run beside it to recover")
    if path.is_file():
        read_recording(path)
        _remove(partial_of(path))
        return path
    return _replace_partial(path, read_partial(path))


def _merged(path: Path) -> Recording:
    """The parts in their order as one recording; a half-written last one bears another ending and is passed over."""
    parts = [read_recording(part) for part in sorted(partial_of(path).glob("*.h5"))]
    if not parts:
        raise BadInput(f"{partial_of(path)}: holds no recording; the run was interrupted before it began")
    strokes = tuple(stroke for part in parts for stroke in part.strokes)
    static = tuple(stage for part in parts for stage in part.static)
    return dataclasses.replace(parts[0], strokes=strokes, static=static)


def _replace_partial(path: Path, whole: Recording) -> Path:
    write_recording(whole, path)
    _remove(partial_of(path))
    return path


def _remove(partial: Path) -> None:
    for file in partial.iterdir():
        file.unlink()
    partial.rmdir()
