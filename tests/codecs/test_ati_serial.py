"""Records and commands of the ATI F/T Controller, and how a stream is found again after noise."""

from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rfca_rig.devices.ati_serial.codec import (
    ASCII_BYTES,
    AsciiStream,
    AtiCommand,
    AtiRecord,
    FoundRecord,
    RecordForm,
    checksum,
    decode_record,
    encode_command,
    encode_record,
    record_stream,
    without_echo,
)
from rfca_rig.errors import MalformedFrame, NotEncodable

FORMS = list(RecordForm)
START = (900, -400, 3000, 50, -700, 10)
COUNTS = st.integers(-(2**15), 2**15 - 1)
RECORDS = st.builds(AtiRecord, st.integers(0, 1), st.tuples(*[COUNTS] * 6))

A_LINE = b"0,  -102,   -99,  -225,   -20,    39,   -39\r\n"
A_RECORD = AtiRecord(0, (-102, -99, -225, -20, 39, -39))
A_BINARY = bytes.fromhex("00 ff9a ff9d ff1f ffec 0027 ffd9")


def drift(count: int, seed: int = 0) -> list[AtiRecord]:
    """Values that wander as a sensor's do, each of them different."""
    values = np.cumsum(np.random.default_rng(seed).normal(0.0, 30.0, (count, 6)), axis=0).astype(
        int
    ) + np.array(START)
    return [AtiRecord(0, tuple(row)) for row in values.tolist()]


def wire(records: list[AtiRecord], form: RecordForm) -> bytes:
    return b"".join(encode_record(record, form) for record in records)


def fed(form: RecordForm, data: bytes, piece: int = 7) -> tuple[list[FoundRecord], int]:
    stream = record_stream(form)
    found = [
        one
        for start in range(0, len(data), piece)
        for one in stream.feed(data[start : start + piece])
    ]
    return found, stream.malformed


def test_a_line_of_a_real_controller_is_read_and_written() -> None:
    assert decode_record(A_LINE, RecordForm.ASCII) == A_RECORD
    assert encode_record(A_RECORD, RecordForm.ASCII) == A_LINE
    assert len(A_LINE) == ASCII_BYTES == RecordForm.ASCII.record_bytes


def test_a_binary_record_is_an_error_flag_and_six_counts_high_byte_first() -> None:
    assert decode_record(A_BINARY, RecordForm.BINARY) == A_RECORD
    assert encode_record(A_RECORD, RecordForm.BINARY) == A_BINARY
    assert encode_record(
        AtiRecord(1, (256, 1, 0, 0, 0, -(2**15))), RecordForm.BINARY
    ) == bytes.fromhex("01 0100 0001 0000 0000 0000 8000")


def test_the_checksum_is_the_sum_of_all_bytes() -> None:
    assert checksum(A_BINARY) == bytes([sum(A_BINARY) % 256])
    assert encode_record(A_RECORD, RecordForm.BINARY_CHECKSUM) == A_BINARY + checksum(A_BINARY)


@given(RECORDS, st.sampled_from(FORMS))
def test_a_record_survives_the_wire(record: AtiRecord, form: RecordForm) -> None:
    data = encode_record(record, form)
    assert len(data) == form.record_bytes
    assert decode_record(data, form) == record


@given(RECORDS, st.integers(0, 13), st.integers(1, 255))
def test_a_changed_byte_never_passes_the_checksum(record: AtiRecord, at: int, change: int) -> None:
    data = bytearray(encode_record(record, RecordForm.BINARY_CHECKSUM))
    data[at] ^= change
    with pytest.raises(MalformedFrame):
        decode_record(bytes(data), RecordForm.BINARY_CHECKSUM)


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"\r\n",
        b">",
        b"QS\r\n",
        b"2,  -102,   -99,  -225,   -20,    39,   -39\r\n",
        b"0,  -102,   -99,  -225,   -20,    39\r\n",
        b"0,  -102,   -99,  -225,   -20,    39,   -39,     1\r\n",
        b"0,  -1 2,   -99,  -225,   -20,    39,   -39\r\n",
        b"0,  40000,   -99,  -225,   -20,    39,   -39\r\n",
        b"0,  -102,   -99,  -225,   -20,    39,   -39\r\n0",
    ],
)
def test_a_line_that_is_no_record_is_malformed(line: bytes) -> None:
    with pytest.raises(MalformedFrame):
        decode_record(line, RecordForm.ASCII)


