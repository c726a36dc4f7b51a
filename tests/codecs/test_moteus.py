"""moteus frames against the documented layouts."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rfca_rig.codecs.fdcanusb import FD_LENGTHS
from rfca_rig.devices.moteus import codec as moteus
from rfca_rig.devices.moteus.codec import (
    ClientStreamData,
    Mode,
    Read,
    Refusal,
    Register,
    Reply,
    Route,
    ServerStreamData,
    StreamPoll,
    Width,
    Write,
    fault_text,
    mode_text,
    register_error_text,
    units_per_count,
)
from rfca_rig.errors import DeviceError, MalformedFrame, NotEncodable

INT8, INT16, INT32, FLOAT = Width

# The two worked examples of the moteus reference, "CAN Protocol".
COMMAND = bytes.fromhex("01000a07206000200150ff140400130d")
COMMAND_SAYS = [
    Write(Register.MODE, INT8, Mode.POSITION),
    Write(Register.COMMAND_POSITION, INT16, 0.0096),
    Write(Register.COMMAND_VELOCITY, INT16, 0.072),
    Write(Register.COMMAND_FEEDFORWARD_TORQUE, INT16, -1.76),
    *(Read(register, INT16) for register in range(4)),
    *(
        Read(register, INT8)
        for register in (Register.VOLTAGE, Register.TEMPERATURE, Register.FAULT)
    ),
]
ANSWER = bytes.fromhex("2404000a005000000170ff230d181400")
ANSWER_SAYS = [
    Reply(Register.MODE, INT16, 10),
    Reply(Register.POSITION, INT16, 0.008),
    Reply(Register.VELOCITY, INT16, 0.064),
    Reply(Register.TORQUE, INT16, -1.44),
    Reply(Register.VOLTAGE, INT8, 12.0),
    Reply(Register.TEMPERATURE, INT8, 20.0),
    Reply(Register.FAULT, INT8, 0),
]


@pytest.mark.parametrize(("data", "says"), [(COMMAND, COMMAND_SAYS), (ANSWER, ANSWER_SAYS)])
def test_the_documented_examples_are_written_and_read_as_documented(
    data: bytes, says: list[moteus.Subframe]
) -> None:
    assert moteus.encode(says) == data
    for read, said in zip(moteus.decode(data), says, strict=True):
        assert (type(read), read.register) == (type(said), said.register)
        assert getattr(read, "width", None) == getattr(said, "width", None)
        assert getattr(read, "value", 0.0) == pytest.approx(getattr(said, "value", 0.0), abs=1e-12)


# Worked out by hand from the reference's tables.
GOLDEN = [
    ([Write(Register.MODE, INT8, 0)], "01 00 00"),
    (
        [
            Write(Register.COMMAND_POSITION, FLOAT, math.nan),
            Write(Register.COMMAND_VELOCITY, FLOAT, 0.5),
        ],
        "0e 20 0000c07f 0000003f 50 50",
    ),
    ([Write(Register.COMMAND_TIMEOUT, INT32, 0.25)], "09 27 90d00300"),
    ([Write(Register.COMMAND_POSITION, INT16, math.nan)], "05 20 0080"),
    ([Write(Register.COMMAND_MAXIMUM_TORQUE, INT8, -63.5)], "01 25 81"),
    ([Write(Register.COMMAND_KP_SCALE, INT16, 1.0)], "05 23 ff7f"),
    (
        [
            Read(Register.MODE, INT8),
            *(Read(register, FLOAT) for register in (1, 2, 3)),
            Read(0x70, INT32),
        ],
        "11 00 1f 01 19 70",
    ),
    ([Read(Register.FIRMWARE_VERSION, INT32)], "19 8102"),
    ([Read(register, INT32) for register in range(0x120, 0x124)], "18 04 a002"),
    ([Refusal(0x200, 1, of_write=False), Refusal(0x001, 2, of_write=True)], "31 8004 01 30 01 02"),
    ([Reply(Register.MODE, FLOAT, 11.0)], "2d 00 00003041"),
]


@pytest.mark.parametrize(("subframes", "data"), GOLDEN)
def test_a_frame_has_the_documented_bytes(subframes: list[moteus.Subframe], data: str) -> None:
    assert moteus.encode(subframes).hex() == data.replace(" ", "")


@pytest.mark.parametrize(
    ("route", "identifier"),
    [
        (Route(0, 1, wants_reply=True), 0x8001),
        (Route(1, 0), 0x100),
        (Route(0x20, 0x7F, wants_reply=True), 0xA07F),
        (Route(3, 4, wants_reply=True, prefix=0x1FFF), 0x1FFF8304),
    ],
)
def test_ids_are_routed_as_documented(route: Route, identifier: int) -> None:
    assert moteus.arbitration_id(route) == identifier
    assert moteus.route_of(identifier) == route


@pytest.mark.parametrize(
    "route", [Route(-1, 0), Route(0x80, 0), Route(0, 0x80), Route(0, 1, prefix=0x2000)]
)
def test_a_route_that_cannot_be_is_refused(route: Route) -> None:
    with pytest.raises(NotEncodable, match="does not exist"):
        moteus.arbitration_id(route)


@pytest.mark.parametrize(
    ("registers", "length"),
    [
        (4, 8),
        (5, 12),
        (15, 20),
        (20, 24),
        (21, 32),
        (28, 32),
        (29, 48),
        (44, 48),
        (45, 64),
        (60, 64),
    ],
)
def test_a_frame_is_filled_up_with_no_operation_to_a_length_that_can_fd_has(
    registers: int, length: int
) -> None:
    data = moteus.encode([Reply(0x200 + at, INT8, 1) for at in range(registers)])
    assert len(data) == length
    assert set(data[4 + registers :]) <= {0x50}
    assert len(moteus.decode(data)) == registers


def test_more_than_a_frame_carries_is_refused() -> None:
    with pytest.raises(NotEncodable, match="carries 64"):
        moteus.encode([Reply(at, FLOAT, 0.0) for at in range(0x200, 0x210)])


@given(st.binary(max_size=70))
def test_no_bytes_make_the_decoder_raise_anything_but_its_own_error(data: bytes) -> None:
    try:
        subframes = moteus.decode(data)
    except MalformedFrame as error:
        assert isinstance(error, DeviceError)
    else:
        assert len(data) in FD_LENGTHS
        assert len(subframes) <= 64 * 32


@pytest.mark.parametrize("length", [9, 10, 11, 13, 63, 65])
def test_a_length_that_can_fd_does_not_have_is_malformed(length: int) -> None:
    with pytest.raises(MalformedFrame, match=f"{length} bytes"):
        moteus.decode(b"\x50" * length)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ("2f 01 00000000", "4 bytes too early"),
        ("11", "1 bytes too early"),
        ("11 80", "1 bytes too early"),
        ("11 80 80 80 80 80 01", "more than five bytes"),
        ("11 ff ff ff ff 7f", "beyond 32 bits"),
        ("10 ff ff ff ff 0f 00", "4294967295 registers"),
        ("41 01 02", "2 bytes too early"),
        ("43 01 02", "0x43 is neither"),
        ("ff", "0xff is neither"),
    ],
)
def test_bytes_that_make_no_sense_are_told_apart(data: str, said: str) -> None:
    with pytest.raises(MalformedFrame, match=said):
        moteus.decode(bytes.fromhex(data))


@pytest.mark.parametrize(
    ("subframe", "data"),
    [
        (ClientStreamData(1, b"d stop\n"), "40 01 07 64 20 73 74 6f 70 0a 50 50"),
        (ServerStreamData(1, b"OK\r\n"), "41 01 04 4f 4b 0d 0a"),
        (ServerStreamData(1, b""), "41 01 00"),
        (StreamPoll(1, 61), "42 01 3d"),
    ],
)
def test_the_stream_has_the_documented_bytes(subframe: moteus.Subframe, data: str) -> None:
    assert moteus.encode([subframe]) == bytes.fromhex(data)
    assert moteus.decode(bytes.fromhex(data)) == [subframe]


@given(st.binary(max_size=moteus.MAX_STREAM_BYTES))
def test_the_bytes_of_a_stream_survive_the_wire(data: bytes) -> None:
    assert moteus.decode(moteus.encode([ClientStreamData(1, data)])) == [ClientStreamData(1, data)]


def test_an_empty_subframe_says_nothing() -> None:
    assert moteus.decode(bytes.fromhex("10 00 20 00 00 00")) == []


SCALED = [register for register in Register if units_per_count(register, INT8) is not None]
PLAIN = [register for register in Register if units_per_count(register, INT8) is None]


@given(
    st.sampled_from(SCALED),
    st.sampled_from([INT8, INT16, INT32]),
    st.floats(-1.0, 1.0),
    st.sampled_from([Write, Reply]),
)
def test_quantities_survive_the_wire_to_half_a_count(
    register: Register, width: Width, share: float, kind: type
) -> None:
    unit = units_per_count(register, width)
    value = share * unit * ((1 << (8 << width) - 1) - 1)
    (back,) = moteus.decode(moteus.encode([kind(register, width, value)]))
    assert (type(back), back.register, back.width) == (kind, register, width)
    assert abs(back.value - value) <= 0.5000001 * unit


@given(st.sampled_from(list(Register)), st.floats(width=32))
def test_floats_survive_the_wire(register: Register, value: float) -> None:
    (back,) = moteus.decode(moteus.encode([Reply(register, FLOAT, value)]))
    assert back.value == value or (math.isnan(back.value) and math.isnan(value))


@given(st.sampled_from(PLAIN), st.integers(-(1 << 31), (1 << 31) - 1))
def test_whole_numbers_survive_the_wire_to_the_last(register: Register, value: int) -> None:
    assert moteus.decode(moteus.encode([Reply(register, INT32, value)])) == [
        Reply(register, INT32, value)
    ]


@given(
    st.lists(
        st.tuples(
            st.sampled_from([Write, Reply]), st.integers(0, 0x300), st.sampled_from(list(Width))
        ),
        max_size=9,
    )
)
def test_any_row_of_registers_comes_back_in_its_order(row: list[tuple[type, int, Width]]) -> None:
    subframes = [kind(register, width, 0.0) for kind, register, width in row]
    assert moteus.decode(moteus.encode(subframes)) == subframes


@given(st.sampled_from(SCALED), st.sampled_from([INT8, INT16, INT32]))
def test_no_number_is_the_lowest_count(register: Register, width: Width) -> None:
    data = moteus.encode([Reply(register, width, math.nan)])
    assert int.from_bytes(data[2 : 2 + (1 << width)], "little", signed=True) == -(
        1 << (8 << width) - 1
    )
    assert math.isnan(moteus.decode(data)[0].value)


@pytest.mark.parametrize("value", [1.28, -1.28, math.inf, -math.inf])
def test_a_value_beyond_its_count_is_refused_with_the_limit(value: float) -> None:
    with pytest.raises(NotEncodable, match=r"COMMAND_POSITION cannot carry .* limit 1\.27"):
        moteus.encode([Write(Register.COMMAND_POSITION, INT8, value)])


@pytest.mark.parametrize(
    ("width", "value"),
    [(INT8, 128), (INT8, 0.5), (INT16, math.nan), (INT32, 1 << 31), (FLOAT, 1e39)],
)
def test_a_plain_number_that_does_not_fit_is_refused(width: Width, value: float) -> None:
    with pytest.raises(NotEncodable, match="MODE"):
        moteus.encode([Write(Register.MODE, width, value)])


@given(
    st.sampled_from(list(Register)), st.sampled_from(list(Width)), st.floats(-1e38, 1e38).map(round)
)
def test_the_nearest_value_can_always_be_carried(
    register: Register, width: Width, value: int
) -> None:
    moteus.encode([Reply(register, width, moteus.clip_to_register(register, width, value))])


def test_what_is_no_number_becomes_none_in_a_quantity() -> None:
    assert math.isnan(moteus.clip_to_register(Register.POSITION, INT16, math.inf))
    assert moteus.clip_to_register(Register.POSITION, INT16, 100.0) == pytest.approx(3.2767)


def test_codes_have_words() -> None:
    assert fault_text(33).startswith("fault 33 (motor driver fault: ")
    assert fault_text(99) == "limit 99 (output limited by servo.max_current_A)"
    assert "not documented" in fault_text(77)
    assert mode_text(11) == "timeout"
    assert mode_text(99) == "mode 99"
    assert register_error_text(2) == "not writeable"
