"""An ODrive with firmware 0.5: driver and twin, and what happens when the dialect is set wrong."""

import re
from contextlib import AbstractContextManager
from dataclasses import replace

import can
import pytest

from rfca_rig.clock import Clock, TwinClock
from rfca_rig.contracts.motor import MotorContract
from rfca_rig.contracts.motor_rig import MotorRig, drain, motor_rig
from rfca_rig.devices.odrive import codec as cansimple
from rfca_rig.devices.odrive import messages as odrive
from rfca_rig.devices.odrive.driver import OdriveMotor, OdriveSettings
from rfca_rig.devices.odrive.messages import Heartbeat, OdriveFirmware, OdrivePart, PartError
from rfca_rig.devices.odrive.twin import OdriveTwin, OdriveTwinSettings
from rfca_rig.errors import BadInput, DeviceError
from rfca_rig.twins.wires import can_wire

GEARED = {"gear_ratio": 9.0, "direction": -1, "zero_turns": 2.75}
OLDER = {"dialect": OdriveFirmware.V0_5, "torque_constant_Nm_per_A": 0.0827}


def send(bus: can.BusABC, frame: cansimple.Frame) -> None:
    bus.send(can.Message(arbitration_id=frame[0], data=frame[1], is_extended_id=False))


def older_rig(
    driver: OdriveSettings | None = None, twin: OdriveTwinSettings | None = None
) -> AbstractContextManager[MotorRig]:
    return motor_rig(
        lambda bus, clock: OdriveMotor(bus, clock, driver or OdriveSettings(0, **OLDER)),
        lambda bus: OdriveTwin(bus, twin or OdriveTwinSettings(**OLDER)),
    )


class TestOlderOdriveAsAMotor(MotorContract):
    """Firmware 0.5, with a gear, the other direction and a zero of its own."""

    ANGLE_TOLERANCE_RAD = 1e-3
    TELLS_TEMPERATURE = False  # 0x15 is something else there

    def driver(self, bus: can.BusABC, clock: Clock) -> OdriveMotor:
        return OdriveMotor(bus, clock, OdriveSettings(0, **OLDER, **GEARED))

    def twin(self, bus: can.BusABC, watchdog_s: float | None) -> OdriveTwin:
        return OdriveTwin(bus, OdriveTwinSettings(watchdog_s=watchdog_s, **OLDER, **GEARED))

    def leave_stale_set_point(self, bus: can.BusABC) -> None:
        send(bus, cansimple.set_input_pos(0, -3.0, 5.0))

    def fail(self, twin: OdriveTwin) -> str:
        twin.set_error(1 << 18)
        return r"error 0x00040000 \(OVER_TEMP: drive or motor too hot\)"

    def refuse(self, twin: OdriveTwin) -> str:
        twin._settings = replace(twin._settings, arming_error=1)
        return r"refuses closed loop with error 0x00000001 \(INVALID_STATE: .*\), state idle$"


def test_the_watchdog_bit_is_the_older_one() -> None:
    with older_rig() as rig:
        rig.motor.enable()
        rig.run(0.4)
        assert (
            rig.motor.status().fault
            == "error 0x00000800 (WATCHDOG_TIMER_EXPIRED: no command reached the drive in time)"
        )


def test_an_emergency_stop_has_the_older_bit() -> None:
    with older_rig() as rig:
        rig.motor.enable()
        send(rig.observer, cansimple.estop(0))
        rig.run(0.2, speed_rad_s=1.0)
        assert "0x00004000 (ESTOP_REQUESTED" in (rig.motor.status().fault or "")


def test_an_error_that_only_a_part_has_is_asked_for_and_told_with_its_meaning() -> None:
    with older_rig() as rig:
        rig.motor.enable()
        rig.twin.fail_part(OdrivePart.ENCODER, 1 << 7)
        rig.run(0.2, speed_rad_s=1.0)
        said = (
            "error 0x00000000 (none); encoder error 0x00000080 (ABS_SPI_COM_FAIL: the "
            "absolute encoder's answers are damaged)"
        )
        assert rig.motor.status().fault == said
        asked = [m for m in drain(rig.observer) if m.arbitration_id == 0x04 and m.dlc == 0]
        assert len(asked) == 1


def test_enabling_clears_the_parts_errors() -> None:
    with older_rig() as rig:
        rig.motor.enable()
        rig.twin.fail_part(OdrivePart.CONTROLLER, 1)
        rig.run(0.2, speed_rad_s=1.0)
        assert "OVERSPEED" in (rig.motor.status().fault or "")
        rig.motor.enable()
        assert rig.motor.status().fault is None


