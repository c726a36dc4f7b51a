"""The bus behind a fdcanusb, on the twin server's adapter and on one whose answers are scripted."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import can
import pytest
import serial
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from rfca_rig.codecs import fdcanusb as codec
from rfca_rig.devices.moteus.driver import MoteusMotor, MoteusSettings
from rfca_rig.doctor.ports import look_for_adapters
from rfca_rig.drivers.can_frames import BusHealth, CanBusSettings, receive_frames, send, send_stop
from rfca_rig.errors import DeviceError
from rfca_rig.twin_server.can_ports import FdcanusbPort, PseudoTerminal, SharedWire
from tests.twin_server.polling import polled, quick_clock
from tests.waiting import wait_for

QUERY = can.Message(
    arbitration_id=0xA001,
    data=b"\x11\x00\x50",
    is_extended_id=True,
    is_fd=True,
    bitrate_switch=True,
)
RATES = {"can.bitrate": "1000000", "can.fd_bitrate": "5000000"}


def open_bus(path: str) -> can.BusABC:
    return CanBusSettings("fdcanusb", path, 1_000_000, 5_000_000).open()


@contextmanager
def adapter() -> Iterator[tuple[can.BusABC, can.BusABC]]:
    """Our bus on the adapter of the twin server, and the wire's other end."""
    wire = SharedWire("test")
    port = FdcanusbPort(wire)
    far = wire.join()
    with polled(port), open_bus(port.path) as bus:
        yield bus, far


class ScriptedAdapter:
    """An adapter on USB, whose lines have no checksums; `answer` says what it makes of a line, and
    `lines` is what it heard.
    """

    def __init__(self, answer: Callable[[str], str | None] | None = None) -> None:
        self.terminal = PseudoTerminal()
        self.lines: list[str] = []
        self.is_stalled = False
        self._answer = answer or like_the_firmware
        self._rest = b""

    def poll(self, now_s: float) -> None:  # noqa: ARG002 (an adapter has no clock)
        if self.is_stalled:
            return
        lines, self._rest = codec.split(self._rest + self.terminal.read())
        for line in lines:
            text = line.decode()
            self.lines.append(text)
            answer = self._answer(text)
            if answer is not None:
                self.say(answer)

    def say(self, text: str) -> None:
        self.terminal.write(text.encode() + b"\r\n")

    def address(self) -> str:
        return self.terminal.path

    def close(self) -> None:
        self.terminal.close()


def like_the_firmware(line: str) -> str | None:
    """can_manager.cc: a bus that is on at the start, settings without an OK after them."""
    if line.startswith("conf get "):
        return RATES[line.removeprefix("conf get ")]
    if line.startswith("can on"):
        return "ERR already in BusOn"
    return "OK"


@contextmanager
def scripted(
    answer: Callable[[str], str | None] | None = None,
) -> Iterator[tuple[can.BusABC, ScriptedAdapter]]:
    device = ScriptedAdapter(answer)
    with polled(device), open_bus(device.terminal.path) as bus:
        device.lines.clear()
        yield bus, device


def received(bus: can.BusABC) -> can.Message:
    message = bus.recv(timeout=60.0)
    assert message is not None
    return message


@pytest.mark.parametrize(
    "message",
    [
        QUERY,
        can.Message(arbitration_id=0x123, data=bytes(64), is_extended_id=False, is_fd=True),
        can.Message(arbitration_id=0x12345, data=b"\1\2\3", is_extended_id=True),
        can.Message(arbitration_id=0x12, data=b"\1", is_extended_id=True),
        can.Message(arbitration_id=0x12, data=bytes(8), is_extended_id=False),
    ],
)
def test_frames_of_every_kind_pass_both_ways(message: can.Message) -> None:
    arrived: list[can.Message | None] = []
    with adapter() as (bus, far):
        bus.send(message)
        wait_for(lambda: arrived.append(far.recv(timeout=0)) or arrived[-1] is not None)
        far.send(message)
        arrived.append(received(bus))
    for copy in arrived[-2:]:
        assert message.equals(copy, timestamp_delta=None, check_channel=False)


def test_an_adapter_on_usb_is_sent_no_checksums_and_one_word_of_flags() -> None:
    with scripted() as (bus, device):
        bus.send(QUERY)
        wait_for(lambda: len(device.lines) > 0)
    assert device.lines == ["can send a001 110050 BF"]


