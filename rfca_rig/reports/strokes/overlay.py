"""Figure of one condition in the manner of the paper's Fig. 7 (c) to (f), with the residual below
on its own scale.

The figure of the cross-check has the contact force of the model and of MuJoCo in the same manner.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rfca_rig.analysis.compare import ComparedCondition
from rfca_rig.analysis.crosscheck import CheckedCondition
from rfca_rig.analysis.phases import StrokePhases, StrokeRegion, Valley
from rfca_rig.reports.style import (
    FAINT,
    MEASURED,
    SIMULATED,
    SIMULATED_EDGE,
    SMALL,
    SOFT,
    Hover,
    check_picture_path,
    drawing,
    envelope,
    hover_values,
    inline_svg,
    save_picture,
)

Floats = NDArray[np.float64]

# Resolution of a line, two points for each column.
COLUMNS = 330
# Points of all lines of a figure together; with many repeats each line is drawn coarser.
MOST_POINTS = 24000
SIZE_IN = (4.9, 3.5)
FORCE_BOX = (0.125, 0.43, 0.86, 0.465)
RESIDUAL_BOX = (0.125, 0.13, 0.86, 0.195)
# Positions above the frame, in heights of the force axes.
RULER_AT = 1.03
WORDS_AT = 1.13
# Share of the width that the word "lift-off" takes.
WORD_SHARE = 0.1
REST_DRAWN_S = 0.1
# Half the width of the parabola that is fitted to a valley.
BEFORE_VALLEY_S = 0.01

COLUMN_IN = 3.3
HEIGHT_IN = 3.6


@dataclass(frozen=True)
class OverlayDrawing:
    """The figure as inline SVG, with the scales that its caption states.

    The residual axis spans +-`residual_limit_N`; `beyond_N` is the largest residual where that is
    larger, else None.
    """

    svg: str
    force_span_N: float
    residual_limit_N: float
    beyond_N: float | None
    regions: tuple[StrokeRegion, ...]


def draw_overlay(compared: ComparedCondition, salt: str) -> OverlayDrawing:
    """Draws measured strokes thin and dark, simulated ones broad and light, with valleys and
    regions I to III; the residual below.

    The residual's scale covers everything up to the first valley, measured or simulated. After it,
    one stroke may have left the ground and the other not: the residual is then as large as the
    force itself. It is cut at the frame and stated in `beyond_N`.

    Parameters
    ----------
    compared
        The condition, with repeats and simulated strokes.
    salt
        Seed of the ids in the SVG, different for each figure of a page.
    """
    limit_N, beyond_N = _residual_scale(compared)
    columns = min(
        COLUMNS, MOST_POINTS // (2 * (2 * len(compared.repeats) + len(compared.simulated)))
    )
    with drawing():
        figure = Figure(figsize=SIZE_IN)
        force = figure.add_axes(FORCE_BOX)
        residual = figure.add_axes(RESIDUAL_BOX)
        end_s = compared.end_s
        draw_force(force, compared, end_s, columns)
        _draw_residual(residual, compared, limit_N, columns)
        for axes in (force, residual):
            axes.set_xlim(-REST_DRAWN_S, end_s)
        low, high = force.get_ylim()
        words = (
            f"fz over time at {compared.condition.label}, measured and simulated, with the "
            "residual below"
        )
        svg = inline_svg(figure, salt, words, _hovers(force, compared))
    return OverlayDrawing(svg, high - low, limit_N, beyond_N, compared.mean_phases().regions(end_s))


def draw_force(axes: Axes, compared: ComparedCondition, end_s: float, columns: int) -> None:
    for model in compared.simulated:
        shown = model.stroke.t_s <= end_s
        axes.plot(
            *envelope(model.stroke.t_s[shown], model.stroke.fz_N[shown], columns),
            color=SIMULATED,
            lw=2.8,
            solid_capstyle="round",
        )
    for repeat in compared.repeats:
        if len(repeat.t_s):
            axes.plot(*envelope(repeat.t_s, repeat.fz_N, columns), color=MEASURED, lw=0.55)
    _mark_valleys(
        axes,
        (s.valley for s in compared.simulated),
        marker="D",
        mfc=SIMULATED,
        mec=SIMULATED_EDGE,
        ms=5.0,
        mew=0.8,
    )
    _mark_valleys(
        axes,
        (r.valley for r in compared.repeats),
        marker="o",
        mfc="none",
        mec=MEASURED,
        ms=7.0,
        mew=0.8,
    )
    axes.margins(y=0.06)
    axes.set_ylabel("fz (N)")
    _mark_phases(axes, compared.mean_phases(), end_s)


def _mark_valleys(
    axes: Axes, valleys: Iterable[object], *, marker: str, mfc: str, mec: str, ms: float, mew: float
) -> None:
    known_valleys = [v for v in valleys if isinstance(v, Valley)]
    axes.plot(
        [v.time_s for v in known_valleys],
        [v.fz_N for v in known_valleys],
        ls="",
        marker=marker,
        mfc=mfc,
        mec=mec,
        ms=ms,
        mew=mew,
        zorder=5,
    )


def _mark_phases(axes: Axes, phases: StrokePhases, end_s: float) -> None:
    """Draws the borders of the phases with their words, and the regions between them on a ruler
    above the frame.
    """
    across = axes.get_xaxis_transform()
    # The word of a lift-off near the right edge is put on its left where there is room.
    width_s = end_s + REST_DRAWN_S
    last = (
        phases.lift_off_s > end_s - WORD_SHARE * width_s
        and phases.lift_off_s - phases.valley_s > WORD_SHARE * width_s
    )
    words = [
        (phases.touchdown_s, "contact", "center"),
        (phases.valley_s, "valley", "right"),
        (phases.lift_off_s, "lift-off", "right" if last else "left"),
    ]
    for at_s, word, side in [border for border in words if border[0] <= end_s]:
        axes.plot(
            [at_s, at_s],
            [0.0, WORDS_AT],
            color=FAINT,
            lw=0.5,
            ls=(0, (2, 2)),
            zorder=0,
            transform=across,
            clip_on=False,
        )
        axes.text(
            at_s,
            WORDS_AT + 0.01,
            word,
            transform=across,
            ha=side,
            va="bottom",
            fontsize=SMALL,
            color=SOFT,
        )
    for region in phases.regions(end_s):
        span_s = [region.begin_s, region.end_s]
        axes.plot(
            span_s,
            [RULER_AT, RULER_AT],
            color=FAINT,
            lw=1.0,
            marker="|",
            ms=4.0,
            transform=across,
            clip_on=False,
        )
        axes.text(
            float(np.mean(span_s)),
            RULER_AT + 0.015,
            region.name,
            transform=across,
            ha="center",
            va="bottom",
            fontsize=SMALL,
        )


def _hovers(axes: Axes, compared: ComparedCondition) -> list[Hover]:
    """fz of the first repeat and of the stroke simulated for it, as a pointer shows them."""
    for repeat, model in zip(
        compared.repeats,
        (*compared.simulated, *compared.simulated[-1:] * len(compared.repeats)),
        strict=False,
    ):
        if len(repeat.t_s):
            simulated_N = np.interp(repeat.t_s, model.stroke.t_s, model.stroke.fz_N, right=np.nan)
            return hover_values(
                axes, repeat.t_s, "s", {"measured": repeat.fz_N, "simulated": simulated_N}, "N"
            )
    return []


def _draw_residual(axes: Axes, compared: ComparedCondition, limit_N: float, columns: int) -> None:
    axes.axhline(0.0, color=SIMULATED, lw=1.6)
    for repeat in compared.repeats:
        known = np.isfinite(repeat.residual_N)
        if known.any():
            axes.plot(
                *envelope(repeat.t_s[known], repeat.residual_N[known], columns),
                color=MEASURED,
                lw=0.45,
            )
    axes.set_ylim(-limit_N, limit_N)
    axes.set_yticks([-limit_N, 0.0, limit_N])
    axes.set_xlabel("time from the start of the motion (s)")
    axes.set_ylabel("residual (N)")


def _residual_scale(compared: ComparedCondition) -> tuple[float, float | None]:
    """Limit of the residual axis, a round number in N; and the largest residual where it exceeds
    that, else None.
    """
    valleys = [s.valley for s in compared.simulated] + [r.valley for r in compared.repeats]
    first_s = (
        min((v.time_s for v in valleys if isinstance(v, Valley)), default=np.inf) - BEFORE_VALLEY_S
    )
    before = 0.0
    anywhere = 0.0
    for repeat in compared.repeats:
        size = np.nan_to_num(np.abs(repeat.residual_N))
        before = max(before, float(size[repeat.t_s < first_s].max(initial=0.0)))
        anywhere = max(anywhere, float(size.max(initial=0.0)))
    # At least 1 N: a finer scale would show nothing but noise.
    value = max(before, 1.0)
    decade = 10.0 ** np.floor(np.log10(value))
    limit_N = float(
        next(
            step * decade
            for step in (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
            if step * decade >= value
        )
    )
    if anywhere > limit_N:
        return limit_N, anywhere
    return limit_N, None


def write_crosscheck_picture(checked: Sequence[CheckedCondition], path: Path) -> None:
    """Writes a picture of the checked conditions to `path`, whose ending decides the format.
    Raises BadInput where that fails.
    """
    # The ending is checked before anything is drawn.
    check_picture_path(path)
    with drawing():
        # A fixed salt makes ids in the SVG, and so its bytes, the same each time; fonttype "none"
        # keeps text as text.
        mpl.rcParams.update({"svg.hashsalt": "crosscheck", "svg.fonttype": "none"})
        figure = Figure(figsize=(COLUMN_IN * len(checked), HEIGHT_IN), layout="constrained")
        axes = figure.subplots(
            2, len(checked), squeeze=False, sharex="col", sharey="row", height_ratios=(2.2, 1.0)
        )
        for column, condition in zip(axes.T, checked, strict=True):
            draw_crosscheck(column[0], column[1], condition)
        axes[0, 0].set_ylabel("contact force (N)")
        axes[1, 0].set_ylabel("difference (N)")
        axes[0, 0].legend(frameon=False, fontsize=SMALL)
        save_picture(figure, path)


def draw_crosscheck(force: Axes, difference: Axes, condition: CheckedCondition) -> None:
    t_s = condition.ours.t_s
    force.plot(t_s, condition.contact_N, color=SIMULATED, lw=2.8, label="this model")
    force.plot(t_s, condition.theirs.normal_N, color=MEASURED, lw=0.7, label="MuJoCo")
    force.set_title(f"{condition.label}: {condition.stroke_pct:.2g} %", fontsize=9.2)
    difference.plot(t_s, condition.contact_N - condition.theirs.normal_N, color=MEASURED, lw=0.6)
    difference.set_xlabel("time from the start of the motion (s)")
    # Only the contact is of interest: the axis shows it with 50 ms on either side.
    touching = t_s[(condition.contact_N > 0.0) | (condition.theirs.normal_N > 0.0)]
    force.set_xlim(float(np.min(touching)) - 0.05, float(np.max(touching)) + 0.05)
