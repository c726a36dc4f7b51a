"""A CAN wire inside this process."""

from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import can


class CanEnd(can.BusABC):
    """One end of a wire: what is sent here arrives at every other end, in order and at once.

    python-can's own `virtual` bus does the same and works in its place; it copies each message deeply, behind locks for
    threads, which costs half the time of a simulated rig. Here nobody changes a message after sending it.
    """

    def __init__(self, name: str, others: list["CanEnd"]) -> None:
        super().__init__(channel=name)
        self.channel_info = name
        self._others = others
        self._arrived: deque[can.Message] = deque()
        self._open = True

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002 (never full, so never waits)
        """Raises can.CanOperationError once this end is shut."""
        self._check_open()
        for end in self._others:
            if end is not self and end._open:
                end._arrived.append(msg)

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
    """The ends of a wire of its own: the driver's, the twin's, and where wanted those of observers. Shut when the block ends."""
    wire: list[CanEnd] = []
    with ExitStack() as stack:
        for _ in range(ends):
            wire.append(stack.enter_context(CanEnd(name, wire)))
        yield tuple(wire)
