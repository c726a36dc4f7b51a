"""CAN-FD bus behind an fdcanusb adapter, or the UART of a moteus, on a pseudo terminal; one client."""

import can

from rfca_rig.codecs import fdcanusb
from rfca_rig.codecs.fdcanusb import FdFrame
from rfca_rig.codecs.malformed import MalformedFrame
from rfca_rig.twin_server.pseudo_terminal import PseudoTerminal
from rfca_rig.twin_server.shared_wire import SharedWire

# Limit of the send queue in bytes.
MAX_QUEUED_BYTES = 1 << 18


class FdcanusbPort:
    """Answers `can on`, `can off` and `can send`, and forwards every frame of the bus; refuses everything else.

    Every sent line carries a checksum. Once a received line had one, all must have one, as on the UART of a moteus.
    """

    def __init__(self, wire: SharedWire) -> None:
        self._wire = wire
        self._end = wire.join()
        self._terminal = PseudoTerminal()
        self._rest = b""
        self._waiting = bytearray()
        self._checksums_asked = False

    def address(self) -> str:
        return f"fdcanusb {self.path}"

    @property
    def path(self) -> str:
        return self._terminal.path

    def poll(self, now_s: float) -> None:  # noqa: ARG002 (a serial adapter has no clock)
        self._receive()
        self._queue_frames()
        del self._waiting[: self._terminal.write(bytes(self._waiting)) if self._waiting else 0]

    def _receive(self) -> None:
        try:
            lines, self._rest = fdcanusb.split(self._rest + self._terminal.read())
        except MalformedFrame as error:
            lines, self._rest = [], b""
            self._waiting += fdcanusb.encode_line(f"ERR {error}")
        for received in lines:
            self._waiting += fdcanusb.encode_line(self._answer(received))

    def _answer(self, line: bytes) -> str:
        try:
            text, has_checksum = fdcanusb.parse_line(line)
            # As soon as a client has sent a checksum, lines without one are refused as damaged.
            if self._checksums_asked and not has_checksum:
                return "ERR checksum required"
            self._checksums_asked |= has_checksum
            if text in {"can on", "can off"}:
                return "OK"
            frame = fdcanusb.decode_send(text)
        except MalformedFrame as error:
            return f"ERR {error}"
        self._end.send(_message_of(frame))
        return "OK"

    def _queue_frames(self) -> None:
        """Queues frames of the bus for the client. Like a real adapter, it drops frames if the client does not read."""
        while (message := self._end.recv(timeout=0)) is not None:
            # The adapter carries CAN-FD frames only.
            if message.is_fd and not message.is_error_frame and len(self._waiting) < MAX_QUEUED_BYTES:
                self._waiting += fdcanusb.encode_received(_frame_of(message))

    def close(self) -> None:
        self._wire.leave(self._end)
        self._terminal.close()


def _message_of(frame: FdFrame) -> can.Message:
    return can.Message(
        arbitration_id=frame.can_id,
        data=frame.data,
        is_extended_id=frame.extended,
        is_fd=True,
        bitrate_switch=frame.bitrate_switch,
    )


def _frame_of(message: can.Message) -> FdFrame:
    return FdFrame(message.arbitration_id, bytes(message.data), message.is_extended_id, message.bitrate_switch)
