"""What the recorded angle of a stroke shows: when the shaft starts and stops, its speed, and the
time in which it speeds up.

Entry point: `measure_motion`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

Floats = NDArray[np.float64]

# Shares of the travel. The start is fitted up to the first: before the leg touches, as a rule.
STARTS_WITHIN = 0.12
# Between them the speed is that of the middle of the stroke.
MIDDLE = (0.15, 0.85)
# The shaft has stopped where it stays beyond this share, or comes back from it.
STOPPED = 0.985
# A stop that is shorter cannot be told from the end of the recording.
SHORTEST_STOP_S = 0.1
# Ramps that are tried first, from a stiff servo to a slow one.
RAMPS_S = (0.01, 0.05, 0.2)
FEWEST_SAMPLES = 8


@dataclass(frozen=True)
class RecordedMotion:
    """One stroke by the clock of its file.

    Parameters
    ----------
    first_s
        Time of the first sample.
    start_s
        When the speed begins to rise.
    end_s
        When the shaft stops, None where it turns to the end.
    rest_rad
        Angle before the start; None where its unit is not known.
    speed_rad_s
        Mean speed in the middle of the stroke; None likewise.
    ramp_s
        Time in which the speed rises.
    """

    first_s: float
    start_s: float
    end_s: float | None
    rest_rad: float | None
    speed_rad_s: float | None
    ramp_s: float


def measure_motion(t_s: Floats, angle_rad: Floats) -> RecordedMotion | None:
    """The motion of one stroke; None where the angle shows none.

    Parameters
    ----------
    t_s : (m,) times, ascending
    angle_rad : (m,) angle of the shaft, rising during the stroke

    Notes
    -----
    The start is that of a rest, a speed that rises linearly, and a constant speed, fitted by least
    squares to the first part of the travel. Nothing is differentiated, so noise hardly shifts it.
    """
    farthest = int(np.argmax(angle_rad))
    first = max(int(np.searchsorted(t_s, t_s[0] + 0.05)), 3)
    rest_rad = float(np.median(angle_rad[:first]))
    travel = float(angle_rad[farthest] - rest_rad)
    share = (angle_rad - rest_rad) / travel if travel > 0.0 else np.zeros_like(angle_rad)
    middle = (share > MIDDLE[0]) & (share < MIDDLE[1]) & (np.arange(len(t_s)) <= farthest)
    beginning = int(np.argmax(share > STARTS_WITHIN))
    if np.count_nonzero(middle) < FEWEST_SAMPLES or beginning < FEWEST_SAMPLES:
        return None
    speed = float(np.polyfit(t_s[middle], angle_rad[middle], 1)[0])
    start_s, ramp_s, rest_rad = _fit_start(t_s[:beginning], angle_rad[:beginning], speed)
    return RecordedMotion(
        first_s=float(t_s[0]),
        start_s=round(start_s, 5),
        end_s=_find_end(t_s, share, farthest),
        rest_rad=rest_rad,
        speed_rad_s=speed,
        ramp_s=ramp_s,
    )


def _fit_start(t_s: Floats, angle_rad: Floats, speed_rad_s: float) -> tuple[float, float, float]:
    """Start and length of the ramp in s, and the angle at rest, of the samples (m,) of the first
    part.
    """

    def miss(point: Floats) -> Floats:
        start_s, ramp_s, rest_rad, speed = point
        since = np.clip(t_s - start_s, 0.0, None)
        rising = np.minimum(since, ramp_s)
        moved = speed * (0.5 * rising * rising / ramp_s + (since - rising))
        return np.asarray(rest_rad + moved - angle_rad)

    crossing_s = float(t_s[-1]) - (float(angle_rad[-1]) - float(angle_rad[0])) / speed_rad_s
    rest_rad = float(np.median(angle_rad[: max(len(t_s) // 4, 3)]))
    best = None
    for ramp_s in RAMPS_S:
        guess = [crossing_s - 0.5 * ramp_s, ramp_s, rest_rad, speed_rad_s]
        fit = least_squares(
            miss,
            guess,
            x_scale=[0.01, 0.02, 0.01, speed_rad_s],
            bounds=(
                [float(t_s[0]) - 1.0, 1e-4, -np.inf, 0.2 * speed_rad_s],
                [float(t_s[-1]), 1.0, np.inf, 5.0 * speed_rad_s],
            ),
        )
        if best is None or fit.cost < best.cost:
            best = fit
    assert best is not None
    start_s, ramp_s, rest_rad, _ = best.x
    return float(start_s), float(ramp_s), float(rest_rad)


def _find_end(t_s: Floats, share: Floats, farthest: int) -> float | None:
    """When the shaft has stopped, or turns back; None where it turns to the end."""
    stopped = int(np.argmax(share >= STOPPED))
    if t_s[-1] - t_s[stopped] < SHORTEST_STOP_S:
        return None
    turning = share[: farthest + 1]
    pace = float(t_s[stopped] - t_s[int(np.argmax(share > 0.5))]) / (STOPPED - 0.5)
    # At its mean pace the rest of the travel would take this long.
    is_turning = t_s[-1] - t_s[stopped] < 1.5 * pace * (1.0 - STOPPED)
    if is_turning or not turning.size:
        return None
    return round(float(t_s[stopped]), 5)
