"""Non-blocking serial port interface, and its pyserial implementation."""

from typing import Protocol

from rfca_rig.errors import DeviceError


class SerialPort(Protocol):
    """The members of `serial.Serial` that drivers use. All raise OSError if the line is broken, as pyserial does."""

    @property
    def in_waiting(self) -> int:
        """Bytes that have arrived."""
        ...

    def read(self, size: int = 1) -> bytes:
        """At most `size` of the bytes that have arrived; never waits."""
        ...

    def write(self, data: bytes) -> int | None: ...

    def close(self) -> None: ...


def open_port(path: str, bits_per_s: int) -> SerialPort:
    """Opens the port with 8 data bits, no parity, one stop bit. Raises DeviceError if it cannot be opened."""
    import serial  # noqa: PLC0415 (no other device needs it)

    try:
        port: SerialPort = serial.Serial(path, bits_per_s, timeout=0, write_timeout=1.0)
    except (serial.SerialException, ValueError) as error:
        raise DeviceError(
            f"serial port {path} cannot be opened: {error}; check [force_sensor] in the rig file, and who may open it"
        ) from error
    return port
