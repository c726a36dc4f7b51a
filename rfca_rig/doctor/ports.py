"""CAN: the interfaces of the Linux kernel, other adapters, and the bus of a rig file, on which it
only listens.

`look_at` functions probe, as does `devices.checks.Listener`; `judge` functions evaluate what was
seen.
"""

import json
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import can

from rfca_rig.devices.checks import CanBusObservation, Finding, green, red, yellow
from rfca_rig.drivers import fdcanusb
from rfca_rig.drivers.can_frames import FD_SAMPLE_POINT_PERCENT

BUS_SUBJECT = "CAN bus"
# Fix and commands for the interfaces of python-can whose drivers have to be installed or set up.
REMEDIES = {
    "socketcand": "start socketcand, or rfca-rig twin serve, and say where it is:",
    "fdcanusb": "check channel under [motor], and that no other program has the port:",
    "slcan": "check the path of the serial port in channel under [motor], and who may open it",
    "pcan": (
        "install PEAK's driver (on Linux its kernel driver does: interface = 'socketcan'), "
        "and check channel, such as PCAN_USBBUS1"
    ),
    "kvaser": "install Kvaser's canlib, and check channel, which is a number",
    "gs_usb": "install the package, and check channel, which is a number:",
    "ixxat": "install IXXAT's VCI driver, and check channel, which is a number",
    "vector": "install Vector's XL driver, and check channel, which is a number",
}
COMMANDS = {
    "socketcand": """export CAN_CONFIG='{"host": "127.0.0.1", "port": 29536}'""",
    "gs_usb": 'pip install "python-can[gs-usb]"',
    "fdcanusb": "ls -l /dev/serial/by-id",
}

CAN_INTERFACE_SUBJECT = "CAN interface"
NETWORK = Path("/sys/class/net")
# From linux/if_arp.h, linux/if.h and linux/can.h.
ARPHRD_CAN = "280"
IFF_UP = 1
CANFD_MTU = 72
IP_WITHIN_S = 2.0
FINDABLE = (
    "canalystii",
    "cantact",
    "gs_usb",
    "ixxat",
    "kvaser",
    "neovi",
    "nican",
    "nixnet",
    "pcan",
    "systec",
    "usb2can",
    "vector",
)


def judge_can_bus(
    seen: CanBusObservation, interface: str, channel: str, known: tuple[str, ...]
) -> Finding:
    """Finding on the bus. `known` are the interfaces of python-can, and fdcanusb."""
    name = f"{interface} {channel}"
    if interface not in known:
        return red(
            BUS_SUBJECT,
            f"{interface} is no interface of python-can",
            f"interface under [motor] must be one of {', '.join(known)}",
        )
    if seen.error is not None:
        remedy = REMEDIES.get(
            interface, "check interface and channel under [motor], and the adapter's driver"
        )
        commands = []
        if interface in COMMANDS:
            commands.append(COMMANDS[interface])
        return red(BUS_SUBJECT, f"{name} cannot be opened: {seen.error}", remedy, *commands)
    if seen.went_off or seen.failed is not None:
        if seen.went_off:
            problem = "went off after too many errors"
        else:
            problem = f"failed: {seen.failed}"
        return red(
            BUS_SUBJECT,
            f"{name} {problem}",
            "check wiring, termination and bit rate, then start the interface again",
        )
    if seen.error_frames:
        fix = (
            "check that the drive has the bit rate of the rig file, the wiring, and a 120 "
            "ohm resistor at both ends"
        )
        return yellow(
            BUS_SUBJECT,
            f"{name} opens, with {seen.error_frames} error frames beside {seen.frames} good ones",
            fix,
        )
    return green(BUS_SUBJECT, f"{name} opens")


@dataclass(frozen=True)
class CanInterfaceObservation:
    """Observed interface. `others` are the other CAN interfaces. Values are None if the system does
    not report them.

    A virtual interface has no bit rate. `state` is that of the controller (ERROR-ACTIVE,
    ERROR-PASSIVE, BUS-OFF ...).
    """

    channel: str
    exists: bool
    others: tuple[str, ...] = ()
    is_can: bool = True
    is_virtual: bool = False
    is_up: bool = False
    state: str | None = None
    bitrate: int | None = None
    data_bitrate: int | None = None
    is_fd: bool = False


