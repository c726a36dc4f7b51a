"""A serial port that does not wait, and the one that pyserial opens."""

from typing import Protocol

from rfca_rig.errors import DeviceError


class SerialPort(Protocol):
    """Those members of `serial.Serial` that a driver uses. All raise OSError when the way is broken, as pyserial does."""

    @property
    def in_waiting(self) -> int:
        """Bytes that have arrived."""
        ...

    def read(self, size: int = 1) -> bytes:
        """At most `size` bytes of what has arrived; never waits."""
        ...

    def write(self, data: bytes) -> int | None: ...

    def close(self) -> None: ...


def open_port(path: str, bits_per_s: int) -> SerialPort:
    """The port with 8 data bits, no parity, one stop bit. Raises DeviceError where it cannot be opened."""
    import serial  # noqa: PLC0415 (no other device needs it)

    try:
        port: SerialPort = serial.Serial(path, bits_per_s, timeout=0, write_timeout=1.0)
    except (serial.SerialException, ValueError) as error:
        raise DeviceError(
            f"serial port {path} cannot be opened: {error}; check [force_sensor] in the rig file, and who may open it"
        ) from error
    return port
