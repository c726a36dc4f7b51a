"""CAN buses that other processes join: by TCP (socketcand), or by a serial adapter on a pseudo
terminal (slcan, fdcanusb).
"""

import os
import pty
import tty
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

import can

from rfca_rig.codecs import classic_can, fdcanusb
from rfca_rig.codecs.classic_can import ClassicFrame
from rfca_rig.codecs.fdcanusb import AdapterFrame
from rfca_rig.errors import MalformedFrame
from rfca_rig.twin_server.tcp import TcpClient, accept_all, is_http, listening_tcp
from rfca_rig.twins.wires import CanEnd

NEVER = float("inf")
# Clients expect the answer to `rawmode` alone in their next read, so frames are held back for this
# long.
FRAME_DELAY_S = 0.05

# Limit of the send queue in bytes.
MAX_QUEUED_BYTES = 1 << 18
# Settings of a fdcanusb from the factory, in bits/s.
FDCANUSB_RATES = {"can.bitrate": 1_000_000, "can.fd_bitrate": 5_000_000}
VERSION = b"V1013"
SERIAL_NUMBER = b"NTWIN"


class SharedWire:
    """Every end receives what the others send, as on a real bus."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._ends: list[CanEnd] = []

    def join(self) -> CanEnd:
        end = CanEnd(self._name, self._ends)
        self._ends.append(end)
        return end

    def leave(self, end: CanEnd) -> None:
        """Removes an end. May be called more than once."""
        if end in self._ends:
            self._ends.remove(end)
            end.shutdown()


def message_of(frame: ClassicFrame) -> can.Message:
    """Converts a classic frame to a python-can message."""
    return can.Message(
        arbitration_id=frame.can_id,
        data=frame.data,
        dlc=frame.length,
        is_extended_id=frame.extended,
        is_remote_frame=frame.remote,
    )


def is_classic(message: can.Message) -> bool:
    """Whether `frame_of` can convert the message: neither CAN FD nor an error frame."""
    return not message.is_fd and not message.is_error_frame


def frame_of(message: can.Message) -> ClassicFrame:
    """Converts a python-can message, which must be classic, to a frame."""
    remote = message.is_remote_frame
    data = b""
    if not remote:
        data = bytes(message.data)
    return ClassicFrame(
        message.arbitration_id,
        data,
        message.is_extended_id,
        remote,
        message.dlc,
    )


@dataclass
class _Member:
    """A client, its end of the bus, and the time from which it is sent frames; never unless it
    requested raw mode.
    """

    client: TcpClient
    end: CanEnd
    frames_from_s: float = NEVER
    is_open: bool = False
    rest: bytes = b""


class SocketcandPort:
    """Answers `open`, `rawmode`, `bcmmode`, `echo` and `send`; everything else is refused with an
    `error` message.

    Every bus name leads to the same bus. Frames carry the time since the epoch; `epoch_s` is that
    of the clock's zero.
    """

    def __init__(self, wire: SharedWire, host: str, port: int, epoch_s: float) -> None:
        self._wire = wire
        self._epoch_s = epoch_s
        self._listening = listening_tcp(host, port)
        self._host, self.port = self._listening.getsockname()
        self._members: list[_Member] = []

    def address(self) -> str:
        return f"socketcand {self._host}:{self.port}, any channel name"

    def poll(self, now_s: float) -> None:
        for client in accept_all(self._listening, len(self._members)):
            client.send(classic_can.GREETING)
            self._members.append(_Member(client, self._wire.join()))
        for member in self._members:
            self._listen_to(member, now_s)
            self._send_frames(member, now_s)
            member.client.flush(now_s)
        self._remove_closed()

    def _listen_to(self, member: _Member, now_s: float) -> None:
        received = member.client.receive()
        if not received:
            return
        # The body of a browser's request may hold valid messages; none of it is obeyed.
        if is_http(member.rest + received):
            member.client.open = False
            return
        try:
            messages, member.rest = classic_can.split_socketcand(member.rest + received)
        # A client that does not follow the protocol is disconnected.
        except MalformedFrame:
            member.client.open = False
            return
        for words in messages:
            self._obey(member, words, now_s)

    def _obey(self, member: _Member, words: list[str], now_s: float) -> None:
        command = words[0] if words else ""
        if command == "send" and member.is_open:
            self._send(member, words)
        elif command == "open":
            member.is_open = True
            member.client.send(classic_can.OK)
        elif command in {"rawmode", "bcmmode"} and member.is_open:
            # Only raw mode receives frames; `bcmmode` switches them off again.
            if command == "rawmode":
                member.frames_from_s = now_s + FRAME_DELAY_S
            else:
                member.frames_from_s = NEVER
            member.client.send(classic_can.OK)
        elif command == "echo":
            member.client.send(b"< echo >")
        elif member.is_open:
            member.client.send(classic_can.error("unknown command"))
        else:
            member.client.send(classic_can.error("open a bus first"))

    def _send(self, member: _Member, words: list[str]) -> None:
        try:
            member.end.send(message_of(classic_can.decode_send(words)))
        except MalformedFrame:
            member.client.send(classic_can.error("could not parse send command"))

    def _send_frames(self, member: _Member, now_s: float) -> None:
        # Frames wait at the end of the bus until then.
        if now_s < member.frames_from_s < NEVER:
            return
        while (message := member.end.recv(timeout=0)) is not None:
            # The protocol carries neither remote frames nor CAN FD.
            if member.frames_from_s < NEVER and is_classic(message) and not message.is_remote_frame:
                member.client.send(
                    classic_can.encode_socketcand(frame_of(message), self._epoch_s + now_s)
                )

    def _remove_closed(self) -> None:
        for member in [member for member in self._members if not member.client.open]:
            self._members.remove(member)
            self._wire.leave(member.end)
            member.client.close()

    def close(self) -> None:
        for member in self._members:
            member.client.open = False
        self._remove_closed()
        self._listening.close()


class PseudoTerminal:
    """Raw byte stream without echo or translation. The client's side stays open here too, so
    that clients may come and go.
    """

    def __init__(self) -> None:
        self._device_side, self._client_side = pty.openpty()
        tty.setraw(self._client_side)
        os.set_blocking(self._device_side, False)
        self.path = os.ttyname(self._client_side)
        self._open = True

    def read(self) -> bytes:
        """All bytes that have arrived; never waits."""
        try:
            return os.read(self._device_side, 1 << 16)
        except BlockingIOError:
            return b""

    def write(self, data: bytes) -> int:
        """Sends bytes; returns how many fitted. The line holds a few kilobytes until the client
        reads.
        """
        try:
            return os.write(self._device_side, data)
        except BlockingIOError:
            return 0

    def close(self) -> None:
        """Closes both sides. May be called any number of times."""
        if self._open:
            self._open = False
            os.close(self._device_side)
            os.close(self._client_side)


class _SerialAdapter(ABC):
    """A CAN adapter on a pseudo terminal: one end of the bus, and the bytes that wait for the
    client.
    """

    def __init__(self, wire: SharedWire) -> None:
        self._wire = wire
        self._end = wire.join()
        self._terminal = PseudoTerminal()
        self._rest = b""
        self._waiting = bytearray()

    @property
    def path(self) -> str:
        return self._terminal.path

    def poll(self, now_s: float) -> None:  # noqa: ARG002 (a serial adapter has no clock)
        self._receive()
        self._queue_frames()
        if self._waiting:
            del self._waiting[: self._terminal.write(bytes(self._waiting))]

    @abstractmethod
    def _receive(self) -> None:
        """Answers what the client sent."""

    @abstractmethod
    def _queue_frames(self) -> None:
        """Queues frames of the bus for the client. Like a real adapter, it drops frames if the
        client does not read.
        """

    def close(self) -> None:
        self._wire.leave(self._end)
        self._terminal.close()


class SlcanPort(_SerialAdapter):
    """Answers open, close, bit rate, version, serial number, status and frames; a bell character
    refuses everything else.
    """

    def __init__(self, wire: SharedWire) -> None:
        super().__init__(wire)
        self._channel_open = False
        self._listen_only = False

    def address(self) -> str:
        return f"slcan {self.path}"

    def _receive(self) -> None:
        try:
            lines, self._rest = classic_can.split_slcan(self._rest + self._terminal.read())
        except MalformedFrame:
            self._rest = b""
            self._waiting += classic_can.REFUSED
            return
        for line in lines:
            if line:
                self._waiting += self._answer(line)

    def _answer(self, line: str) -> bytes:
        letter = line[0]
        if letter in classic_can.FRAME_LETTERS:
            return self._send(line)
        if letter in "OLC":
            self._channel_open = letter != "C"
            self._listen_only = letter == "L"
            # Frames from before the channel was opened are not delivered.
            self._waiting.clear()
            return classic_can.END
        answer = {"V": VERSION, "N": SERIAL_NUMBER, "F": b"F00"}.get(
            letter, b"" if letter in "SsZMmXW" else None
        )
        if answer is None:
            return classic_can.REFUSED
        return answer + classic_can.END

    def _send(self, line: str) -> bytes:
        if not self._channel_open or self._listen_only:
            return classic_can.REFUSED
        try:
            frame = classic_can.decode_frame(line)
        except MalformedFrame:
            return classic_can.REFUSED
        self._end.send(message_of(frame))
        if frame.extended:
            return b"Z\r"
        return b"z\r"

    def _queue_frames(self) -> None:
        while (message := self._end.recv(timeout=0)) is not None:
            if self._channel_open and is_classic(message) and len(self._waiting) < MAX_QUEUED_BYTES:
                self._waiting += classic_can.encode_slcan(frame_of(message))


class FdcanusbPort(_SerialAdapter):
    """Answers `can on`, `can off`, `can send` and `conf get`, and forwards every frame of the bus;
    refuses everything else. The bus is on until it is switched off, as with today's adapters.

    Every sent line carries a checksum. Once a received line had one, all must have one, as on the
    UART of a drive. `rates` are the adapter's settings.
    """

    def __init__(self, wire: SharedWire, rates: Mapping[str, int] = FDCANUSB_RATES) -> None:
        super().__init__(wire)
        self._rates = rates
        self._checksums_asked = False
        self._is_on = True

    def address(self) -> str:
        return f"fdcanusb {self.path}"

    def _receive(self) -> None:
        try:
            lines, self._rest = fdcanusb.split(self._rest + self._terminal.read())
        except MalformedFrame as error:
            lines = []
            self._rest = b""
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
                return self._switch(text == "can on")
            if text.startswith("conf get "):
                return str(self._rates.get(text.removeprefix("conf get "), "ERR error reading"))
            frame = fdcanusb.decode_send(text)
        except MalformedFrame as error:
            return f"ERR {error}"
        if not self._is_on:
            return "ERR not in BusOn state"
        self._end.send(
            can.Message(
                arbitration_id=frame.can_id,
                data=frame.data,
                is_extended_id=frame.extended,
                is_fd=frame.fd,
                bitrate_switch=frame.bitrate_switch,
                is_remote_frame=frame.remote,
            )
        )
        return "OK"

    def _switch(self, on: bool) -> str:
        if on == self._is_on:
            return f"ERR already in {'BusOn' if on else 'BusOff'}"
        self._is_on = on
        # Frames that nobody fetched are not those of the next client.
        self._waiting.clear()
        return "OK"

    def _queue_frames(self) -> None:
        while (message := self._end.recv(timeout=0)) is not None:
            if self._is_on and not message.is_error_frame and len(self._waiting) < MAX_QUEUED_BYTES:
                self._waiting += fdcanusb.encode_received(
                    AdapterFrame(
                        message.arbitration_id,
                        bytes(message.data),
                        message.is_extended_id,
                        message.bitrate_switch,
                        message.is_fd,
                        message.is_remote_frame,
                    )
                )
