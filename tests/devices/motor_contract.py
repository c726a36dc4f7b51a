"""What every driver of a shaft motor must do, written once; each device inherits it and runs it on its own twin.

A device's test file says how to make its driver and its twin, how to leave a stale set-point in the drive and how to make it
fail, and adds tests of what only it does:

    class TestMyDrive(MotorContract):
        def driver(self, bus, clock): ...
"""

import re
from contextlib import AbstractContextManager
from typing import Any

import can
import numpy as np
import pytest

from rfca_rig.clock import Clock, TwinClock
from rfca_rig.drivers.roles import ShaftMotor, ShaftSamples
from rfca_rig.errors import DeviceError
from rfca_rig.twins.can_wire import can_wire
from tests.devices.motor_rig import MotorRig, drained, motor_rig
from tests.devices.rotor import Rotor

NUMBERS_THAT_ARE_NONE = [float("nan"), float("inf"), -float("inf")]


class Failing(can.BusABC):
    """A bus whose adapter was pulled."""

    channel_info = "pulled"

    def __init__(self) -> None:
        super().__init__(channel="pulled")

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002
        raise can.CanOperationError("transmit buffer full")

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:  # noqa: ARG002
        raise can.CanOperationError("no such device")


class FullFor(can.BusABC):
    """A bus whose transmit queue is full for the first few frames."""

    channel_info = "full"

    def __init__(self, frames: int) -> None:
        super().__init__(channel="full")
        self._left = frames
        self.sent: list[can.Message] = []

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002
        self._left -= 1
        if self._left >= 0:
            raise can.CanOperationError("transmit buffer full")
        self.sent.append(msg)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:  # noqa: ARG002
        return None, False