def test_the_bus_is_switched_off_and_on_so_that_a_bus_off_is_over() -> None:
    device = ScriptedAdapter()
    with polled(device), open_bus(device.terminal.path):
        assert [codec.parse_line(line.encode())[0] for line in device.lines[:2]] == [
            "can off",
            "can on",
        ]


def test_a_port_without_an_adapter_is_named() -> None:
    device = ScriptedAdapter(lambda _: None)
    with polled(device), pytest.raises(can.CanInitializationError, match="no answer from a fdcan"):
        open_bus(device.terminal.path)


def test_an_adapter_with_other_bit_rates_is_refused_with_the_lines_that_set_it() -> None:
    device = ScriptedAdapter(
        lambda line: "250000" if line == "conf get can.fd_bitrate" else like_the_firmware(line)
    )
    with (
        polled(device),
        pytest.raises(
            can.CanInitializationError,
            match=r"has can\.fd_bitrate 250000, the rig file says 5000000; .*"
            r"can off, conf set can\.fd_bitrate 5000000, conf write, can on",
        ),
    ):
        open_bus(device.terminal.path)


def test_a_uart_gets_checksums_also_where_the_program_before_left_it_with_them() -> None:
    wire = SharedWire("test")
    port = FdcanusbPort(wire)
    far = wire.join()
    arrived: list[can.Message | None] = []
    with polled(port):
        with serial.Serial(port.path, timeout=60.0) as line:
            line.write(codec.encode_line("can on"))
            assert line.readline()
        with open_bus(port.path) as bus:
            bus.send(QUERY)
            wait_for(lambda: arrived.append(far.recv(timeout=0)) or arrived[-1] is not None)
    assert arrived[-1].arbitration_id == QUERY.arbitration_id


def test_a_uart_that_protects_its_lines_only_when_asked_is_asked() -> None:
    """As in uart_fdcanusb_micro_server.h: it knows one command, and its frames have no flags."""
    is_guarded = False

    def answer(line: str) -> str:
        nonlocal is_guarded
        text, has_checksum = codec.parse_line(line.encode())
        is_guarded |= has_checksum
        replies = ["OK", "rcv 00000120 21000a"] if text.startswith("can send ") else []
        lines = replies or ["ERR unknown command"]
        return "\r\n".join(codec.encode_line(reply, is_guarded).decode().strip() for reply in lines)

    with scripted(answer) as (bus, device):
        bus.send(QUERY)
        message = received(bus)
        assert device.lines == [codec.encode_line("can send a001 110050 BF").decode().strip()]
        # A frame that lost its end on the way, and the checksum with it, is none.
        device.say("rcv 00000120 2100")
        assert received(bus).is_error_frame
    assert (message.arbitration_id, bytes(message.data), message.is_fd) == (
        0x120,
        b"\x21\x00\x0a",
        True,
    )


def test_a_second_program_cannot_take_lines_away() -> None:
    with scripted() as (_, device), pytest.raises(can.CanInitializationError, match="lock"):
        open_bus(device.terminal.path)


def test_a_refused_frame_is_one_line() -> None:
    with scripted(
        lambda line: "ERR unknown flag" if "send" in line else like_the_firmware(line)
    ) as (bus, device):
        bus.send(QUERY)
        wait_for(lambda: len(device.lines) > 0)
        with pytest.raises(
            DeviceError,
            match=r"^CAN bus failed while reading the drive: the adapter refused a frame: "
            r"unknown flag; press the emergency stop if it turns$",
        ):
            for _ in range(10_000):
                list(receive_frames(bus, BusHealth()))
                quick_clock.wait_until(quick_clock.now_s() + 1e-3)


def test_a_frame_that_it_cannot_send_is_one_line() -> None:
    empty = can.Message(arbitration_id=0xA001, is_fd=True)
    with (
        scripted() as (bus, _),
        pytest.raises(DeviceError, match="0x0000a001 to the drive not sent: a fdcanusb sends no"),
    ):
        send(bus, empty)


