"""Drives, judged as if they had been heard."""

from dataclasses import replace

import pytest

from rfca_rig.devices.cubemars.checks import MitSeen, ServoSeen, judge_mit, judge_servo
from rfca_rig.devices.cubemars.codec.mit import MitReply
from rfca_rig.devices.cubemars.codec.servo import Status
from rfca_rig.devices.moteus.checks import MoteusAnswer, MoteusSeen, judge_moteus
from rfca_rig.devices.odrive.checks import OdriveSeen, OdriveWanted, judge_odrive
from rfca_rig.devices.odrive.messages import Heartbeat, OdriveFirmware, OdrivePart, PartError
from tests.doctor.said import colours, whole

WANTED = OdriveWanted(5, 2e-3)
OLDER = OdriveWanted(5, 2e-3, OdriveFirmware.V0_5)
IDLE = Heartbeat(0, 1, 0, False)
HEALTHY = OdriveSeen(own_frames=1000, beat=IDLE, period_s=2e-3, torques=500, firmware="0.6.11")


def odrive(seen: OdriveSeen, wanted: OdriveWanted = WANTED) -> str:
    """What is said of all that is not green."""
    return " || ".join(
        f"{one.colour} {one.subject}: {whole(one)}"
        for one in judge_odrive(seen, wanted)
        if one.colour != "green"
    )


def test_a_healthy_odrive_is_all_green():
    assert colours(judge_odrive(HEALTHY, WANTED)) == dict.fromkeys(
        ("drive", "drive error", "drive's encoder", "drive's torque"), "green"
    )


@pytest.mark.parametrize(
    ("seen", "wanted", "says"),
    [
        (
            OdriveSeen(others=(3,)),
            WANTED,
            "red drive: heard node 3, the rig file says 5 | put node_id = 3",
        ),
        (
            OdriveSeen(others=(3,)),
            WANTED,
            "odrv0.axis0.config.can.node_id = 5 | odrv0.save_configuration()",
        ),
        (OdriveSeen(others=(63,)), WANTED, "red drive: heard a drive that has no address yet"),
        (OdriveSeen(others=(2, 63)), WANTED, "heard node 2, the rig file"),
        (OdriveSeen(strangers=40), WANTED, "heard 40 frames, none as an ODrive speaks"),
        (OdriveSeen(), WANTED, "red drive: nothing at all heard on the bus"),
        (replace(HEALTHY, beat=None), WANTED, "odrv0.axis0.config.can.heartbeat_msg_rate_ms = 100"),
        (replace(HEALTHY, beat=None), OLDER, "odrv0.axis0.config.can.heartbeat_rate_ms = 100"),
        (
            replace(HEALTHY, beat=replace(IDLE, error=1 << 13)),
            WANTED,
            "red drive error: error 0x00002000 (MOTOR_OVER_TEMP: motor too hot)",
        ),
        (
            replace(HEALTHY, beat=replace(IDLE, error=1 << 24)),
            WANTED,
            "yellow drive error: error 0x01000000 (WATCHDOG_TIMER_EXPIRED",
        ),
        (
            replace(HEALTHY, beat=replace(IDLE, state=8)),
            WANTED,
            "yellow drive error: no error, but the drive is not idle: closed loop",
        ),
        (
            replace(HEALTHY, period_s=10e-3),
            WANTED,
            "red drive's encoder: every 10 ms, the rig file says 2 ms | put encoder_period_ms = 10",
        ),
        (
            replace(HEALTHY, period_s=10e-3),
            WANTED,
            "odrv0.axis0.config.can.encoder_msg_rate_ms = 2",
        ),
        (replace(HEALTHY, period_s=3e-3), WANTED, "yellow drive's encoder: every 3 ms"),
        (
            replace(HEALTHY, period_s=None),
            WANTED,
            "red drive's encoder: no steady encoder estimates",
        ),
        (replace(HEALTHY, torques=0), WANTED, "torques_msg_rate_ms = 2"),
        (replace(HEALTHY, torques=0), OLDER, "odrv0.axis0.config.can.iq_rate_ms = 2"),
        (
            HEALTHY,
            OLDER,
            (
                "red drive: ODrive, node 5, firmware 0.6.11: only firmware 0.6 tells its "
                'version | put dialect = "0.6"'
            ),
        ),
        (
            replace(HEALTHY, unreadable="7 bytes"),
            WANTED,
            "cannot be understood: 7 bytes | check dialect",
        ),
    ],
)
def test_what_is_wrong_with_an_odrive_is_named_with_its_remedy(seen, wanted, says):
    assert says in odrive(seen, wanted)


