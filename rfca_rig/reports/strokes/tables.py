"""Tables of a report on strokes: Table II of the paper, forces at the peak, and static stages.

Formats rfca-table2/1 and rfca-peak-forces/1 are JSON; each is also a `Table` for CSV and LaTeX.
"""

import json
from collections.abc import Sequence
from math import hypot
from typing import Any

import numpy as np

from rfca_rig.analysis.compare import PAPER_AVERAGE_ERROR_PCT, Table2
from rfca_rig.analysis.compare import Table2Row as Compared
from rfca_rig.analysis.peak_force import PeakForceRow
from rfca_rig.analysis.repeats import Condition
from rfca_rig.recording.model import StaticStage
from rfca_rig.reports.table import Foot, Table, TableColumn, TableRow, Value
from rfca_rig.reports.text import count_noun

FORMAT = "rfca-table2/1"
MEASURED = "Measured valley"
SIMULATED = "Simulated valley"
ERROR = "Error"

COLUMNS = (
    TableColumn("height_mm", "Rack height", set_value=True),
    TableColumn("speed_rad_s", "Speed", set_value=True),
    TableColumn("repeats", "Repeats"),
    TableColumn("measured_time_s", "time", digits=4, half="measured_time_std_s", over=MEASURED),
    TableColumn("measured_time_std_s", role="kept"),
    TableColumn("measured_fz_N", "fz", digits=2, half="measured_fz_std_N", over=MEASURED),
    TableColumn("measured_fz_std_N", role="kept"),
    TableColumn("simulated_time_s", "time", digits=4, over=SIMULATED),
    TableColumn("simulated_fz_N", "fz", digits=2, over=SIMULATED),
    TableColumn("time_error_pct", "time", digits=2, over=ERROR),
    TableColumn("force_error_pct", "fz", digits=2, over=ERROR),
    TableColumn("signed_time_error_pct", role="kept"),
    TableColumn("signed_force_error_pct", role="kept"),
    TableColumn("shaft_speed_rad_s", role="kept"),
    TableColumn("source", role="group"),
    TableColumn("refused", role="note"),
)

PEAK_FORMAT = "rfca-peak-forces/1"
PEAK_MEASURED = "Measured peak"
PEAK_SIMULATED = "Simulated peak"
# The paper's impact test, section IV.A: 155 mm and 15 rad/s.
PAPER_CONDITION = Condition(0.155, 15.0, ())
# fy and fz there, which the paper prints without signs.
PAPER_PEAK_N = (188.0, 232.0)

PEAK_COLUMNS = (
    TableColumn("height_mm", "Rack height", set_value=True),
    TableColumn("speed_rad_s", "Speed", set_value=True),
    TableColumn("repeats", "Repeats"),
    TableColumn(
        "measured_force_N", "|F|", digits=1, half="measured_force_std_N", over=PEAK_MEASURED
    ),
    TableColumn("measured_force_std_N", role="kept"),
    TableColumn("measured_fy_N", "fy", digits=1, half="measured_fy_std_N", over=PEAK_MEASURED),
    TableColumn("measured_fy_std_N", role="kept"),
    TableColumn("measured_fz_N", "fz", digits=1, half="measured_fz_std_N", over=PEAK_MEASURED),
    TableColumn("measured_fz_std_N", role="kept"),
    TableColumn(
        "measured_time_s", "time", digits=4, half="measured_time_std_s", over=PEAK_MEASURED
    ),
    TableColumn("measured_time_std_s", role="kept"),
    TableColumn("simulated_force_N", "|F|", digits=1, over=PEAK_SIMULATED),
    TableColumn("simulated_fy_N", "fy", digits=1, over=PEAK_SIMULATED),
    TableColumn("simulated_fz_N", "fz", digits=1, over=PEAK_SIMULATED),
    TableColumn("simulated_time_s", "time", digits=4, over=PEAK_SIMULATED),
    TableColumn("simulated_touching", role="kept"),
    TableColumn("shaft_speed_rad_s", role="kept"),
    TableColumn("source", role="group"),
    TableColumn("notes", role="note"),
)

