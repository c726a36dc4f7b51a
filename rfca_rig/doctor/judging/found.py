"""Evaluates devices found without a rig file; a missing one is not an error."""

from rfca_rig.codecs.netft_configuration import CalibrationInfo, NetFtConfiguration
from rfca_rig.doctor.finding import Finding, green, yellow
from rfca_rig.doctor.judging.can_interface import CanInterfaceObservation, make_up_command
from rfca_rig.doctor.judging.netft import BoxObservation

ADAPTERS, PORTS, SENSOR = "CAN adapters", "serial port", "Net F/T"
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


def judge_found_sensor(seen: BoxObservation) -> Finding:
    if seen.says is None:
        fix = "a sensor as delivered needs this computer in its network; with the right network port for eth0:"
        return yellow(SENSOR, f"none at {seen.host}, where it is as delivered", fix, "sudo ip address add 192.168.1.100/24 dev eth0")
    return green(SENSOR, _describe(seen.host, seen.says))


def _describe(host: str, says: NetFtConfiguration | CalibrationInfo) -> str:
    name = f"{says.product} {says.serial_number}" if isinstance(says, NetFtConfiguration) else "a sensor"
    return f"{name} at {host}: counts_per_N = {says.counts_per_N:.10g}, counts_per_Nm = {says.counts_per_Nm:.10g}"
