"""Lists serial ports and their permissions."""

import os
from pathlib import Path

from rfca_rig.doctor.judging.serial_port import SerialPortSeen


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
