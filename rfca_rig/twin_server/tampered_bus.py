"""CAN bus with injected faults, between the drive twin and its clients."""

from typing import Protocol

import can

from rfca_rig.codecs.moteus import FD_LENGTHS
from rfca_rig.twin_server.faults import FaultPanel


class DriveDialect(Protocol):
    """Knowledge of the drive's frames that bus faults need."""

    def is_heartbeat(self, message: can.Message) -> bool: ...

    def jumped(self, message: can.Message) -> can.Message:
        """The frame with a displaced encoder position; other frames unchanged."""
        ...


class NoDialect:
    """For drives without faults that depend on the content of frames."""

    def is_heartbeat(self, message: can.Message) -> bool:  # noqa: ARG002 (none is)
        return False

    def jumped(self, message: can.Message) -> can.Message:
        return message


class TamperedBus(can.BusABC):
    """The twin's bus; the faults of the panel act on the frames that pass."""

    def __init__(self, end: can.BusABC, panel: FaultPanel, dialect: DriveDialect) -> None:
        super().__init__(channel=end.channel_info)
        self.channel_info = end.channel_info
        self._end = end
        self._panel = panel
        self._dialect = dialect

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Sends a frame with the active faults. Raises can.CanOperationError once the end is shut down."""
        # Without faults, the usual case, a frame costs no further lookups.
        if self._panel.any_on():
            if self._panel.is_on("can-silent") or self._panel.is_on("bus-off"):
                return
            if self._panel.is_on("heartbeat-silent") and self._dialect.is_heartbeat(msg):
                return
            if self._panel.is_on("encoder-jump"):
                msg = self._dialect.jumped(msg)
            if self._panel.is_on("can-short"):
                msg = _shorten(msg)
            # The frame is sent here a first time.
            if self._panel.is_on("can-twice"):
                self._end.send(msg, timeout)
        self._end.send(msg, timeout)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        message = self._end.recv(timeout)
        # A drive without a bus receives nothing: what arrives meanwhile is lost.
        while message is not None and self._panel.is_on("bus-off"):
            message = self._end.recv(timeout)
        if message is not None and self._panel.is_on("own-frame-echo"):
            self._end.send(message)
        return message, False

    def shutdown(self) -> None:
        super().shutdown()
        self._end.shutdown()


def replace_data(message: can.Message, data: bytes) -> can.Message:
    """The same frame with other data, and the matching length."""
    return can.Message(
        arbitration_id=message.arbitration_id,
        data=data,
        is_extended_id=message.is_extended_id,
        is_fd=message.is_fd,
        bitrate_switch=message.bitrate_switch,
    )


def _shorten(message: can.Message) -> can.Message:
    """Removes the last byte; on CAN-FD as many as lead to the next valid length."""
    length = len(message.data) - 1
    if message.is_fd:
        length = max((one for one in FD_LENGTHS if one <= length), default=0)
    return replace_data(message, bytes(message.data[: max(length, 0)]))
