"""Phases of a stroke: touchdown, lift-off, and the valley between them.

In a measured stroke the contact is found from the force alone. The leg presses while the smoothed
fz stays below its level at rest by more than a tenth of its greatest depth, with an impulse that
free swinging cannot have. Touchdown is searched before it, where fz leaves its previous course.

Valid for one stroke per recording at up to about 5 rad/s, sampled at 500 Hz or faster. Touchdown is
then accurate to about 10 ms for a firm touch. It is up to 30 ms late for a touch that begins as
softly as the leg swings. Lift-off is the moment when the ground no longer pushes, not that of the
last contact. A simulated stroke has known contact forces and uses them.

Touchdown and lift-off are found by `local_quadratic`, a local quadratic least squares over a window
in time.

The valley is the most negative fz of the contact, after touchdown and before lift-off, and its
time. A plain minimum over the recording would be wrong: the spike of touchdown and the whip after
lift-off can be deeper. Measured and simulated strokes are evaluated by the same estimator, so that
smoothing affects both alike.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.model.stroke import SimulatedStroke
from rfca_rig.recording.model import Stroke

Floats = NDArray[np.float64]

# Three samples determine the parabola; two more begin to average noise.
MIN_SAMPLES = 5

PHASES = ("rest", "free", "touchdown", "loading", "release", "rebound")
REGIONS = ("I", "II", "III")
# Time after touchdown that belongs to the first impact, not to the loading.
TOUCHDOWN_LASTS_S = 0.030
# Whole width of the window over which fz is smoothed, and spacing of the smoothed trace.
SMOOTHING_S = 0.020
GRID_S = 0.001
# Share of the greatest depth of fz below its level at rest, from which on the leg presses.
PRESSING_DEPTH = 0.1
# 2 m v of a leg of 0.32 kg whose middle moves at 0.15 m * 5 rad/s: free swinging cannot have a
# larger impulse.
FREE_IMPULSE_NS = 0.5
# The first stretch with this share of the largest impulse is the contact: a later rebound may be as
# strong.
CONTACT_IMPULSE_SHARE = 0.5
# Touchdown: a line through this much of the past is extrapolated, and compared with a short stretch
# ahead.
COURSE_WINDOW_S = 0.020
LOOKAHEAD_S = 0.004
# Fall of fz below the extrapolated line that counts as a touch.
OFF_COURSE_N = 0.6

MIN_RECORDED_S = 2.0 * SMOOTHING_S


@dataclass(frozen=True)
class LocalFit:
    """Parabolas fitted around each of `t_s` (m,): value, slope per second, curvature per second
    squared; NaN with too few samples.

    `mean` of the same samples is less sharp. Beside a jump it stays within the range of the
    samples, which a parabola does not.
    """

    t_s: Floats
    mean: Floats
    value: Floats
    slope: Floats
    curvature: Floats


def local_quadratic(t_s: Floats, values: Floats, at_s: Floats, width_s: float) -> LocalFit:
    """Fit a parabola to the samples in a window around each of `at_s`.

    Parameters
    ----------
    t_s, values : (n,) samples, `t_s` ascending, in s, evenly spaced or not
    at_s : (m,) centres of the windows, in s
    width_s : whole width of a window, in s

    Returns
    -------
    LocalFit : arrays (m,), NaN where fewer than MIN_SAMPLES lie in the window

    Notes
    -----
    The window is defined in time, so that a trace is smoothed alike at 1 kHz and at 15 kHz.

    References
    ----------
    Savitzky and Golay, Anal. Chem. 36 (1964) 1627, for even spacing.
    """
    first = np.searchsorted(t_s, at_s - 0.5 * width_s, side="left")
    count = np.searchsorted(t_s, at_s + 0.5 * width_s, side="right") - first
    # Windows hold different numbers of samples. They are padded to the longest one, so that all
    # parabolas are solved in one batch. A window is a column: sums down the columns add whole rows,
    # which is several times faster.
    row = np.arange(max(int(count.max(initial=0)), 1))[:, None]
    inside = row < count
    pick = np.minimum(first + row, len(t_s) - 1)
    # Time in half widths: -1 to 1 within the window; padding counts as zero in all sums.
    x = np.where(inside, (t_s[pick] - at_s) / (0.5 * width_s), 0.0)
    y = np.where(inside, values[pick], 0.0)
    value, slope, curvature = _parabolas(x, y, count)
    mean = np.where(np.isnan(value), np.nan, y.sum(0) / np.maximum(count, 1))
    return LocalFit(
        at_s, mean, value, slope / (0.5 * width_s), 2.0 * curvature / (0.5 * width_s) ** 2
    )


def _parabolas(x: Floats, y: Floats, count: NDArray[np.intp]) -> tuple[Floats, Floats, Floats]:
    """Three coefficients (m,) of each column of x and y (n, m), by the normal equations; x in -1
    .. 1 keeps them well conditioned.
    """
    x2 = x * x
    s0 = count.astype(np.float64)
    s1 = x.sum(0)
    s2 = x2.sum(0)
    s3 = (x2 * x).sum(0)
    s4 = (x2 * x2).sum(0)
    r0 = y.sum(0)
    r1 = (x * y).sum(0)
    r2 = (x2 * y).sum(0)
    # The cofactors of the matrix of the normal equations, s0 s1 s2, s1 s2 s3, s2 s3 s4.
    c00 = s2 * s4 - s3 * s3
    c01 = s2 * s3 - s1 * s4
    c02 = s1 * s3 - s2 * s2
    c11 = s0 * s4 - s2 * s2
    c12 = s1 * s2 - s0 * s3
    c22 = s0 * s2 - s1 * s1
    determinant = s0 * c00 + s1 * c01 + s2 * c02
    # Samples at fewer than three distinct times leave the matrix singular, although there are
    # enough of them.
    solvable = (count >= MIN_SAMPLES) & (determinant > 1e-6)
    scale = np.divide(1.0, determinant, out=np.full(len(count), np.nan), where=solvable)
    return (
        (c00 * r0 + c01 * r1 + c02 * r2) * scale,
        (c01 * r0 + c11 * r1 + c12 * r2) * scale,
        (c02 * r0 + c12 * r1 + c22 * r2) * scale,
    )


@dataclass(frozen=True)
class StrokeRegion:
    """One of the paper's regions I to III with its borders, in seconds from the commanded start."""

    name: str
    begin_s: float
    end_s: float


