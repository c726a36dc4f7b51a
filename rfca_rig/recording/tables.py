"""The static experiment as an HDF5 group of columns, one row per settled stage, and the table of a
fatigue run's cycles.

The cycles are stored block by block like every other stage, a row of numbers each.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import h5py
import numpy as np
from numpy.typing import NDArray

from rfca_rig.recording.columns import (
    DEVICE_TIME,
    HOST_TIME,
    ColumnForm,
    Rows,
    StreamForm,
    read_column,
    read_names,
    write_column,
)
from rfca_rig.recording.model import Column, Direction, Floats, Recording, StaticStage
from rfca_rig.recording.strokes import BEFORE, height_mm

STATIC = "static"
DIRECTION_BYTES = 16
# Value of `strokes_before` where strokes were not counted; older files have neither this column nor
# `held_s`.
NOT_COUNTED = -1

_SETTLED = {None: -1, False: 0, True: 1}
# UTF-8; files from before there were cameras have none.
_TEXTS = ("photo", "overlay", "photo_doubts")
_PLAIN = {"shaft_angle_rad": "rad", "fy_N": "N", "fz_N": "N", "tx_Nm": "N m"}

CYCLES = "cycles"
NUMBER = "cycle"

CYCLE_FORM = StreamForm(
    CYCLES,
    (
        ColumnForm(NUMBER, "<u4", ""),
        ColumnForm("peak_force_N", "<f4", "N"),
        ColumnForm("peak_moment_Nm", "<f4", "N m"),
        ColumnForm("min_fz_N", "<f4", "N"),
        ColumnForm("mean_speed_rad_s", "<f4", "rad/s"),
        ColumnForm(HOST_TIME, "<f8", "s"),
        ColumnForm(DEVICE_TIME, "<f8", "s"),
    ),
)
_DTYPE = CYCLE_FORM.dtype


def write_static(parent: h5py.Group, stages: Sequence[StaticStage]) -> None:
    """The group `static`; none where there are no stages. All stages must have the same number
    of hinges.
    """
    if not stages:
        return
    group = parent.create_group(STATIC)
    directions = np.array(
        [stage.direction.encode() for stage in stages], dtype=f"S{DIRECTION_BYTES}"
    )
    group.create_dataset("direction", data=directions, track_times=False)
    for name in _TEXTS:
        group.create_dataset(
            name,
            data=np.array([getattr(stage, name).encode() for stage in stages]),
            track_times=False,
        )
    for name, column in _columns(stages).items():
        write_column(group, name, column)
    group.attrs["hinges"] = len(stages[0].hinge_deg)
    group.attrs["std"] = json.dumps(_std_names(stages))


def _columns(stages: Sequence[StaticStage]) -> dict[str, Column]:
    hinges = np.array([stage.hinge_deg for stage in stages], dtype=np.float64).reshape(
        len(stages), -1
    )
    stds = np.array([stage.hinge_std_deg for stage in stages], dtype=np.float64).reshape(
        hinges.shape
    )
    reading_stds = np.array(
        [stage.hinge_reading_std_deg for stage in stages], dtype=np.float64
    ).reshape(hinges.shape)
    columns = {
        "height_mm": _floats([height_mm(stage.height_m) for stage in stages], "mm"),
        "stage": Column(np.array([stage.stage for stage in stages], dtype=np.int64), ""),
    }
    for name, unit in _PLAIN.items():
        columns[name] = _floats([getattr(stage, name) for stage in stages], unit)
    for name, angles in zip(_hinge_names(hinges.shape[1]), hinges.T, strict=True):
        columns[name] = _floats(angles, "deg")
    for name, hinge_stds in zip(_hinge_std_names(hinges.shape[1]), stds.T, strict=True):
        columns[name] = _floats(hinge_stds, "deg")
    reading_names = _hinge_reading_std_names(hinges.shape[1])
    for name, hinge_stds in zip(reading_names, reading_stds.T, strict=True):
        columns[name] = _floats(hinge_stds, "deg")
    for name in _std_names(stages):
        columns[f"std_{name}"] = _floats([stage.std.get(name, math.nan) for stage in stages], "")
    settled = np.array([_SETTLED[stage.settled] for stage in stages], dtype=np.int8)
    columns["settled"] = Column(settled, "")
    held_s = [math.nan if stage.held_s is None else stage.held_s for stage in stages]
    columns["held_s"] = _floats(held_s, "s")
    strokes_before = [
        NOT_COUNTED if stage.strokes_before is None else stage.strokes_before for stage in stages
    ]
    columns[BEFORE] = Column(np.array(strokes_before, dtype=np.int64), "")
    return columns


def _floats(values: Any, unit: str) -> Column:
    return Column(np.array(values, dtype=np.float64), unit)


def _hinge_names(hinges: int) -> list[str]:
    return [f"hinge{i}_deg" for i in range(2, 2 + hinges)]


def _hinge_std_names(hinges: int) -> list[str]:
    return [f"hinge{i}_std_deg" for i in range(2, 2 + hinges)]


def _hinge_reading_std_names(hinges: int) -> list[str]:
    return [f"hinge{i}_reading_std_deg" for i in range(2, 2 + hinges)]


def _std_names(stages: Sequence[StaticStage]) -> list[str]:
    return list(dict.fromkeys(name for stage in stages for name in stage.std))


def read_static(parent: h5py.Group) -> tuple[StaticStage, ...]:
    """The stages in their order; () where there are none."""
    if STATIC not in parent:
        return ()
    group = parent[STATIC]
    hinges = int(group.attrs["hinges"])
    if not 0 <= hinges <= len(group):
        raise ValueError(f"{hinges} hinges, where the table has {len(group)} columns")
    # Columns that older files lack are read only where they exist.
    std = read_names(group.attrs["std"])
    std_names = (*_hinge_std_names(hinges), *_hinge_reading_std_names(hinges))
    hinge_stds = [name for name in std_names if name in group]
    names = [
        "height_mm",
        "stage",
        *_PLAIN,
        *_hinge_names(hinges),
        *hinge_stds,
        *(f"std_{name}" for name in std),
        "settled",
    ]
    names += [name for name in (BEFORE, "held_s") if name in group]
    columns = {name: read_column(group, name).data.tolist() for name in names}
    texts = {}
    for name in ("direction", *_TEXTS):
        if name in group:
            texts[name] = [text.decode() for text in group[name][:].tolist()]
    rows = zip(*columns.values(), *texts.values(), strict=True)
    return tuple(
        _stage(dict(zip((*columns, *texts), row, strict=True)), hinges, std) for row in rows
    )


def _stage(row: dict[str, Any], hinges: int, std: Sequence[str]) -> StaticStage:
    if row["direction"] not in ("loading", "unloading"):
        raise ValueError(f"direction {row['direction']!r} is neither loading nor unloading")
    settled = None
    if row["settled"] >= 0:
        settled = bool(row["settled"])
    held_s = row.get("held_s", math.nan)
    if math.isnan(held_s):
        held_s = None
    strokes_before = row.get(BEFORE, NOT_COUNTED)
    if strokes_before == NOT_COUNTED:
        strokes_before = None
    return StaticStage(
        height_m=row["height_mm"] / 1e3,
        stage=row["stage"],
        direction=cast(Direction, row["direction"]),
        hinge_deg=tuple(row[name] for name in _hinge_names(hinges)),
        hinge_std_deg=tuple(row.get(name, math.nan) for name in _hinge_std_names(hinges)),
        hinge_reading_std_deg=tuple(
            row.get(name, math.nan) for name in _hinge_reading_std_names(hinges)
        ),
        std={name: row[f"std_{name}"] for name in std if not math.isnan(row[f"std_{name}"])},
        settled=settled,
        held_s=held_s,
        strokes_before=strokes_before,
        **{name: row[name] for name in _PLAIN},
        **{name: row.get(name, "") for name in _TEXTS},
    )


def cycle_row(
    number: int, values: tuple[float, float, float, float], host_s: float, device_s: float
) -> Rows:
    """One cycle as a record array (1,); `values` are peak force, peak moment, least fz and mean
    speed.
    """
    return np.array([(number, *values, host_s, device_s)], _DTYPE)


@dataclass(frozen=True)
class CycleTable:
    """All cycles of a run in order; all (m,). `numbers` count from 1 over the whole run; cycles
    recorded as full strokes are not here.
    """

    numbers: NDArray[np.uint32]
    peak_force_N: Floats
    peak_moment_Nm: Floats
    min_fz_N: Floats
    mean_speed_rad_s: Floats


def cycle_table(recording: Recording) -> CycleTable:
    """The cycles of every block, complete or cut short; empty where the run has none."""
    streams = [stage.streams[CYCLES] for stage in recording.raw if CYCLES in stage.streams]

    def join_column(name: str) -> NDArray[np.float64]:
        return np.concatenate([np.zeros(0), *(stream.columns[name].values for stream in streams)])

    numbers = np.concatenate(
        [np.zeros(0, np.uint32), *(stream.columns[NUMBER].data for stream in streams)]
    )
    return CycleTable(
        numbers,
        *(
            join_column(name)
            for name in ("peak_force_N", "peak_moment_Nm", "min_fz_N", "mean_speed_rad_s")
        ),
    )
