"""Writes the report of static stages: static.html, tables as CSV and LaTeX, static.json, and the
models with law and curve.

Results of the static experiment for other programs: every stage and hinge as a table, and
static.json in format rfca-static/1.
"""

import json
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
from rfca_rig.analysis.torque_rotation.static_result import (
    PredictedHingeCurve,
    StaticResult,
    predict_hinge_curves,
    remarks,
)
from rfca_rig.reports.provenance import (
    Origin,
    PageContext,
    PageLink,
    command_line,
    find_pages,
    origin_in_memory,
)
from rfca_rig.reports.static.page import page
from rfca_rig.reports.static.tables import (
    StaticSource,
    curve_table,
    full_curve_table,
    hinges_table,
    values_table,
)
from rfca_rig.reports.table import Table, TableColumn, TableRow, as_csv, table_files, write_all

FORMAT = "rfca-static/1"

MODEL_NAME = "model.toml"
CURVE_NAME = "model-curve.toml"
# Largest angle of the predicted elastica: its grooves meet at 90 degrees.
FARTHEST_RAD = float(np.radians(85.0))


def choose_model_name(result: StaticResult) -> str:
    """The model file to go on with: that with the law where the law holds, else that with the
    measured curve; "" where neither can be written.
    """
    possible = {MODEL_NAME: can_be_written(result), CURVE_NAME: can_curve_be_written(result)}
    names = [MODEL_NAME, CURVE_NAME]
    if not result.form.holds:
        names.reverse()
    return next((name for name in names if possible[name]), "")


def suggest_strokes(model: Path | str) -> str:
    """The command that flaps with the measured springs as the model. A path is shown as on a page,
    a text as it is.
    """
    return command_line("dynamic", "run", options={"--protocol": "table2", "--model": model})


def stages_table(result: StaticResult, sources: Sequence[StaticSource]) -> Table:
    """A row for each stage and hinge: readings, angle, torque, standard deviations, torque of
    the curve, and link ends in contact.
    """
    rows = []
    for row, stage in enumerate(result.data.stages):
        readings = {
            "source": sources[result.data.recording[row]].name,
            "height_mm": _round(1e3 * stage.height_m, 3),
            "stage": stage.stage,
            "direction": stage.direction,
            "shaft_angle_rad": _round(stage.shaft_angle_rad, 6),
            "fy_N": _round(stage.fy_N, 4),
            "fz_N": _round(stage.fz_N, 4),
            "tx_Nm": _round(stage.tx_Nm, 5),
            "links_touching": " ".join(str(end + 1) for end in result.found.ends[row]),
        }
        for hinge in range(result.data.hinges):
            rows.append({**readings, "hinge": hinge + 2, **_angle(result, row, hinge)})
    return Table(
        "stages",
        "",
        tuple(TableColumn(key) for key in rows[0]),
        tuple(TableRow(row) for row in rows),
    )


def _angle(result: StaticResult, row: int, hinge: int) -> dict[str, Any]:
    points = result.points
    phi = points.phi_rad[row, hinge]
    return {
        "angle_deg": _round(np.degrees(phi), 4),
        "angle_std_deg": _round(np.degrees(points.phi_std_rad[row, hinge]), 4),
        "torque_Nm": _round(points.torque_Nm[row, hinge], 5),
        "torque_std_Nm": _round(points.torque_std_Nm[row, hinge], 5),
        "curve_torque_Nm": _round(result.curve.torque_Nm(np.array([phi]))[0][0], 5),
        "turned": {1.0: "bending", -1.0: "unbending"}.get(float(points.turned[row, hinge]), ""),
    }