MEANS = ("shaft_angle_rad", "fy_N", "fz_N", "tx_Nm")
STAGE = (
    TableColumn("height_mm", "Height", set_value=True),
    TableColumn("stage", "Stage"),
    TableColumn("direction", "Direction"),
)
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


def as_json(table: Table2) -> str:
    """The JSON document; unknown values are null."""
    average = {
        "time_error_pct": round_or_none(table.average_time_error_pct, 4),
        "force_error_pct": round_or_none(table.average_force_error_pct, 4),
    }
    document = {"format": FORMAT, "rows": [record(row) for row in table.rows], "average": average}
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def as_table(table: Table2, shaft_words: str) -> Table:
    """Table II in the paper's layout, with the paper's own averages below.

    `shaft_words` states how the simulated shaft turned.
    """
    paper = dict(zip(("time_error_pct", "force_error_pct"), PAPER_AVERAGE_ERROR_PCT, strict=True))
    average = {
        "time_error_pct": table.average_time_error_pct,
        "force_error_pct": table.average_force_error_pct,
    }
    averaged = count_noun(sum(row.time_error_pct is not None for row in table.rows), "condition")
    return Table(
        name="table2",
        caption=(
            "Valley of fz: measured as mean ± one standard deviation (n - 1) over the "
            "repeats, simulated with "
        )
        + shaft_words
        + ". "
        "Errors are relative to the measured mean.",
        columns=COLUMNS,
        rows=tuple(
            TableRow({**record(row), "refused": "; ".join(row.refused)}) for row in table.rows
        ),
        foot=(
            Foot(f"Average over {averaged}", average),
            Foot("The paper\u2019s own averages, over four conditions of its rig", paper, digits=1),
        ),
    )


def record(row: Compared) -> dict[str, Any]:
    """A row under its keys: first those of rfca-table2/1, then additional ones."""
    return {
        "height_mm": round_or_none(1e3 * row.height_m, 3),
        "speed_rad_s": round_or_none(row.speed_rad_s, 5),
        "repeats": row.repeats,
        "measured_time_s": round_or_none(row.time.mean, 6),
        "measured_time_std_s": round_or_none(row.time.std, 6),
        "measured_fz_N": round_or_none(row.fz.mean, 4),
        "measured_fz_std_N": round_or_none(row.fz.std, 4),
        "simulated_time_s": round_or_none(row.simulated_time_s, 6),
        "simulated_fz_N": round_or_none(row.simulated_fz_N, 4),
        "time_error_pct": round_or_none(row.time_error_pct, 4),
        "force_error_pct": round_or_none(row.force_error_pct, 4),
        "signed_time_error_pct": round_or_none(row.signed_time_error_pct, 4),
        "signed_force_error_pct": round_or_none(row.signed_force_error_pct, 4),
        "shaft_speed_rad_s": round_or_none(row.shaft_speed_rad_s, 5),
        "source": row.source,
        "refused": list(row.refused),
    }


def round_or_none(value: float | None, digits: int) -> float | None:
    """A rounded value for JSON: null where unknown, and no minus where all digits are zero."""
    # Adding 0.0 turns -0.0 into 0.0.
    if value is None:
        return None
    return round(value, digits) + 0.0


def peaks_as_json(rows: Sequence[PeakForceRow]) -> str:
    """The JSON document; unknown values are null."""
    document = {"format": PEAK_FORMAT, "rows": [peak_record(row) for row in rows]}
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def peaks_as_table(rows: Sequence[PeakForceRow], shaft_words: str) -> Table:
    """The table of peak forces, with the paper's own peak below where a row has its condition.

    `shaft_words` states how the simulated shaft turned, as for Table II.
    """
    return Table(
        name="peak-forces",
        caption="Forces on the sensor at the instant when |F|, with |F|² = fy² + fz², is largest "
        "in the stroke. The instant is one sample. "
        "Measured: mean ± one standard deviation (n - 1) over the repeats. Simulated: "
        f"{shaft_words}. Time counts from the start of the motion.",
        columns=PEAK_COLUMNS,
        rows=tuple(TableRow({**peak_record(row), "notes": "; ".join(_notes(row))}) for row in rows),
        foot=_foot(rows),
    )