def test_a_refusal_by_a_part_names_its_error() -> None:
    clock = TwinClock()
    with can_wire() as (here, there):

        def drive(_: float) -> None:
            send(there, cansimple.encoder_estimates(0, 0.0, 0.0))
            send(there, cansimple.iq(0, 0.0, 0.0))
            send(
                there,
                cansimple.heartbeat(
                    0, Heartbeat(0, 1, 0, False, (OdrivePart.MOTOR,)), OdriveFirmware.V0_5
                ),
            )
            if any(m.arbitration_id == 0x03 for m in drain(there)):
                send(there, cansimple.part_error(0, PartError(OdrivePart.MOTOR, 1 << 35)))

        clock.carry(drive)
        with pytest.raises(
            DeviceError,
            match=(
                r"still reports error 0x00000000 \(none\); motor error 0x800000000 "
                r"\(UNBALANCED_PHASES"
            ),
        ):
            OdriveMotor(here, clock, OdriveSettings(0, encoder_period_s=2e-3, **OLDER)).enable()


def test_a_set_point_that_is_no_number_fails_the_motor() -> None:
    with older_rig() as rig:
        rig.motor.enable()
        send(rig.observer, cansimple.set_input_vel(0, float("nan")))
        rig.run(0.2, speed_rad_s=1.0)
        assert re.search(
            r"motor error 0x00010000 \(MODULATION_IS_NAN", rig.motor.status().fault or ""
        )


def test_torque_is_the_current_times_its_constant() -> None:
    with older_rig() as rig:
        rig.motor.enable()
        rig.rotor.load_Nm = 2.0
        shaft = rig.run(1.5, angle_rad=0.3)
        assert shaft.torque_Nm[-1] == pytest.approx(-2.0, rel=0.02)
        currents = [
            cansimple.decode(m.arbitration_id, m.data)
            for m in drain(rig.observer)
            if m.arbitration_id == 0x14
        ]
        assert currents[-1].measured_A == pytest.approx(-2.0 / 0.0827, rel=0.02)


def test_clearing_errors_takes_no_byte_and_nothing_of_0_6_is_on_the_wire() -> None:
    with older_rig() as rig:
        rig.motor.enable()
        rig.run(0.2, speed_rad_s=1.0)
        heard = drain(rig.observer)
        assert {m.dlc for m in heard if m.arbitration_id == 0x18} == {0}
        assert not [
            m
            for m in heard
            if m.arbitration_id in {0x1C, 0x15} or (m.arbitration_id == 0 and not m.is_remote_frame)
        ]


def test_an_older_drive_needs_its_torque_constant() -> None:
    with pytest.raises(
        BadInput,
        match=r"torque_constant_Nm_per_A is missing; firmware 0\.5 tells the motor's current",
    ):
        OdriveSettings(0, dialect=OdriveFirmware.V0_5)


def test_a_newer_drive_taken_for_an_older_one_is_found_out() -> None:
    newer = OdriveTwinSettings()
    with older_rig(twin=newer) as rig:
        rig.clock.carry(lambda _: send(rig.observer, cansimple.iq(0, 0.0, 0.0)))
        with pytest.raises(DeviceError, match=r'its firmware is 0\.6\.10; set dialect = "0\.6"'):
            rig.motor.enable()


def test_an_older_drive_taken_for_a_newer_one_is_found_out() -> None:
    with (
        older_rig(OdriveSettings(0)) as rig,
        pytest.raises(DeviceError, match=r'no torques \(0x1C\).*or dialect = "0\.5"'),
    ):
        rig.motor.enable()


def test_what_is_missing_is_called_as_the_older_firmware_calls_it() -> None:
    clock = TwinClock()
    with can_wire() as (here, there):
        clock.carry(
            lambda _: send(
                there, cansimple.heartbeat(0, Heartbeat(0, 1, 0, False), OdriveFirmware.V0_5)
            )
        )
        with pytest.raises(
            DeviceError, match="no encoder estimates from node 0; set its encoder_rate_ms to 1"
        ):
            OdriveMotor(here, clock, OdriveSettings(0, **OLDER)).enable()


def test_the_identity_names_the_dialect() -> None:
    with older_rig() as rig:
        assert rig.motor.identity()["dialect"] == "0.5"
        assert rig.motor.identity()["torque_from"] == "motor currents (0x14)"


def test_the_twin_answers_requests_without_a_byte_as_firmware_0_5_6_does() -> None:
    with older_rig() as rig:
        rig.twin.fail_part(OdrivePart.MOTOR, 8)
        send(rig.observer, (0x03, b""))
        rig.tick()
        (told,) = (m for m in drain(rig.observer) if m.arbitration_id == 0x03)
        assert cansimple.decode(
            told.arbitration_id, told.data, OdriveFirmware.V0_5
        ) == odrive.PartError(OdrivePart.MOTOR, 8)
