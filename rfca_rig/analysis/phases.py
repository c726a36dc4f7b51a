"""The phases of a stroke: when the leg touches, when it lets go, and what lies between.

A measured stroke knows its contact only by its force. Pressing is the stretch in which the smoothed fz stays below its level at rest by
more than a tenth of its greatest depth, and which carries an impulse that free swinging cannot have. Touchdown is sought before it,
where fz leaves the course it was on. Valid for one flap per recording at up to about 5 rad/s, sampled at 500 Hz or faster; touchdown
is then true to about 10 ms for a firm touch, and up to 30 ms late for one that begins as softly as the leg swings. Lift-off is the
moment the ground has ceased to push, not that of the last contact. A simulated stroke knows its contact forces and uses them.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.local_fit import LocalFit, local_quadratic
from rfca_rig.model.stroke import SimulatedStroke

Floats = NDArray[np.float64]

PHASES = ("rest", "free", "touchdown", "loading", "release", "rebound")
REGIONS = ("I", "II", "III")
TOUCHDOWN_LASTS_S = 0.030
SMOOTHING_S = 0.020
GRID_S = 0.001
PRESSING_DEPTH = 0.1
FREE_IMPULSE_NS = 0.5  # 2 m v of a 0.32 kg leg whose middle moves at 0.15 m * 5 rad/s
SAME_IMPULSE = 0.5
COURSE_S = 0.020
AHEAD_S = 0.004
OFF_COURSE_N = 0.6


@dataclass(frozen=True)
class StrokeRegion:
    """One of the paper's regions I to III with its borders, in seconds from the commanded start."""

    name: str
    begin_s: float
    end_s: float


@dataclass(frozen=True)
class Refused:
    """A value that could not be had, and why, in words for the reader of a report."""

    reason: str


@dataclass(frozen=True)
class Contact:
    """The one contact of a stroke. `lift_off_s` is infinite where the recording ends first. `rest_N` is fz before the start."""

    touchdown_s: float
    lift_off_s: float
    rest_N: float


@dataclass(frozen=True)
class StrokePhases:
    """Where the phases of a stroke meet, in seconds from the commanded start; infinite where the phase was not reached."""

    touchdown_s: float = np.inf
    valley_s: float = np.inf
    lift_off_s: float = np.inf

    def number(self, t_s: Floats) -> NDArray[np.intp]:
        """Index into PHASES of each moment, same shape as `t_s`."""
        valley_s = min(self.valley_s, self.lift_off_s)
        borders = np.array([0.0, self.touchdown_s, self.touchdown_s + TOUCHDOWN_LASTS_S, valley_s, self.lift_off_s])
        return np.searchsorted(np.maximum.accumulate(borders), t_s, side="right")

    def regions(self, end_s: float) -> tuple[StrokeRegion, ...]:
        """Those of the regions I to III that begin before `end_s`, where the last is cut: free swing, loading, release.

        The paper compares lead and lag of the model in them (section IV.B). Its text names them and leaves their borders to Fig. 7.
        Without a valley the loading lasts to lift-off, as in `number`.
        """
        borders = (0.0, self.touchdown_s, min(self.valley_s, self.lift_off_s), self.lift_off_s)
        pairs = zip(REGIONS, borders[:-1], borders[1:], strict=True)
        return tuple(StrokeRegion(name, begin_s, min(to_s, end_s)) for name, begin_s, to_s in pairs if begin_s < min(to_s, end_s))


def smoothed(t_s: Floats, fz_N: Floats) -> LocalFit:
    """The trace on a 1 ms grid, fitted over 20 ms around each moment; ends where half a window still fits."""
    start, end = float(t_s[0]) + 0.5 * SMOOTHING_S, float(t_s[-1]) - 0.5 * SMOOTHING_S
    grid = GRID_S * np.arange(np.ceil(start / GRID_S), np.floor(end / GRID_S) + 1)
    return local_quadratic(t_s, fz_N, grid, SMOOTHING_S)


