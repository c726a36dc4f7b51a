"""Fatigue cycles: the shaft turns without pause. Of each turn a few numbers are kept, in memory that does not grow."""

import math

import numpy as np

from rfca_rig.drivers.roles import ForceSamples, SensorScale, ShaftSamples
from rfca_rig.engine.loop import Loop
from rfca_rig.engine.stages import MOVE_TICK_S
from rfca_rig.engine.stopping import Cycle, Sink
from rfca_rig.errors import Stopped
from rfca_rig.protocol.plan import MOVE_RAMP_S, TURN_RAD, Cycles

# A cycle ends in the air, this far before the start angle. The start angle is then reached forwards: a bent leg that
# is pushed backwards wedges.
BEFORE_START_RAD = math.radians(30.0)
# Least share of the stage's speed. The square-root profile alone would approach its end ever more slowly and never
# command a start from rest.
CREEP_SHARE = 0.05
# Drives report the angle in single precision: at a gear ratio of 9 it is resolved to 2.5 degrees after so many turns.
MAX_TURNS = 100_000


def run_cycles(loop: Loop, stage: Cycles, sink: Sink, scale: SensorScale) -> None:
    """Turns the shaft from the start angle until the last cycle is done. After a stop request, one more cycle is the last.

    Each cycle is handed to the sink as soon as it is done. Raises Stopped where the drive has made more turns than it can report well.

    Parameters
    ----------
    loop : Loop
        The control loop, with the shaft at the start angle.
    stage : Cycles
        Speed and number of the cycles.
    sink : Sink
        Receives every cycle.
    scale : SensorScale
        Counts of the force sensor per N and per N m.
    """
    tally, turning = CycleTally(scale), CycleProfile(loop.target_rad, stage)
    sink.begin(stage)
    sink.start(loop.now_s, 0.0)
    with loop.listen(tally.take):
        while not turning.is_over:
            loop.step_at_speed(turning.speed_rad_s(loop.target_rad), MOVE_TICK_S)
            if turning.count_if_complete(loop.target_rad):
                # Cycles are counted by the commanded angle, which grows steadily, not by the reported one, which lags
                # and has noise.
                sink.cycle(tally.cycle(turning.number))
                if loop.is_stop_requested:
                    # One more cycle, not an immediate end: the shaft needs part of a turn to slow down in the air.
                    turning.end_after_next()
    loop.step_at_speed(0.0, MOVE_TICK_S)
    # A drive that sagged under load is behind its target. The way back must begin where the shaft really is.
    loop.target_rad = loop.angle_rad
    sink.cycles(stage)
    # Checked between blocks of cycles, when all cycles are handed over: the run can be resumed without loss.
    check_turns(loop.angle_rad)


def check_turns(angle_rad: float) -> None:
    """Raises Stopped where the angle has more turns than a drive can report precisely."""
    turns = abs(angle_rad) / TURN_RAD
    if turns > MAX_TURNS:
        raise Stopped(
            f"the shaft has turned {turns:.0f} times since the drive was switched on, and drives tell such angles only coarsely; "
            "switch the drive off and on again, check its zero, then go on with rfca-rig resume"
        )


class CycleProfile:
    """Speed of the shaft at each angle, and the end of each cycle. All angles are commanded ones, which the shaft follows."""

    def __init__(self, start_rad: float, stage: Cycles) -> None:
        self._stage = stage
        self._start_rad = start_rad
        self._count = stage.count
        self._done = 0

    @property
    def is_over(self) -> bool:
        return self._done >= self._count

    @property
    def number(self) -> int:
        """Of the cycle completed last, counted over the whole run."""
        return self._stage.first + self._done - 1

    def count_if_complete(self, target_rad: float) -> bool:
        """Whether one more cycle is complete at this target angle; counts it."""
        is_complete = target_rad >= self._end_rad(self._done + 1)
        self._done += is_complete
        return is_complete

    def end_after_next(self) -> None:
        """Makes the next cycle the last one, so that there is room to slow down in it."""
        self._count = min(self._count, self._done + 1)

    def speed_rad_s(self, target_rad: float) -> float:
        """Speed in rad/s: constant acceleration from the start, constant deceleration towards the end of the last cycle.

        At a distance s from either end it is sqrt(2 a s), where a is the stage's speed divided by MOVE_RAMP_S; at most the stage's speed.
        """
        # The same profile serves both ends: the shorter distance decides. Rounding may make it slightly negative,
        # hence the 0.
        top, both_ramps = self._stage.speed_rad_s, 2.0 * self._stage.speed_rad_s / MOVE_RAMP_S
        from_start_rad, to_end_rad = target_rad - self._start_rad, self._end_rad(self._count) - target_rad
        return max(min(top, math.sqrt(both_ramps * max(min(from_start_rad, to_end_rad), 0.0))), CREEP_SHARE * top)

    def _end_rad(self, count: int) -> float:
        return self._start_rad + TURN_RAD * count - BEFORE_START_RAD


class CycleTally:
    """Peak loads and mean speed of the cycle under way."""

    def __init__(self, scale: SensorScale) -> None:
        self._counts_per_unit = np.repeat([scale.counts_per_N, scale.counts_per_Nm], 3)
        self._began: tuple[float, float] | None = None
        self._last = (math.nan, math.nan, math.nan)
        self._forget()

    def _forget(self) -> None:
        self._peak_force_N = self._peak_moment_Nm = 0.0
        self._min_fz_N = math.inf

    def take(self, shaft: ShaftSamples, force: ForceSamples) -> None:
        """Adds the samples of one tick; `force.counts` (m, 6) are raw counts, both blocks may be empty."""
        if len(shaft.angle_rad):
            self._last = float(shaft.host_s[-1]), float(shaft.device_s[-1]), float(shaft.angle_rad[-1])
            # By the device's own clock: the host's arrival times jitter with the load of the computer.
            self._began = self._began or (float(shaft.device_s[0]), float(shaft.angle_rad[0]))
        if len(force.counts):
            wrench = force.counts / self._counts_per_unit
            squares = wrench * wrench
            self._peak_force_N = max(self._peak_force_N, math.sqrt(squares[:, :3].sum(axis=1).max()))
            self._peak_moment_Nm = max(self._peak_moment_Nm, math.sqrt(squares[:, 3:].sum(axis=1).max()))
            self._min_fz_N = min(self._min_fz_N, float(wrench[:, 2].min()))

    def cycle(self, number: int) -> Cycle:
        """The cycle that ends now; the next one begins where it ended."""
        host_s, device_s, angle_rad = self._last
        began_s, began_rad = self._began or (math.nan, math.nan)
        elapsed_s = device_s - began_s
        mean_speed_rad_s = (angle_rad - began_rad) / elapsed_s if elapsed_s > 0.0 else math.nan
        done = Cycle(number, host_s, device_s, self._peak_force_N, self._peak_moment_Nm, self._min_fz_N, mean_speed_rad_s)
        # The next cycle begins at this sample, not at the next one: no part of a turn is left out of a mean speed.
        self._began = device_s, angle_rad
        self._forget()
        return done
