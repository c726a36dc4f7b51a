"""Looks for serial ports, and at who may open them."""

import os
from pathlib import Path

from rfca_rig.doctor.judging.serial_port import SerialPortSeen


def look_at_serial_port(path: str) -> SerialPortSeen:
    """One port, with the others there are."""
    known = _known()
    others = tuple(sorted(other for other in known if other != path))
    return _seen(path, known.get(path, ""), others)


def look_for_serial_ports() -> tuple[SerialPortSeen, ...]:
    return tuple(_seen(path, product, ()) for path, product in sorted(_known().items()))


def _known() -> dict[str, str]:
    """What pyserial finds, with what the device calls itself; ports of the mainboard that lead nowhere are left out."""
    from serial.tools import list_ports  # noqa: PLC0415 (little else needs it)

    return {port.device: port.product or "" for port in list_ports.comports() if not port.device.startswith("/dev/ttyS")}


def _seen(path: str, product: str, others: tuple[str, ...]) -> SerialPortSeen:
    if os.name == "nt":  # a COM port is no file, and belongs to no group
        return SerialPortSeen(path, path in _known(), True, None, others, product)
    exists = Path(path).exists()
    return SerialPortSeen(path, exists, os.access(path, os.R_OK | os.W_OK), _group(path) if exists else None, others, product)


def _group(path: str) -> str | None:
    """None for a group without a name."""
    try:
        return Path(path).group()
    except KeyError:
        return None
