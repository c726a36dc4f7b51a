"""Scan for devices without a rig file."""

from collections.abc import Iterator
from pathlib import Path

from rfca_rig.clock import Clock
from rfca_rig.devices import FORCE_SENSORS, find_sensor, load_object
from rfca_rig.devices.checks import Finding, FoundSensor, green, judge_found_port, look_for_serial_ports, yellow
from rfca_rig.doctor.computer import check_computer
from rfca_rig.doctor.ports import (
    CanInterfaceObservation,
    can_interfaces,
    look_at_can_interface,
    look_for_adapters,
    make_up_command,
)

ADAPTERS, PORTS = "CAN adapters", "serial port"
# Bit rate for the proposed command if the interface has none yet, in bit/s.
USUAL_BITRATE = 1_000_000


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


def find_sensors() -> dict[str, FoundSensor]:
    """Results of the search for each built-in force sensor that can be found without a rig file, by its kind."""
    places = {kind: find_sensor(kind).find for kind in FORCE_SENSORS}
    return {kind: load_object(place)() for kind, place in places.items() if place is not None}


def scan(runs: Path, clock: Clock) -> Iterator[Finding]:
    """Yields all findings as they come. Sends only what the search for each force sensor sends."""
    yield from judge_found_interfaces(tuple(look_at_can_interface(name) for name in can_interfaces()))
    yield from judge_found_adapters(look_for_adapters())
    ports = look_for_serial_ports()
    yield from [judge_found_port(port) for port in ports] or [judge_no_ports()]
    for found in find_sensors().values():
        yield from found.findings
    yield from check_computer(runs, clock, None)
