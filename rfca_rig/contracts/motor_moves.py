"""Conformance tests for motor drivers: enabling, commands, reports."""

import numpy as np
import pytest

from rfca_rig.clock import TwinClock
from rfca_rig.contracts.motor_rig import MotorHooks, Rotor, drain
from rfca_rig.drivers.roles import ShaftSamples
from rfca_rig.errors import DeviceError
from rfca_rig.twins.wires import can_wire

NOT_FINITE = [float("nan"), float("inf"), -float("inf")]


class MotorMoves(MotorHooks):
    """Tests of enabling, commanding and reading."""

    # -- enabling ------------------------------------------------------------------------------------------------------------

    def test_enabling_moves_nothing_even_where_a_stale_set_point_waits_in_the_drive(self) -> None:
        with self.rig(Rotor(angle_rad=1.2)) as rig:
            self.leave_stale_set_point(rig.observer)
            rig.motor.enable()
            shaft = rig.run(0.2, angle_rad=1.2)
            angles_rad = np.array([angle_rad for _, angle_rad, _ in rig.turned])
            assert np.abs(angles_rad - 1.2).max() < self.ANGLE_TOLERANCE_RAD
            assert np.abs(shaft.angle_rad - 1.2).max() < self.ANGLE_TOLERANCE_RAD
            # At rest at the enabling angle, any torque shows a jerk.
            torques_Nm = np.array([law.torque_Nm(1.2, 0.0) for _, law in rig.rotor.drives])
            assert np.abs(torques_Nm).max() < self.ENABLING_TORQUE_Nm
            assert rig.motor.status().fault is None

    # Beyond 12.5 rad (MIT mode) and many turns, where positions in a protocol wrap.
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
            # The shaft is turned by hand.
            rig.rotor.speed_rad_s = 2.2
            rig.run(0.5)
            rig.rotor.angle_rad, rig.rotor.speed_rad_s = 0.9, 0.0
            rig.run(0.05)
            rig.motor.enable()
            rig.run(0.2, angle_rad=0.9)
            assert rig.rotor.angle_rad == pytest.approx(0.9, abs=self.ANGLE_TOLERANCE_RAD)

    def test_a_refused_enable_says_with_which_error_of_the_drive_and_leaves_no_torque(self) -> None:
        with self.rig() as rig:
            pattern = self.refuse(rig.twin)
            with pytest.raises(DeviceError, match=pattern):
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

    @pytest.mark.parametrize("value", NOT_FINITE)
    def test_a_command_that_is_no_number_is_refused_and_not_sent(self, value: float) -> None:
        with self.rig() as rig:
            rig.motor.enable()
            drain(rig.observer)
            for act in (rig.motor.command_speed, rig.motor.command_angle):
                with pytest.raises(DeviceError, match="nothing was sent"):
                    act(value)
            assert drain(rig.observer) == []

    # -- reading -------------------------------------------------------------------------------------------------------------

    @pytest.mark.parametrize("speed_rad_s", [14.0, -14.0])
    def test_the_angle_goes_on_over_many_turns(self, speed_rad_s: float) -> None:
        with self.rig() as rig:
            rig.motor.enable()
            shaft = rig.run(6.0, speed_rad_s=speed_rad_s)
            # Twelve turns: more than the nine that the status frame of the servo mode covers.
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
            # Nearly one sample for each of the 250 ticks.
            assert len(shaft.angle_rad) >= 240
            assert np.all(np.diff(shaft.device_s) > 0.0)
            assert np.all(np.diff(shaft.host_s) >= 0.0)
            assert np.isfinite([shaft.angle_rad, shaft.speed_rad_s]).all()

    def test_device_time_is_the_time_of_the_motion(self) -> None:
        """At constant speed, the angle over device time is a straight line with that slope."""
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
