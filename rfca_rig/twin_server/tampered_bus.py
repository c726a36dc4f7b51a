"""The drive's end of the CAN wire with its faults."""

from typing import Protocol

import can

from rfca_rig.codecs.moteus import FD_LENGTHS
from rfca_rig.twin_server.faults import FaultPanel


class DriveDialect(Protocol):
    """What a fault must know of the drive's own frames."""

    def is_heartbeat(self, message: can.Message) -> bool: ...

    def jumped(self, message: can.Message) -> can.Message:
        """The frame as it is with the encoder displaced; other frames as they are."""
        ...


class NoDialect:
    """For drives whose frames no fault looks into."""

    def is_heartbeat(self, message: can.Message) -> bool:  # noqa: ARG002 (none is)
        return False

    def jumped(self, message: can.Message) -> can.Message:
        return message


class TamperedBus(can.BusABC):
    """A bus for the twin; what the panel says happens to the frames that pass."""

    def __init__(self, end: can.BusABC, panel: FaultPanel, dialect: DriveDialect) -> None:
        super().__init__(channel=end.channel_info)
        self.channel_info = end.channel_info
        self._end = end
        self._panel = panel
        self._dialect = dialect

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Raises can.CanOperationError once the end is shut."""
        if self._panel.any_on():
            if self._panel.is_on("can-silent") or self._panel.is_on("bus-off"):
                return
            if self._panel.is_on("heartbeat-silent") and self._dialect.is_heartbeat(msg):
                return
            if self._panel.is_on("encoder-jump"):
                msg = self._dialect.jumped(msg)
            if self._panel.is_on("can-short"):
                msg = _shortened(msg)
            if self._panel.is_on("can-twice"):
                self._end.send(msg, timeout)
        self._end.send(msg, timeout)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        message = self._end.recv(timeout)
        while message is not None and self._panel.is_on("bus-off"):
            message = self._end.recv(timeout)
        if message is not None and self._panel.is_on("own-frame-echo"):
            self._end.send(message)
        return message, False

    def shutdown(self) -> None:
        super().shutdown()
        self._end.shutdown()


def with_data(message: can.Message, data: bytes) -> can.Message:
    """The same frame with other data, and the length that goes with it."""
    return can.Message(
        arbitration_id=message.arbitration_id,
        data=data,
        is_extended_id=message.is_extended_id,
        is_fd=message.is_fd,
        bitrate_switch=message.bitrate_switch,
    )


def _shortened(message: can.Message) -> can.Message:
    """Without its last byte, or on CAN-FD of the next length that there is."""
    length = len(message.data) - 1
    if message.is_fd:
        length = max((one for one in FD_LENGTHS if one <= length), default=0)
    return with_data(message, bytes(message.data[: max(length, 0)]))