@pytest.mark.parametrize("form", [RecordForm.BINARY, RecordForm.BINARY_CHECKSUM])
@pytest.mark.parametrize(
    "data",
    [b"", bytes(12), bytes(15), b"\x02" + bytes(11) + b"\x00", b"\x02" + bytes(12) + b"\x02"],
)
def test_a_binary_record_of_wrong_length_or_flag_is_malformed(
    form: RecordForm, data: bytes
) -> None:
    with pytest.raises(MalformedFrame):
        decode_record(data, form)


@pytest.mark.parametrize("record", [AtiRecord(0, (2**15, 0, 0, 0, 0, 0)), AtiRecord(256, (0,) * 6)])
def test_what_does_not_fit_cannot_be_sent(record: AtiRecord) -> None:
    with pytest.raises(NotEncodable):
        encode_record(record, RecordForm.BINARY)


def test_commands_end_in_a_carriage_return() -> None:
    assert encode_command(AtiCommand.BINARY) == b"CD B\r"
    assert encode_command(AtiCommand.QUERY_STREAM) == b"QS\r"
    assert encode_command(AtiCommand.NOTHING) == b"\r"
    with pytest.raises(NotEncodable):
        encode_command(b"SB\rSZ")


@given(st.binary(max_size=300), st.sampled_from(FORMS))
def test_no_bytes_make_a_decoder_raise_anything_but_its_own_error(
    data: bytes, form: RecordForm
) -> None:
    with suppress(MalformedFrame):
        decode_record(data, form)
    record_stream(form).feed(data)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("piece", [1, 13, 14, 45, 1000])
def test_a_clean_stream_is_read_whole_in_pieces_of_any_length(form: RecordForm, piece: int) -> None:
    records = drift(50)
    found, malformed = fed(form, wire(records, form), piece)
    learnt = (
        1 if form is RecordForm.ASCII else 0
    )  # the width of a line is learnt from the first two
    assert [one.record for one in found] == records[learnt:]
    assert malformed == 0
    assert all(one.missed == 0 for one in found)


@pytest.mark.parametrize("form", FORMS)
@given(data=st.data())
@settings(max_examples=60, deadline=None)
def test_after_noise_the_records_are_found_again_and_the_lost_ones_counted(
    form: RecordForm, data: st.DataObject
) -> None:
    records = drift(60, data.draw(st.integers(0, 1000)))
    size = form.record_bytes
    clean = wire(records, form)
    at = data.draw(st.integers(10 * size, 40 * size))
    lost = data.draw(st.integers(0, 3 * size))
    noise = data.draw(st.binary(min_size=0 if lost else 1, max_size=size // 3))
    found, malformed = fed(form, clean[:at] + noise + clean[at + lost :])
    last = found[-5:]
    assert [one.record for one in last] == records[-5:]
    assert malformed >= 0
    counted = sum(one.missed + 1 for one in found) + (1 if form is RecordForm.ASCII else 0)
    assert abs(counted - (len(records) - lost / size + len(noise) / size)) <= 1.6 + lost / size


def test_a_line_that_lost_a_character_is_not_believed() -> None:
    stream = AsciiStream()
    records = drift(10)
    lines = [encode_record(record, RecordForm.ASCII) for record in records]
    lines[5] = lines[5][:4] + lines[5][5:]
    found = stream.feed(b"".join(lines))
    assert [one.record for one in found] == records[1:5] + records[6:]
    assert [one.missed for one in found] == [0, 0, 0, 0, 1, 0, 0, 0]
    assert "among lines of 45" in stream.last_malformed


def test_echo_and_prompt_before_the_first_record_count_as_nothing() -> None:
    found, malformed = fed(RecordForm.ASCII, b"> QS\r\n" + wire(drift(5), RecordForm.ASCII))
    assert len(found) == 4
    assert malformed == 0


def test_a_line_without_end_does_not_fill_the_memory() -> None:
    stream = AsciiStream()
    for _ in range(1000):
        stream.feed(b"x" * 100)
    assert len(stream._held) <= 300


def test_the_echo_is_cut_off_once_it_is_whole() -> None:
    assert without_echo(b"QS", b"QS") is None
    assert without_echo(b"\r\n>QS\r\n\x00\x01", b"QS") == b"\x00\x01"
