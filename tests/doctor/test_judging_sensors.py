"""Force sensors, judged as if they had been asked."""

from dataclasses import replace

import pytest

from rfca_rig.devices.ati_daq.checks import CardsSeen, judge_calibration, judge_card
from rfca_rig.devices.ati_serial.checks import ControllerSeen, judge_controller
from rfca_rig.devices.netft.checks import (
    BoxObservation,
    StreamObservation,
    judge_box,
    judge_found_sensor,
    judge_stream,
)
from rfca_rig.devices.netft.codec import (
    CalibrationInfo,
    NetFtConfiguration,
    ToolTransformation,
)
from rfca_rig.devices.netft.section import NetFtSettings
from tests.doctor.said import colours, whole

SETTINGS = NetFtSettings()
PAGE = NetFtConfiguration("Net F/T", "FT12345", "N", "Nm", 1e6, 1e6, True, 7000.0, 7000.0, 40)
STREAM = StreamObservation("10.0.0.7:49152", 0.5, received=3500, step=1, words=(0,))


@pytest.mark.parametrize(
    ("says", "colour", "said"),
    [
        (PAGE, "green", "Net F/T FT12345, set as the rig file says"),
        (
            replace(PAGE, counts_per_force=2e6),
            "red",
            "counts_per_N is 1000000, the box at 10.0.0.7 is set to 2000000",
        ),
        (replace(PAGE, force_unit="lbf"), "red", "counts_per_N is 1000000"),
        (replace(PAGE, rdt_rate_Hz=1000.0), "red", "rate_Hz is 7000"),
        (replace(PAGE, rdt_enabled=False), "red", "RDT is disabled"),
        (replace(PAGE, low_pass="0"), "green", "records/s); filter off"),
        (replace(PAGE, low_pass="8"), "yellow", "about 32 ms late, which looks like a lag"),
        (replace(PAGE, is_axia=True), "red", "is an Ethernet Axia"),
        (
            replace(PAGE, tool_transformation=ToolTransformation((0.0, 0.0, 5.0))),
            "red",
            "10.0.0.7 is shift 0, 0, 5 mm, turn 0, 0, 0 degrees, the rig file states none",
        ),
        (
            CalibrationInfo("N", "Nm", 10**6, 10**6, (1,) * 6),
            "green",
            "its command interface tells neither filter nor tool transformation",
        ),
    ],
)
def test_a_box_is_held_against_the_rig_file(says, colour, said):
    finding = judge_box(BoxObservation("10.0.0.7", says), SETTINGS)
    assert finding.colour == colour
    assert said in whole(finding)


def test_a_box_that_is_not_there_is_red_in_a_rig_file_and_yellow_in_a_scan():
    away = BoxObservation("10.0.0.7", None, "timed out")
    assert (judge_box(away, SETTINGS).colour, judge_found_sensor(away).colour) == ("red", "yellow")
    assert "timed out" in whole(judge_box(away, SETTINGS)) and "ping -c 3 10.0.0.7" in whole(
        judge_box(away, SETTINGS)
    )
    assert "counts_per_N = 1000000" in whole(
        judge_found_sensor(BoxObservation("192.168.1.1", PAGE))
    )
    axia = replace(PAGE, is_axia=True, low_pass="3")
    assert 'model = "axia"; filter on, code 3' in whole(
        judge_found_sensor(BoxObservation("192.168.1.1", axia))
    )


def test_a_healthy_stream_is_all_green():
    findings = judge_stream(STREAM, SETTINGS, True)
    assert colours(findings) == dict.fromkeys(
        ("sensor's records", "sensor's rate", "sensor's status"), "green"
    )


@pytest.mark.parametrize(
    ("seen", "box_answers", "colour", "says"),
    [
        (
            StreamObservation("h:1", 0.5, "refused"),
            True,
            "red",
            "the box answers, but not on UDP port 1",
        ),
        (StreamObservation("h:1", 0.5), True, "red", "sudo ufw allow proto udp from h"),
        (StreamObservation("h:1", 0.5, "refused"), None, "red", "ping -c 3 h"),
        (
            StreamObservation("h:1", 0.5, malformed=9),
            None,
            "red",
            "9 datagrams from h:1, none with records",
        ),
        (replace(STREAM, lost=3), True, "yellow", "3 lost"),
        (
            replace(STREAM, step=7),
            True,
            "red",
            "1000 records/s, the rig file says 7000 | put rate_Hz = 1000",
        ),
        (replace(STREAM, step=0), True, "red", "stands still"),
        (
            replace(STREAM, words=(0, 0x80020000)),
            True,
            "red",
            "transducer saturation or A/D error) | take every load off",
        ),
        (replace(STREAM, words=(0x80000004,)), True, "red", "temperature"),
        (replace(STREAM, words=(0x80010000,)), True, "yellow", "monitor condition latched"),
    ],
)
def test_what_is_wrong_with_a_stream_is_named_with_its_remedy(seen, box_answers, colour, says):
    findings = [one for one in judge_stream(seen, SETTINGS, box_answers) if one.colour != "green"]
    assert [(one.colour, says in whole(one)) for one in findings] == [(colour, True)]


@pytest.mark.parametrize(
    ("seen", "subject", "colour", "says"),
    [
        (
            ControllerSeen("/dev/ttyUSB0", None, 1.0, 80, 80.0),
            "sensor's rate",
            "green",
            "80.0 records/s",
        ),
        (
            ControllerSeen("/dev/ttyUSB0", "gives no prompt"),
            "sensor",
            "red",
            "gives no prompt | check the controller's power",
        ),
        (ControllerSeen("/dev/ttyUSB0", None, 1.0), "sensor", "red", "no record came"),
        (
            ControllerSeen("/dev/ttyUSB0", None, 1.0, 60, 60.0),
            "sensor's rate",
            "red",
            "60.0 records/s, the rig file says 80 | put rate_Hz = 60",
        ),
        (
            ControllerSeen("/dev/ttyUSB0", None, 1.0, 80, 80.0, ("error flag",)),
            "sensor's records",
            "yellow",
            "error flag",
        ),
    ],
)
def test_a_controller_is_judged(seen, subject, colour, says):
    finding = next(one for one in judge_controller(seen, 80.0) if one.subject == subject)
    assert finding.colour == colour
    assert says in whole(finding)


@pytest.mark.parametrize(
    ("seen", "colour", "says"),
    [
        (CardsSeen(True, None, ("Dev1", "Dev2")), "green", "Dev1 is there"),
        (CardsSeen(False), "red", 'pip install "rfca-rig[daq]"'),
        (CardsSeen(True, "DaqNotFoundError"), "red", "install the NI-DAQmx driver"),
        (CardsSeen(True, None, ("cDAQ1Mod1",)), "red", 'put channels = "cDAQ1Mod1/ai0:5"'),
        (CardsSeen(True), "red", "there is no card at all"),
    ],
)
def test_a_card_is_judged(seen, colour, says):
    finding = judge_card(seen, "Dev1/ai0:5")
    assert finding.colour == colour
    assert says in whole(finding)


def test_a_calibration_file_that_cannot_be_used_is_red():
    assert judge_calibration("FT1.cal", None).colour == "green"
    assert "FT1.cal cannot be read" in whole(
        judge_calibration("FT1.cal", "FT1.cal cannot be read: No such file")
    )