@dataclass(frozen=True)
class Undetermined:
    """A value that could not be determined, and why, in words for the reader of a report."""

    reason: str


@dataclass(frozen=True)
class Contact:
    """The one contact of a stroke. `lift_off_s` is infinite where the recording ends first.
    `rest_N` is fz before the start.
    """

    touchdown_s: float
    lift_off_s: float
    rest_N: float


@dataclass(frozen=True)
class StrokePhases:
    """Borders between the phases of a stroke, in seconds from the commanded start; infinite
    where the phase was not reached.
    """

    touchdown_s: float = np.inf
    valley_s: float = np.inf
    lift_off_s: float = np.inf

    def number(self, t_s: Floats) -> NDArray[np.intp]:
        """Index into PHASES of each moment, same shape as `t_s`."""
        valley_s = min(self.valley_s, self.lift_off_s)
        borders = np.array(
            [0.0, self.touchdown_s, self.touchdown_s + TOUCHDOWN_LASTS_S, valley_s, self.lift_off_s]
        )
        # Borders must ascend, also where the valley follows touchdown at once or was not reached.
        return np.searchsorted(np.maximum.accumulate(borders), t_s, side="right")

    def regions(self, end_s: float) -> tuple[StrokeRegion, ...]:
        """Those of the regions I to III that begin before `end_s`, where the last is cut: free
        swing, loading, release.

        The paper compares lead and lag of the model in them (section IV.B). Its text names them and
        leaves their borders to Fig. 7. Without a valley the loading lasts to lift-off, as in
        `number`.
        """
        borders = (0.0, self.touchdown_s, min(self.valley_s, self.lift_off_s), self.lift_off_s)
        pairs = zip(REGIONS, borders[:-1], borders[1:], strict=True)
        return tuple(
            StrokeRegion(name, begin_s, min(to_s, end_s))
            for name, begin_s, to_s in pairs
            if begin_s < min(to_s, end_s)
        )


def smooth_trace(t_s: Floats, fz_N: Floats) -> LocalFit:
    """Smooth the trace (m,) by local parabolas over 20 ms, on a 1 ms grid that ends where half a
    window still fits.
    """
    start = float(t_s[0]) + 0.5 * SMOOTHING_S
    end = float(t_s[-1]) - 0.5 * SMOOTHING_S
    grid = GRID_S * np.arange(np.ceil(start / GRID_S), np.floor(end / GRID_S) + 1)
    return local_quadratic(t_s, fz_N, grid, SMOOTHING_S)


