"""A serial line inside this process: nothing is lost on it, and nothing waits."""

from typing import Protocol


class SerialLine(Protocol):
    """What a twin asks of its end, here or on a pseudo terminal."""

    def read(self) -> bytes:
        """What has arrived; never waits."""
        ...

    def write(self, data: bytes) -> int:
        """Sends what there is room for; returns how many bytes that were."""
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
    """The driver's end, with those members of `serial.Serial` that a driver uses. A closed end raises OSError, as there."""

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
    """Both ends, for the driver and for the twin."""
    there, back = bytearray(), bytearray()
    return HostEnd(there, back), DeviceEnd(back, there)
