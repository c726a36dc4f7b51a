"""Simulation that matches a measured stroke: same height, and the same shaft motion as far as it
is known.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.phases import Undetermined, Valley, find_valley
from rfca_rig.analysis.repeats import Condition
from rfca_rig.model.motion import ShaftMotion, follow, ramp_to_speed
from rfca_rig.model.parameters import RigModel
from rfca_rig.model.stroke import SimulatedStroke, simulate_stroke, simulate_stroke_at_speed
from rfca_rig.recording.model import Stroke, collect_strokes_before

Floats = NDArray[np.float64]

# Averages encoder noise at either end; the turn is long compared with it.
END_MEAN_S = 0.020
# A shaft that has made this share of its turn has arrived, even if the recording continues.
ARRIVED_SHARE = 0.998
Shaft = Literal["commanded", "average", "recorded"]

# Samples of the simulated stroke, and how much of the rest before it is shown.
GRID_S = 5e-4
REST_BEFORE_S = 0.1
# Simulated over measured duration: a model that reaches its valley later than the leg did needs the
# time to.
DURATION_FACTOR = 1.3


@dataclass(frozen=True)
class AverageSpeed:
    """Average shaft speed and its source: "shaft angle", "shaft speed" or "command"."""

    speed_rad_s: float
    taken_from: str


def average_speed(stroke: Stroke, ramp_s: float) -> AverageSpeed:
    """Turned angle from the end of the drive's ramp to the end of the motion, divided by the time
    it took.

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
    # Angle and time are averaged over the same samples, so that a steady turn gives its exact
    # speed.
    first = t_s <= t_s[0] + END_MEAN_S
    last = t_s >= t_s[-1] - END_MEAN_S
    return float(
        (angle_rad[last].mean() - angle_rad[first].mean()) / (t_s[last].mean() - t_s[first].mean())
    )


def _moving_part(t_s: Floats, angle_rad: Floats, ramp_s: float) -> tuple[Floats, Floats]:
    """Samples from the end of the ramp until the shaft has arrived at the angle where it stops."""
    after = t_s >= ramp_s
    t_s = t_s[after]
    angle_rad = angle_rad[after]
    if not len(t_s):
        return t_s, angle_rad
    turn = np.abs(angle_rad - angle_rad[0])
    arrived = int(np.argmax(turn >= ARRIVED_SHARE * turn.max()))
    return t_s[: arrived + 1], angle_rad[: arrived + 1]


def _from_speed(stroke: Stroke, ramp_s: float) -> float | None:
    """Mean of the recorded speed while the shaft runs. Without an angle, a standing shaft is
    recognised by less than half the commanded speed.
    """
    trace = stroke.channel("shaft_speed_rad_s")
    if trace is None:
        return None
    t_s, speed_rad_s = trace
    running = speed_rad_s[(t_s >= ramp_s) & (np.abs(speed_rad_s) > 0.5 * abs(stroke.speed_rad_s))]
    if len(running):
        return float(running.mean())
    return None


@dataclass(frozen=True)
class MatchedSimulation:
    """One simulated stroke and its valley, with its shaft speed (the mean where a recorded turn
    was followed) and where that came from.
    """

    shaft_speed_rad_s: float
    shaft_taken_from: str
    stroke: SimulatedStroke
    valley: Valley | Undetermined


def simulate_matching(
    rig: RigModel, condition: Condition, shaft: Shaft
) -> tuple[MatchedSimulation, ...]:
    """Simulate one stroke for all repeats; with `shaft` "recorded" one for each repeat, in their
    order.

    Parameters
    ----------
    rig
        The nominal model.
    condition
        Measured strokes of one height and one commanded speed.
    shaft
        "commanded": the condition's speed. "average": the mean of the repeats' average speeds, as
        in the paper. Both begin at the nominal start angle. "recorded": each repeat's own shaft
        angle.

    Raises
    ------
    SimulationFailed
        Where the model cannot be computed.
    """
    if shaft == "recorded":
        return tuple(_following(rig, condition, stroke) for stroke in condition.strokes)
    speed_rad_s = condition.speed_rad_s
    taken_from = "command"
    if shaft == "average":
        averages = [average_speed(stroke, rig.drive.ramp_s) for stroke in condition.strokes]
        speed_rad_s = float(np.mean([a.speed_rad_s for a in averages]))
        taken_from = " and ".join(sorted({a.taken_from for a in averages}))
    end_s = DURATION_FACTOR * max(last_moment_s(stroke) for stroke in condition.strokes)
    simulated = simulate_stroke_at_speed(
        rig,
        condition.height_m,
        speed_rad_s,
        make_grid(end_s),
        strokes_before=condition.strokes_before,
    )
    return (_counterpart(speed_rad_s, taken_from, simulated),)


def _following(rig: RigModel, condition: Condition, stroke: Stroke) -> MatchedSimulation:
    average = average_speed(stroke, rig.drive.ramp_s)
    motion = _motion_from_recording(rig, stroke)
    # The motion is unknown after the last recorded shaft angle.
    end_s = min(float(motion.breaks_s[-1]), last_moment_s(stroke))
    simulated = simulate_stroke(
        rig,
        condition.height_m,
        motion,
        make_grid(end_s),
        strokes_before=collect_strokes_before((stroke,)),
    )
    return _counterpart(average.speed_rad_s, average.taken_from, simulated)


def _motion_from_recording(rig: RigModel, stroke: Stroke) -> ShaftMotion:
    """Motion from the recorded shaft angle; else from the recorded speed, integrated from the
    nominal start angle; else as commanded.
    """
    angle = stroke.channel("shaft_angle_rad")
    speed = stroke.channel("shaft_speed_rad_s")
    if angle is not None:
        return follow(*angle)
    start_rad = rig.leg.start_angle_rad
    if speed is None:
        return ramp_to_speed(start_rad, stroke.speed_rad_s, rig.drive.ramp_s, last_moment_s(stroke))
    t_s, speed_rad_s = speed
    # Trapezoidal rule; the turn is then shifted so that it is zero at the commanded start.
    turned = np.concatenate(
        [[0.0], np.cumsum(0.5 * (speed_rad_s[1:] + speed_rad_s[:-1]) * np.diff(t_s))]
    )
    return follow(t_s, start_rad + turned - float(np.interp(0.0, t_s, turned)))


def _counterpart(
    speed_rad_s: float, taken_from: str, simulated: SimulatedStroke
) -> MatchedSimulation:
    return MatchedSimulation(
        speed_rad_s, taken_from, simulated, find_valley(simulated.t_s, simulated.fz_N)
    )


def last_moment_s(stroke: Stroke) -> float:
    """Time of the last sample of any channel."""
    return max(float(stream.t_s[-1]) for stream in stroke.streams.values())


def make_grid(end_s: float) -> Floats:
    """Sample times (m,) of a simulated stroke, from the rest before it to `end_s`."""
    return GRID_S * np.arange(
        -round(REST_BEFORE_S / GRID_S), int(end_s / GRID_S) + 1, dtype=np.float64
    )
