"""Lines of a fdcanusb against their description."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rfca_rig.codecs import fdcanusb
from rfca_rig.codecs.fdcanusb import FD_LENGTHS, AdapterFrame
from rfca_rig.errors import MalformedFrame

COMMAND = "01000a07206000200150ff140400130d"  # the worked example of the moteus reference


def test_the_documented_example_is_read() -> None:
    frame = fdcanusb.decode_send(f"can send 8001 {COMMAND}")
    assert frame == AdapterFrame(0x8001, bytes.fromhex(COMMAND))
    assert fdcanusb.decode_received("rcv 100 2404000a005000000170ff230d181400").extended is False


def test_the_checksum_is_that_of_its_polynomial() -> None:
    assert fdcanusb.crc8(b"") == 0
    assert fdcanusb.crc8(b"\x01") == 0x97  # one bit: the polynomial itself
    remainder = int.from_bytes(b"OK \x00", "big")
    for bit in range(31, 7, -1):  # long division by x^8 + 0x97
        remainder ^= (0x197 << bit - 8) if remainder >> bit & 1 else 0
    assert fdcanusb.crc8(b"OK ") == remainder


frames = st.builds(
    AdapterFrame,
    st.integers(0, (1 << 29) - 1),
    st.sampled_from([length for length in FD_LENGTHS if length]).flatmap(
        lambda length: st.binary(min_size=length, max_size=length)
    ),
    st.just(True),
    st.booleans(),
)
classic_frames = st.builds(
    AdapterFrame,
    st.integers(0, (1 << 11) - 1),
    st.binary(min_size=1, max_size=8),
    st.booleans(),
    st.just(False),
    st.just(False),
)


@given(st.one_of(frames, classic_frames))
def test_frames_survive_both_ways(frame: AdapterFrame) -> None:
    for encode, decode in (
        (fdcanusb.encode_send, fdcanusb.decode_send),
        (fdcanusb.encode_received, fdcanusb.decode_received),
    ):
        ((said,), rest) = fdcanusb.split(encode(frame))
        text, has_checksum = fdcanusb.parse_line(said)
        assert (decode(text), has_checksum, rest) == (frame, True, b"")


@given(frames, st.integers(0, 50), st.integers(0, 7))
def test_a_flipped_bit_is_never_taken_for_another_frame(
    frame: AdapterFrame, at: int, bit: int
) -> None:
    ((said,), _) = fdcanusb.split(fdcanusb.encode_send(frame))
    at %= len(said) - 3
    flipped = said[:at] + bytes([said[at] ^ 1 << bit]) + said[at + 1 :]
    with pytest.raises(MalformedFrame, match="checksum"):
        fdcanusb.parse_line(flipped)


@given(st.binary(max_size=300))
def test_no_bytes_raise_anything_but_the_codecs_own_error(received: bytes) -> None:
    try:
        lines, _ = fdcanusb.split(received)
        for said in lines:
            text, _ = fdcanusb.parse_line(said)
            fdcanusb.decode_send(text)
    except MalformedFrame:
        pass


@pytest.mark.parametrize(
    "text",
    [
        "",
        "can send",
        "can send 1",
        "can send 8001 0",
        "can send xyz 00",
        "can send 8001 000000000000000000",
        "can send 123456789 00",
        "can send 8001 00 E",
        "hello",
    ],
)
def test_what_is_no_frame_is_refused(text: str) -> None:
    with pytest.raises(MalformedFrame):
        fdcanusb.decode_send(text)


@pytest.mark.parametrize(
    ("text", "extended", "switched"),
    [("send 7ff 00", False, True), ("send 800 00", True, True), ("ext 1 00 bF", True, False)],
)
def test_flags_left_out_are_as_the_identifier_needs(
    text: str, extended: bool, switched: bool
) -> None:
    frame = fdcanusb.decode_send(f"can {text}")
    assert (frame.extended, frame.bitrate_switch) == (extended, switched)


def test_a_line_without_an_end_is_thrown_away() -> None:
    with pytest.raises(MalformedFrame, match="without an end"):
        fdcanusb.split(b"c" * 300)


def test_flags_of_an_order_are_one_word_of_letters_that_the_firmware_knows() -> None:
    """The adapter's firmware refuses a space among them, and the letters of the id's length."""
    assert fdcanusb.encode_send(AdapterFrame(0x8001, b"\1"), with_checksum=False) == (
        b"can send 8001 01 BF\r\n"
    )
    classic = AdapterFrame(0x1, b"\1", extended=True, bitrate_switch=False, fd=False)
    assert fdcanusb.encode_send(classic, with_checksum=False) == b"can ext 0001 01 bf\r\n"
    with pytest.raises(MalformedFrame, match="without data"):
        fdcanusb.encode_send(AdapterFrame(0x8001, b""))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        # What the firmware prints (can_manager.cc): flags apart, then the number of the filter.
        ("rcv 100 F0 e B F r f-1", AdapterFrame(0x100, b"\xf0", False, True)),
        ("rcv 100 f0 E b f r f0", AdapterFrame(0x100, b"\xf0", True, False, False)),
        ("rcv 100 00 E b F r t123456 f3", AdapterFrame(0x100, b"\0", True, False)),
        ("rcv 100  e B F r f-1", AdapterFrame(0x100, b"", False, True)),
        ("rcv 100 E b f R", AdapterFrame(0x100, b"", True, False, False, True)),
    ],
)
def test_received_lines_of_the_firmware_are_read(text: str, expected: AdapterFrame) -> None:
    assert fdcanusb.decode_received(text) == expected


def test_a_classic_frame_has_eight_bytes_at_most() -> None:
    with pytest.raises(MalformedFrame, match="8 bytes at most"):
        fdcanusb.decode_received("rcv 100 000000000000000000 e b f")
