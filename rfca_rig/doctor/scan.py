"""Scan for devices without a rig file."""

from collections.abc import Iterator
from pathlib import Path

from rfca_rig.clock import Clock
from rfca_rig.codecs.netft_configuration import CalibrationInfo, NetFtConfiguration
from rfca_rig.devices.checks import Finding, green, yellow
from rfca_rig.doctor.computer import check_computer, judge_receive_buffer, probe_receive_buffer
from rfca_rig.doctor.netft import BoxObservation, look_at_box
from rfca_rig.doctor.ports import (
    CanInterfaceObservation,
    can_interfaces,
    judge_found_port,
    look_at_can_interface,
    look_for_adapters,
    look_for_serial_ports,
    make_up_command,
)
from rfca_rig.drivers.force_sensors.netft import HttpBox
from rfca_rig.drivers.ports import RECEIVE_BUFFER_BYTES

ADAPTERS, PORTS, SENSOR = "CAN adapters", "serial port", "Net F/T"
# Bit rate for the proposed command if the interface has none yet, in bit/s.
USUAL_BITRATE = 1_000_000

# Factory address of a Net F/T, its record rate, and a short time limit, since usually none is there.
NETFT_AS_DELIVERED = "192.168.1.1"
NETFT_RATE_Hz = 7000.0
NETFT_WITHIN_S = 0.5


def judge_found_interfaces(seen: tuple[CanInterfaceObservation, ...]) -> list[Finding]:
    if not seen:
        fix = "plug the adapter in; where it is not seen, load its driver, or make a serial adapter an interface:"
        commands = ("sudo modprobe can_raw gs_usb", "sudo slcand -o -c -s8 /dev/ttyACM0 can0")
        return [yellow("CAN interface", "none in the kernel", fix, *commands)]
    return [_interface(one) for one in seen]


def _interface(seen: CanInterfaceObservation) -> Finding:
    rate = "" if seen.bitrate is None else f", {seen.bitrate} bit/s"
    if not seen.is_up:
        fix = "bring it up, with the bit rate of the drive:"
        return yellow("CAN interface", f"{seen.channel} is down", fix, make_up_command(seen.channel, seen.bitrate or USUAL_BITRATE))
    return green("CAN interface", f'{seen.channel} is up{rate}: interface = "socketcan", channel = "{seen.channel}"')


def judge_found_adapters(seen: tuple[tuple[str, str], ...]) -> list[Finding]:
    """Findings on adapters other than the kernel's, as (interface, channel) of python-can."""
    if not seen:
        return [green(ADAPTERS, "none beside the kernel's")]
    return [green(ADAPTERS, f'interface = "{interface}", channel = "{channel}"') for interface, channel in seen]


def judge_no_ports() -> Finding:
    return green(PORTS, "none")


def judge_found_sensor(seen: BoxObservation) -> Finding:
    if seen.says is None:
        fix = "a sensor as delivered needs this computer in its network; with the right network port for eth0:"
        return yellow(SENSOR, f"none at {seen.host}, where it is as delivered", fix, "sudo ip address add 192.168.1.100/24 dev eth0")
    return green(SENSOR, _describe(seen.host, seen.says))


def _describe(host: str, says: NetFtConfiguration | CalibrationInfo) -> str:
    name = f"{says.product} {says.serial_number}" if isinstance(says, NetFtConfiguration) else "a sensor"
    return f"{name} at {host}: counts_per_N = {says.counts_per_N:.10g}, counts_per_Nm = {says.counts_per_Nm:.10g}"


def look_for_box() -> BoxObservation:
    """Asks for the configuration page of a Net F/T at its default address."""
    return look_at_box(NETFT_AS_DELIVERED, HttpBox(NETFT_AS_DELIVERED, timeout_s=NETFT_WITHIN_S))


def scan(runs: Path, clock: Clock) -> Iterator[Finding]:
    """Yields all findings as they come. Sends only a request for the configuration page of a Net F/T at its default address."""
    yield from judge_found_interfaces(tuple(look_at_can_interface(name) for name in can_interfaces()))
    yield from judge_found_adapters(look_for_adapters())
    ports = look_for_serial_ports()
    yield from [judge_found_port(port) for port in ports] or [judge_no_ports()]
    yield judge_found_sensor(look_for_box())
    yield judge_receive_buffer(probe_receive_buffer(), RECEIVE_BUFFER_BYTES, NETFT_RATE_Hz)
    yield from check_computer(runs, clock, None)
