"""Writes the report of static stages: static.html, stages.csv, curve.csv, static.json, and model.toml where the law can hold."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rfca_rig.analysis.torque_rotation.calibration_file import can_be_written, write_calibration
from rfca_rig.analysis.torque_rotation.elastica_curves import foretold
from rfca_rig.analysis.torque_rotation.static_result import StaticResult
from rfca_rig.errors import RigError
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.report.static_files import curve_csv, stages_csv, static_json
from rfca_rig.report.static_page import page
from rfca_rig.report.static_source import StaticSource

MODEL_NAME = "model.toml"
FARTHEST_RAD = float(np.radians(85.0))  # the elastica's grooves meet at 90 degrees


def write_static_report(
    result: StaticResult,
    sources: Sequence[StaticSource],
    out: Path,
    believed: Mapping[str, Any],
    known_to: Mapping[str, Any],
    model_file: str | None = None,
) -> None:
    """All files into `out`, made where it is not there; the same bytes for the same input. Raises RigError where the disk refuses.

    `believed` and `known_to` are the sections that the stages were held against, `model_file` the file they came from where one was given.
    """
    most_rad = min(max(abs(angle) for angle in result.curve.range_rad), FARTHEST_RAD)
    elastica = foretold(result.rig.leg, result.values.k0_Nm_per_rad, most_rad)
    has_model = can_be_written(result)
    contents = {
        "static.html": page(result, sources, elastica, model_file, has_model),
        "stages.csv": stages_csv(result, sources),
        "curve.csv": curve_csv(result),
        "static.json": static_json(result, sources, elastica),
    }
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RigError(f"{out}: the folder for the report cannot be made: {error.strerror}; give another with --out") from None
    for name, text in contents.items():
        write_atomically(out / name, text.encode("utf-8"))
    if has_model:
        named = [f"{source.name} ({source.recording.source})" for source in sources]
        write_calibration(out / MODEL_NAME, result, believed, known_to, named)
    else:
        (out / MODEL_NAME).unlink(missing_ok=True)
