"""`run.h5`: all stages of a run in one file, copied from theirs bit by bit, with as little memory for hours as for seconds."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import h5py

from rfca_rig.progress import Watcher, counted, unwatched
from rfca_rig.recording.cooperative import Steps
from rfca_rig.recording.hdf5_file import FileBeingMade, being_made
from rfca_rig.recording.layout import RECORDING, stage_files
from rfca_rig.recording.model import Recording, Source, StaticStage
from rfca_rig.recording.raw_stages import GROUP as RAW
from rfca_rig.recording.raw_stages import make_raw_stages
from rfca_rig.recording.run_text import Ending, read_ending, read_header, run_provenance
from rfca_rig.recording.static_table import read_static, write_static
from rfca_rig.recording.store import mark_recording, opened
from rfca_rig.recording.strokes import GROUP as STROKES
from rfca_rig.recording.strokes import copy_streams, make_strokes


def write_run(folder: Path, told: Watcher = unwatched) -> Steps[Path]:
    """Comes to the path of `run.h5`. Raises BadInput, naming the file, where a stage is damaged; RigError, DiskFull."""
    header, ending = read_header(folder), read_ending(folder)
    with being_made(folder / RECORDING) as made:
        static = yield from _copy_stages(made, counted(stage_files(folder), told), header.source)
        _finish(made, folder, replace(header, static=static), ending)
        yield from made.put_in_place()
    return folder / RECORDING


def _copy_stages(made: FileBeingMade, files: Iterable[Path], source: Source) -> Steps[tuple[StaticStage, ...]]:
    """Strokes and raw stages into groups of their own, numbered anew; comes to the static stages, which are one table."""
    make_strokes(made.root)
    static: list[StaticStage] = []
    for path in files:
        with opened(path) as (stage, _):
            static += read_static(stage)
            for kind in (STROKES, RAW):
                for number in sorted(stage.get(kind, ()), key=int):
                    yield from _copy_stage(stage[kind][number], _place(made.root, kind), source)
        made.check()
    return tuple(static)


def _place(root: h5py.Group, kind: str) -> h5py.Group:
    """The next numbered group of its kind."""
    parent = root[kind] if kind in root else make_raw_stages(root)
    return parent.create_group(f"{len(parent) + 1:03d}")


def _copy_stage(stage: h5py.Group, target: h5py.Group, source: Source) -> Steps[None]:
    for name, value in stage.attrs.items():
        target.attrs[name] = value
    yield from copy_streams(stage, target, source)


def _finish(made: FileBeingMade, folder: Path, known: Recording, ending: Ending | None) -> None:
    strokes, static = len(made.root[STROKES]), known.static
    provenance = run_provenance(folder, known, ending, strokes)
    mark_recording(made.root, replace(known, provenance=provenance), has_strokes=bool(strokes or RAW not in made.root))
    write_static(made.root, static if ending is None or ending.static is None else ending.static)
