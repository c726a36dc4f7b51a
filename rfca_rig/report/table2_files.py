"""Table II of the paper: as JSON in format rfca-table2/1, and as a `Table` for CSV and LaTeX."""

import json
from typing import Any

from rfca_rig.analysis.compare import PAPER_AVERAGE_ERROR_PCT, Table2
from rfca_rig.analysis.compare import Table2Row as Compared
from rfca_rig.analysis.repeats import Spread
from rfca_rig.report.table import Foot, Table, TableColumn, TableRow
from rfca_rig.report.text import count_noun

FORMAT = "rfca-table2/1"
MEASURED, SIMULATED, ERROR = "Measured valley", "Simulated valley", "Error"

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
    average = {"time_error_pct": table.average_time_error_pct, "force_error_pct": table.average_force_error_pct}
    averaged = count_noun(sum(row.time_error_pct is not None for row in table.rows), "condition")
    return Table(
        name="table2",
        caption="Valley of fz: measured as mean ± one standard deviation (n - 1) over the repeats, simulated with " + shaft_words + ". "
        "Errors are relative to the measured mean.",
        columns=COLUMNS,
        rows=tuple(TableRow({**record(row), "refused": "; ".join(row.refused)}) for row in table.rows),
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
        **_measurement(row.time, row.fz),
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


def _measurement(time: Spread, fz: Spread) -> dict[str, float | None]:
    return {
        "measured_time_s": round_or_none(time.mean, 6),
        "measured_time_std_s": round_or_none(time.std, 6),
        "measured_fz_N": round_or_none(fz.mean, 4),
        "measured_fz_std_N": round_or_none(fz.std, 4),
    }


def round_or_none(value: float | None, digits: int) -> float | None:
    """A rounded value for JSON: null where unknown, and no minus where all digits are zero."""
    # Adding 0.0 turns -0.0 into 0.0.
    return None if value is None else round(value, digits) + 0.0
