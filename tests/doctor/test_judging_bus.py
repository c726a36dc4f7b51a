"""Interfaces, buses and serial ports, judged as if they had been seen."""

from dataclasses import replace

import pytest

from rfca_rig.devices.checks import (
    CanBusObservation,
    Colour,
    SerialPortSeen,
    judge_found_port,
    judge_serial_port,
)
from rfca_rig.doctor.ports import CanInterfaceObservation, judge_can_bus, judge_can_interface
from rfca_rig.doctor.rig_checks import judge_found_adapters, judge_found_interfaces
from tests.doctor.said import whole

UP = CanInterfaceObservation("can0", True, is_up=True, state="ERROR-ACTIVE", bitrate=1_000_000)
FD = replace(UP, is_fd=True, data_bitrate=5_000_000)
KNOWN = ("socketcan", "socketcand", "pcan")


@pytest.mark.parametrize(
    ("seen", "data_bitrate", "colour", "says"),
    [
        (UP, None, "green", "can0 is up, 1000000 bit/s"),
        (FD, 5_000_000, "green", "data 5000000 bit/s"),
        (
            CanInterfaceObservation("can0", False),
            None,
            "red",
            "sudo slcand -o -c -s8 /dev/ttyACM0 can0",
        ),
        (CanInterfaceObservation("can0", False, ("can1", "can2")), None, "red", 'channel = "can1"'),
        (replace(UP, is_can=False), None, "red", "not CAN"),
        (
            replace(UP, is_up=False),
            None,
            "red",
            "sudo ip link set can0 up type can bitrate 1000000",
        ),
        (
            replace(UP, is_up=False),
            5_000_000,
            "red",
            "bitrate 1000000 dbitrate 5000000 fd on sample-point 0.666 dsample-point 0.666",
        ),
        (
            replace(UP, bitrate=500_000),
            None,
            "red",
            "runs at 500000 bit/s, the rig file says 1000000",
        ),
        (
            replace(UP, bitrate=500_000),
            None,
            "red",
            "| sudo ip link set can0 down | sudo ip link set can0 up type can bitrate 1000000",
        ),
        (UP, 5_000_000, "red", "classic CAN, the drive speaks CAN-FD"),
        (replace(FD, data_bitrate=2_000_000), 5_000_000, "red", "data phase at 2000000"),
        (replace(UP, state="BUS-OFF"), None, "red", "off after too many errors"),
        (replace(UP, state="ERROR-PASSIVE"), None, "yellow", "120 ohm"),
        (replace(UP, bitrate=None), None, "yellow", "ip -details link show can0"),
        (replace(UP, bitrate=None, is_virtual=True), None, "green", "virtual"),
    ],
)
def test_an_interface_is_judged_with_the_command_that_mends_it(seen, data_bitrate, colour, says):
    finding = judge_can_interface(seen, 1_000_000, data_bitrate)
    assert finding.colour == colour
    assert says in whole(finding)


@pytest.mark.parametrize(
    ("seen", "interface", "colour", "says"),
    [
        (CanBusObservation(), "pcan", "green", "pcan ch opens"),
        (
            CanBusObservation("refused"),
            "socketcand",
            "red",
            "socketcand ch cannot be opened: refused",
        ),
        (CanBusObservation("refused"), "socketcand", "red", "| export CAN_CONFIG="),
        (
            CanBusObservation("no such library"),
            "pcan",
            "red",
            "no such library | install PEAK's driver",
        ),
        (CanBusObservation(), "socktcan", "red", "must be one of socketcan, socketcand, pcan"),
        (
            CanBusObservation(frames=5, error_frames=3),
            "pcan",
            "yellow",
            "3 error frames beside 5 good ones",
        ),
        (CanBusObservation(went_off=True, error_frames=1), "pcan", "red", "too many errors"),
        (CanBusObservation(failed="Network is down"), "pcan", "red", "Network is down"),
    ],
)
def test_a_bus_is_judged(seen, interface, colour, says):
    finding = judge_can_bus(seen, interface, "ch", KNOWN)
    assert finding.colour == colour
    assert says in whole(finding)


@pytest.mark.parametrize(
    ("seen", "colour", "says"),
    [
        (SerialPortSeen("/dev/ttyUSB0", True, True, "dialout"), "green", "/dev/ttyUSB0"),
        (
            SerialPortSeen("/dev/ttyUSB0", False, others=("/dev/ttyUSB1",)),
            "red",
            "there is /dev/ttyUSB1",
        ),
        (SerialPortSeen("/dev/ttyUSB0", False), "red", "no serial port at all"),
        (
            SerialPortSeen("/dev/ttyUSB0", True, False, "dialout"),
            "red",
            "sudo usermod -aG dialout $USER",
        ),
        (
            SerialPortSeen("/dev/ttyUSB0", True, False, "root"),
            "red",
            "sudo chmod a+rw /dev/ttyUSB0",
        ),
    ],
)
def test_a_serial_port_is_judged(seen, colour, says):
    finding = judge_serial_port(seen, "[force_sensor]")
    assert finding.colour == colour
    assert says in whole(finding)


def test_nothing_that_a_scan_finds_or_misses_is_red():
    down = replace(UP, is_up=False, bitrate=250_000)
    closed = SerialPortSeen("/dev/ttyACM0", True, False, "dialout", product="CANable")
    findings = [
        *judge_found_interfaces(()),
        *judge_found_interfaces((UP, down)),
        *judge_found_adapters(()),
        *judge_found_adapters((("pcan", "PCAN_USBBUS1"),)),
        judge_found_port(closed),
    ]
    said = " ".join(whole(one) for one in findings)
    assert {one.colour for one in findings} == {Colour.GREEN, Colour.YELLOW}
    assert "sudo ip link set can0 up type can bitrate 250000" in said
    assert 'interface = "pcan", channel = "PCAN_USBBUS1"' in said
    assert "CANable" in said
