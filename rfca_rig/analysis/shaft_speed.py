"""The average speed of the shaft over a stroke, which the paper's simulation uses in place of the commanded speed."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.recording.model import Stroke

Floats = NDArray[np.float64]

# Averages encoder noise at either end; the turn is long compared with it.
END_MEAN_S = 0.020
# A shaft that has made this share of its turn has arrived, even if the recording continues.
ARRIVED_SHARE = 0.998


@dataclass(frozen=True)
class AverageSpeed:
    """Average shaft speed and its source: "shaft angle", "shaft speed" or "command"."""

    speed_rad_s: float
    taken_from: str


def average_speed(stroke: Stroke, ramp_s: float) -> AverageSpeed:
    """Turned angle from the end of the drive's ramp to the end of the motion, divided by the time it took.

    Falls back to the mean recorded shaft speed, then to the commanded speed.
    """
    from_angle = _from_angle(stroke, ramp_s)
    if from_angle is not None:
        return AverageSpeed(from_angle, "shaft angle")
    from_speed = _from_speed(stroke, ramp_s)
    if from_speed is not None:
        return AverageSpeed(from_speed, "shaft speed")
    return AverageSpeed(stroke.speed_rad_s, "command")


def _from_angle(stroke: Stroke, ramp_s: float) -> float | None:
    trace = stroke.channel("shaft_angle_rad")
    if trace is None:
        return None
    t_s, angle_rad = _moving_part(*trace, ramp_s)
    # Both ends need their own samples to average over.
    if len(t_s) < 2 or t_s[-1] - t_s[0] < 2.0 * END_MEAN_S:
        return None
    # Angle and time are averaged over the same samples, so that a steady turn gives its exact speed.
    first, last = t_s <= t_s[0] + END_MEAN_S, t_s >= t_s[-1] - END_MEAN_S
    return float((angle_rad[last].mean() - angle_rad[first].mean()) / (t_s[last].mean() - t_s[first].mean()))


def _moving_part(t_s: Floats, angle_rad: Floats, ramp_s: float) -> tuple[Floats, Floats]:
    """Samples from the end of the ramp until the shaft has arrived at the angle where it stops."""
    after = t_s >= ramp_s
    t_s, angle_rad = t_s[after], angle_rad[after]
    if not len(t_s):
        return t_s, angle_rad
    turn = np.abs(angle_rad - angle_rad[0])
    arrived = int(np.argmax(turn >= ARRIVED_SHARE * turn.max()))
    return t_s[: arrived + 1], angle_rad[: arrived + 1]


def _from_speed(stroke: Stroke, ramp_s: float) -> float | None:
    """Mean of the recorded speed while the shaft runs. Without an angle, a standing shaft is recognised by less than half the commanded
    speed.
    """
    trace = stroke.channel("shaft_speed_rad_s")
    if trace is None:
        return None
    t_s, speed_rad_s = trace
    running = speed_rad_s[(t_s >= ramp_s) & (np.abs(speed_rad_s) > 0.5 * abs(stroke.speed_rad_s))]
    return float(running.mean()) if len(running) else None
