"""In-process CAN bus."""

from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import can


class CanEnd(can.BusABC):
    """One end of the bus: a frame sent here arrives at every other end, in order and at once.

    python-can's `virtual` bus does the same and can replace it. It makes a deep copy of each message, behind thread locks, which
    takes half the time of a simulated rig. Here no message is changed after sending, so none is copied.
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
        """As every bus. A look without waiting skips the clock and the log of the base class, which cost more than the message."""
        return super().recv(timeout) if timeout != 0 or self.filters else self._recv_internal(timeout)[0]

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
    """Creates a bus with `ends` ends: driver, twin, and optional observers. They are shut down when the block ends."""
    wire: list[CanEnd] = []
    with ExitStack() as stack:
        for _ in range(ends):
            wire.append(stack.enter_context(CanEnd(name, wire)))
        yield tuple(wire)
