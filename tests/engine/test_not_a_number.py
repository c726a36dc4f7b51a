"""A comparison with NaN is false: each place that compares with a limit does so such that NaN is
beyond it.
"""

from collections.abc import Callable
from dataclasses import replace
from math import nan

import numpy as np
import pytest

from rfca_rig.clock import TwinClock
from rfca_rig.devices.cubemars.driver import await_standstill
from rfca_rig.drivers.drive_report import EncoderJumpMonitor
from rfca_rig.drivers.guard import TorqueOffResult, prove_guard
from rfca_rig.drivers.roles import MotorStatus, ShaftSamples
from rfca_rig.engine.interfaces import Bench
from rfca_rig.engine.limit_monitor import LimitMonitor, Tracking
from rfca_rig.engine.run import RampUp
from rfca_rig.engine.stages import check_turns
from rfca_rig.engine.stopping import stop
from rfca_rig.errors import BadInput, DeviceError, RigError, Stopped, Trip, Tripped
from rfca_rig.protocol.check import Load, check_plan
from rfca_rig.protocol.plan import Approach
from tests.engine.obedient import Motor, Sensor
from tests.engine.rigs import one_condition, twin_rig
from tests.engine.test_trips import LIMITS, SCALE, WELL, Rig


def track(**values: float) -> None:
    rig = Rig()
    rig.ticks(1, tracking=Tracking(0.0, 0.0, 0.0, 0.0)._replace(**values))


def report(**values: float) -> None:
    rig = Rig()
    rig.ticks(1)
    rig.ticks(
        1, shaft=replace(rig.shaft(), **{name: np.array([value]) for name, value in values.items()})
    )


def feel(name: str) -> None:
    rig = Rig()
    rig.ticks(1)
    samples = rig.force()
    values = getattr(samples, name).astype(np.float64)
    values[-1] = nan
    rig.ticks(1, force=lambda: replace(samples, **{name: values}))


def tell(**values: float) -> None:
    Rig().ticks(1, status=WELL.__class__(**{**vars(WELL), **values}))


LIMITED: dict[str, tuple[Callable[[], None], Trip]] = {
    "angle": (lambda: track(angle_rad=nan), Trip.FOLLOWING),
    "speed": (lambda: track(speed_rad_s=nan), Trip.OVERSPEED),
    "reported angle": (lambda: report(angle_rad=nan), Trip.JUMP),
    "device time of an angle": (lambda: report(device_s=nan), Trip.JUMP),
    "host time of an angle": (lambda: report(host_s=nan), Trip.READING_OLD),
    "counts": (lambda: feel("counts"), Trip.FORCE),
    "device time of a record": (lambda: feel("device_s"), Trip.SENSOR_BLIND),
    "temperature": (lambda: tell(temperature_C=nan), Trip.DRIVE_HOT),
    "silence": (lambda: tell(silent_s=nan), Trip.DRIVE_SILENT),
    "age of the torque": (lambda: tell(torque_age_s=nan), Trip.READING_OLD),
    "length of a tick": (lambda: LimitMonitor(LIMITS, SCALE, 0.0).gap(nan, 0.002), Trip.LATE),
}


@pytest.mark.parametrize("name", LIMITED)
def test_the_limit_monitor_by_itself(name: str) -> None:
    act, code = LIMITED[name]
    with pytest.raises(Tripped) as found:
        act()
    assert found.value.code == code


@pytest.mark.parametrize("load", [Load(nan, 1.0), Load(1.0, nan)])
def test_a_first_stroke_and_a_plan(load: Load) -> None:
    with pytest.raises(Tripped) as found:
        RampUp(twin_rig().facts().limits, {}).take(Approach(0.215, 3.0, 4.0, 0.05, 3.5), load)
    assert found.value.code == Trip.FULL_SPEED_TOO_MUCH
    plan = one_condition(twin_rig())
    with pytest.raises(BadInput, match="the model expects"):
        check_plan(plan, {plan.flaps[0]: load})


def test_turns_of_the_shaft() -> None:
    with pytest.raises(Stopped):
        check_turns(nan)


def test_a_step_of_the_encoder() -> None:
    monitor = EncoderJumpMonitor()
    monitor.follow(0.0, 0.0, 0.0, 0.0)
    monitor.follow(0.001, 0.001, nan, 0.0)
    assert monitor.fault is not None


def test_a_shaft_is_not_at_rest_before_it_is_energised() -> None:
    clock = TwinClock()

    def speed_rad_s() -> float:
        clock.wait_until(clock.now_s() + 0.002)
        return nan

    with pytest.raises(DeviceError, match="does not come to rest"):
        await_standstill(clock, speed_rad_s)


def test_a_shaft_does_not_stand_after_the_stop() -> None:
    clock = TwinClock()

    class Confused(Motor):
        def read(self) -> ShaftSamples:
            return replace(super().read(), speed_rad_s=np.array([nan]))

    motor = Confused(clock)
    motor.enable()
    assert np.isnan(stop(Bench(motor, Sensor(clock), motor, clock, is_real=False)).latency_s)


@pytest.mark.parametrize(("held_Nm", "left_Nm"), [(1.0, nan), (nan, 5.0)])
def test_a_guardian_is_not_proven(held_Nm: float, left_Nm: float) -> None:
    class Guard:
        def await_let_go(self, _limit_s: float) -> TorqueOffResult:
            return TorqueOffResult(0.1, 0.1, 3, left_Nm)

    with pytest.raises(RigError, match="still shows"):
        prove_guard(Guard(), held_Nm, 0.1, 1.0, answers=True)


def test_a_status_with_all_numbers_is_no_reason_to_stop() -> None:
    Rig().ticks(1, status=MotorStatus("closed loop", None, 0.0, 30.0, 0.0))