def test_the_errors_of_its_parts_are_told_where_known():
    failed = replace(IDLE, error=0x40, failed=(OdrivePart.MOTOR, OdrivePart.ENCODER))
    seen = replace(
        HEALTHY, firmware=None, beat=failed, part_errors=(PartError(OdrivePart.MOTOR, 1),)
    )
    assert "PHASE_RESISTANCE_OUT_OF_RANGE" in odrive(seen, OLDER)
    assert "encoder error" in odrive(seen, OLDER)


REPLY = MitReply(1, 0x8000, 0.0, 0.0, 0.0, 31, 0)


@pytest.mark.parametrize(
    ("seen", "colour", "says"),
    [
        (MitSeen(True, REPLY), "green", "AK drive 1 in MIT mode, 31 degC"),
        (MitSeen(True), "red", "drive 1 does not answer, and nothing else speaks"),
        (
            MitSeen(False, others=(4, 7)),
            "red",
            "heard id 4, 7, the rig file says 1; it was not asked while others speak",
        ),
        (
            MitSeen(False, servo=(1,)),
            "red",
            (
                "drive 1 is in servo mode | set it to MIT mode in CubeMarsTool, or put "
                'device = "cubemars-servo"'
            ),
        ),
        (MitSeen(True, masters=(2,)), "red", "replies under id 2 | set its master id to 0 or 1"),
        (MitSeen(True, unreadable="9 bytes"), "red", "9 bytes"),
    ],
)
def test_a_drive_in_mit_mode_is_judged(seen, colour, says):
    drive = judge_mit(seen, 1)[0]
    assert drive.colour == colour
    assert says in whole(drive)


def test_the_errors_of_ak_drives_are_told():
    for findings in (
        judge_mit(MitSeen(True, replace(REPLY, error=1)), 1),
        judge_servo(ServoSeen(Status(0, 0.0, 0.0, 90, 1), 2e-3), 1, 2e-3),
    ):
        assert colours(findings)["drive error"] == "red"
        assert "error 1 (motor too hot)" in " ".join(map(whole, findings))
    assert (
        colours(judge_mit(MitSeen(True, replace(REPLY, error=None)), 1))["drive error"] == "yellow"
    )


STATUS = Status(0, 0.0, 0.0, 31, 0)


@pytest.mark.parametrize(
    ("seen", "colour", "says"),
    [
        (ServoSeen(STATUS, 2e-3), "green", "AK drive 1 in servo mode, 31 degC"),
        (ServoSeen(others=(3,)), "red", "heard drive 3, the rig file says 1 | put drive_id = 3"),
        (ServoSeen(strangers=9), "red", 'device = "cubemars-mit"'),
        (ServoSeen(), "red", "nothing at all heard"),
        (
            ServoSeen(STATUS, 20e-3),
            "red",
            "every 20 ms, the rig file says 2 ms | put status_period_ms = 20",
        ),
        (ServoSeen(STATUS, 3e-3), "yellow", "set its upload rate to 500 Hz"),
        (ServoSeen(STATUS, None), "red", "too few status frames"),
    ],
)
def test_a_drive_in_servo_mode_is_judged(seen, colour, says):
    findings = judge_servo(seen, 1, 2e-3)
    assert says in " || ".join(map(whole, findings))
    assert max(one.colour for one in findings if says in whole(one)) == colour


@pytest.mark.parametrize(
    ("seen", "colour", "says"),
    [
        (MoteusSeen(MoteusAnswer(0, 0, 24.0, 30.0)), "green", "moteus 1, 24.0 V, 30 degC"),
        (MoteusSeen(others=(3,)), "red", "heard drive 3, the rig file says 1 | put drive_id = 3"),
        (MoteusSeen(others=(3,)), "red", "conf set id.id 1 | conf write"),
        (MoteusSeen(), "red", "no id from 1 to 126 answers"),
        (MoteusSeen(MoteusAnswer(1, 40, 9.0, 30.0)), "red", "fault 40 (under voltage"),
        (MoteusSeen(MoteusAnswer(11, 0, 24.0, 30.0)), "yellow", "watchdog expired"),
        (MoteusSeen(MoteusAnswer(10, 0, 24.0, 30.0)), "yellow", "not stopped: position"),
    ],
)
def test_a_moteus_is_judged(seen, colour, says):
    findings = judge_moteus(seen, 1)
    assert [one.colour for one in findings if says in whole(one)] == [colour]
