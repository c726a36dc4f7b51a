"""The valley of a stroke: the most negative fz of the contact, after touchdown and before lift-off, and its time.

A plain minimum over the recording would be wrong: the spike of touchdown and the whip after lift-off can be deeper. Measured and simulated
strokes are evaluated by the same estimator, so that smoothing affects both alike.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.phases import (
    PRESSING_DEPTH,
    SMOOTHING_S,
    TOUCHDOWN_LASTS_S,
    Contact,
    LocalFit,
    StrokePhases,
    Undetermined,
    find_contact,
    local_quadratic,
    smooth_trace,
)
from rfca_rig.recording.model import Stroke

Floats = NDArray[np.float64]

MIN_RECORDED_S = 2.0 * SMOOTHING_S


@dataclass(frozen=True)
class Valley:
    """Time from the commanded start and fz, which is negative where the ground pushes the leg up."""

    time_s: float
    fz_N: float


def find_valley(t_s: Floats, fz_N: Floats) -> Valley | Undetermined:
    """The valley of one stroke, or why there is none.

    Parameters
    ----------
    t_s : (m,) ascending, in s from the commanded start, evenly spaced or not, 500 Hz or faster
    fz_N : (m,) in N, negative where the ground pushes the leg up

    Notes
    -----
    The time is where the slope of a parabola over 20 ms vanishes, the force is the parabola's value there. With 0.15 N of noise at 1 kHz
    and a valley as sharp as the paper's leg has, the time is good to about 1 ms and the force to 0.05 N.

    References
    ----------
    Table II of the paper.
    """
    valley, _ = valley_and_phases(t_s, fz_N)
    return valley


def stroke_valley(stroke: Stroke) -> Valley | Undetermined:
    """The valley of a recorded stroke."""
    trace = stroke.channel("fz_N")
    return Undetermined("fz was not recorded") if trace is None else find_valley(*trace)


def describe_stroke(stroke: Stroke) -> dict[str, float | None]:
    """A row of numbers: the condition, and time and force of the valley, None where there is none."""
    valley = stroke_valley(stroke)
    found = valley if isinstance(valley, Valley) else None
    return {
        "height_mm": round(1e3 * stroke.height_m, 6),
        "speed_rad_s": stroke.speed_rad_s,
        "repeat": stroke.repeat,
        "valley_time_s": None if found is None else found.time_s,
        "valley_fz_N": None if found is None else found.fz_N,
    }


def valley_and_phases(t_s: Floats, fz_N: Floats) -> tuple[Valley | Undetermined, StrokePhases]:
    """The valley and the phases that it separates, from times and forces (m,); a phase that was not reached begins at infinity."""
    recorded_s = float(t_s[-1] - t_s[0]) if len(t_s) else 0.0
    if recorded_s < MIN_RECORDED_S:
        return Undetermined(f"fz was recorded for {recorded_s:.3f} s only; a stroke needs {MIN_RECORDED_S:g} s at least"), StrokePhases()
    smooth = smooth_trace(t_s, fz_N)
    contact = find_contact(t_s, fz_N, smooth)
    if isinstance(contact, Undetermined):
        return contact, StrokePhases()
    valley = _valley_within(t_s, fz_N, smooth, contact)
    valley_s = np.inf if isinstance(valley, Undetermined) else valley.time_s
    return valley, StrokePhases(contact.touchdown_s, valley_s, contact.lift_off_s)


def _valley_within(t_s: Floats, fz_N: Floats, smooth: LocalFit, contact: Contact) -> Valley | Undetermined:
    # The spike of touchdown may be deeper than the valley, so its time is left out of the search.
    begin_s = contact.touchdown_s + TOUCHDOWN_LASTS_S
    window = np.flatnonzero((smooth.t_s >= begin_s) & (smooth.t_s < contact.lift_off_s))
    if len(window) < 3:
        return Undetermined(f"contact at {contact.touchdown_s:.3f} s lasts less than touchdown, {1e3 * TOUCHDOWN_LASTS_S:.0f} ms")
    # The mean is searched, not the parabola: beside the jumps of the contact a parabola overshoots.
    lowest = int(window[smooth.mean[window].argmin()])
    refusal = _at_an_edge(smooth, window, lowest, contact)
    return refusal or _where_slope_vanishes(t_s, fz_N, smooth, lowest)


def _at_an_edge(smooth: LocalFit, window: NDArray[np.intp], lowest: int, contact: Contact) -> Undetermined | None:
    """Refuses a minimum that comes from a border of the window. Towards the end, the force must have risen visibly again."""
    time_s, fz_N = smooth.t_s[lowest], smooth.mean[lowest]
    if time_s - smooth.t_s[window[0]] < 0.5 * SMOOTHING_S:
        return Undetermined(
            f"fz is lowest, {fz_N:.1f} N, right after touchdown at {contact.touchdown_s:.3f} s: the spike outweighs the loading"
        )
    risen_N = smooth.mean[window[-1]] - fz_N
    if not np.isfinite(contact.lift_off_s) and risen_N < PRESSING_DEPTH * (contact.rest_N - fz_N):
        return Undetermined(f"fz still falls, {fz_N:.1f} N at {time_s:.3f} s, where the recording ends: record longer")
    return None


def _where_slope_vanishes(t_s: Floats, fz_N: Floats, smooth: LocalFit, lowest: int) -> Valley | Undetermined:
    # About 15 ms to either side on the 1 ms grid: the zero of the slope may differ a little from the minimum of the mean.
    near = slice(max(lowest - 15, 0), lowest + 17)
    time, slope = smooth.t_s[near], smooth.slope[near]
    rising = np.flatnonzero((slope[:-1] <= 0.0) & (slope[1:] > 0.0))
    if not len(rising):
        return Undetermined(f"fz has no rounded minimum near {smooth.t_s[lowest]:.3f} s")
    i = int(rising[np.abs(time[rising] - smooth.t_s[lowest]).argmin()])
    # Linear interpolation of the slope between two grid points, then one parabola exactly there.
    time_s = float(time[i] - slope[i] * (time[i + 1] - time[i]) / (slope[i + 1] - slope[i]))
    fit = local_quadratic(t_s, fz_N, np.array([time_s]), SMOOTHING_S)
    return Valley(time_s, float(fit.value[0]))