def find_contact(t_s: Floats, fz_N: Floats, smooth: LocalFit) -> Contact | Undetermined:
    """Find the contact of a measured stroke from its fz alone, or why there is none.

    Parameters
    ----------
    t_s, fz_N : (m,) time from the commanded start, ascending, in s, and force in N
    smooth : the same trace, smoothed
    """
    if not np.isfinite(smooth.value).all():
        where = float(smooth.t_s[~np.isfinite(smooth.value)][0])
        return Undetermined(
            f"fz has fewer than 5 samples within {1e3 * SMOOTHING_S:.0f} ms at "
            f"{where:.3f} s: a gap, or a rate under 250 Hz"
        )
    # Mean of fz before the start; of the first 20 ms where a recording begins with the motion.
    rest_N = float(fz_N[t_s <= max(0.0, float(t_s[0]) + SMOOTHING_S)].mean())
    pressing = _pressing(smooth, rest_N)
    if pressing is None:
        return Undetermined(
            f"no contact: fz never presses below its level at rest, {rest_N:.1f} N, with "
            f"more than {FREE_IMPULSE_NS:g} N s"
        )
    start_s = float(smooth.t_s[pressing.start])
    # A recording that ends under load has no lift-off; infinity keeps all later comparisons valid.
    reaches_end = pressing.stop == len(smooth.t_s)
    if reaches_end:
        lift_off_s = np.inf
    else:
        lift_off_s = float(smooth.t_s[pressing.stop])
    return Contact(_touchdown(t_s, fz_N, smooth, start_s), lift_off_s, rest_N)


def phases_of_simulation(stroke: SimulatedStroke, valley_s: float) -> StrokePhases:
    """Phases of a simulated stroke from its contact forces; `valley_s` from `find_valley`,
    infinite where refused.
    """
    touching = (stroke.normal_N > 0.0).any(axis=1)
    moments = stroke.t_s[touching & (stroke.t_s >= 0.0)]
    if not len(moments):
        return StrokePhases()
    # Contact may be lost briefly after touchdown, so lift-off counts only after the valley.
    apart = stroke.t_s[~touching & (stroke.t_s > valley_s)]
    lift_off_s = np.inf
    if len(apart):
        lift_off_s = float(apart[0])
    return StrokePhases(float(moments[0]), valley_s, lift_off_s)


def _pressing(smooth: LocalFit, rest_N: float) -> slice | None:
    """Grid stretch of the first long push. Spike, whip and rebound may be deeper, but carry only
    a fraction of its impulse.
    """
    below_N = rest_N - smooth.mean
    inside = (below_N > PRESSING_DEPTH * below_N.max()) & (smooth.t_s > 0.0)
    turns = np.diff(np.concatenate([[0], inside.astype(np.int8), [0]]))
    stretches = [
        slice(int(a), int(b))
        for a, b in zip(np.flatnonzero(turns > 0), np.flatnonzero(turns < 0), strict=True)
    ]
    impulses = [GRID_S * float(below_N[s].sum()) for s in stretches]
    if not impulses or max(impulses) < FREE_IMPULSE_NS:
        return None
    return next(
        s
        for s, impulse in zip(stretches, impulses, strict=True)
        if impulse >= CONTACT_IMPULSE_SHARE * max(impulses)
    )


def _touchdown(t_s: Floats, fz_N: Floats, smooth: LocalFit, pressing_s: float) -> float:
    """Where fz first falls off the straight course of the last 20 ms, between the maximum of the
    free swing and the push.

    Before this maximum, the drive's ramp bends the trace much like a soft touch, so nothing is
    searched there.
    """
    free = (smooth.t_s >= 0.0) & (smooth.t_s <= pressing_s)
    if not free.any():
        return pressing_s
    crest_s = float(smooth.t_s[free][smooth.value[free].argmax()])
    at_s = np.arange(max(crest_s, COURSE_WINDOW_S), pressing_s, GRID_S)
    # The line is fitted to the past window and extrapolated to the centre of the short stretch
    # ahead.
    course = local_quadratic(t_s, fz_N, at_s - 0.5 * COURSE_WINDOW_S, COURSE_WINDOW_S)
    ahead = local_quadratic(t_s, fz_N, at_s + 0.5 * LOOKAHEAD_S, 1.5 * LOOKAHEAD_S)
    expected_N = course.value + course.slope * 0.5 * (COURSE_WINDOW_S + LOOKAHEAD_S)
    off = np.flatnonzero(ahead.value < expected_N - OFF_COURSE_N)
    if len(off):
        return float(at_s[off[0]])
    return pressing_s


