"""Drives' twins, looked at over the wire in simulated time; and nothing that was sent could have
moved them.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import can
import pytest

from rfca_rig.clock import Clock
from rfca_rig.contracts.motor_rig import MotorRig, drain, motor_rig
from rfca_rig.devices.checks import Finding, Listener
from rfca_rig.devices.cubemars.codec.mit import Special, encode_special
from rfca_rig.devices.cubemars.section import CubemarsMitSection, CubemarsServoSection
from rfca_rig.devices.cubemars.twin import (
    CubemarsMitTwin,
    CubemarsServoTwin,
    MitTwinSettings,
    ServoTwinSettings,
)
from rfca_rig.devices.moteus import codec as moteus
from rfca_rig.devices.moteus.codec import Read
from rfca_rig.devices.moteus.section import MoteusSection
from rfca_rig.devices.moteus.twin import MoteusTwin, MoteusTwinSettings
from rfca_rig.devices.odrive import codec as cansimple
from rfca_rig.devices.odrive.messages import (
    AxisState,
    Heartbeat,
    OdriveCommand,
    OdriveFirmware,
    OdrivePart,
    OlderCommand,
)
from rfca_rig.devices.odrive.section import OdriveSection
from rfca_rig.devices.odrive.twin import OdriveTwin, OdriveTwinSettings
from rfca_rig.doctor.rig_checks import check_drive, check_motor
from tests.doctor.said import colours, whole

ANY = {"direction": 1, "interface": "virtual", "channel": "test"}
ODRIVE = OdriveSection(
    device="odrive", node_id=5, gear_ratio=9.0, zero_turns=0.0, encoder_period_ms=2.0, **ANY
)
OLDER = ODRIVE.model_copy(update={"dialect": "0.5", "torque_constant_Nm_per_A": 0.08})
MIT = CubemarsMitSection(device="cubemars-mit", drive_id=1, model="AK80-9", zero_rad=0.0, **ANY)
SERVO = CubemarsServoSection(
    device="cubemars-servo",
    drive_id=1,
    gear_ratio=9.0,
    pole_pairs=21,
    torque_constant_Nm_per_A=0.1,
    zero_deg=0.0,
    status_period_ms=2.0,
    **ANY,
)
MOTEUS = MoteusSection(device="moteus", drive_id=1, zero_turns=0.0, **ANY)


@contextmanager
def wired(twin: Callable[[can.BusABC], Any]) -> Iterator[MotorRig]:
    with motor_rig(no_driver, twin) as rig:
        yield rig


def no_driver(bus: can.BusABC, clock: Clock) -> None:
    """The wire is left to whoever looks."""


def odrive(**settings: Any) -> Callable[[can.BusABC], OdriveTwin]:
    return lambda bus: OdriveTwin(
        bus, OdriveTwinSettings(**{"node_id": 5, "encoder_period_s": 2e-3} | settings)
    )


def checked(rig: MotorRig, motor: Any) -> list[Finding]:
    return list(check_drive(motor, Listener(rig.wire, rig.clock)))


def said(findings: list[Finding]) -> str:
    return " || ".join(whole(one) for one in findings)


def test_a_healthy_odrive_is_green_and_was_only_asked_for_its_version():
    with wired(odrive()) as rig:
        findings = checked(rig, ODRIVE)
        assert set(colours(findings).values()) == {"green"} and len(findings) == 5, said(findings)
        sent = [message for message in drain(rig.observer) if message.is_remote_frame]
        assert [message.arbitration_id for message in sent] == [5 << 5 | OdriveCommand.VERSION]


def test_an_odrive_that_somebody_runs_is_only_listened_to():
    """Any frame would feed its watchdog."""
    with wired(odrive(node_id=3)) as rig:
        identifier, data = cansimple.heartbeat(5, Heartbeat(0, AxisState.CLOSED_LOOP, 0, False))
        rig.observer.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
        assert "not idle: closed loop" in said(checked(rig, ODRIVE))
        assert not [message for message in drain(rig.observer) if message.is_remote_frame]


def test_a_wrong_node_id_is_named():
    with wired(odrive(node_id=3)) as rig:
        findings = checked(rig, ODRIVE)
        assert "heard node 3, the rig file says 5" in said(findings)
        assert colours(findings) == {"CAN bus": "green", "drive": "red"}
        assert not [message for message in drain(rig.observer) if message.is_remote_frame]


def test_a_wrong_period_is_told():
    with wired(odrive(encoder_period_s=10e-3)) as rig:
        assert "every 10 ms, the rig file says 2 ms" in said(checked(rig, ODRIVE))


def test_an_older_odrive_tells_the_error_of_its_part():
    with wired(odrive(dialect=OdriveFirmware.V0_5)) as rig:
        assert set(colours(checked(rig, OLDER)).values()) == {"green"}
        rig.twin.set_error(0x40)
        findings = checked(rig, OLDER)
        assert colours(findings)["drive error"] == "red"
        assert "MOTOR_FAILED" in said(findings)


def test_the_error_of_a_part_is_asked_for_and_others_are_not():
    with wired(odrive(node_id=3, dialect=OdriveFirmware.V0_5)) as rig:
        identifier, data = cansimple.heartbeat(
            5, Heartbeat(0x40, 1, 0, False, (OdrivePart.MOTOR,)), OdriveFirmware.V0_5
        )
        rig.observer.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
        assert "motor error" in said(checked(rig, OLDER))
        asked = {
            message.arbitration_id for message in drain(rig.observer) if message.is_remote_frame
        }
        assert asked == {5 << 5 | OdriveCommand.VERSION, 5 << 5 | OlderCommand.MOTOR_ERROR}


def test_a_drive_in_mit_mode_is_asked_by_the_frame_that_switches_it_off():
    with wired(lambda bus: CubemarsMitTwin(bus, MitTwinSettings())) as rig:
        findings = checked(rig, MIT)
        assert set(colours(findings).values()) == {"green"}, said(findings)
        sent = [
            bytes(message.data) for message in drain(rig.observer) if message.arbitration_id == 1
        ]
        assert sent == [encode_special(Special.EXIT)]


def test_a_drive_in_mit_mode_is_not_asked_while_others_speak():
    with wired(odrive()) as rig:
        findings = checked(rig, MIT)
        assert "it was not asked while others speak" in said(findings)
        assert not [message for message in drain(rig.observer) if message.arbitration_id == 1]


def test_a_silent_drive_in_mit_mode_is_told():
    with wired(lambda bus: CubemarsMitTwin(bus, MitTwinSettings(drive_id=9))) as rig:
        assert "drive 1 does not answer" in said(checked(rig, MIT))


@pytest.mark.parametrize(
    ("drive_id", "says"),
    [(1, "AK drive 1 in servo mode"), (3, "heard drive 3, the rig file says 1")],
)
def test_a_drive_in_servo_mode_is_only_listened_to(drive_id, says):
    settings = ServoTwinSettings(
        drive_id=drive_id,
        gear_ratio=9.0,
        pole_pairs=21,
        torque_constant_Nm_per_A=0.1,
        status_period_s=2e-3,
    )
    with wired(lambda bus: CubemarsServoTwin(bus, settings)) as rig:
        findings = checked(rig, SERVO)
        assert says in said(findings)
        assert (colours(findings)["drive"] == "green") == (drive_id == 1)
        assert all(message.arbitration_id >> 8 == 0x29 for message in drain(rig.observer))


@pytest.mark.parametrize(
    ("drive_id", "says"), [(1, "moteus 1, 24.0 V"), (3, "heard drive 3, the rig file says 1")]
)
def test_a_moteus_is_only_asked_to_read(drive_id, says):
    with wired(lambda bus: MoteusTwin(bus, MoteusTwinSettings(drive_id=drive_id))) as rig:
        findings = checked(rig, MOTEUS)
        assert says in said(findings)
        assert (colours(findings)["drive"] == "green") == (drive_id == 1)
        asked = [message for message in drain(rig.observer) if message.arbitration_id & 0x8000]
        assert asked
        assert all(
            isinstance(item, Read) for message in asked for item in moteus.decode(message.data)
        )


def test_a_moteus_tells_its_fault():
    with wired(lambda bus: MoteusTwin(bus, MoteusTwinSettings())) as rig:
        rig.twin.set_error(38)
        findings = checked(rig, MOTEUS)
        assert colours(findings)["drive error"] == "red"
        assert "over temperature" in said(findings)


def test_a_bus_that_goes_off_is_the_only_thing_told():
    with wired(odrive()) as rig:
        rig.observer.send(
            can.Message(arbitration_id=0x40, is_error_frame=True, is_extended_id=False)
        )
        assert colours(checked(rig, ODRIVE)) == {"CAN bus": "red"}


def test_a_bus_that_fails_while_it_is_listened_to_is_told():
    with wired(odrive()) as rig:
        rig.wire.shutdown()
        assert "is shut" in said(checked(rig, ODRIVE))


@pytest.mark.parametrize(
    ("where", "says"),
    [
        ({"interface": "socketcan", "channel": "can77"}, "there is no can77"),
        ({"interface": "slcan", "channel": "/dev/there-is-none"}, "there is no /dev/there-is-none"),
        ({"interface": "no-such"}, "no-such is no interface of python-can"),
    ],
)
def test_a_bus_that_does_not_exist_ends_the_look(where, says):
    with wired(odrive()) as rig:
        (finding,) = check_motor(ODRIVE.model_copy(update=where), rig.clock)
    assert finding.colour == "red"
    assert says in whole(finding)
