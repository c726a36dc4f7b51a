"""CAN bus of python-can on a fdcanusb, the CAN-FD adapter of mjbots, or on the UART of a drive that
speaks as one.
"""

import os
import select
import time
from collections import deque
from typing import Any

import can

from rfca_rig.codecs import fdcanusb
from rfca_rig.codecs.fdcanusb import AdapterFrame
from rfca_rig.errors import MalformedFrame

INTERFACE = "fdcanusb"
# An adapter on USB takes any rate; the UART of a drive has this one.
UART_BITS_PER_S = 921_600
# USB ids of the adapters. The older ones are those of STMicroelectronics' example of a serial port,
# so the name of the product must fit as well.
USB_IDS = frozenset({(0x0483, 0x5740), (0x1209, 0x2323)})
PRODUCTS = ("fdcanusb", "mjcanfd")
# Time for the answer to a command, in s. An adapter takes milliseconds; the twin server on a busy
# machine takes longer.
ANSWER_S = 1.0
# Time in which the system takes a line, in s: it holds a hundred of them. Torque-off frames, which
# are sent again if they are not taken, have 20 ms in all.
WRITE_S = 5e-3
POLL_S = 5e-4
NO_ANSWER = "no answer from a fdcanusb"
GONE = "the adapter is gone, or another program reads its port; check the USB cable"


