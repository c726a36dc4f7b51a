"""Figures of an exam: calibration of probabilities, detection by size, errors of parameters, misfit
removed.
"""

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from rfca_rig.escaping import html_text
from rfca_rig.exam import cases
from rfca_rig.exam.answer import CLASS, EXTRA, RIGHT, WRONG
from rfca_rig.exam.claims import ClaimCalibration
from rfca_rig.exam.score import Share
from rfca_rig.exam.scored import ParameterDeviation, ScoredCase
from rfca_rig.reports.style import ALIKE, BAD, FAINT, MEASURED, PALE, SMALL, drawing, inline_svg

WIDTH_IN = 4.3
HEIGHT_IN = 3.1
# Height of the line of one effect in the figure of parameters.
LINE_IN = 0.17
# Relative errors beyond these are drawn at the border.
SMALLEST = 1e-3
LARGEST = 10.0
# Kinds of cases whose parameters and fitted models are scored.
SCORED_KINDS = (cases.SINGLE, cases.PAIR)
# Parts of a stacked bar from below: outcomes, colour, words. The part without outcomes takes all
# that no other part lists.
PARTS = (
    ((RIGHT,), MEASURED, "right"),
    ((CLASS,), ALIKE, "in its indistinguishable set"),
    ((), PALE, "none identified"),
    ((WRONG, EXTRA), BAD, "wrong effect"),
)


def draw_reliability(found: ClaimCalibration) -> str:
    """Reliability diagram: share of right claims over the stated probability, with 90 % bounds;
    numbers of claims above.
    """
    return _draw_figure(
        lambda axes: _reliability(axes, found),
        HEIGHT_IN,
        "share of claims that are right against the stated probability",
    )


def draw_power(marked: Sequence[ScoredCase]) -> str:
    """Shares of outcomes for single effects over their strength, in bins of equal width."""
    single = [case for case in marked if case.kind == cases.SINGLE]
    return _draw_figure(
        lambda axes: _draw_power_axes(axes, single),
        HEIGHT_IN,
        "outcomes of cases with one effect, by its strength",
    )


def draw_parameter_errors(marked: Sequence[ScoredCase]) -> str:
    """Relative error of each parameter of a right answer, by effect; hollow where the truth is
    outside the 90 % interval.
    """
    deviations = [
        deviation for case in marked if case.kind in SCORED_KINDS for deviation in case.deviations
    ]
    effects = sorted({deviation.effect for deviation in deviations}, reverse=True)
    height_in = max(HEIGHT_IN, 0.75 + LINE_IN * len(effects))
    return _draw_figure(
        lambda axes: _errors(axes, deviations, effects),
        height_in,
        "relative errors of parameters by effect",
        left_in=1.75,
    )


def draw_gaps(marked: Sequence[ScoredCase]) -> str:
    """Histogram of the share of the misfit on held-out conditions that right answers remove;
    cases that got worse are left of 0.
    """
    right = [case for case in marked if case.kind in SCORED_KINDS and case.outcome == RIGHT]
    closed = [case.gap_closed for case in right if case.gap_closed is not None]
    return _draw_figure(
        lambda axes: _gaps(axes, closed),
        HEIGHT_IN,
        "share of the misfit that right answers remove on held-out conditions",
    )


def _draw_figure(
    draw: Callable[[Axes], None], height_in: float, label: str, left_in: float = 0.6
) -> str:
    with drawing():
        figure = Figure(figsize=(WIDTH_IN, height_in))
        box = (
            left_in / WIDTH_IN,
            0.5 / height_in,
            (WIDTH_IN - left_in - 0.22) / WIDTH_IN,
            (height_in - 0.8) / height_in,
        )
        draw(figure.add_axes(box))
        return inline_svg(figure, label, html_text(label))


def _reliability(axes: Axes, scores: ClaimCalibration) -> None:
    axes.plot([0.0, 1.0], [0.0, 1.0], color=FAINT, lw=0.7, ls=(0, (3, 2)), zorder=0)
    for count, mean, right in scores.bins:
        if count:
            # Two one-sided bounds of 95 % (Clopper and Pearson) make an interval of 90 %.
            share = Share(round(count * right), count)
            axes.plot([mean, mean], [share.lower, share.upper], color=MEASURED, lw=1.1)
            axes.plot(
                [mean], [right], ls="", marker="o", ms=5.5, mfc=MEASURED, mec="white", mew=0.8
            )
            axes.text(
                mean, 1.04, str(count), ha="center", va="bottom", fontsize=SMALL, color="#555555"
            )
    _unit_axes(axes)
    axes.set_xlabel("stated probability")
    axes.set_ylabel("share right")