def peak_record(row: PeakForceRow) -> dict[str, Any]:
    """A row under the keys of rfca-peak-forces/1."""
    return {
        "height_mm": round_or_none(1e3 * row.height_m, 3),
        "speed_rad_s": round_or_none(row.speed_rad_s, 5),
        "repeats": row.repeats,
        "measured_force_N": round_or_none(row.measured.force_N.mean, 4),
        "measured_force_std_N": round_or_none(row.measured.force_N.std, 4),
        "measured_fy_N": round_or_none(row.measured.fy_N.mean, 4),
        "measured_fy_std_N": round_or_none(row.measured.fy_N.std, 4),
        "measured_fz_N": round_or_none(row.measured.fz_N.mean, 4),
        "measured_fz_std_N": round_or_none(row.measured.fz_N.std, 4),
        "measured_time_s": round_or_none(row.measured.time_s.mean, 6),
        "measured_time_std_s": round_or_none(row.measured.time_s.std, 6),
        "simulated_force_N": round_or_none(row.simulated.force_N.mean, 4),
        "simulated_fy_N": round_or_none(row.simulated.fy_N.mean, 4),
        "simulated_fz_N": round_or_none(row.simulated.fz_N.mean, 4),
        "simulated_time_s": round_or_none(row.simulated.time_s.mean, 6),
        "simulated_touching": row.simulated_touching,
        "shaft_speed_rad_s": round_or_none(row.shaft_speed_rad_s, 5),
        "source": row.source,
        "refused": list(row.refused),
    }


def _notes(row: PeakForceRow) -> list[str]:
    """Notes against a wrong reading: the largest force of a fast stroke may be the pull of the
    leg in the air.
    """
    if row.simulated_touching is False:
        in_the_air = ["simulated: the leg is off the ground at its peak"]
    else:
        in_the_air = []
    return [*row.refused, *in_the_air]


def _foot(rows: Sequence[PeakForceRow]) -> tuple[Foot, ...]:
    # By label, which is rounded: floats from files may differ from 0.155 and 15.0 in the last
    # digits.
    if not any(
        PAPER_CONDITION.label == Condition(row.height_m, row.speed_rad_s, ()).label for row in rows
    ):
        return ()
    fy_N, fz_N = PAPER_PEAK_N
    values = {"measured_force_N": hypot(fy_N, fz_N), "measured_fy_N": fy_N, "measured_fz_N": fz_N}
    return (
        Foot(
            f"The paper\u2019s own peak at {PAPER_CONDITION.label}, without signs", values, digits=0
        ),
    )


def stage_tables(name: str, stages: Sequence[StaticStage]) -> list[Table]:
    """Tables of readings, and of hinge angles where there are any; a stage that had not settled
    is marked.
    """
    if not stages:
        return []
    rows = tuple(TableRow(_values(stage), marked=stage.settled is False) for stage in stages)
    readings = (
        f"{name}, readings: means after settling, ± one standard deviation of a single sample "
        "where the recording tells it."
    )
    tables = [Table("static-readings", readings, (*STAGE, *READINGS), rows)]
    if any(np.isfinite(stage.hinge_deg).any() for stage in stages):
        hinges = (
            f"{name}, hinge angles of each link against the one before it, ± one standard "
            "deviation where their photo tells it. "
            "Bend: between first and last link, the sum of the hinge angles without sign."
        )
        columns = (
            *STAGE,
            *_hinge_columns(len(stages[0].hinge_deg)),
            BEND,
            TableColumn("photo_doubts", role="note"),
        )
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
    for number, (angle, std) in enumerate(
        zip(stage.hinge_deg, stage.hinge_std_deg, strict=True), start=2
    ):
        values |= {f"hinge{number}_deg": angle, f"hinge{number}_std_deg": std}
    return values
