"""In-process wires between drivers and twins: a CAN bus, a datagram link and a serial line, without
loss and without delay.

`SampleGrid` gives the times at which a twin sends on them.
"""

from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from math import floor
from typing import Protocol

import can
import numpy as np
from numpy.typing import NDArray

from rfca_rig.clock import TWIN_START
from rfca_rig.errors import DeviceError

Floats = NDArray[np.float64]

# Seconds since 1970; kept, because a twin stamps hundreds of frames a second.
TWIN_START_S = TWIN_START.timestamp()
# Share of a period: a time that rounding moved just past the end of a step still belongs to it.
SLACK = 1e-6

NO_TIMES = np.empty(0)


def stamp_s(at_s: float) -> float:
    """Time stamp of a CAN frame that a twin sends at a time of its clock: seconds since 1970, as a
    socket of Linux stamps the frames that arrive.
    """
    return TWIN_START_S + at_s


class CanEnd(can.BusABC):
    """One end of the bus: a frame sent here arrives at every other end, in order and at once.

    python-can's `virtual` bus does the same and can replace it. It makes a deep copy of each
    message, behind thread locks, which takes half the time of a simulated rig. Here no message is
    changed after sending, so none is copied.
    """

    def __init__(self, name: str, others: list["CanEnd"]) -> None:
        super().__init__(channel=name)
        self.channel_info = name
        self._others = others
        self._arrived: deque[can.Message] = deque()
        self._open = True

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002 (never full, so never waits)
        """Sends to all other open ends. Raises can.CanOperationError once this end is shut down."""
        self._check_open()
        for end in self._others:
            if end is not self and end._open:
                end._arrived.append(msg)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """As every bus. A look without waiting skips the clock and the log of the base class,
        which cost more than the message.
        """
        if timeout != 0 or self._filters:
            return super().recv(timeout)
        return self._recv_internal(timeout)[0]

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:  # noqa: ARG002 (nothing can arrive meanwhile)
        self._check_open()
        return (self._arrived.popleft() if self._arrived else None), False

    def shutdown(self) -> None:
        super().shutdown()
        self._open = False

    def _check_open(self) -> None:
        if not self._open:
            raise can.CanOperationError(f"{self.channel_info} is shut")


@contextmanager
def can_wire(name: str = "twin CAN wire", ends: int = 2) -> Iterator[tuple[CanEnd, ...]]:
    """Creates a bus with `ends` ends: driver, twin, and optional observers. They are shut down
    when the block ends.
    """
    wire: list[CanEnd] = []
    with ExitStack() as stack:
        for _ in range(ends):
            wire.append(stack.enter_context(CanEnd(name, wire)))
        yield tuple(wire)


class DatagramLink(Protocol):
    """A twin's end of a datagram link, in-process or on a network."""

    def send(self, datagram: bytes) -> None: ...

    def receive_all(self) -> list[bytes]:
        """Everything that has arrived, oldest first; never waits."""
        ...

    def close(self) -> None: ...


class LinkEnd:
    """One end; datagrams sent here are received at the other end in order."""

    def __init__(self, outgoing: deque[bytes], incoming: deque[bytes]) -> None:
        self._outgoing = outgoing
        self._incoming = incoming
        self._open = True

    def send(self, datagram: bytes) -> None:
        """Raises DeviceError once this end is closed."""
        self._check_open()
        self._outgoing.append(datagram)

    def receive_all(self) -> list[bytes]:
        """Everything that has arrived, oldest first. Raises DeviceError once this end is closed."""
        self._check_open()
        # Asked at every step of a twin, for an order that comes once in a run.
        if not self._incoming:
            return []
        received = list(self._incoming)
        self._incoming.clear()
        return received

    def close(self) -> None:
        self._open = False

    def _check_open(self) -> None:
        if not self._open:
            raise DeviceError("datagram link used after it was closed")


def datagram_link() -> tuple[LinkEnd, LinkEnd]:
    """Creates both ends: the driver's and the twin's."""
    to_twin: deque[bytes] = deque()
    to_driver: deque[bytes] = deque()
    return LinkEnd(to_twin, to_driver), LinkEnd(to_driver, to_twin)


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
    """The driver's end, with the members of `serial.Serial` that a driver uses. A closed end
    raises OSError, as pyserial does.
    """

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
    to_twin = bytearray()
    to_driver = bytearray()
    return HostEnd(to_twin, to_driver), DeviceEnd(to_driver, to_twin)


class SampleGrid:
    """The times n * period, n = 1, 2 ..., each returned once. They are computed from zero, so
    rounding errors do not accumulate.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._taken = 0

    @property
    def taken(self) -> int:
        """Number of the last time returned."""
        return self._taken

    def skip_to(self, now_s: float) -> None:
        """Leaves out all times up to `now_s`, for a grid that begins there."""
        self.count_until(now_s)

    def until(self, to_s: float) -> Floats:
        """Times (m,) in s not yet returned, none later than `to_s`."""
        first = self._taken + 1
        count = self.count_until(to_s)
        if not count:
            return NO_TIMES
        times: Floats = np.arange(first, first + count, dtype=np.float64)
        times *= self._period_s
        # Only the last may have been moved past the end by rounding.
        times[-1] = min(times[-1], to_s)
        return times

    def list_until(self, to_s: float) -> list[float]:
        """The same times as plain numbers: for one or two, an array takes longer."""
        first = self._taken + 1
        count = self.count_until(to_s)
        return [min(number * self._period_s, to_s) for number in range(first, first + count)]

    def count_until(self, to_s: float) -> int:
        """How many times `until` would return; they count as returned."""
        count = max(0, floor(to_s / self._period_s + SLACK) - self._taken)
        self._taken += count
        return count
