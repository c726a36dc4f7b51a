"""Conditions that were left out, of a leg at the commanded motion: their forces before and after,
as a figure, as a table with the rows of Table II, and in a sentence.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

from rfca_rig.diagnosis.data import rms
from rfca_rig.diagnosis.result import BeforeAfter, Diagnosis, LeftOutCondition, SignalOverlay
from rfca_rig.escaping import html_text
from rfca_rig.reports.diagnosis.pictures import residuals_of
from rfca_rig.reports.diagnosis.tables import format_change, list_signal_rows
from rfca_rig.reports.style import (
    ALIKE,
    FAINT,
    MEASURED,
    OTHER,
    SIMULATED,
    drawing,
    hover_values,
    inline_svg,
)
from rfca_rig.reports.table import Foot, Table, TableColumn, TableRow, places
from rfca_rig.reports.text import format_significant, number

FORCE = "fz_N"
SIZE_IN = (5.6, 3.6)
FORCE_BOX = (0.13, 0.42, 0.86, 0.55)
RESIDUAL_BOX = (0.13, 0.125, 0.86, 0.2)
DASHES = (0, (3.2, 1.8))
# Half width of the band of noise and scatter, in standard deviations.
BAND = 2.0
# Of the residual's axis, over the largest value that it shows whole.
MARGIN = 1.15
PCT_DIGITS = 2
TIME = "valley, time"
SIZE = "valley, force"
RMS = "fz, rms"
CAPTION = (
    "Conditions left out in turn: all values of the model after come from the others, and the "
    "shaft is commanded. Valley: error of the force minimum, as in Table II. fz: measured "
    "means less simulated, until shortly before lift-off."
)
CURVES = ("condition", "signal", "t_s", "measured", "nominal", "amended", "floor")


def measure_misfits(left_out: Sequence[LeftOutCondition]) -> dict[str, BeforeAfter]:
    """Rms of measured less simulated over all left-out conditions, by signal, with the rms of what
    noise and scatter leave.
    """
    by_signal: dict[str, list[SignalOverlay]] = {}
    for condition in left_out:
        for overlay in condition.overlays:
            by_signal.setdefault(overlay.signal, []).append(overlay)
    return {signal: _measure_misfit(overlays) for signal, overlays in by_signal.items()}


def _measure_misfit(overlays: Sequence[SignalOverlay]) -> BeforeAfter:
    floor = np.concatenate([overlay.floor for overlay in overlays])
    return replace(residuals_of(overlays), noise_floor=rms(floor))


def describe_misfit(diagnosis: Diagnosis) -> str:
    """By how much fz is missed on left-out conditions, as a sentence; "" where there are none."""
    misfit = measure_misfits(diagnosis.left_out).get(FORCE)
    if misfit is None:
        return ""
    return (
        "In conditions that were left out, with the shaft as commanded, fz is missed by "
        f"{format_significant(misfit.before, 2)} N rms before and by "
        f"{format_significant(misfit.after, 2)} N after."
    )


@dataclass(frozen=True)
class LeftOutRow:
    """Errors on a left-out condition, or on all of them: of its valley in time and force [%], and
    the rms of fz [N]. None where it is not known.
    """

    name: str
    time_pct: BeforeAfter | None
    force_pct: BeforeAfter | None
    fz_N: BeforeAfter | None


def list_left_out_rows(diagnosis: Diagnosis) -> tuple[list[LeftOutRow], LeftOutRow | None]:
    """A row per condition, and that of all conditions; None for the latter where fz was not
    recorded.
    """
    rows = []
    for condition in diagnosis.left_out:
        time_pct = None
        force_pct = None
        if condition.valley is not None:
            time_pct = condition.valley.time_error_pct
            force_pct = condition.valley.force_error_pct
        fz_N = measure_misfits([condition]).get(FORCE)
        rows.append(LeftOutRow(condition.condition, time_pct, force_pct, fz_N))
    of_all = measure_misfits(diagnosis.left_out).get(FORCE)
    if of_all is None:
        return rows, None
    time_pct = diagnosis.valley.get("valley_time_error_pct")
    force_pct = diagnosis.valley.get("valley_force_error_pct")
    return rows, LeftOutRow("All", time_pct, force_pct, of_all)


def describe_left_out(diagnosis: Diagnosis) -> str:
    """What the answer is worth on left-out conditions, in words; "" where there are none."""
    _, of_all = list_left_out_rows(diagnosis)
    if of_all is None or of_all.fz_N is None or of_all.fz_N.noise_floor is None:
        return ""
    text = (
        f"left out in turn, shaft as commanded: fz {format_change(of_all.fz_N)} N (noise and "
        f"scatter {format_significant(of_all.fz_N.noise_floor, 2)})"
    )
    if of_all.time_pct is None or of_all.force_pct is None:
        return text
    return (
        f"{text}; valley {format_change(of_all.time_pct)} % in time, "
        f"{format_change(of_all.force_pct)} % in force"
    )


def left_out_table(diagnosis: Diagnosis) -> Table:
    """A row per condition: errors of its valley, and rms of its fz, before and after."""
    rows, of_all = list_left_out_rows(diagnosis)
    digits = _count_digits([row.fz_N for row in rows if row.fz_N is not None])
    columns = (
        TableColumn("condition", "Condition"),
        TableColumn("time_before_pct", "before", over=TIME, digits=PCT_DIGITS),
        TableColumn("time_after_pct", "after", over=TIME, digits=PCT_DIGITS),
        TableColumn("force_before_pct", "before", over=SIZE, digits=PCT_DIGITS),
        TableColumn("force_after_pct", "after", over=SIZE, digits=PCT_DIGITS),
        TableColumn("fz_before_N", "before", over=RMS, digits=digits),
        TableColumn("fz_after_N", "after", over=RMS, digits=digits),
        TableColumn("floor_N", "noise, scatter", over=RMS, digits=digits),
    )
    foot: tuple[Foot, ...] = ()
    if of_all is not None:
        foot = (Foot(of_all.name, _sizes(of_all)),)
    table_rows = tuple(TableRow({"condition": row.name, **_sizes(row)}) for row in rows)
    return Table("left-out", CAPTION, columns, table_rows, foot)


def _sizes(row: LeftOutRow) -> dict[str, float | None]:
    sizes: dict[str, float | None] = {}
    if row.time_pct is not None:
        sizes["time_before_pct"] = row.time_pct.before
        sizes["time_after_pct"] = row.time_pct.after
    if row.force_pct is not None:
        sizes["force_before_pct"] = row.force_pct.before
        sizes["force_after_pct"] = row.force_pct.after
    if row.fz_N is not None:
        sizes["fz_before_N"] = row.fz_N.before
        sizes["fz_after_N"] = row.fz_N.after
        sizes["floor_N"] = row.fz_N.noise_floor
    return sizes


def _count_digits(misfits: Sequence[BeforeAfter]) -> int:
    """Decimals with which the smallest of these numbers has two digits; 2 where there is none."""
    sizes = [size for misfit in misfits for size in (misfit.after, misfit.noise_floor) if size]
    return max((places(size, 2) for size in sizes), default=2)


def left_out_curves_table(diagnosis: Diagnosis) -> Table:
    """All signals of the left-out conditions over time, with both models."""
    overlays = [overlay for condition in diagnosis.left_out for overlay in condition.overlays]
    rows = list_signal_rows(overlays, CURVES)
    return Table("left-out-signals", "", tuple(TableColumn(key) for key in CURVES), rows)


def choose_shown(left_out: Sequence[LeftOutCondition]) -> SignalOverlay | None:
    """fz of the condition that the nominal model misses most; None where fz was not recorded."""
    of_force = [
        overlay
        for condition in left_out
        for overlay in condition.overlays
        if overlay.signal == FORCE
    ]
    return max(of_force, key=lambda overlay: rms(overlay.measured - overlay.before), default=None)


def draw_left_out(overlay: SignalOverlay) -> str:
    """fz over time, measured and by both models, as inline SVG; below it the residual of the model
    after, with the band of noise and scatter. The residual of the nominal model leaves its frame.
    """
    before = overlay.measured - overlay.before
    after = overlay.measured - overlay.after
    limit_N = MARGIN * float(np.max(np.maximum(np.abs(after), BAND * overlay.floor)))
    with drawing():
        figure = Figure(figsize=SIZE_IN)
        force = figure.add_axes(FORCE_BOX)
        residual = figure.add_axes(RESIDUAL_BOX)
        for values, color, width, dashes in (
            (overlay.after, SIMULATED, 3.4, "-"),
            (overlay.before, OTHER, 1.6, DASHES),
            (overlay.measured, MEASURED, 1.0, "-"),
        ):
            force.plot(overlay.t_s, values, color=color, lw=width, ls=dashes)
        residual.fill_between(
            overlay.t_s,
            -BAND * overlay.floor,
            BAND * overlay.floor,
            color=ALIKE,
            alpha=0.55,
            lw=0.0,
        )
        residual.axhline(0.0, color=FAINT, lw=0.6)
        residual.plot(overlay.t_s, after, color=SIMULATED, lw=2.4)
        residual.plot(overlay.t_s, before, color=OTHER, lw=1.4, ls=DASHES)
        residual.set_ylim(-limit_N, limit_N)
        force.set_ylabel("fz (N)")
        residual.set_ylabel("residual (N)")
        figure.align_ylabels()
        residual.set_xlabel("time from the start of the motion (s)")
        for axes in (force, residual):
            axes.set_xlim(float(overlay.t_s[0]), float(overlay.t_s[-1]))
        lines = {"measured": overlay.measured, "before": overlay.before, "after": overlay.after}
        hovers = hover_values(force, overlay.t_s, "s", lines, "N")
        label = html_text(
            f"fz over time at {overlay.condition}, which was left out: measured, before and after, "
            "with the residual below"
        )
        return inline_svg(figure, "left out", label, hovers)


def describe_shown(overlay: SignalOverlay) -> str:
    """The caption of its figure."""
    misfit = _measure_misfit([overlay])
    return (
        f"{overlay.condition}, left out: fz misses by {format_significant(misfit.before, 2)} N rms "
        f"before, by {format_significant(misfit.after, 2)} N after; noise and scatter leave "
        f"{format_significant(misfit.noise_floor, 2)} N. Below: measured less simulated, with "
        f"\u00b1{number(BAND, 0)} standard deviations of noise and scatter."
    )
