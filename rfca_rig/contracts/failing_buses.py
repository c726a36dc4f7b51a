"""CAN buses with faults, for tests."""

import can


class UnpluggedBus(can.BusABC):
    """A bus whose adapter was unplugged."""

    channel_info = "pulled"

    def __init__(self) -> None:
        super().__init__(channel="pulled")

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002
        raise can.CanOperationError("transmit buffer full")

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:  # noqa: ARG002
        raise can.CanOperationError("no such device")


class BusFullFor(can.BusABC):
    """A bus whose transmit queue is full for the first `frames` frames."""

    channel_info = "full"

    def __init__(self, frames: int) -> None:
        super().__init__(channel="full")
        self._left = frames
        self.sent: list[can.Message] = []

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002
        self._left -= 1
        if self._left >= 0:
            raise can.CanOperationError("transmit buffer full")
        self.sent.append(msg)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:  # noqa: ARG002
        return None, False