class MotorContract:
    """Inherit, and fill in what raises NotImplementedError; the tolerances are one count of the wire and what the drive's loop leaves."""

    ANGLE_TOLERANCE_RAD = 2e-3
    SPEED_TOLERANCE_RAD_S = 1e-2
    TORQUE_TOLERANCE_Nm = 0.05
    ENABLING_TORQUE_Nm = 0.05  # a loop that is stiff in the angle turns one count into torque
    FOLLOWING_TOLERANCE_RAD = 0.02  # behind a target that moves at 2 rad/s
    TELLS_TEMPERATURE = True

    def driver(self, bus: can.BusABC, clock: Clock) -> ShaftMotor:
        raise NotImplementedError

    def twin(self, bus: can.BusABC, watchdog_s: float | None) -> Any:
        """The other end of the wire; with `watchdog_s` None it runs on for ever, as many drives do."""
        raise NotImplementedError

    def leave_stale_set_point(self, bus: can.BusABC) -> None:
        """Says to the drive, before it is enabled, to be somewhere else and fast."""
        raise NotImplementedError

    def fail(self, twin: Any) -> str:
        """Gives the drive an error of its own; returns the pattern of what must be said: its code, and what that means."""
        raise NotImplementedError

    def refuse(self, twin: Any) -> str:
        """Makes every attempt to enable the drive end in an error of its own; returns the pattern of what must be said."""
        raise NotImplementedError

    def rig(self, rotor: Rotor | None = None, watchdog_s: float | None = 0.1) -> AbstractContextManager[MotorRig]:
        return motor_rig(self.driver, lambda bus: self.twin(bus, watchdog_s), rotor)

    # -- enabling ------------------------------------------------------------------------------------------------------------

    def test_enabling_moves_nothing_even_where_a_stale_set_point_waits_in_the_drive(self) -> None:
        with self.rig(Rotor(angle_rad=1.2)) as rig:
            self.leave_stale_set_point(rig.onlooker)
            rig.motor.enable()
            shaft = rig.run(0.2, angle_rad=1.2)
            angles_rad = np.array([angle_rad for _, angle_rad, _ in rig.turned])
            assert np.abs(angles_rad - 1.2).max() < self.ANGLE_TOLERANCE_RAD
            assert np.abs(shaft.angle_rad - 1.2).max() < self.ANGLE_TOLERANCE_RAD
            torques_Nm = np.array([law.torque_Nm(1.2, 0.0) for _, law in rig.rotor.drives])
            assert np.abs(torques_Nm).max() < self.ENABLING_TORQUE_Nm
            assert rig.motor.status().fault is None

    @pytest.mark.parametrize("angle_rad", [-11.0, 14.0, 200.0])
    def test_enabling_moves_nothing_however_often_the_shaft_had_turned_before(self, angle_rad: float) -> None:
        with self.rig(Rotor(angle_rad=angle_rad)) as rig:
            rig.motor.enable()
            begun_rad = rig.motor.read().angle_rad[-1]
            rig.run(0.2, angle_rad=begun_rad)
            assert abs(rig.rotor.angle_rad - angle_rad) < self.ANGLE_TOLERANCE_RAD

    def test_the_shaft_has_been_heard_once_it_is_enabled_and_nothing_of_it_is_lost(self) -> None:
        with self.rig() as rig:
            rig.motor.enable()
            assert len(rig.motor.read().angle_rad) > 0
            assert len(rig.motor.read().angle_rad) == 0

    def test_a_loaded_shaft_is_held_where_it_stands(self) -> None:
        with self.rig(Rotor(angle_rad=0.3)) as rig:
            rig.motor.enable()
            rig.rotor.load_Nm = 1.0
            shaft = rig.run(2.0, angle_rad=0.3)
            assert shaft.torque_Nm[-1] == pytest.approx(-1.0, abs=self.TORQUE_TOLERANCE_Nm)
            assert abs(rig.rotor.speed_rad_s) < self.SPEED_TOLERANCE_RAD_S
            assert rig.rotor.angle_rad == pytest.approx(0.3, abs=0.02)

    def test_enabling_again_after_disabling_begins_where_the_shaft_then_is(self) -> None:
        with self.rig() as rig:
            rig.motor.enable()
            rig.run(0.5, angle_rad=-0.2)
            rig.motor.disable()
            rig.rotor.speed_rad_s = 2.2  # a hand turns it
            rig.run(0.5)
            rig.rotor.angle_rad, rig.rotor.speed_rad_s = 0.9, 0.0
            rig.run(0.05)
            rig.motor.enable()
            rig.run(0.2, angle_rad=0.9)
            assert rig.rotor.angle_rad == pytest.approx(0.9, abs=self.ANGLE_TOLERANCE_RAD)

    def test_a_refused_enable_says_with_which_error_of_the_drive_and_leaves_no_torque(self) -> None:
        with self.rig() as rig:
            said = self.refuse(rig.twin)
            with pytest.raises(DeviceError, match=said):
                rig.motor.enable()
            rig.tick()
            assert rig.rotor.drives[-1][1].torque_Nm(1.0, 1.0) == 0.0

    def test_a_drive_that_is_not_there_is_told_within_two_seconds(self) -> None:
        clock = TwinClock()
        with can_wire() as (here, _), pytest.raises(DeviceError, match="check"):
            self.driver(here, clock).enable()
        assert clock.now_s() <= 2.0

    # -- commanding ----------------------------------------------------------------------------------------------------------

    @pytest.mark.parametrize("speed_rad_s", [3.2, -1.7])
    def test_a_commanded_speed_is_reached(self, speed_rad_s: float) -> None:
        with self.rig() as rig:
            rig.motor.enable()
            shaft = rig.run(1.0, speed_rad_s=speed_rad_s)
            assert rig.rotor.speed_rad_s == pytest.approx(speed_rad_s, abs=self.SPEED_TOLERANCE_RAD_S)
            assert shaft.speed_rad_s[-20:].mean() == pytest.approx(speed_rad_s, abs=2.0 * self.SPEED_TOLERANCE_RAD_S)
            assert rig.motor.status().fault is None

    def test_a_commanded_angle_is_reached_and_held(self) -> None:
        with self.rig() as rig:
            rig.motor.enable()
            rig.run(2.0, angle_rad=-0.7)
            assert rig.rotor.angle_rad == pytest.approx(-0.7, abs=self.ANGLE_TOLERANCE_RAD)
            assert abs(rig.rotor.speed_rad_s) < self.SPEED_TOLERANCE_RAD_S

    def test_a_moving_target_is_followed(self) -> None:
        with self.rig() as rig:
            rig.motor.enable()
            for tick in range(500):
                rig.motor.command_angle(0.3 + 2.0 * 2e-3 * tick, 2.0)
                rig.tick()
                rig.motor.read()
            assert abs(0.3 + 2.0 * 2e-3 * 500 - rig.rotor.angle_rad) < self.FOLLOWING_TOLERANCE_RAD

    def test_ticks_of_10_ms_hold_as_well(self) -> None:
        with self.rig() as rig:
            rig.motor.enable()
            rig.rotor.load_Nm = 1.0
            rig.run(1.5, angle_rad=0.3, tick_s=0.01)
            assert abs(rig.rotor.speed_rad_s) < self.SPEED_TOLERANCE_RAD_S
            assert rig.rotor.angle_rad == pytest.approx(0.3, abs=0.02)

    def test_the_speed_under_a_load_comes_back(self) -> None:
        with self.rig() as rig:
            rig.motor.enable()
            rig.run(0.5, speed_rad_s=3.0)
            rig.rotor.load_Nm = -2.0
            rig.run(1.5, speed_rad_s=3.0)
            assert rig.rotor.speed_rad_s == pytest.approx(3.0, abs=self.SPEED_TOLERANCE_RAD_S)

    @pytest.mark.parametrize("value", NUMBERS_THAT_ARE_NONE)
    def test_a_command_that_is_no_number_is_refused_and_not_sent(self, value: float) -> None:
        with self.rig() as rig:
            rig.motor.enable()
            drained(rig.onlooker)
            for act in (rig.motor.command_speed, rig.motor.command_angle):
                with pytest.raises(DeviceError, match="nothing was sent"):
                    act(value)
            assert drained(rig.onlooker) == []

    # -- reading -------------------------------------------------------------------------------------------------------------

    @pytest.mark.parametrize("speed_rad_s", [14.0, -14.0])
    def test_the_angle_goes_on_over_many_turns(self, speed_rad_s: float) -> None:
        with self.rig() as rig:
            rig.motor.enable()
            shaft = rig.run(6.0, speed_rad_s=speed_rad_s)
            assert abs(rig.rotor.angle_rad) > 75.0
            assert np.abs(np.diff(shaft.angle_rad)).max() < 0.1
            assert shaft.angle_rad[-1] == pytest.approx(rig.rotor.angle_rad, abs=abs(speed_rad_s) * 3e-3 + self.ANGLE_TOLERANCE_RAD)
            stop_rad = rig.rotor.angle_rad
            rig.run(2.0, angle_rad=stop_rad)
            assert rig.rotor.angle_rad == pytest.approx(stop_rad, abs=self.ANGLE_TOLERANCE_RAD)
            assert rig.motor.status().fault is None

    def test_samples_are_columns_of_one_length_in_the_order_of_time(self) -> None:
        with self.rig() as rig:
            rig.motor.enable()
            shaft = rig.run(0.5, speed_rad_s=1.0)
            assert len({column.shape for column in vars(shaft).values()}) == 1
            assert len(shaft.angle_rad) >= 240
            assert np.all(np.diff(shaft.device_s) > 0.0)
            assert np.all(np.diff(shaft.host_s) >= 0.0)
            assert np.isfinite([shaft.angle_rad, shaft.speed_rad_s]).all()

    def test_device_time_is_the_time_of_the_motion(self) -> None:
        """At a steady speed angle over device time is a straight line of that slope."""
        with self.rig() as rig:
            rig.motor.enable()
            rig.run(1.0, speed_rad_s=3.0)
            shaft = rig.run(1.0, speed_rad_s=3.0)
            slope, offset = np.polyfit(shaft.device_s, shaft.angle_rad, 1)
            assert slope == pytest.approx(3.0, abs=self.SPEED_TOLERANCE_RAD_S)
            assert np.abs(shaft.angle_rad - slope * shaft.device_s - offset).max() < 2.0 * self.ANGLE_TOLERANCE_RAD

    def test_reading_never_waits_and_is_empty_where_nothing_came(self) -> None:
        with self.rig() as rig:
            shaft = rig.motor.read()
            assert isinstance(shaft, ShaftSamples)
            assert shaft.angle_rad.shape == (0,)
            assert rig.clock.now_s() == 0.0

    # -- stopping ------------------------------------------------------------------------------------------------------------

    def test_disabling_takes_the_torque_away_and_may_be_repeated(self) -> None:
        with self.rig() as rig:
            rig.motor.disable()
            rig.motor.enable()
            rig.run(0.3, speed_rad_s=2.0)
            for _ in range(3):
                rig.motor.disable()
            rig.tick()
            speed_rad_s = rig.rotor.speed_rad_s
            rig.run(0.3)
            assert rig.rotor.speed_rad_s == speed_rad_s
            assert rig.motor.status().fault is None

    def test_a_drive_that_falls_silent_is_a_fault(self) -> None:
        with self.rig() as rig:
            rig.motor.enable()
            rig.run(0.1, speed_rad_s=1.0)
            assert rig.motor.status().silent_s <= 0.11
            rig.run(1.0, speed_rad_s=1.0, deaf=True)
            assert rig.motor.status().silent_s > 0.8
            assert re.search(r"no .* for .* s, limit .*check", rig.motor.status().fault or "")

    def test_an_error_of_the_drive_is_told_with_its_code_and_meaning(self) -> None:
        with self.rig() as rig:
            rig.motor.enable()
            rig.run(0.1, speed_rad_s=1.0)
            said = self.fail(rig.twin)
            rig.run(0.2, speed_rad_s=1.0)
            assert re.search(said, rig.motor.status().fault or "")

    def test_a_watchdog_that_works_is_proven_and_the_motor_can_be_enabled_again(self) -> None:
        with self.rig(watchdog_s=0.1) as rig:
            rig.motor.enable()
            rig.rotor.load_Nm = 0.5  # as gravity pulls at a leg
            rig.run(0.2, angle_rad=0.3)
            assert 0.0 < rig.motor.prove_watchdog(0.6) <= 0.7
            rig.tick()
            assert rig.rotor.drives[-1][1].torque_Nm(1.0, 1.0) == 0.0
            rig.rotor.load_Nm = rig.rotor.speed_rad_s = 0.0
            rig.run(0.05)
            rig.motor.enable()
            assert rig.motor.status().fault is None

    @pytest.mark.parametrize("load_Nm", [0.0, 0.5])
    def test_a_drive_without_watchdog_is_found_out_and_left_without_torque(self, load_Nm: float) -> None:
        with self.rig(watchdog_s=None) as rig:
            rig.motor.enable()
            rig.rotor.load_Nm = load_Nm
            rig.run(0.2, angle_rad=0.3)
            with pytest.raises(DeviceError, match="watchdog"):
                rig.motor.prove_watchdog(0.5)
            rig.tick()
            assert rig.rotor.drives[-1][1].torque_Nm(1.0, 1.0) == 0.0

    def test_the_temperature_is_told_where_the_drive_tells_it(self) -> None:
        with self.rig() as rig:
            rig.motor.enable()
            rig.run(0.6, angle_rad=0.3)
            told_C = rig.motor.status().temperature_C
            assert told_C == pytest.approx(30.5, abs=1.0) if self.TELLS_TEMPERATURE else told_C is None

    def test_a_motor_that_warms_up_is_told(self) -> None:
        with self.rig() as rig:
            rig.motor.enable()
            rig.twin.warmth.fever_K_s = 20.0
            rig.run(2.0, angle_rad=0.3)
            told_C = rig.motor.status().temperature_C
            assert told_C is None or told_C == pytest.approx(70.0, abs=12.0)

    def test_what_dammed_up_while_nobody_looked_and_has_holes_is_neither_a_leap_nor_handed_out(self) -> None:
        """A full buffer of the system drops frames while a hand turns the shaft, as at every change of the rack's height."""
        with self.rig() as rig:
            rig.motor.enable()
            rig.run(0.2, angle_rad=0.3)
            rig.motor.disable()
            rig.rotor.speed_rad_s = 2.0
            rig.clock.wait_until(rig.clock.now_s() + 1.0)
            rig.rotor.speed_rad_s = 0.0
            rig.clock.wait_until(rig.clock.now_s() + 0.1)
            arrived = rig.wire._arrived
            kept = [*list(arrived)[:50], *list(arrived)[-10:]]
            arrived.clear()
            arrived.extend(kept)
            rig.motor.enable()
            shaft = rig.run(0.2, angle_rad=2.3)
            assert rig.motor.status().fault is None
            assert np.abs(np.diff(shaft.angle_rad)).max() < 0.1

    def test_a_drive_that_restarts_in_motion_is_a_fault_and_not_enabled_again_as_its_zero_is_lost(self) -> None:
        with self.rig() as rig:
            rig.motor.enable()
            rig.run(0.5, speed_rad_s=3.0)
            rig.twin.restart()
            rig.run(0.2, speed_rad_s=3.0)
            assert re.search("leapt|restarted", rig.motor.status().fault or "")
            assert rig.rotor.drives[-1][1].torque_Nm(1.0, 1.0) == 0.0 or not rig.motor.disable()
            with pytest.raises(DeviceError, match=r"not enabled: .*find its zero again, then start anew"):
                rig.motor.enable()

    # -- the bus -------------------------------------------------------------------------------------------------------------

    @pytest.mark.parametrize("act", ["enable", "disable"])
    def test_a_frame_that_cannot_be_sent_is_an_error(self, act: str) -> None:
        with Failing() as bus, pytest.raises(DeviceError, match="not sent: transmit buffer full"):
            getattr(self.driver(bus, TwinClock()), act)()

    def test_disabling_tries_again_while_the_transmit_queue_is_full(self) -> None:
        clock = TwinClock()
        with FullFor(5) as bus:
            self.driver(bus, clock).disable()
            assert bus.sent
            assert clock.now_s() < 0.02

    def test_disabling_gives_up_after_20_ms(self) -> None:
        clock = TwinClock()
        with Failing() as bus, pytest.raises(DeviceError, match="not sent"):
            self.driver(bus, clock).disable()
        assert clock.now_s() <= 0.02

    def test_a_controller_that_counts_errors_is_a_fault_until_it_is_well_again(self) -> None:
        with self.rig() as rig:
            rig.motor.enable()
            rig.run(0.1, angle_rad=0.3)
            for data, passive in (([0, 0x20, 0, 0, 0, 0, 136, 0], True), ([0, 0x40, 0, 0, 0, 0, 90, 0], False)):
                rig.onlooker.send(can.Message(arbitration_id=0x204, data=data, is_error_frame=True, is_extended_id=False))
                rig.run(0.01, angle_rad=0.3)
                assert bool(re.search("error-passive, .* counters 136 and 0", rig.motor.status().fault or "")) == passive
            assert rig.motor.identity()["can_error_frames"] == "2"

    def test_a_failing_bus_is_an_error_when_reading(self) -> None:
        with Failing() as bus, pytest.raises(DeviceError, match="no such device"):
            self.driver(bus, TwinClock()).read()

    def test_a_bus_that_went_off_is_an_error_when_reading(self) -> None:
        with can_wire() as (here, there):
            there.send(can.Message(arbitration_id=0x40, is_error_frame=True, is_extended_id=False))
            with pytest.raises(DeviceError, match="CAN bus is off"):
                self.driver(here, TwinClock()).read()

    def test_the_identity_is_text_and_names_the_make(self) -> None:
        with self.rig() as rig:
            rig.motor.enable()
            identity = rig.motor.identity()
            assert identity["make"]
            assert all(isinstance(value, str) for value in identity.values())