def _draw_power_axes(axes: Axes, single: Sequence[ScoredCase]) -> None:
    # A strength of exactly 1 belongs to the last bin.
    level = np.array(
        [min(int(case.strength * cases.LEVELS), cases.LEVELS - 1) for case in single], dtype=int
    )
    total = np.bincount(level, minlength=cases.LEVELS)
    centres = (np.arange(cases.LEVELS) + 0.5) / cases.LEVELS
    below = np.zeros(cases.LEVELS)
    listed = {outcome for outcomes, _, _ in PARTS for outcome in outcomes}
    for outcomes, colour, words in PARTS:
        if outcomes:
            inside = [case.outcome in outcomes for case in single]
        else:
            inside = [case.outcome not in listed for case in single]
        counts = np.bincount(level[np.array(inside, dtype=bool)], minlength=cases.LEVELS)
        share = counts / np.maximum(total, 1)
        axes.bar(centres, share, 0.86 / cases.LEVELS, bottom=below, color=colour, label=words)
        below = below + share
    for x, count in zip(centres, total, strict=True):
        axes.text(x, 1.02, str(count), ha="center", va="bottom", fontsize=SMALL, color="#555555")
    _unit_axes(axes)
    axes.set_xlabel("strength, from hardly visible (0) to gross (1)")
    axes.set_ylabel("share of cases")


def _unit_axes(axes: Axes) -> None:
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(0.0, 1.0)
    # Markers on the border of the unit square are not cut in half.
    for spread in (axes.lines, axes.collections):
        for artist in spread:
            artist.set_clip_on(False)


def _errors(axes: Axes, deviations: Sequence[ParameterDeviation], effects: Sequence[str]) -> None:
    for covered, face, edge in (
        (True, MEASURED, MEASURED),
        (None, FAINT, FAINT),
        (False, "none", BAD),
    ):
        some = [deviation for deviation in deviations if deviation.covered is covered]
        x = np.clip([deviation.error for deviation in some], SMALLEST, LARGEST)
        axes.plot(
            x,
            [effects.index(deviation.effect) for deviation in some],
            ls="",
            marker="o",
            ms=4.2,
            mfc=face,
            mec=edge,
            mew=0.9,
            alpha=0.85,
        )
    axes.set_xscale("log")
    axes.set_xlim(0.8 * SMALLEST, 1.25 * LARGEST)
    # The goal for the median error of parameters in the exam.
    axes.axvline(0.1, color=FAINT, lw=0.7, ls=(0, (3, 2)), zorder=0)
    axes.set_xticks([0.001, 0.01, 0.1, 1.0, 10.0], ["0.1 %", "1 %", "10 %", "100 %", "1000 %"])
    axes.minorticks_off()
    axes.set_ylim(-0.7, max(len(effects), 1) - 0.3)
    axes.set_yticks(
        range(len(effects)), [effect.replace("_", " ") for effect in effects], fontsize=SMALL
    )
    axes.set_xlabel("error relative to what the effect changes")


def _gaps(axes: Axes, closed: Sequence[float]) -> None:
    edges = np.linspace(-0.2, 1.1, 14)
    # Values beyond the axis count in the outermost bins.
    axes.hist(
        np.clip(closed, edges[0] + 1e-9, edges[-1] - 1e-9),
        edges.tolist(),
        color=ALIKE,
        edgecolor="white",
        linewidth=0.8,
    )
    if closed:
        axes.axvline(float(np.median(closed)), color=MEASURED, lw=1.4)
    # The goal for the median share in the exam.
    axes.axvline(0.8, color=FAINT, lw=0.7, ls=(0, (3, 2)))
    axes.set_xlim(edges[0], edges[-1])
    axes.set_xlabel("share of the misfit removed (1: down to the noise)")
    axes.set_ylabel("right answers")
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
