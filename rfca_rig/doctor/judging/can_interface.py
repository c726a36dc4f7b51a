"""Evaluates a CAN interface of the Linux kernel: existence, type, state and bit rate."""

from dataclasses import dataclass

from rfca_rig.doctor.finding import Finding, green, red, yellow

SUBJECT = "CAN interface"


@dataclass(frozen=True)
class CanInterfaceObservation:
    """Observed interface. `others` are the other CAN interfaces. Values are None if the system does not report them.

    A virtual interface has no bit rate. `state` is that of the controller (ERROR-ACTIVE, ERROR-PASSIVE, BUS-OFF ...).
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


def judge_can_interface(seen: CanInterfaceObservation, bitrate: int, data_bitrate: int | None) -> Finding:
    """Finding on the interface. `data_bitrate` is that of CAN-FD, None for a drive with classic CAN."""
    if not seen.exists:
        return _absent(seen, bitrate)
    if not seen.is_can:
        problem = f"{seen.channel} is a network interface but not CAN{_others(seen)}"
        return red(SUBJECT, problem, "put a CAN interface into channel under [motor]")
    finding = _not_running(seen, make_up_command(seen.channel, bitrate, data_bitrate))
    # A virtual interface has no bit rate to compare.
    if finding is None and not seen.is_virtual:
        finding = _wrong_rate(seen, bitrate, data_bitrate)
    return finding or _errors_counted(seen) or green(SUBJECT, f"{seen.channel} is up, {_rates(seen)}")


def _not_running(seen: CanInterfaceObservation, up: str) -> Finding | None:
    if not seen.is_up:
        return red(SUBJECT, f"{seen.channel} is down", "bring it up:", up)
    if seen.state == "BUS-OFF":
        fix = "check wiring, termination and bit rate, then:"
        return red(SUBJECT, f"{seen.channel} is off after too many errors", fix, make_down_command(seen.channel), up)
    return None


def _errors_counted(seen: CanInterfaceObservation) -> Finding | None:
    if seen.state not in {"ERROR-PASSIVE", "ERROR-WARNING"}:
        return None
    fix = "check the drive's power, the wiring, a 120 ohm resistor at both ends, and that the drive has the same bit rate"
    return yellow(SUBJECT, f"{seen.channel} is up, but its controller counts errors ({seen.state})", fix)


def make_up_command(name: str, bitrate: int, data_bitrate: int | None = None) -> str:
    """Shell command that brings a kernel interface up."""
    fd = "" if data_bitrate is None else f" dbitrate {data_bitrate} fd on"
    return f"sudo ip link set {name} up type can bitrate {bitrate}{fd}"


def make_down_command(name: str) -> str:
    """Shell command that takes a kernel interface down."""
    return f"sudo ip link set {name} down"


def _absent(seen: CanInterfaceObservation, bitrate: int) -> Finding:
    problem = f"there is no {seen.channel}{_others(seen)}"
    if seen.others:
        return red(SUBJECT, problem, f'put channel = "{seen.others[0]}" under [motor]')
    fix = "plug the adapter in, and load its driver; an adapter that is a serial port needs slcand (s6 is 500 kbit/s, s8 is 1 Mbit/s):"
    # Codes of slcand's option -s.
    speed = {125_000: 4, 250_000: 5, 500_000: 6, 800_000: 7}.get(bitrate, 8)
    return red(SUBJECT, problem, fix, "sudo modprobe can_raw gs_usb", f"sudo slcand -o -c -s{speed} /dev/ttyACM0 {seen.channel}")


def _wrong_rate(seen: CanInterfaceObservation, bitrate: int, data_bitrate: int | None) -> Finding | None:
    name, restart = seen.channel, (make_down_command(seen.channel), make_up_command(seen.channel, bitrate, data_bitrate))
    if seen.bitrate is not None and seen.bitrate != bitrate:
        return red(SUBJECT, f"{name} runs at {seen.bitrate} bit/s, the rig file says {bitrate}", "correct the one that is wrong:", *restart)
    if data_bitrate is not None and not seen.is_fd:
        return red(SUBJECT, f"{name} is set to classic CAN, the drive speaks CAN-FD", "set it up for CAN-FD:", *restart)
    if data_bitrate is not None and seen.data_bitrate not in {None, data_bitrate}:
        problem = f"{name} runs its data phase at {seen.data_bitrate} bit/s, the rig file says {data_bitrate}"
        return red(SUBJECT, problem, "correct the one that is wrong:", *restart)
    if seen.bitrate is None:
        fix = f"it must be {bitrate} bit/s: slcand has it in its option -s, else ip shows it (package iproute2):"
        return yellow(SUBJECT, f"{name} is up, its bit rate is not told", fix, _show(name))
    return None


def _rates(seen: CanInterfaceObservation) -> str:
    if seen.is_virtual:
        return "virtual"
    return f"{seen.bitrate} bit/s" + ("" if seen.data_bitrate is None else f", data {seen.data_bitrate} bit/s")


def _others(seen: CanInterfaceObservation) -> str:
    return f"; there is {', '.join(seen.others)}" if seen.others else "; no CAN interface at all"


def _show(name: str) -> str:
    return f"ip -details link show {name}"
