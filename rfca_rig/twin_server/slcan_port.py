"""CAN bus behind a serial adapter (slcan) on a pseudo terminal; one client, as on a real adapter."""

from rfca_rig.codecs import slcan
from rfca_rig.codecs.malformed import MalformedFrame
from rfca_rig.twin_server.pseudo_terminal import PseudoTerminal
from rfca_rig.twin_server.shared_wire import SharedWire, frame_of, is_classic, message_of

# Limit of the send queue in bytes.
MAX_QUEUED_BYTES = 1 << 18
VERSION, SERIAL_NUMBER = b"V1013", b"NTWIN"


class SlcanPort:
    """Answers open, close, bit rate, version, serial number, status and frames; a bell character refuses everything else."""

    def __init__(self, wire: SharedWire) -> None:
        self._wire = wire
        self._end = wire.join()
        self._terminal = PseudoTerminal()
        self._rest = b""
        self._waiting = bytearray()
        self._channel_open = False
        self._listen_only = False

    def address(self) -> str:
        return f"slcan {self.path}"

    @property
    def path(self) -> str:
        return self._terminal.path

    def poll(self, now_s: float) -> None:  # noqa: ARG002 (a serial adapter has no clock)
        self._receive()
        self._queue_frames()
        del self._waiting[: self._terminal.write(bytes(self._waiting)) if self._waiting else 0]

    def _receive(self) -> None:
        try:
            lines, self._rest = slcan.split(self._rest + self._terminal.read())
        except MalformedFrame:
            self._rest = b""
            self._waiting += slcan.REFUSED
            return
        for line in lines:
            if line:
                self._waiting += self._answer(line)

    def _answer(self, line: str) -> bytes:
        letter = line[0]
        if letter in slcan.FRAME_LETTERS:
            return self._send(line)
        if letter in "OLC":
            self._channel_open, self._listen_only = letter != "C", letter == "L"
            # Frames from before the channel was opened are not delivered.
            self._waiting.clear()
            return slcan.END
        answer = {"V": VERSION, "N": SERIAL_NUMBER, "F": b"F00"}.get(letter, b"" if letter in "SsZMmXW" else None)
        return slcan.REFUSED if answer is None else answer + slcan.END

    def _send(self, line: str) -> bytes:
        if not self._channel_open or self._listen_only:
            return slcan.REFUSED
        try:
            frame = slcan.decode_frame(line)
        except MalformedFrame:
            return slcan.REFUSED
        self._end.send(message_of(frame))
        return b"Z\r" if frame.extended else b"z\r"

    def _queue_frames(self) -> None:
        """Queues frames of the bus for the client. Like a real adapter, it drops frames if the client does not read."""
        while (message := self._end.recv(timeout=0)) is not None:
            if self._channel_open and is_classic(message) and len(self._waiting) < MAX_QUEUED_BYTES:
                self._waiting += slcan.encode_frame(frame_of(message))

    def close(self) -> None:
        self._wire.leave(self._end)
        self._terminal.close()
