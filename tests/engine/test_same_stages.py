"""The list that is checked, printed and timed is the list that is run: for any plan, on a rig that simply obeys."""

import numpy as np
from hypothesis import HealthCheck, given, settings

from rfca_rig.cli.planning import _rows
from rfca_rig.clock import TwinClock
from rfca_rig.drivers.roles import ForceSamples, MotorStatus, SensorScale, ShaftSamples
from rfca_rig.engine.bench import Bench
from rfca_rig.engine.run import run_plan
from rfca_rig.engine.sink import Sink
from tests.protocol.random_plans import PLANS
from tests.protocol.test_plans import RIG


class Obedient:
    """Motor, sensor and rack in one: the shaft stands where it was sent, the sensor hums."""

    def __init__(self, clock: TwinClock) -> None:
        self._clock, self._read_s = clock, 0.0
        self._angle_rad, self._speed_rad_s, self._told_rad_s = RIG.parked_angle_rad, 0.0, 0.0
        self._records = 0

    def command_angle(self, angle_rad, speed_rad_s=0.0):
        self._angle_rad, self._speed_rad_s, self._since_s = angle_rad, 0.0, self._clock.now_s()
        self._told_rad_s = speed_rad_s

    def command_speed(self, speed_rad_s):
        self._move()
        self._speed_rad_s = self._told_rad_s = speed_rad_s

    def _move(self):
        now_s = self._clock.now_s()
        self._angle_rad += self._speed_rad_s * (now_s - self._since_s)
        self._since_s = now_s

    def enable(self):
        self._since_s = self._clock.now_s()

    def disable(self):
        self._speed_rad_s = 0.0
        self._since_s = self._clock.now_s()

    def set_height(self, height_m):
        pass

    start = stop = disable

    def scale(self):
        return SensorScale(1e6, 1e6, 100.0)

    def status(self):
        return MotorStatus("closed loop", None, 0.0)


class Motor(Obedient):
    def read(self):
        self._move()
        now_s = self._clock.now_s()
        return ShaftSamples(*(np.array([value]) for value in (now_s, now_s, self._angle_rad, self._told_rad_s, 0.0)))


class Sensor(Obedient):
    def read(self):
        self._records += 1
        t_s = np.array([self._clock.now_s()])
        counts = np.full((1, 6), self._records % 7, np.int32)
        return ForceSamples(t_s, t_s, np.array([self._records]), np.zeros(1, np.uint32), counts)


class Nowhere(Sink):
    """Keeps nothing."""


@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(plan=PLANS)
def test_what_is_run_is_what_was_planned_in_no_more_than_the_time_that_was_told(plan):
    clock, carried_out = TwinClock(), []
    motor, sensor = Motor(clock), Sensor(clock)
    run_plan(plan, Bench(motor, sensor, motor, clock, is_real=False), Nowhere(), carried_out.append)
    assert carried_out == list(plan.stages)
    assert len(_rows(plan, {})) == len(carried_out)
    assert clock.now_s() <= plan.duration_s + 1.0