def judge_can_interface(
    seen: CanInterfaceObservation, bitrate: int, data_bitrate: int | None
) -> Finding:
    """Finding on the interface. `data_bitrate` is that of CAN-FD, None for a drive with classic
    CAN.
    """
    if not seen.exists:
        return _absent(seen, bitrate)
    if not seen.is_can:
        problem = f"{seen.channel} is a network interface but not CAN{_others(seen)}"
        return red(CAN_INTERFACE_SUBJECT, problem, "put a CAN interface into channel under [motor]")
    finding = _not_running(seen, make_up_command(seen.channel, bitrate, data_bitrate))
    # A virtual interface has no bit rate to compare.
    if finding is None and not seen.is_virtual:
        finding = _wrong_rate(seen, bitrate, data_bitrate)
    return (
        finding
        or _errors_counted(seen)
        or green(CAN_INTERFACE_SUBJECT, f"{seen.channel} is up, {_rates(seen)}")
    )


def _not_running(seen: CanInterfaceObservation, up: str) -> Finding | None:
    if not seen.is_up:
        return red(CAN_INTERFACE_SUBJECT, f"{seen.channel} is down", "bring it up:", up)
    if seen.state == "BUS-OFF":
        fix = "check wiring, termination and bit rate, then:"
        return red(
            CAN_INTERFACE_SUBJECT,
            f"{seen.channel} is off after too many errors",
            fix,
            make_down_command(seen.channel),
            up,
        )
    return None


def _errors_counted(seen: CanInterfaceObservation) -> Finding | None:
    if seen.state not in {"ERROR-PASSIVE", "ERROR-WARNING"}:
        return None
    fix = (
        "check the drive's power, the wiring, a 120 ohm resistor at both ends, and that the "
        "drive has the same bit rate"
    )
    return yellow(
        CAN_INTERFACE_SUBJECT,
        f"{seen.channel} is up, but its controller counts errors ({seen.state})",
        fix,
    )


def make_up_command(name: str, bitrate: int, data_bitrate: int | None = None) -> str:
    """Shell command that brings a kernel interface up."""
    command = f"sudo ip link set {name} up type can bitrate {bitrate}"
    if data_bitrate is None:
        return command
    sample_point = FD_SAMPLE_POINT_PERCENT / 100.0
    return (
        f"{command} dbitrate {data_bitrate} fd on "
        f"sample-point {sample_point:g} dsample-point {sample_point:g}"
    )


def make_down_command(name: str) -> str:
    """Shell command that takes a kernel interface down."""
    return f"sudo ip link set {name} down"


def _absent(seen: CanInterfaceObservation, bitrate: int) -> Finding:
    problem = f"there is no {seen.channel}{_others(seen)}"
    if seen.others:
        return red(
            CAN_INTERFACE_SUBJECT, problem, f'put channel = "{seen.others[0]}" under [motor]'
        )
    fix = (
        "plug the adapter in, and load its driver; an adapter that is a serial port needs "
        "slcand (s6 is 500 kbit/s, s8 is 1 Mbit/s):"
    )
    # Codes of slcand's option -s.
    speed = {125_000: 4, 250_000: 5, 500_000: 6, 800_000: 7}.get(bitrate, 8)
    return red(
        CAN_INTERFACE_SUBJECT,
        problem,
        fix,
        "sudo modprobe can_raw gs_usb",
        f"sudo slcand -o -c -s{speed} /dev/ttyACM0 {seen.channel}",
    )


