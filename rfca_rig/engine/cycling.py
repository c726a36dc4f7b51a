"""Cycle after cycle: the shaft turns on and on, and of each turn a few numbers are kept, in memory that does not grow."""

import math

import numpy as np

from rfca_rig.drivers.roles import ForceSamples, SensorScale, ShaftSamples
from rfca_rig.engine.loop import Loop
from rfca_rig.engine.sink import Cycle, Sink
from rfca_rig.engine.stages import MOVE_TICK_S
from rfca_rig.errors import Stopped
from rfca_rig.protocol.cycles import Cycles
from rfca_rig.protocol.plan import MOVE_RAMP_S, TURN_RAD

BEFORE_START_RAD = math.radians(30.0)  # where a cycle ends: in the air, short of the start angle, which is then reached forwards
CREEP_SHARE = 0.05  # of the speed: the last hundredths of a radian are not approached for ever
MOST_TURNS = 100_000  # drives tell the angle in single precision: at a gear of 9 it is known to 2.5 degrees by then


def cycle(loop: Loop, stage: Cycles, sink: Sink, scale: SensorScale) -> None:
    """Turns the shaft from the start angle until the last cycle is done, or the operator wants a stop: then at the end of the one after.

    Each cycle is handed over as soon as it is done. Raises Stopped where the drive has turned further than it can tell.
    """
    tally, turning = CycleTally(scale), Turning(loop.target_rad, stage)
    sink.begin(stage)
    sink.start(loop.now_s, 0.0)
    with loop.heard(tally.take):
        while not turning.is_over:
            loop.at_speed(turning.speed_rad_s(loop.target_rad), MOVE_TICK_S)
            if turning.has_passed(loop.target_rad):
                sink.cycle(tally.cycle(turning.number))
                if loop.is_to_end:
                    turning.end_soon()
    loop.at_speed(0.0, MOVE_TICK_S)
    loop.target_rad = loop.angle_rad  # a drive that sagged is behind; the way back starts where the shaft is
    sink.cycles(stage)
    check_turns(loop.angle_rad)


def check_turns(angle_rad: float) -> None:
    """Raises Stopped for an angle of more turns than a drive can tell well."""
    turns = abs(angle_rad) / TURN_RAD
    if turns > MOST_TURNS:
        raise Stopped(
            f"the shaft has turned {turns:.0f} times since the drive was switched on, and drives tell such angles only coarsely; "
            "switch the drive off and on again, check its zero, then go on with rfca-rig resume"
        )


class Turning:
    """How fast the shaft is to turn at each angle, and when a cycle is done. Angles are those commanded, which the shaft follows."""

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
        """Of the cycle done last."""
        return self._stage.first + self._done - 1

    def has_passed(self, target_rad: float) -> bool:
        """Whether one more cycle is done."""
        passed = target_rad >= self._end_rad(self._done + 1)
        self._done += passed
        return passed

    def end_soon(self) -> None:
        """The next cycle becomes the last: there is time to slow down in it."""
        self._count = min(self._count, self._done + 1)

    def speed_rad_s(self, target_rad: float) -> float:
        """Up evenly from the start, and down again towards the end of the last cycle: the root of twice acceleration times way."""
        top, both_ramps = self._stage.speed_rad_s, 2.0 * self._stage.speed_rad_s / MOVE_RAMP_S
        gone_rad, left_rad = target_rad - self._start_rad, self._end_rad(self._count) - target_rad
        return max(min(top, math.sqrt(both_ramps * max(min(gone_rad, left_rad), 0.0))), CREEP_SHARE * top)

    def _end_rad(self, count: int) -> float:
        return self._start_rad + TURN_RAD * count - BEFORE_START_RAD


class CycleTally:
    """What the cycle under way has brought so far."""

    def __init__(self, scale: SensorScale) -> None:
        self._counts_per_unit = np.repeat([scale.counts_per_N, scale.counts_per_Nm], 3)
        self._began: tuple[float, float] | None = None
        self._last = (math.nan, math.nan, math.nan)
        self._forget()

    def _forget(self) -> None:
        self._peak_force_N = self._peak_moment_Nm = 0.0
        self._min_fz_N = math.inf

    def take(self, shaft: ShaftSamples, force: ForceSamples) -> None:
        """One tick."""
        if len(shaft.angle_rad):
            self._last = float(shaft.host_s[-1]), float(shaft.device_s[-1]), float(shaft.angle_rad[-1])
            self._began = self._began or (float(shaft.device_s[0]), float(shaft.angle_rad[0]))
        if len(force.counts):
            wrench = force.counts / self._counts_per_unit
            squares = wrench * wrench
            self._peak_force_N = max(self._peak_force_N, math.sqrt(squares[:, :3].sum(axis=1).max()))
            self._peak_moment_Nm = max(self._peak_moment_Nm, math.sqrt(squares[:, 3:].sum(axis=1).max()))
            self._min_fz_N = min(self._min_fz_N, float(wrench[:, 2].min()))

    def cycle(self, number: int) -> Cycle:
        """The cycle that ends now; the next one begins."""
        host_s, device_s, angle_rad = self._last
        began_s, began_rad = self._began or (math.nan, math.nan)
        elapsed_s = device_s - began_s
        mean_speed_rad_s = (angle_rad - began_rad) / elapsed_s if elapsed_s > 0.0 else math.nan
        done = Cycle(number, host_s, device_s, self._peak_force_N, self._peak_moment_Nm, self._min_fz_N, mean_speed_rad_s)
        self._began = device_s, angle_rad
        self._forget()
        return done
