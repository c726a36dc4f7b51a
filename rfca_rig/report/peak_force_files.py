"""Forces at the peak of the strokes: as JSON in format rfca-peak-forces/1, and as a `Table` for CSV and LaTeX."""

import json
from collections.abc import Sequence
from math import hypot
from typing import Any

from rfca_rig.analysis.peak_force import PeakForceRow, PeakSpread
from rfca_rig.analysis.repeats import Condition
from rfca_rig.report.table import Foot, Table, TableColumn, TableRow
from rfca_rig.report.table2_files import round_or_none

FORMAT = "rfca-peak-forces/1"
MEASURED, SIMULATED = "Measured peak", "Simulated peak"
# The paper's impact test, section IV.A: 155 mm and 15 rad/s.
PAPER_CONDITION = Condition(0.155, 15.0, ())
# fy and fz there, which the paper prints without signs.
PAPER_PEAK_N = (188.0, 232.0)

COLUMNS = (
    TableColumn("height_mm", "Rack height", set_value=True),
    TableColumn("speed_rad_s", "Speed", set_value=True),
    TableColumn("repeats", "Repeats"),
    TableColumn("measured_force_N", "|F|", digits=1, half="measured_force_std_N", over=MEASURED),
    TableColumn("measured_force_std_N", role="kept"),
    TableColumn("measured_fy_N", "fy", digits=1, half="measured_fy_std_N", over=MEASURED),
    TableColumn("measured_fy_std_N", role="kept"),
    TableColumn("measured_fz_N", "fz", digits=1, half="measured_fz_std_N", over=MEASURED),
    TableColumn("measured_fz_std_N", role="kept"),
    TableColumn("measured_time_s", "time", digits=4, half="measured_time_std_s", over=MEASURED),
    TableColumn("measured_time_std_s", role="kept"),
    TableColumn("simulated_force_N", "|F|", digits=1, over=SIMULATED),
    TableColumn("simulated_fy_N", "fy", digits=1, over=SIMULATED),
    TableColumn("simulated_fz_N", "fz", digits=1, over=SIMULATED),
    TableColumn("simulated_time_s", "time", digits=4, over=SIMULATED),
    TableColumn("simulated_touching", role="kept"),
    TableColumn("shaft_speed_rad_s", role="kept"),
    TableColumn("source", role="group"),
    TableColumn("notes", role="note"),
)


def peaks_as_json(rows: Sequence[PeakForceRow]) -> str:
    """The JSON document; unknown values are null."""
    document = {"format": FORMAT, "rows": [peak_record(row) for row in rows]}
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def peaks_as_table(rows: Sequence[PeakForceRow], shaft_words: str) -> Table:
    """The table of peak forces, with the paper's own peak below where a row has its condition.

    `shaft_words` states how the simulated shaft turned, as for Table II.
    """
    return Table(
        name="peak-forces",
        caption="Forces on the sensor at the instant when |F|, with |F|² = fy² + fz², is largest in the stroke. The instant is one sample. "
        "Measured: mean ± one standard deviation (n - 1) over the repeats. Simulated: "
        f"{shaft_words}. Time counts from the start of the motion.",
        columns=COLUMNS,
        rows=tuple(TableRow({**peak_record(row), "notes": "; ".join(_notes(row))}) for row in rows),
        foot=_foot(rows),
    )


def peak_record(row: PeakForceRow) -> dict[str, Any]:
    """A row under the keys of rfca-peak-forces/1."""
    return {
        "height_mm": round_or_none(1e3 * row.height_m, 3),
        "speed_rad_s": round_or_none(row.speed_rad_s, 5),
        "repeats": row.repeats,
        **_measurement(row.measured),
        "simulated_force_N": round_or_none(row.simulated.force_N.mean, 4),
        "simulated_fy_N": round_or_none(row.simulated.fy_N.mean, 4),
        "simulated_fz_N": round_or_none(row.simulated.fz_N.mean, 4),
        "simulated_time_s": round_or_none(row.simulated.time_s.mean, 6),
        "simulated_touching": row.simulated_touching,
        "shaft_speed_rad_s": round_or_none(row.shaft_speed_rad_s, 5),
        "source": row.source,
        "refused": list(row.refused),
    }


def _measurement(peaks: PeakSpread) -> dict[str, float | None]:
    return {
        "measured_force_N": round_or_none(peaks.force_N.mean, 4),
        "measured_force_std_N": round_or_none(peaks.force_N.std, 4),
        "measured_fy_N": round_or_none(peaks.fy_N.mean, 4),
        "measured_fy_std_N": round_or_none(peaks.fy_N.std, 4),
        "measured_fz_N": round_or_none(peaks.fz_N.mean, 4),
        "measured_fz_std_N": round_or_none(peaks.fz_N.std, 4),
        "measured_time_s": round_or_none(peaks.time_s.mean, 6),
        "measured_time_std_s": round_or_none(peaks.time_s.std, 6),
    }


def _notes(row: PeakForceRow) -> list[str]:
    """Notes against a wrong reading: the largest force of a fast stroke may be the pull of the leg in the air."""
    in_the_air = ["simulated: the leg is off the ground at its peak"] if row.simulated_touching is False else []
    return [*row.refused, *in_the_air]


def _foot(rows: Sequence[PeakForceRow]) -> tuple[Foot, ...]:
    # By label, which is rounded: floats from files may differ from 0.155 and 15.0 in the last digits.
    if not any(PAPER_CONDITION.label == Condition(row.height_m, row.speed_rad_s, ()).label for row in rows):
        return ()
    fy_N, fz_N = PAPER_PEAK_N
    values = {"measured_force_N": hypot(fy_N, fz_N), "measured_fy_N": fy_N, "measured_fz_N": fz_N}
    return (Foot(f"The paper\u2019s own peak at {PAPER_CONDITION.label}, without signs", values, digits=0),)
