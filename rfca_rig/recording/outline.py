"""What a recording in one file is of, without its samples."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import h5py

from rfca_rig.recording.cycle_table import CYCLES, NUMBER
from rfca_rig.recording.raw_stages import GROUP as RAW
from rfca_rig.recording.static_table import read_static
from rfca_rig.recording.store import opened
from rfca_rig.recording.strokes import GROUP as STROKES


@dataclass(frozen=True)
class Outline:
    """`strokes` are (height in mm, speed in rad/s) of each, `static_heights_mm` that of each stage."""

    title: str
    source: str
    provenance: Mapping[str, str]
    strokes: tuple[tuple[float, float], ...]
    static_heights_mm: tuple[float, ...]
    cycles: int


def outline_of(path: Path) -> Outline:
    """Raises BadInput for a file that is damaged or of another kind."""
    with opened(path) as (file, source):
        return Outline(
            title=str(file.attrs["title"]),
            source=source,
            provenance=json.loads(file["provenance"][()]),
            strokes=tuple(
                (float(stroke.attrs["height_mm"]), float(stroke.attrs["speed_rad_s"]))
                for stroke in (file[STROKES][number] for number in sorted(file[STROKES], key=int))
            ),
            static_heights_mm=tuple(round(1e3 * stage.height_m, 6) for stage in read_static(file)),
            cycles=_cycles(file),
        )


def _cycles(file: h5py.File) -> int:
    return sum(len(stage[CYCLES][NUMBER]) for stage in file.get(RAW, {}).values() if CYCLES in stage)