def _wrong_rate(
    seen: CanInterfaceObservation, bitrate: int, data_bitrate: int | None
) -> Finding | None:
    name = seen.channel
    restart = (
        make_down_command(seen.channel),
        make_up_command(seen.channel, bitrate, data_bitrate),
    )
    if seen.bitrate is not None and seen.bitrate != bitrate:
        return red(
            CAN_INTERFACE_SUBJECT,
            f"{name} runs at {seen.bitrate} bit/s, the rig file says {bitrate}",
            "correct the one that is wrong:",
            *restart,
        )
    if data_bitrate is not None and not seen.is_fd:
        return red(
            CAN_INTERFACE_SUBJECT,
            f"{name} is set to classic CAN, the drive speaks CAN-FD",
            "set it up for CAN-FD:",
            *restart,
        )
    if data_bitrate is not None and seen.data_bitrate not in {None, data_bitrate}:
        problem = (
            f"{name} runs its data phase at {seen.data_bitrate} bit/s, the rig file says "
            f"{data_bitrate}"
        )
        return red(CAN_INTERFACE_SUBJECT, problem, "correct the one that is wrong:", *restart)
    if seen.bitrate is None:
        fix = (
            f"it must be {bitrate} bit/s: slcand has it in its option -s, else ip shows it "
            "(package iproute2):"
        )
        return yellow(
            CAN_INTERFACE_SUBJECT, f"{name} is up, its bit rate is not reported", fix, _show(name)
        )
    return None


def _rates(seen: CanInterfaceObservation) -> str:
    if seen.is_virtual:
        return "virtual"
    if seen.data_bitrate is None:
        return f"{seen.bitrate} bit/s"
    return f"{seen.bitrate} bit/s, data {seen.data_bitrate} bit/s"


def _others(seen: CanInterfaceObservation) -> str:
    if seen.others:
        return f"; there is {', '.join(seen.others)}"
    return "; no CAN interface at all"


def _show(name: str) -> str:
    return f"ip -details link show {name}"


def look_at_can_interface(channel: str, network: Path = NETWORK) -> CanInterfaceObservation:
    """Observes one interface. The bit rate is known only if the command `ip` is installed."""
    names = can_interfaces(network)
    others = tuple(name for name in names if name != channel)
    if not channel or "/" in channel or not (network / channel).exists():
        return CanInterfaceObservation(channel, False, others)
    details = {}
    if network == NETWORK:
        details = _query_ip(channel)
    info = details.get("linkinfo", {})
    data = info.get("info_data", {})
    return CanInterfaceObservation(
        channel=channel,
        exists=True,
        others=others,
        is_can=channel in names,
        is_virtual=info.get("info_kind", "") in {"vcan", "vxcan"},
        is_up=bool(int(_text(network / channel / "flags") or "0", 16) & IFF_UP),
        state=data.get("state"),
        bitrate=data.get("bittiming", {}).get("bitrate"),
        data_bitrate=data.get("data_bittiming", {}).get("bitrate"),
        is_fd=_text(network / channel / "mtu") == str(CANFD_MTU),
    )


def can_interfaces(network: Path = NETWORK) -> tuple[str, ...]:
    """Names of all CAN interfaces of the kernel."""
    if not network.is_dir():
        return ()
    return tuple(
        sorted(entry.name for entry in network.iterdir() if _text(entry / "type") == ARPHRD_CAN)
    )


def _text(file: Path) -> str:
    """Content of a file, empty if it does not exist: interfaces come and go."""
    try:
        return file.read_text().strip()
    except OSError:
        return ""


def _query_ip(channel: str) -> dict[str, Any]:
    """Output of `ip` on the interface; empty if it is not installed, or too old for JSON."""
    command = ["ip", "-details", "-json", "link", "show", "dev", channel]
    try:
        output = subprocess.run(
            command, capture_output=True, timeout=IP_WITHIN_S, check=True
        ).stdout
        links = json.loads(output)
    except (OSError, subprocess.SubprocessError, ValueError):
        return {}
    if links and isinstance(links[0], dict):
        return links[0]
    return {}


def look_for_adapters() -> tuple[tuple[str, str], ...]:
    """All adapters as (interface, channel). Interfaces without an installed driver find none."""
    configurations = can.detect_available_configs(FINDABLE)
    adapters = [
        (str(configuration["interface"]), str(configuration["channel"]))
        for configuration in configurations
    ]
    adapters += [(fdcanusb.INTERFACE, port) for port in fdcanusb.find_adapters()]
    return tuple(sorted(adapters))