def find_contact(t_s: Floats, fz_N: Floats, smooth: LocalFit) -> Contact | Refused:
    """The contact of a measured stroke from its fz alone. `t_s`, `fz_N` (m,), time from the commanded start, ascending."""
    if not np.isfinite(smooth.value).all():
        where = float(smooth.t_s[~np.isfinite(smooth.value)][0])
        return Refused(f"fz has fewer than 5 samples within {1e3 * SMOOTHING_S:.0f} ms at {where:.3f} s: a gap, or a rate under 250 Hz")
    rest_N = _rest_level(t_s, fz_N)
    pressing = _pressing(smooth, rest_N)
    if pressing is None:
        return Refused(f"no contact: fz never presses below its level at rest, {rest_N:.1f} N, with more than {FREE_IMPULSE_NS:g} N s")
    start_s = float(smooth.t_s[pressing.start])
    reaches_end = pressing.stop == len(smooth.t_s)
    lift_off_s = np.inf if reaches_end else float(smooth.t_s[pressing.stop])
    return Contact(_touchdown(t_s, fz_N, smooth, start_s), lift_off_s, rest_N)


def simulated_phases(stroke: SimulatedStroke, valley_s: float) -> StrokePhases:
    """Phases of the model's stroke by its own contact forces; `valley_s` from `valley.find_valley`, infinite where refused."""
    touching = (stroke.normal_N > 0.0).any(axis=1)
    moments = stroke.t_s[touching & (stroke.t_s >= 0.0)]
    if not len(moments):
        return StrokePhases()
    apart = stroke.t_s[~touching & (stroke.t_s > valley_s)]
    return StrokePhases(float(moments[0]), valley_s, float(apart[0]) if len(apart) else np.inf)


def _rest_level(t_s: Floats, fz_N: Floats) -> float:
    """Mean before the start; of the first 20 ms where a recording begins with the motion."""
    return float(fz_N[t_s <= max(0.0, float(t_s[0]) + SMOOTHING_S)].mean())


def _pressing(smooth: LocalFit, rest_N: float) -> slice | None:
    """Grid stretch of the first long push. Spike, whip and rebound may be deeper, but carry a fraction of its impulse."""
    below_N = rest_N - smooth.mean
    inside = (below_N > PRESSING_DEPTH * below_N.max()) & (smooth.t_s > 0.0)
    turns = np.diff(np.concatenate([[0], inside.astype(np.int8), [0]]))
    stretches = [slice(int(a), int(b)) for a, b in zip(np.flatnonzero(turns > 0), np.flatnonzero(turns < 0), strict=True)]
    impulses = [GRID_S * float(below_N[s].sum()) for s in stretches]
    if not impulses or max(impulses) < FREE_IMPULSE_NS:
        return None
    return next(s for s, impulse in zip(stretches, impulses, strict=True) if impulse >= SAME_IMPULSE * max(impulses))


def _touchdown(t_s: Floats, fz_N: Floats, smooth: LocalFit, pressing_s: float) -> float:
    """Where fz first falls off the straight course of the last 20 ms, between the crest of the free swing and the push.

    Before the crest the drive's ramp bends the trace much as a soft touch does, so nothing is looked for there.
    """
    free = (smooth.t_s >= 0.0) & (smooth.t_s <= pressing_s)
    if not free.any():
        return pressing_s
    crest_s = float(smooth.t_s[free][smooth.value[free].argmax()])
    at_s = np.arange(max(crest_s, COURSE_S), pressing_s, GRID_S)
    course = local_quadratic(t_s, fz_N, at_s - 0.5 * COURSE_S, COURSE_S)
    ahead = local_quadratic(t_s, fz_N, at_s + 0.5 * AHEAD_S, 1.5 * AHEAD_S)
    expected_N = course.value + course.slope * 0.5 * (COURSE_S + AHEAD_S)
    off = np.flatnonzero(ahead.value < expected_N - OFF_COURSE_N)
    return float(at_s[off[0]]) if len(off) else pressing_s
