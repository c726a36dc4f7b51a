"""The static experiment as an HDF5 group of columns, one row per settled stage."""

import json
import math
from collections.abc import Sequence
from typing import Any, cast

import h5py
import numpy as np

from rfca_rig.recording.columns import read_column, write_column
from rfca_rig.recording.form import Column, Direction, StaticStage
from rfca_rig.recording.strokes import height_mm

GROUP = "static"
DIRECTION_BYTES = 16

_SETTLED = {None: -1, False: 0, True: 1}
_PLAIN = {"shaft_angle_rad": "rad", "fy_N": "N", "fz_N": "N", "tx_Nm": "N m"}


def write_static(parent: h5py.Group, stages: Sequence[StaticStage]) -> None:
    """The group `static`; none where there are no stages. All stages must have the same number of hinges."""
    if not stages:
        return
    group = parent.create_group(GROUP)
    directions = np.array([stage.direction.encode() for stage in stages], dtype=f"S{DIRECTION_BYTES}")
    group.create_dataset("direction", data=directions, track_times=False)
    for name, column in _columns(stages).items():
        write_column(group, name, column)
    group.attrs["hinges"] = len(stages[0].hinge_deg)
    group.attrs["std"] = json.dumps(_std_names(stages))


def _columns(stages: Sequence[StaticStage]) -> dict[str, Column]:
    hinges = np.array([stage.hinge_deg for stage in stages], dtype=np.float64).reshape(len(stages), -1)
    return {
        "height_mm": _floats([height_mm(stage.height_m) for stage in stages], "mm"),
        "stage": Column(np.array([stage.stage for stage in stages], dtype=np.int64), ""),
        **{name: _floats([getattr(stage, name) for stage in stages], unit) for name, unit in _PLAIN.items()},
        **{f"hinge{i}_deg": _floats(angles, "deg") for i, angles in enumerate(hinges.T, start=2)},
        **{f"std_{name}": _floats([stage.std.get(name, math.nan) for stage in stages], "") for name in _std_names(stages)},
        "settled": Column(np.array([_SETTLED[stage.settled] for stage in stages], dtype=np.int8), ""),
    }


def _floats(values: Any, unit: str) -> Column:
    return Column(np.array(values, dtype=np.float64), unit)


def _std_names(stages: Sequence[StaticStage]) -> list[str]:
    return list(dict.fromkeys(name for stage in stages for name in stage.std))


def read_static(parent: h5py.Group) -> tuple[StaticStage, ...]:
    """The stages in their order; () where there are none."""
    if GROUP not in parent:
        return ()
    group = parent[GROUP]
    hinges = [f"hinge{i}_deg" for i in range(2, 2 + int(group.attrs["hinges"]))]
    std = json.loads(group.attrs["std"])
    names = ["height_mm", "stage", *_PLAIN, *hinges, *(f"std_{name}" for name in std), "settled"]
    columns = {name: read_column(group, name).raw.tolist() for name in names}
    directions = [text.decode() for text in group["direction"][:].tolist()]
    rows = zip(*columns.values(), strict=True)
    return tuple(_stage(dict(zip(names, row, strict=True)), way, hinges, std) for row, way in zip(rows, directions, strict=True))


def _stage(row: dict[str, Any], direction: str, hinges: Sequence[str], std: Sequence[str]) -> StaticStage:
    if direction not in ("loading", "unloading"):
        raise ValueError(f"direction {direction!r} is neither loading nor unloading")
    return StaticStage(
        height_m=row["height_mm"] / 1e3,
        stage=row["stage"],
        direction=cast(Direction, direction),
        hinge_deg=tuple(row[name] for name in hinges),
        std={name: row[f"std_{name}"] for name in std if not math.isnan(row[f"std_{name}"])},
        settled=None if row["settled"] < 0 else bool(row["settled"]),
        **{name: row[name] for name in _PLAIN},
    )