class FdcanusbBus(can.BusABC):
    """The bus behind one serial port. A line that is damaged on its way counts as an error frame.

    The first command has a checksum, which an adapter on USB ignores, and which makes a UART
    protect all its lines. Once a line came with a checksum, all must have one, both ways.
    """

    def __init__(self, channel: str, bitrate: int, data_bitrate: int | None = None) -> None:
        """Opens the port and switches the bus on. Raises can.CanInitializationError for a port
        that cannot be opened, without a fdcanusb, or where the adapter has other bit rates.
        """
        # A bus whose base class was initialised is shut down when it is collected.
        self._port = _open_port(channel)
        super().__init__(channel=channel)
        self.channel_info = f"{INTERFACE} {channel}"
        self._can_protocol = can.CanProtocol.CAN_FD
        self._rest = b""
        self._messages = deque[can.Message]()
        self._refusal: str | None = None
        self._is_protected = False
        # The rest of a line of which the system took only a part.
        self._cut = b""
        try:
            self._switch_on()
            self._check_rate("can.bitrate", bitrate)
            if data_bitrate is not None:
                self._check_rate("can.fd_bitrate", data_bitrate)
        except BaseException:
            self.shutdown()
            raise
        # What the bus said before it was asked belongs to nobody.
        self._messages.clear()

    def _switch_on(self) -> None:
        # Both are refused in the state that they lead to. Switching off first ends a bus-off.
        answers = (self._ask("can off", with_checksum=True), self._ask("can on"))
        if answers == (None, None):
            raise can.CanInitializationError(NO_ANSWER)

    def _check_rate(self, name: str, wanted: int) -> None:
        answer = self._ask(f"conf get {name}")
        # A UART has no such setting.
        if answer is None or not answer.isdecimal() or int(answer) == wanted:
            return
        raise can.CanInitializationError(
            f"the adapter has {name} {answer}, the rig file says {wanted}; correct the rig file, "
            f"or write to the adapter: can off, conf set {name} {wanted}, conf write, can on"
        )

    def _ask(self, command: str, with_checksum: bool = False) -> str | None:
        """The first line of the answer to a command; None without one in time."""
        self._write(fdcanusb.encode_line(command, with_checksum or self._is_protected))
        until_s = time.monotonic() + ANSWER_S
        while time.monotonic() < until_s:
            for text in self._read_texts():
                if not text.startswith("rcv "):
                    return text
            time.sleep(POLL_S)
        return None

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002
        """Hands a frame to the adapter, in 5 ms at most whatever `timeout` says. That the adapter
        refused a frame shows in a later call.

        Raises can.CanOperationError.
        """
        try:
            frame = AdapterFrame(
                msg.arbitration_id,
                bytes(msg.data),
                msg.is_extended_id,
                msg.bitrate_switch and msg.is_fd,
                msg.is_fd,
                msg.is_remote_frame,
            )
            line = fdcanusb.encode_send(frame, self._is_protected)
        except MalformedFrame as error:
            raise can.CanOperationError(str(error)) from error
        self._write(line)

    def _write(self, line: bytes) -> None:
        """Writes a line, after what is left of one that was cut. A line that the adapter did not
        begin to take is forgotten.
        """
        until_s = time.monotonic() + WRITE_S
        self._cut = self._push(self._cut, until_s)
        left = line
        if not self._cut:
            left = self._push(line, until_s)
            if left != line:
                self._cut = left
        if left:
            raise can.CanOperationError("the adapter takes no more frames")

    def _push(self, data: bytes, until_s: float) -> bytes:
        """Writes as much as the system takes until then; returns what is left."""
        try:
            while data and self._is_writable(until_s):
                # Takes at once what there is room for.
                data = data[self._port.write(data) :]
                if time.monotonic() > until_s:
                    break
        except (OSError, ValueError) as error:
            raise can.CanOperationError(f"{GONE}: {error}") from error
        return data

    def _is_writable(self, until_s: float) -> bool:
        # Windows cannot wait for a port; its buffer grows as needed.
        if os.name == "nt":
            return True
        left_s = max(until_s - time.monotonic(), 0.0)
        return bool(select.select([], [self._port], [], left_s)[1])

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        until_s = time.monotonic() + (timeout or 0.0)
        while not self._messages:
            for text in self._read_texts():
                self._take(text)
            if self._refusal is not None:
                refusal = self._refusal
                self._refusal = None
                raise can.CanOperationError(f"the adapter refused a frame: {refusal}")
            if self._messages or (timeout is not None and time.monotonic() >= until_s):
                break
            time.sleep(POLL_S)
        if not self._messages:
            return None, False
        return self._messages.popleft(), False

    def _read_texts(self) -> list[str]:
        """Lines that have arrived, without their checksums; damaged ones are noted."""
        try:
            received = self._port.read(self._port.in_waiting)
        # pyserial lets TypeError and termios.error pass where the port vanished meanwhile.
        except Exception as error:
            raise can.CanOperationError(f"{GONE}: {error}") from error
        texts: list[str] = []
        try:
            lines, self._rest = fdcanusb.split(self._rest + received)
        except MalformedFrame:
            lines = []
            self._rest = b""
            self._note_damage()
        for line in lines:
            try:
                text, has_checksum = fdcanusb.parse_line(line)
            except MalformedFrame:
                self._note_damage()
                continue
            self._is_protected |= has_checksum
            if self._is_protected and not has_checksum:
                self._note_damage()
            else:
                texts.append(text)
        return texts

    def _take(self, text: str) -> None:
        if text == "OK":
            return
        if text.startswith("ERR"):
            # A command that arrived damaged: lost, as on any bus.
            if "checksum" in text:
                self._note_damage()
            else:
                self._refusal = text.removeprefix("ERR").strip()
            return
        try:
            frame = fdcanusb.decode_received(text)
        except MalformedFrame:
            self._note_damage()
            return
        self._messages.append(
            can.Message(
                timestamp=time.time(),
                arbitration_id=frame.can_id,
                is_extended_id=frame.extended,
                is_remote_frame=frame.remote,
                channel=self.channel_info,
                data=frame.data,
                is_fd=frame.fd,
                bitrate_switch=frame.bitrate_switch,
            )
        )

    def _note_damage(self) -> None:
        self._messages.append(can.Message(timestamp=time.time(), is_error_frame=True))

    def shutdown(self) -> None:
        """Closes the port. The adapter stays on the bus, and acknowledges the frames of others."""
        super().shutdown()
        self._port.close()


def _open_port(channel: str) -> Any:
    import serial  # noqa: PLC0415 (no other bus needs it)

    try:
        return serial.Serial(channel, UART_BITS_PER_S, timeout=0, write_timeout=0, exclusive=True)
    except (OSError, ValueError) as error:
        raise can.CanInitializationError(str(error)) from error


def find_adapters() -> tuple[str, ...]:
    """Serial ports with an adapter, by its USB ids and name."""
    from serial.tools import list_ports  # noqa: PLC0415 (no other bus needs it)

    return tuple(
        sorted(
            port.device
            for port in list_ports.comports()
            if (port.vid, port.pid) in USB_IDS and _is_adapter(port.product)
        )
    )


def _is_adapter(product: str | None) -> bool:
    return any(name in (product or "").lower() for name in PRODUCTS)
