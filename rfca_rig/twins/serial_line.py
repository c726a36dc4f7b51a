"""In-process serial line, without loss and without delay."""

from typing import Protocol


class SerialLine(Protocol):
    """A twin's end of a serial line, in-process or on a pseudo terminal."""

    def read(self) -> bytes:
        """All bytes that have arrived; never waits."""
        ...

    def write(self, data: bytes) -> int:
        """Sends as many bytes as there is room for; returns their number."""
        ...


class DeviceEnd:
    """The twin's end."""

    def __init__(self, outgoing: bytearray, incoming: bytearray) -> None:
        self._outgoing = outgoing
        self._incoming = incoming

    def read(self) -> bytes:
        data = bytes(self._incoming)
        self._incoming.clear()
        return data

    def write(self, data: bytes) -> int:
        self._outgoing += data
        return len(data)


class HostEnd:
    """The driver's end, with the members of `serial.Serial` that a driver uses. A closed end raises OSError, as pyserial does."""

    def __init__(self, outgoing: bytearray, incoming: bytearray) -> None:
        self._outgoing = outgoing
        self._incoming = incoming
        self._open = True

    @property
    def in_waiting(self) -> int:
        self._check_open()
        return len(self._incoming)

    def read(self, size: int = 1) -> bytes:
        self._check_open()
        data = bytes(self._incoming[:size])
        del self._incoming[:size]
        return data

    def write(self, data: bytes) -> int:
        self._check_open()
        self._outgoing += data
        return len(data)

    def close(self) -> None:
        self._open = False

    def _check_open(self) -> None:
        if not self._open:
            raise OSError("serial line used after it was closed")


def serial_line() -> tuple[HostEnd, DeviceEnd]:
    """Creates both ends: the driver's and the twin's."""
    to_twin, to_driver = bytearray(), bytearray()
    return HostEnd(to_twin, to_driver), DeviceEnd(to_driver, to_twin)
