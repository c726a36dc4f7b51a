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
from rfca_rig.analysis.torque_rotation.elastica_curves import predict_hinge_curves
from rfca_rig.analysis.torque_rotation.static_result import StaticResult
from rfca_rig.report.files import table_files, write_all
from rfca_rig.report.provenance import Origin, PageContext, origin_in_memory
from rfca_rig.report.static_files import stages_table, static_json
from rfca_rig.report.static_page import page
from rfca_rig.report.static_source import StaticSource
from rfca_rig.report.static_tables import curve_table, full_curve_table, hinges_table, values_table
from rfca_rig.report.table_files import as_csv

MODEL_NAME, CURVE_NAME = "model.toml", "model-curve.toml"
# Largest angle of the predicted elastica: its grooves meet at 90 degrees.
FARTHEST_RAD = float(np.radians(85.0))


def write_static_report(
    result: StaticResult,
    sources: Sequence[StaticSource],
    out: Path,
    nominal: Mapping[str, Any],
    known_to: Mapping[str, Any],
    model_file: str | None = None,
    origin: Origin | None = None,
) -> None:
    """Writes all files of the report. The same input gives the same bytes.

    Parameters
    ----------
    result
        The torque-rotation curve and what it was found from.
    sources
        Recordings in the order of `result.data.recording`.
    out
        Folder of the report, made where it does not exist.
    nominal, known_to
        Sections of the nominal model and of its priors that the analysis used.
    model_file
        File that they came from; None for those of the recordings.
    origin
        Command, recordings and version for the foot of the page.

    Raises
    ------
    RigError
        Where a file cannot be written.
    """
    most_rad = min(max(abs(angle) for angle in result.curve.range_rad), FARTHEST_RAD)
    elastica = predict_hinge_curves(result.rig.leg, result.values.k0_Nm_per_rad, most_rad)
    writers = {MODEL_NAME: (can_be_written(result), write_calibration), CURVE_NAME: (can_curve_be_written(result), write_curve)}
    context = PageContext(origin or origin_in_memory([source.recording for source in sources]), (), model_file)
    curve = curve_table(result.curve, int(result.data.seen.sum()))
    contents = {
        **table_files((values_table(result), hinges_table(result), curve)),
        "curve.csv": as_csv(full_curve_table(result.curve)),
        "stages.csv": as_csv(stages_table(result, sources)),
        "static.json": static_json(result, sources, elastica),
    }
    beside = (*contents, *(name for name, (is_possible, _) in writers.items() if is_possible))
    write_all(out, {"static.html": page(result, sources, elastica, context, beside), **contents})
    source_names = [f"{source.name} ({source.recording.source})" for source in sources]
    for name, (is_possible, write) in writers.items():
        if is_possible:
            write(out / name, result, nominal, known_to, source_names)
        else:
            # A model of an earlier report must not remain beside a page that does not state it.
            (out / name).unlink(missing_ok=True)
