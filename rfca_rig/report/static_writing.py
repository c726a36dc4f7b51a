"""Writes the report of static stages: static.html, tables as CSV and LaTeX, static.json, and the models with law and curve."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rfca_rig.analysis.torque_rotation.calibration_file import (
    can_be_written,
    can_curve_be_written,
    write_calibration,
    write_curve,
)
from rfca_rig.analysis.torque_rotation.elastica_curves import foretold
from rfca_rig.analysis.torque_rotation.static_result import StaticResult
from rfca_rig.report.files import table_files, write_all
from rfca_rig.report.provenance import Origin, Told, untold
from rfca_rig.report.static_files import stages_table, static_json
from rfca_rig.report.static_page import page
from rfca_rig.report.static_source import StaticSource
from rfca_rig.report.static_tables import curve_table, hinges_table, values_table, whole_curve
from rfca_rig.report.table_files import as_csv

MODEL_NAME, CURVE_NAME = "model.toml", "model-curve.toml"
FARTHEST_RAD = float(np.radians(85.0))  # the elastica's grooves meet at 90 degrees


def write_static_report(
    result: StaticResult,
    sources: Sequence[StaticSource],
    out: Path,
    nominal: Mapping[str, Any],
    known_to: Mapping[str, Any],
    model_file: str | None = None,
    origin: Origin | None = None,
) -> None:
    """All files into `out`, made where it is not there; the same bytes for the same input. Raises RigError where the disk refuses.

    `nominal` and `known_to` are the sections that the stages were held against, `model_file` the file they came from where one was given.
    """
    most_rad = min(max(abs(angle) for angle in result.curve.range_rad), FARTHEST_RAD)
    elastica = foretold(result.rig.leg, result.values.k0_Nm_per_rad, most_rad)
    writers = {MODEL_NAME: (can_be_written(result), write_calibration), CURVE_NAME: (can_curve_be_written(result), write_curve)}
    told = Told(origin or untold([source.recording for source in sources]), (), model_file)
    curve = curve_table(result.curve, int(result.data.seen.sum()))
    contents = {
        **table_files((values_table(result), hinges_table(result), curve)),
        "curve.csv": as_csv(whole_curve(result.curve)),
        "stages.csv": as_csv(stages_table(result, sources)),
        "static.json": static_json(result, sources, elastica),
    }
    beside = (*contents, *(name for name, (is_possible, _) in writers.items() if is_possible))
    write_all(out, {"static.html": page(result, sources, elastica, told, beside), **contents})
    named = [f"{source.name} ({source.recording.source})" for source in sources]
    for name, (is_possible, write) in writers.items():
        if is_possible:
            write(out / name, result, nominal, known_to, named)
        else:
            (out / name).unlink(missing_ok=True)
