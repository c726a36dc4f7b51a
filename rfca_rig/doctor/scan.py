"""Scan for devices without a rig file."""

from collections.abc import Iterator
from pathlib import Path

from rfca_rig.clock import Clock
from rfca_rig.doctor.computer_checks import check_computer
from rfca_rig.doctor.finding import Finding
from rfca_rig.doctor.judging.found import judge_found_adapters, judge_found_interfaces, judge_found_sensor, judge_no_ports
from rfca_rig.doctor.judging.receive_buffer import judge_receive_buffer
from rfca_rig.doctor.judging.serial_port import judge_found_port
from rfca_rig.doctor.looking.adapters import look_for_adapters
from rfca_rig.doctor.looking.can_interface import can_interfaces, look_at_can_interface
from rfca_rig.doctor.looking.computer import probe_receive_buffer
from rfca_rig.doctor.looking.netft import look_at_box
from rfca_rig.doctor.looking.serial_port import look_for_serial_ports
from rfca_rig.drivers.force_sensors.netft import HttpBox
from rfca_rig.drivers.ports import RECEIVE_BUFFER_BYTES

# Factory address of a Net F/T, its record rate, and a short time limit, since usually none is there.
NETFT_AS_DELIVERED = "192.168.1.1"
NETFT_RATE_Hz = 7000.0
NETFT_WITHIN_S = 0.5


def scan(runs: Path, clock: Clock) -> Iterator[Finding]:
    """Yields all findings as they come. Sends only a request for the configuration page of a Net F/T at its default address."""
    yield from judge_found_interfaces(tuple(look_at_can_interface(name) for name in can_interfaces()))
    yield from judge_found_adapters(look_for_adapters())
    ports = look_for_serial_ports()
    yield from [judge_found_port(port) for port in ports] or [judge_no_ports()]
    yield judge_found_sensor(look_at_box(NETFT_AS_DELIVERED, HttpBox(NETFT_AS_DELIVERED, timeout_s=NETFT_WITHIN_S)))
    yield judge_receive_buffer(probe_receive_buffer(), RECEIVE_BUFFER_BYTES, NETFT_RATE_Hz)
    yield from check_computer(runs, clock, None)
