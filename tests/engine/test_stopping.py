"""The one way out: asked three times, bounded in time, and measured."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.clock import TwinClock
from rfca_rig.drivers.roles import ShaftSamples
from rfca_rig.engine.interfaces import Bench
from rfca_rig.engine.stopping import WATCH_LIMIT_S, disable_motor, stop
from rfca_rig.errors import DeviceError


class Coasting:
    """A shaft that goes on evenly slower once it is let go; deaf for the first `deaf` times."""

    def __init__(self, clock, speed_rad_s=3.0, stands_after_s=0.2, deaf=0, tells=True):
        self._clock = clock
        self._speed = speed_rad_s
        self._stands_s = stands_after_s
        self._deaf = deaf
        self._tells = tells
        self.asked = 0
        self._off_s = np.inf

    def disable(self):
        self.asked += 1
        if self.asked <= self._deaf:
            raise DeviceError("no buffer space")
        self._off_s = min(self._off_s, self._clock.now_s())

    def read(self):
        t_s = min(self._clock.now_s() - self._off_s, self._stands_s)
        angle = self._speed * (t_s - 0.5 * t_s**2 / self._stands_s)
        speed = self._speed * (1.0 - t_s / self._stands_s)
        if self._tells:
            values = [self._clock.now_s(), self._clock.now_s(), angle, speed, 0.0]
        else:
            values = []
        return ShaftSamples(*(np.array(values[i : i + 1]) for i in range(5)))


class Sensor:
    stopped = 0

    def stop(self):
        self.stopped += 1


def bench(**motor):
    clock = TwinClock()
    return Bench(Coasting(clock, **motor), Sensor(), None, clock, is_real=False)


def test_standstill_is_what_was_measured():
    one = bench()
    seen = stop(one)
    assert seen.latency_s == pytest.approx(0.2, abs=0.011)
    assert seen.turned_rad == pytest.approx(0.3, abs=0.001)  # half the speed for the time
    assert "turned by 17.2 deg" in seen.text()
    assert one.sensor.stopped == 1


def test_a_shaft_that_swings_on_is_not_waited_for():
    one = bench(stands_after_s=10.0)
    assert np.isnan(stop(one).latency_s)
    assert one.clock.now_s() == pytest.approx(WATCH_LIMIT_S, abs=0.011)


def test_a_drive_that_tells_nothing_is_said_to():
    assert "tells nothing" in stop(bench(tells=False)).text()


def test_a_bus_that_refuses_is_asked_again_and_the_sensor_is_stopped_whatever_comes():
    one = bench(deaf=2)
    stop(one)
    assert one.motor.asked == 3
    deaf = bench(deaf=100)
    with pytest.raises(DeviceError, match="press the emergency stop"):
        stop(deaf)
    assert deaf.motor.asked == 3
    assert deaf.sensor.stopped == 1
    assert 0.2 < deaf.clock.now_s() < 0.3  # until its own watchdog has acted


def test_stopping_twice_is_stopping_once():
    one = bench()
    stop(one)
    assert stop(one).latency_s == pytest.approx(0.0, abs=0.011)


def test_letting_go_does_not_wait_where_the_drive_obeys():
    one = replace(bench())
    disable_motor(one.motor, one.clock)
    assert one.clock.now_s() == 0.0