@pytest.mark.parametrize(
    "damaged",
    [
        "rcv 120 210",
        "rcv 120 21000A E B F r f-1 *00",
        "rcv 120 21rcv 120 21000A E B F r f-1",
        "v 120 21000A E B F r f-1",
        "ERR checksum mismatch",
        "x" * 300,
    ],
)
def test_a_damaged_line_is_an_error_frame_and_the_next_one_is_read(damaged: str) -> None:
    with scripted() as (bus, device):
        device.say(damaged)
        assert received(bus).is_error_frame
        device.say("rcv 120 21000A E B F r f-1")
        message = received(bus)
    assert (message.arbitration_id, bytes(message.data)) == (0x120, b"\x21\x00\x0a")


def test_error_frames_are_counted_and_do_not_end_a_run() -> None:
    health = BusHealth()
    with scripted() as (bus, device):
        device.say("rcv 120 2")
        device.say("rcv 120 21 E B F r")
        frames: list[can.Message] = []
        wait_for(lambda: bool(frames.extend(receive_frames(bus, health)) or frames))
    assert [bytes(frame.data) for frame in frames] == [b"\x21"]
    assert health.facts()["can_error_frames"] == "1"


def test_a_pulled_cable_is_one_line_when_read_and_when_commanded() -> None:
    device = ScriptedAdapter()
    with polled(device):
        bus = open_bus(device.terminal.path)
    # The other end of the line was closed with the block.
    with bus:
        motor = MoteusMotor(bus, quick_clock, MoteusSettings())
        with pytest.raises(
            DeviceError, match=r"^CAN bus failed while reading the drive: the adapter is gone"
        ):
            motor.read()
        with pytest.raises(DeviceError, match="not sent: the adapter is gone, or another program"):
            motor.disable()


def test_a_stalled_adapter_refuses_within_the_time_for_torque_off() -> None:
    with scripted() as (bus, device):
        device.is_stalled = True
        # The system holds the lines until its buffer is full.
        with pytest.raises(DeviceError, match="not sent: the adapter takes no more frames"):
            for _ in range(100_000):
                send(bus, QUERY)
        began_s = quick_clock.now_s()
        with pytest.raises(DeviceError, match="takes no more frames"):
            send_stop(bus, quick_clock, [QUERY])
        # It has 20 ms; a busy machine takes longer, but not seconds.
        assert quick_clock.now_s() - began_s < 4.0


class NarrowPort:
    """A port of which the system takes `room` bytes, and no more."""

    def __init__(self, port: Any, room: int) -> None:
        self._port = port
        self.room = room

    def write(self, data: bytes) -> int:
        taken = data[: self.room]
        self.room -= len(taken)
        self._port.write(taken)
        return len(taken)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._port, name)


def test_a_line_that_was_cut_is_finished_before_the_next() -> None:
    other = can.Message(arbitration_id=0xA002, data=b"\x50", is_fd=True)
    with scripted() as (bus, device):
        bus._port = narrow = NarrowPort(bus._port, 10)
        with pytest.raises(DeviceError, match="takes no more frames"):
            send(bus, QUERY)
        # Nothing of this one is taken: it is forgotten.
        with pytest.raises(DeviceError, match="takes no more frames"):
            send(bus, QUERY)
        narrow.room = 1000
        send(bus, other)
        wait_for(lambda: len(device.lines) == 2)
    assert device.lines == ["can send a001 110050 BF", "can send a002 50 bF"]


def test_adapters_are_found_by_their_usb_ids_and_names(monkeypatch: pytest.MonkeyPatch) -> None:
    def port(device: str, vid: int | None, pid: int | None, product: str | None) -> ListPortInfo:
        info = ListPortInfo(device)
        info.vid = vid
        info.pid = pid
        info.product = product
        return info

    ports = [
        port("/dev/ttyACM1", 0x0483, 0x5740, "fdcanusb"),
        port("/dev/ttyACM2", 0x0483, 0x5740, "STM32 Virtual ComPort"),
        port("/dev/ttyACM0", 0x1209, 0x2323, "mjcanfd-usb-1x"),
        port("/dev/ttyS0", None, None, None),
    ]
    monkeypatch.setattr(list_ports, "comports", lambda: ports)
    assert look_for_adapters() == (("fdcanusb", "/dev/ttyACM0"), ("fdcanusb", "/dev/ttyACM1"))