def static_json(
    result: StaticResult, sources: Sequence[StaticSource], elastica: Sequence[PredictedHingeCurve]
) -> str:
    """The JSON document; unknown values are null.

    Parameters
    ----------
    result
        The torque-rotation curve and what it was found from.
    sources
        Recordings in the order of `result.data.recording`.
    elastica
        Curves that the elastica predicts for the paper's strip.
    """
    curve = full_curve_table(result.curve)
    curve_rows = []
    for row in curve.rows:
        curve_rows.append(
            {column.key: _round(row.values[column.key], 6) for column in curve.columns}
        )
    document = {
        "format": FORMAT,
        "sources": [{"name": source.name, "source": source.recording.source} for source in sources],
        **summary(result),
        "hinges": [
            {"hinge": c.hinge, "stiffer_relative": _round(c.stiffer, 6), "std": _round(c.std, 6)}
            for c in result.hinges
        ],
        "common": [
            {
                "what": d.words,
                "unit": d.unit,
                "value": _round(d.value, 6),
                "std": _round(d.std, 6),
                "known_to": _round(d.prior_std, 6),
            }
            for d in result.systematic_errors
        ],
        "elastica": [
            {
                "holds": e.words,
                "free_mm": _round(1e3 * e.free_m, 3),
                "k0_Nm_per_rad": _round(e.k0_Nm_per_rad, 5),
                "k2_per_rad2": _round(e.k2_per_rad2, 5),
            }
            for e in elastica
        ],
        "curve": curve_rows,
    }
    return json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def summary(result: StaticResult) -> dict[str, Any]:
    """Values with their intervals, and remarks on them, as in static.json."""
    values = result.values
    form = result.form
    errors = result.found.errors
    loop = result.loop
    low, high = sorted(abs(float(np.degrees(angle))) for angle in result.curve.range_rad)
    stage = result.most_bent
    most_bent = None
    if stage is not None:
        most_bent = {
            "bend_deg": _round(stage.bend_deg, 3),
            "height_mm": _round(1e3 * stage.height_m, 3),
            "stage": stage.stage,
            "shaft_angle_deg": _round(np.degrees(stage.shaft_angle_rad), 3),
        }
    loop_values = None
    if loop is not None:
        loop_values = {
            "half_Nm": _round(loop.half_Nm, 6),
            "std_Nm": _round(loop.std_Nm, 6),
            "seen": loop.seen,
        }
    hinge_noise_deg = None
    if (result.data.unstated & result.data.seen).any():
        hinge_noise_deg = _round(np.degrees(errors.hinge_std_rad), 4)
    stated_noise_times = None
    if (~result.data.unstated & result.data.seen).any():
        stated_noise_times = _round(errors.stated_factor, 4)
    return {
        "stages": len(result.data.stages),
        "angles": int(result.data.seen.sum()),
        "range_deg": [_round(low, 3), _round(high, 3)],
        # The stage with the largest angle between first and last link; none where no stage has all
        # hinge angles.
        "most_bent": most_bent,
        "k0_Nm_per_rad": _value(values.k0_Nm_per_rad, values.k0_std, values.reach),
        "k2_per_rad2": _value(values.k2_per_rad2, values.k2_std, values.reach),
        "correlation": _round(values.correlation, 4),
        "law": {
            "holds": form.holds,
            "chance": float(f"{form.p_value:.3g}"),
            "apart_Nm": _round(form.apart_Nm, 5),
            "apart_relative": _round(form.apart_relative, 5),
            "at_deg": _round(np.degrees(form.at_rad), 3),
        },
        "rest_angles": _rests(result),
        "loop": loop_values,
        "noise": {
            "hinge_deg": hinge_noise_deg,
            "stated_angles_times": stated_noise_times,
            "fz_N": _round(errors.force_factor * float(np.median(result.data.force_std[:, 1])), 5),
        },
        "remarks": remarks(result),
    }


def _rests(result: StaticResult) -> dict[str, Any] | None:
    """Rest angles fitted with the law, or with the measured curve where the law does not hold;
    None where they count as exact.
    """
    rests = result.rests_of_curve
    if rests is None:
        return None
    return {
        "deg": [_round(angle, 4) for angle in np.degrees(rests.rest_rad)],
        "std_deg": [_round(std, 4) for std in np.degrees(rests.std_rad)],
        "mean_std_deg": _round(np.degrees(rests.common_std_rad), 4),
        "correlation_with_stiffness": _round(rests.with_stiffness, 4),
    }


def _value(value: float, std: float, reach: float) -> dict[str, Any]:
    return {
        "value": _round(value, 6),
        "std": _round(std, 6),
        "interval_95": [_round(value - reach * std, 6), _round(value + reach * std, 6)],
    }


def _round(value: Any, digits: int) -> float | None:
    # Adding 0.0 turns -0.0 into 0.0.
    if np.isfinite(value):
        return round(float(value), digits) + 0.0
    return None


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
    writers = {
        MODEL_NAME: (can_be_written(result), write_calibration),
        CURVE_NAME: (can_curve_be_written(result), write_curve),
    }
    known_origin = origin or origin_in_memory([source.recording for source in sources])
    links = find_pages(out, known_origin, ("static.html",))
    model_name = choose_model_name(result)
    if model_name:
        following = suggest_strokes(out / model_name)
        links = (*links, PageLink("", "Strokes with these springs", following))
    context = PageContext(known_origin, links, model_file)
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
