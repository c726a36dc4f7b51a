"""CAN frames as the text of socketcand and of serial adapters, against python-can's own ends of
both.
"""

import os
import pty

import can
import pytest
from can.interfaces.slcan import slcanBus
from can.interfaces.socketcand.socketcand import (
    convert_ascii_message_to_can_message,
    convert_can_message_to_ascii_message,
)
from hypothesis import given
from hypothesis import strategies as st

from rfca_rig.codecs import classic_can
from rfca_rig.codecs.classic_can import ClassicFrame
from rfca_rig.errors import MalformedFrame


@st.composite
def frames(draw: st.DrawFn, remote: bool = False) -> ClassicFrame:
    extended = draw(st.booleans())
    can_id = draw(st.integers(0, 2**29 - 1 if extended else 2**11 - 1))
    if remote and draw(st.booleans()):
        return ClassicFrame(can_id, b"", extended, True, draw(st.integers(0, 8)))
    return ClassicFrame(can_id, draw(st.binary(max_size=8)), extended)


def message(frame: ClassicFrame) -> can.Message:
    return can.Message(arbitration_id=frame.can_id, data=frame.data, is_extended_id=frame.extended)


@given(frames())
def test_what_python_can_sends_to_socketcand_is_read(frame: ClassicFrame) -> None:
    (words,), rest = classic_can.split_socketcand(
        convert_can_message_to_ascii_message(message(frame)).encode()
    )
    assert classic_can.decode_send(words) == frame
    assert rest == b""


@given(frames())
def test_what_socketcand_tells_is_read_by_python_can(frame: ClassicFrame) -> None:
    heard = convert_ascii_message_to_can_message(classic_can.encode_socketcand(frame, 1.5).decode())
    assert (heard.arbitration_id, bytes(heard.data), heard.is_extended_id) == (
        frame.can_id,
        frame.data,
        frame.extended,
    )
    assert heard.timestamp == 1.5


def test_messages_of_the_socketcand_manual() -> None:
    (words,), _ = classic_can.split_socketcand(b"< send 123 0 >")
    assert classic_can.decode_send(words) == ClassicFrame(0x123)
    (words,), _ = classic_can.split_socketcand(b"< send 1AAAAAAA 8 11 22 33 44 55 66 77 88 >")
    assert classic_can.decode_send(words) == ClassicFrame(
        0x1AAAAAAA, bytes.fromhex("1122334455667788"), extended=True
    )
    assert (
        classic_can.encode_socketcand(ClassicFrame(0x123, b"\x11\x22\x33\x44"), 23.424242)
        == b"< frame 123 23.424242 11223344 >"
    )


@given(st.lists(frames(), max_size=5), st.integers(1, 30))
def test_messages_come_through_however_the_stream_is_cut(
    sent: list[ClassicFrame], cut: int
) -> None:
    stream = b"".join(
        convert_can_message_to_ascii_message(message(frame)).encode() for frame in sent
    )
    heard = []
    rest = b""
    for at in range(0, len(stream), cut):
        messages, rest = classic_can.split_socketcand(rest + stream[at : at + cut])
        heard += [classic_can.decode_send(words) for words in messages]
    assert heard == sent


@given(frames(remote=True))
def test_a_frame_survives_a_serial_adapter(frame: ClassicFrame) -> None:
    (line,), rest = classic_can.split_slcan(classic_can.encode_slcan(frame))
    assert classic_can.decode_frame(line) == frame
    assert rest == b""


def test_lines_of_the_serial_adapter_manual() -> None:
    assert classic_can.decode_frame("t10021133") == ClassicFrame(0x100, b"\x11\x33")
    assert classic_can.decode_frame("T0000010021133") == ClassicFrame(
        0x100, b"\x11\x33", extended=True
    )
    assert classic_can.decode_frame("r1002") == ClassicFrame(0x100, remote=True, length=2)
    assert classic_can.encode_slcan(ClassicFrame(0x100, b"\x11\x33")) == b"t10021133\r"


def test_python_can_s_serial_bus_hears_and_says_the_same() -> None:
    master, slave = pty.openpty()
    bus = slcanBus(os.ttyname(slave), sleep_after_open=0.0)
    sent = ClassicFrame(0x09, bytes(range(8)))
    os.write(master, classic_can.encode_slcan(sent))
    heard = bus.recv(timeout=60.0)
    assert (heard.arbitration_id, bytes(heard.data)) == (sent.can_id, sent.data)
    bus.send(can.Message(arbitration_id=0x29, is_extended_id=False, is_remote_frame=True, dlc=8))
    said = b""
    while b"r" not in said or not said.endswith(classic_can.END):
        said += os.read(master, 100)
    lines, _ = classic_can.split_slcan(said)
    assert lines[-1] == "r0298"
    assert classic_can.decode_frame(lines[-1]) == ClassicFrame(0x29, remote=True, length=8)
    bus.shutdown()
    os.close(master)
    os.close(slave)


@given(st.binary(max_size=600))
def test_no_bytes_make_a_reader_raise_anything_but_its_own_error(junk: bytes) -> None:
    try:
        for words in classic_can.split_socketcand(junk)[0]:
            classic_can.decode_send(words)
    except MalformedFrame:
        pass
    try:
        for line in classic_can.split_slcan(junk)[0]:
            classic_can.decode_frame(line)
    except MalformedFrame:
        pass


@given(st.text(alphabet="<> send0123456789abcdefTtRr\r", max_size=80))
def test_nothing_close_to_a_frame_does_either(text: str) -> None:
    test_no_bytes_make_a_reader_raise_anything_but_its_own_error.hypothesis.inner_test(
        text.encode()
    )


@pytest.mark.parametrize(
    "line",
    [
        "t80000",
        "t1009",
        "t1002113",
        "T3FFFFFFF0",
        "t",
        "x1000",
        "t10021133 ",
        "r10021133",
        "t100²11",
    ],
)
def test_a_serial_line_that_is_no_frame_is_refused(line: str) -> None:
    with pytest.raises(MalformedFrame):
        classic_can.decode_frame(line)


@pytest.mark.parametrize(
    "text",
    [
        "send 123 2 11",
        "send 800 0",
        "send 123 1 111",
        "send 3FFFFFFF 0",
        "send 123",
        "open can0",
        "send 123 -1",
        "send 1_2 0",
    ],
)
def test_a_socketcand_message_that_is_no_frame_is_refused(text: str) -> None:
    with pytest.raises(MalformedFrame):
        classic_can.decode_send(text.split())


def test_socketcand_carries_no_remote_frame() -> None:
    with pytest.raises(MalformedFrame):
        classic_can.encode_socketcand(ClassicFrame(0x123, remote=True), 0.0)
