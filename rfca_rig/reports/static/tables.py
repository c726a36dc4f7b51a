"""Tables of the static experiment, and its recordings with the folders that hold their photos.

Tables hold fitted values, the curve with its stiffness, differences between hinges, and systematic
errors.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.torque_rotation.bases import TorqueCurve
from rfca_rig.analysis.torque_rotation.static_result import PredictedHingeCurve, StaticResult
from rfca_rig.recording.model import Recording
from rfca_rig.reports.table import Table, TableColumn, TableRow, Value, with_common_decimals
from rfca_rig.reports.text import number_equal_names

# Step of the curve's table for reading; doubled until the table has FEW_LINES lines or less.
TABLE_STEP_DEG = 2.5
FEW_LINES = 12
# Points of the curve for other programs.
FULL_GRID = 101

CURVE_COLUMNS = (
    TableColumn("angle_deg", "Rotation", set_value=True),
    TableColumn("torque_Nm", "Torque", half="torque_half_Nm"),
    TableColumn("torque_std_Nm", role="kept"),
    TableColumn("torque_low_Nm", role="kept"),
    TableColumn("torque_high_Nm", role="kept"),
    TableColumn("stiffness_Nm_per_rad", "Stiffness", half="stiffness_half_Nm_per_rad"),
    TableColumn("stiffness_std_Nm_per_rad", role="kept"),
    TableColumn("stiffness_low_Nm_per_rad", role="kept"),
    TableColumn("stiffness_high_Nm_per_rad", role="kept"),
)


def values_table(result: StaticResult) -> Table:
    """k0 and k2 of the law k0 (phi + k2 phi^3), with standard deviation and 95 % interval."""
    values = result.values
    rows = (
        _value("k0", values.k0_Nm_per_rad, values.k0_std, values.reach, "N m/rad"),
        _value("k2", values.k2_per_rad2, values.k2_std, values.reach, "1/rad²"),
    )
    columns = (
        TableColumn("parameter"),
        TableColumn("value", half="half_95"),
        TableColumn("unit"),
        TableColumn("std", role="kept"),
        TableColumn("low_95", role="kept"),
        TableColumn("high_95", role="kept"),
    )
    stages = len(result.data.stages)
    angles = int(result.data.seen.sum())
    return Table(
        "values",
        (
            f"Torque k0 (phi + k2 phi^3) of a hinge, ± half of a 95 % interval; {stages} "
            f"stages, {angles} hinge angles."
        ),
        columns,
        rows,
    )


def _value(name: str, value: float, std: float, reach: float, unit: str) -> TableRow:
    half = reach * std
    cells: dict[str, Value] = {
        "parameter": name,
        "value": value,
        "half_95": half,
        "unit": unit,
        "std": std,
    }
    return TableRow({**cells, "low_95": value - half, "high_95": value + half})


def curve_table(curve: TorqueCurve, angles: int) -> Table:
    """A few rows over the range of the curve, for reading, with bending positive; `angles` is
    the number of measured ones.
    """
    # Round angles over the range of the curve, in steps that make FEW_LINES lines or less.
    low, high = sorted(abs(float(np.degrees(angle))) for angle in curve.range_rad)
    step = TABLE_STEP_DEG
    while (high - low) / step > FEW_LINES:
        step *= 2.0
    round_deg = np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step
    return _curve(curve, np.radians(round_deg) * curve.bends, f"from {angles} hinge angles")


def full_curve_table(curve: TorqueCurve) -> Table:
    """The curve over its whole range, for other programs; the signs are those of the hinge
    angles.
    """
    return _curve(curve, curve.grid_rad(FULL_GRID), "over the whole range", signed=True)


def _curve(curve: TorqueCurve, phi: NDArray[np.float64], words: str, signed: bool = False) -> Table:
    # Shown with bending positive, angle and torque change sign together; stiffness, their
    # derivative, does not.
    side = curve.bends
    if signed:
        side = 1.0
    torque, torque_std = curve.torque_Nm(phi)
    stiffness, stiffness_std = curve.stiffness_Nm_per_rad(phi)
    points = np.column_stack(
        [np.degrees(side * phi), side * torque, torque_std, stiffness, stiffness_std]
    )
    rows = tuple(_curve_row(curve.reach, *point) for point in points.tolist())
    caption = (
        "Torque and stiffness of a hinge, ± half of the 95 % band, which holds at each angle "
        f"by itself; {words}."
    )
    return Table(
        "curve",
        caption,
        tuple(with_common_decimals(column, rows) for column in CURVE_COLUMNS),
        rows,
    )


def _curve_row(
    reach: float,
    angle: float,
    torque: float,
    torque_std: float,
    stiffness: float,
    stiffness_std: float,
) -> TableRow:
    half = reach * torque_std
    stiff_half = reach * stiffness_std
    return TableRow(
        {
            "angle_deg": round(angle, 5) + 0.0,
            "torque_Nm": torque,
            "torque_half_Nm": half,
            "torque_std_Nm": torque_std,
            "torque_low_Nm": torque - half,
            "torque_high_Nm": torque + half,
            "stiffness_Nm_per_rad": stiffness,
            "stiffness_half_Nm_per_rad": stiff_half,
            "stiffness_std_Nm_per_rad": stiffness_std,
            "stiffness_low_Nm_per_rad": stiffness - stiff_half,
            "stiffness_high_Nm_per_rad": stiffness + stiff_half,
        }
    )


def hinges_table(result: StaticResult) -> Table:
    """Stiffness of each hinge relative to the common curve; those that differ by more than
    chance are marked.
    """
    rows = tuple(
        TableRow(
            {
                "hinge": check.hinge,
                "stiffer_pct": 100.0 * check.stiffer,
                "std_pct": 100.0 * check.std,
            },
            marked=check.is_significant,
        )
        for check in result.hinges
    )
    stiffer = with_common_decimals(
        TableColumn("stiffer_pct", "Stiffer than the curve", half="std_pct"), rows
    )
    columns = (TableColumn("hinge", "Hinge"), stiffer, TableColumn("std_pct", role="kept"))
    return Table(
        "hinges",
        (
            "Each hinge by itself, ± one standard deviation; bold where it differs by more "
            "than chance."
        ),
        columns,
        rows,
    )


def systematic_errors_table(result: StaticResult) -> Table:
    """Systematic errors: quantities that are the same in all stages and were fitted within their
    priors.
    """
    rows = tuple(
        TableRow(
            {
                "what": d.words,
                "off": d.value,
                "off_std": d.std,
                "known_to": float(f"{d.prior_std:.2g}"),
                "unit": d.unit,
            },
            marked=d.is_implausible,
        )
        for d in result.systematic_errors
    )
    columns = (
        TableColumn("what", "Off the nominal value"),
        TableColumn("off", "Found", half="off_std"),
        TableColumn("off_std", role="kept"),
        TableColumn("known_to", "Prior std.", set_value=True),
        TableColumn("unit", "Unit"),
    )
    return Table(
        "common",
        "One standard deviation each; bold where the prior makes the shift implausible.",
        columns,
        rows,
    )


def repeats_table(result: StaticResult, names: Sequence[str]) -> Table:
    """The law fitted to each recording alone; no rows for a single recording."""
    rows = tuple(
        TableRow(
            {
                "recording": name,
                "k0_Nm_per_rad": law.k0_Nm_per_rad,
                "k0_half": law.reach * law.k0_std,
                "k2_per_rad2": law.k2_per_rad2,
                "k2_half": law.reach * law.k2_std,
            }
        )
        for name, law in zip(names, result.repeats.values, strict=False)
    )
    columns = (
        TableColumn("recording", "Recording"),
        TableColumn("k0_Nm_per_rad", "k0", half="k0_half"),
        TableColumn("k2_per_rad2", "k2", half="k2_half"),
    )
    return Table(
        "recordings", "From each recording alone, ± half of a 95 % interval.", columns, rows
    )


def elastica_table(predicted: Sequence[PredictedHingeCurve], result: StaticResult) -> Table:
    """Values that the elastica predicts for the paper's strip, with the measured ones below."""
    values = result.values
    rows: list[dict[str, Value]] = [
        {
            "held": curve.words,
            "free_mm": 1e3 * curve.free_m,
            "k0_Nm_per_rad": curve.k0_Nm_per_rad,
            "k2_per_rad2": curve.k2_per_rad2,
        }
        for curve in predicted
    ]
    measured: dict[str, Value] = {
        "held": "measured here",
        "k0_Nm_per_rad": values.k0_Nm_per_rad,
        "k2_per_rad2": values.k2_per_rad2,
    }
    columns = (
        TableColumn("held", "The paper\u2019s strip, held"),
        TableColumn("free_mm", "Free", digits=1),
        TableColumn("k0_Nm_per_rad", "k0", digits=2),
        TableColumn("k2_per_rad2", "k2", digits=2),
    )
    caption = (
        "Computed, two strips of 226 \u00d7 25.4 \u00d7 0.8 mm, 120 GPa; what was measured "
        "has its interval above."
    )
    return Table(
        "elastica", caption, columns, (*(TableRow(row) for row in rows), TableRow(measured))
    )


@dataclass(frozen=True)
class StaticSource:
    """One recording of static stages; paths of its photos are relative to `folder`."""

    name: str
    folder: Path
    recording: Recording


def static_sources(
    paths: Sequence[Path], recordings: Sequence[Recording]
) -> tuple[StaticSource, ...]:
    """One source for each recording, read at the path of the same place; equal titles are
    numbered in their order.
    """
    names = number_equal_names([recording.title for recording in recordings])
    folders = [path if path.is_dir() else path.parent for path in paths]
    return tuple(StaticSource(*parts) for parts in zip(names, folders, recordings, strict=True))
