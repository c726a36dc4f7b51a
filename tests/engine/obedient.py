"""A rig that simply obeys: the shaft stands where it was sent, the sensor hums. For plans, where
no physics is asked for.
"""

import numpy as np

from rfca_rig.clock import TwinClock
from rfca_rig.drivers.roles import ForceSamples, MotorStatus, SensorScale, ShaftSamples
from rfca_rig.engine.stopping import Sink
from tests.protocol.test_plans import RIG


class Obedient:
    """What motor, sensor and rack have in common here."""

    def __init__(self, clock: TwinClock) -> None:
        self._clock = clock
        self._read_s = 0.0
        self._angle_rad = RIG.parked_angle_rad
        self._speed_rad_s = 0.0
        self._told_rad_s = 0.0
        self._records = 0

    def command_angle(self, angle_rad, speed_rad_s=0.0):
        self._angle_rad = angle_rad
        self._speed_rad_s = 0.0
        self._since_s = self._clock.now_s()
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
        return ShaftSamples(
            *(np.array([value]) for value in (now_s, now_s, self._angle_rad, self._told_rad_s, 0.0))
        )


class Sensor(Obedient):
    def read(self):
        self._records += 1
        t_s = np.array([self._clock.now_s()])
        counts = np.full((1, 6), self._records % 7, np.int32)
        return ForceSamples(t_s, t_s, np.array([self._records]), np.zeros(1, np.uint32), counts)


class Nowhere(Sink):
    """Keeps nothing."""
