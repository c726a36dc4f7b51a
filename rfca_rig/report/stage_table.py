"""Tables of static stages: means after settling and hinge angles, with their scatter where the recording states it."""

from collections.abc import Sequence

import numpy as np

from rfca_rig.recording.model import StaticStage
from rfca_rig.report.table import Table, TableColumn, TableRow, Value

MEANS = ("shaft_angle_rad", "fy_N", "fz_N", "tx_Nm")
STAGE = (TableColumn("height_mm", "Height", set_value=True), TableColumn("stage", "Stage"), TableColumn("direction", "Direction"))
READINGS = (
    TableColumn("shaft_angle_deg", "Shaft", digits=2),
    TableColumn("fy_N", "fy", digits=2, half="fy_std_N"),
    TableColumn("fy_std_N", role="kept"),
    TableColumn("fz_N", "fz", digits=2, half="fz_std_N"),
    TableColumn("fz_std_N", role="kept"),
    TableColumn("tx_Nm", "tx", digits=3, half="tx_std_Nm"),
    TableColumn("tx_std_Nm", role="kept"),
    TableColumn("settled", "Settled"),
)
BEND = TableColumn("bend_deg", "Bend", digits=1)


def stage_tables(name: str, stages: Sequence[StaticStage]) -> list[Table]:
    """Tables of readings, and of hinge angles where there are any; a stage that had not settled is marked."""
    if not stages:
        return []
    rows = tuple(TableRow(_values(stage), marked=stage.settled is False) for stage in stages)
    readings = f"{name}, readings: means after settling, ± one standard deviation of a single sample where the recording tells it."
    tables = [Table("static-readings", readings, (*STAGE, *READINGS), rows)]
    if any(np.isfinite(stage.hinge_deg).any() for stage in stages):
        hinges = (
            f"{name}, hinge angles of each link against the one before it, ± one standard deviation where their photo tells it. "
            "Bend: between first and last link, the sum of the hinge angles without sign."
        )
        columns = (*STAGE, *_hinge_columns(len(stages[0].hinge_deg)), BEND, TableColumn("photo_doubts", role="note"))
        tables.append(Table("hinge-angles", hinges, columns, rows))
    return tables


def _hinge_columns(count: int) -> tuple[TableColumn, ...]:
    pairs = (
        (
            TableColumn(f"hinge{i}_deg", f"{i}", digits=2, half=f"hinge{i}_std_deg", over="Hinge"),
            TableColumn(f"hinge{i}_std_deg", role="kept"),
        )
        for i in range(2, 2 + count)
    )
    return tuple(column for pair in pairs for column in pair)


def _values(stage: StaticStage) -> dict[str, Value]:
    values: dict[str, Value] = {
        "height_mm": round(1e3 * stage.height_m, 3),
        "stage": stage.stage,
        "direction": stage.direction,
        "shaft_angle_deg": float(np.degrees(stage.shaft_angle_rad)),
        "settled": stage.settled,
        "bend_deg": stage.bend_deg,
        "photo_doubts": stage.photo_doubts,
    }
    # The shaft angle, the first of them, is shown in degrees above.
    for name in MEANS[1:]:
        base, unit = name.split("_")
        values |= {name: getattr(stage, name), f"{base}_std_{unit}": stage.std.get(name)}
    for number, (angle, std) in enumerate(zip(stage.hinge_deg, stage.hinge_std_deg, strict=True), start=2):
        values |= {f"hinge{number}_deg": angle, f"hinge{number}_std_deg": std}
    return values