@dataclass(frozen=True)
class Valley:
    """Time from the commanded start and fz, which is negative where the ground pushes the leg
    up.
    """

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
    The time is where the slope of a parabola over 20 ms vanishes, the force is the parabola's value
    there. With 0.15 N of noise at 1 kHz and a valley as sharp as the paper's leg has, the time is
    good to about 1 ms and the force to 0.05 N.

    References
    ----------
    Table II of the paper.
    """
    valley, _ = valley_and_phases(t_s, fz_N)
    return valley


def stroke_valley(stroke: Stroke) -> Valley | Undetermined:
    """The valley of a recorded stroke."""
    trace = stroke.channel("fz_N")
    if trace is None:
        return Undetermined("fz was not recorded")
    return find_valley(*trace)


def describe_stroke(
    stroke: Stroke, valley: Valley | Undetermined | None = None
) -> dict[str, float | None]:
    """A row of numbers: the condition, and time and force of the valley, None where there is
    none; a caller may know the valley.
    """
    valley = valley or stroke_valley(stroke)
    time_s = None
    fz_N = None
    if isinstance(valley, Valley):
        time_s = valley.time_s
        fz_N = valley.fz_N
    return {
        "height_mm": round(1e3 * stroke.height_m, 6),
        "speed_rad_s": stroke.speed_rad_s,
        "repeat": stroke.repeat,
        "valley_time_s": time_s,
        "valley_fz_N": fz_N,
    }


def valley_and_phases(t_s: Floats, fz_N: Floats) -> tuple[Valley | Undetermined, StrokePhases]:
    """The valley and the phases that it separates, from times and forces (m,); a phase that was
    not reached begins at infinity.
    """
    recorded_s = 0.0
    if len(t_s):
        recorded_s = float(t_s[-1] - t_s[0])
    if recorded_s < MIN_RECORDED_S:
        return Undetermined(
            f"fz was recorded for {recorded_s:.3f} s only; a stroke needs "
            f"{MIN_RECORDED_S:g} s at least"
        ), StrokePhases()
    smooth = smooth_trace(t_s, fz_N)
    contact = find_contact(t_s, fz_N, smooth)
    if isinstance(contact, Undetermined):
        return contact, StrokePhases()
    valley = _valley_within(t_s, fz_N, smooth, contact)
    return valley, StrokePhases(contact.touchdown_s, valley_time_s(valley), contact.lift_off_s)


def valley_time_s(valley: Valley | Undetermined) -> float:
    """Time of the valley in s; infinite where there is none, so that nothing comes after it."""
    if isinstance(valley, Valley):
        return valley.time_s
    return np.inf


def _valley_within(
    t_s: Floats, fz_N: Floats, smooth: LocalFit, contact: Contact
) -> Valley | Undetermined:
    # The spike of touchdown may be deeper than the valley, so its time is left out of the search.
    begin_s = contact.touchdown_s + TOUCHDOWN_LASTS_S
    window = np.flatnonzero((smooth.t_s >= begin_s) & (smooth.t_s < contact.lift_off_s))
    if len(window) < 3:
        return Undetermined(
            f"contact at {contact.touchdown_s:.3f} s lasts less than touchdown, "
            f"{1e3 * TOUCHDOWN_LASTS_S:.0f} ms"
        )
    # The mean is searched, not the parabola: beside the jumps of the contact a parabola overshoots.
    lowest = int(window[smooth.mean[window].argmin()])
    refusal = _at_an_edge(smooth, window, lowest, contact)
    return refusal or _where_slope_vanishes(t_s, fz_N, smooth, lowest)


def _at_an_edge(
    smooth: LocalFit, window: NDArray[np.intp], lowest: int, contact: Contact
) -> Undetermined | None:
    """Refuses a minimum that comes from a border of the window. Towards the end, the force must
    have risen visibly again.
    """
    time_s = smooth.t_s[lowest]
    fz_N = smooth.mean[lowest]
    if time_s - smooth.t_s[window[0]] < 0.5 * SMOOTHING_S:
        return Undetermined(
            f"fz is lowest, {fz_N:.1f} N, right after touchdown at "
            f"{contact.touchdown_s:.3f} s: the spike outweighs the loading"
        )
    risen_N = smooth.mean[window[-1]] - fz_N
    if not np.isfinite(contact.lift_off_s) and risen_N < PRESSING_DEPTH * (contact.rest_N - fz_N):
        return Undetermined(
            f"fz still falls, {fz_N:.1f} N at {time_s:.3f} s, where the recording ends: "
            "record longer"
        )
    return None


def _where_slope_vanishes(
    t_s: Floats, fz_N: Floats, smooth: LocalFit, lowest: int
) -> Valley | Undetermined:
    # About 15 ms to either side on the 1 ms grid: the zero of the slope may differ a little from
    # the minimum of the mean.
    near = slice(max(lowest - 15, 0), lowest + 17)
    time = smooth.t_s[near]
    slope = smooth.slope[near]
    rising = np.flatnonzero((slope[:-1] <= 0.0) & (slope[1:] > 0.0))
    if not len(rising):
        return Undetermined(f"fz has no rounded minimum near {smooth.t_s[lowest]:.3f} s")
    i = int(rising[np.abs(time[rising] - smooth.t_s[lowest]).argmin()])
    # Linear interpolation of the slope between two grid points, then one parabola exactly there.
    time_s = float(time[i] - slope[i] * (time[i + 1] - time[i]) / (slope[i + 1] - slope[i]))
    fit = local_quadratic(t_s, fz_N, np.array([time_s]), SMOOTHING_S)
    return Valley(time_s, float(fit.value[0]))
