"""One static CSV: a settled stage per line."""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import cast

from rfca_rig.campaign.columns import STATIC, STATIC_NEEDED, fault_in_names
from rfca_rig.campaign.table import Table, number, read_table, rows
from rfca_rig.channels import HINGES
from rfca_rig.errors import BadInput
from rfca_rig.recording.model import Direction, StaticStage

DIRECTIONS = ("loading", "unloading")

Extra = dict[str, list[str]]


def read_stages(path: Path, strokes_before: int | None = None, held_s: float | None = None) -> tuple[tuple[StaticStage, ...], Extra]:
    """The stages in the file, in its order, and its extra columns as text by name; `strokes_before` and `held_s` are those of all.

    Hinge columns may be absent; their angles are NaN then. Raises BadInput, naming file, line and column, for the first fault.
    """
    table = read_table(path)
    if said := fault_in_names(table.names, known=STATIC, needed=STATIC_NEEDED):
        raise BadInput(f"{table.path}:1: {said}")
    lines = [dict(zip(table.names, cells, strict=True)) for cells in rows(table)]
    extra = {name: [cells[name] for cells in lines] for name in table.names if name not in STATIC}
    stages = tuple(replace(_stage(table, row, cells), strokes_before=strokes_before, held_s=held_s) for row, cells in enumerate(lines))
    return stages, extra


def _stage(table: Table, row: int, cells: Mapping[str, str]) -> StaticStage:
    value = {name: number(table, row, name, cells[name]) for name in STATIC if name in cells and name != "direction"}
    return StaticStage(
        height_m=_positive(table, row, "height_mm", value["height_mm"]) / 1e3,
        stage=_whole(table, row, "stage", value["stage"]),
        direction=_direction(table, row, cells["direction"]),
        shaft_angle_rad=value["shaft_angle_rad"],
        hinge_deg=tuple(value.get(name, math.nan) for name in HINGES),
        fy_N=value["fy_N"],
        fz_N=value["fz_N"],
        tx_Nm=value["tx_Nm"],
    )


def _positive(table: Table, row: int, name: str, value: float) -> float:
    if value <= 0:
        raise table.fault(row, f"column {name}: {value:g} should be greater than 0")
    return value


def _whole(table: Table, row: int, name: str, value: float) -> int:
    if value < 0 or not value.is_integer():
        raise table.fault(row, f"column {name}: {value:g} should be a whole number, 0 or more")
    return int(value)


def _direction(table: Table, row: int, cell: str) -> Direction:
    if cell not in DIRECTIONS:
        raise table.fault(row, f"column direction: {cell!r} should be loading or unloading")
    return cast(Direction, cell)
