"""report.html of a pendulum: angles and speeds of each run, measured and simulated, with nominal and with fitted values."""

import json
from pathlib import Path

from rfca_rig.campaign.pendulum import PendulumCampaign
from rfca_rig.diagnosis.pendulums.fit import PENDULUM_FIT, PendulumFit
from rfca_rig.report.diagnosis_pictures import pictures_of
from rfca_rig.report.files import table_files, write_all
from rfca_rig.report.named_units import words_and_unit
from rfca_rig.report.origin import Origin
from rfca_rig.report.table import Column, Row, Table
from rfca_rig.report.templates import template

PAGE, JSON_FILE = "report.html", "pendulum.json"

ERROR_COLUMNS = (
    Column("run", "Run"),
    Column("signal", "Signal"),
    Column("unit", "Unit"),
    Column("noise", "Noise", over="Rms error"),
    Column("nominal", "Nominal values", over="Rms error"),
    Column("fitted", "Fitted values", over="Rms error"),
    Column("held_out", "Held-out", over="Rms error"),
)
SHIFT_COLUMNS = (
    Column("name", "Value"),
    Column("prior_std", "Prior standard deviation", digits=5),
    Column("value", "Shift from nominal", half="std"),
    Column("std", role="kept"),
)


def write_pendulum_report(campaign: PendulumCampaign, fit: PendulumFit, out: Path, origin: Origin, model_file: str | None) -> None:
    """report.html, and its tables as CSV, LaTeX and JSON, into `out`. Raises RigError where the disk refuses."""
    tables = (_error_table(fit), _shift_table(fit))
    contents = {JSON_FILE: json.dumps({"title": campaign.title, **fit.fit.plain(PENDULUM_FIT)}, indent=1) + "\n", **table_files(tables)}
    page = template("pendulum.html").render(
        sheets=(),
        origin=origin,
        files=tuple(contents),
        title=campaign.title,
        nominal=f"the model file {model_file}" if model_file else "pendulum.toml",
        tables=tables,
        pictures=pictures_of(fit.fit.overlays),
    )
    write_all(out, {PAGE: page, **contents})


def _error_table(fit: PendulumFit) -> Table:
    caption = "Rms of measured less simulated. Each window of 0.5 s is simulated from the measured state at its start. "
    caption += "Held-out: each stretch of about 2 s is predicted with values fitted to all others."
    return Table("pendulum-errors", caption, ERROR_COLUMNS, tuple(_error_row(error.__dict__) for error in fit.fit.errors))


def _error_row(error: dict[str, str | float | None]) -> Row:
    words, unit = words_and_unit(str(error["signal"]))
    return Row({**error, "signal": words, "unit": unit}, digits=5)


def _shift_table(fit: PendulumFit) -> Table:
    caption = "Shift of each nominal value that fits all runs best, ± one standard deviation; its unit is the end of its name."
    return Table("pendulum-values", caption, SHIFT_COLUMNS, tuple(Row(dict(shift.__dict__)) for shift in fit.fit.shifts))
