"""Serial ports: existence and permission."""

import os
from dataclasses import dataclass
from pathlib import Path

from rfca_rig.devices.checks import Finding, green, red, yellow

SUBJECT = "serial port"


@dataclass(frozen=True)
class SerialPortSeen:
    """Observed port. `group` is its owner group, None if the system has no groups; `others` are the other serial ports."""

    path: str
    exists: bool
    may_open: bool = False
    group: str | None = None
    others: tuple[str, ...] = ()
    product: str = ""


def judge_serial_port(seen: SerialPortSeen, section: str) -> Finding:
    """Finding on a port that the rig file names under `section`."""
    if not seen.exists:
        existing = f"there is {', '.join(seen.others)}" if seen.others else "there is no serial port at all"
        return red(SUBJECT, f"there is no {seen.path}; {existing}", f"plug the cable in, or name the right port under {section}")
    if not seen.may_open:
        return red(SUBJECT, f"{seen.path} is not open to you{_owner_text(seen)}", *_permission(seen))
    return green(SUBJECT, f"{seen.path} {seen.product}".strip())


def judge_found_port(seen: SerialPortSeen) -> Finding:
    """Finding on a port that was found by a scan; a missing permission may not matter."""
    if not seen.may_open:
        return yellow(SUBJECT, f"{seen.path} {seen.product}".strip() + f", not open to you{_owner_text(seen)}", *_permission(seen))
    return green(SUBJECT, f"{seen.path} {seen.product}".strip())


def _owner_text(seen: SerialPortSeen) -> str:
    return "" if seen.group is None else f", it belongs to the group {seen.group}"


def _permission(seen: SerialPortSeen) -> tuple[str, ...]:
    """Fix for a missing permission. For a port of root the mode is changed: joining root's group would grant too much."""
    if seen.group is None or seen.group == "root":
        return "let yourself in until the next restart:", f"sudo chmod a+rw {seen.path}"
    return "join the group, then log out and in again:", f"sudo usermod -aG {seen.group} $USER"


def look_at_serial_port(path: str) -> SerialPortSeen:
    """Observes one port, with the names of the others."""
    products = _list_ports()
    others = tuple(sorted(other for other in products if other != path))
    return _observe(path, products.get(path, ""), others)


def look_for_serial_ports() -> tuple[SerialPortSeen, ...]:
    return tuple(_observe(path, product, ()) for path, product in sorted(_list_ports().items()))


def _list_ports() -> dict[str, str]:
    """Ports found by pyserial, with the product name. Ports of the mainboard without a connector are left out."""
    from serial.tools import list_ports  # noqa: PLC0415 (little else needs it)

    return {port.device: port.product or "" for port in list_ports.comports() if not port.device.startswith("/dev/ttyS")}


def _observe(path: str, product: str, others: tuple[str, ...]) -> SerialPortSeen:
    # On Windows a COM port is not a file and has no group.
    if os.name == "nt":
        return SerialPortSeen(path, path in _list_ports(), True, None, others, product)
    exists = Path(path).exists()
    return SerialPortSeen(path, exists, os.access(path, os.R_OK | os.W_OK), _group(path) if exists else None, others, product)


def _group(path: str) -> str | None:
    """Name of the owner group; None if it has no name."""
    try:
        return Path(path).group()
    except KeyError:
        return None
