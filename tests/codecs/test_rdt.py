"""ATI RDT requests and records against the documented layout."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rfca_rig.codecs.force_sensors import SATURATED, mark_axia_status, status_text
from rfca_rig.devices.netft.codec import (
    RECORD_BYTES,
    RdtCommand,
    Records,
    Request,
    decode_records,
    decode_request,
    encode_records,
    encode_request,
)
from rfca_rig.errors import MalformedFrame, NotEncodable

ONE_RECORD = bytes.fromhex(
    "00000001 00001b58 80020000 000f4240 fff0bdc0 00000000 00000001 ffffffff 7fffffff"
)


def test_a_start_request_is_the_documented_eight_bytes() -> None:
    assert encode_request(RdtCommand.START_BUFFERED) == bytes.fromhex("1234 0003 00000000")
    assert encode_request(RdtCommand.START_SINGLE, 0x01020304) == bytes.fromhex(
        "1234 0002 01020304"
    )
    assert encode_request(RdtCommand.STOP) == bytes.fromhex("1234 0000 00000000")
    assert encode_request(RdtCommand.SET_BIAS) == bytes.fromhex("1234 0042 00000000")


def test_a_record_is_read_as_documented() -> None:
    records = decode_records(ONE_RECORD)
    assert records.rdt_sequence.tolist() == [1]
    assert records.ft_sequence.tolist() == [7000]
    assert records.status.tolist() == [SATURATED]
    assert records.counts.tolist() == [[1_000_000, -1_000_000, 0, 1, -1, 2**31 - 1]]
    assert records.counts.dtype == np.int32


def test_a_record_is_written_as_documented() -> None:
    assert encode_records(decode_records(ONE_RECORD)) == ONE_RECORD


@given(
    st.lists(
        st.tuples(*[st.integers(0, 2**32 - 1)] * 3, *[st.integers(-(2**31), 2**31 - 1)] * 6),
        min_size=1,
        max_size=40,
    )
)
def test_a_datagram_holds_what_a_plain_struct_packs(rows: list[tuple[int, ...]]) -> None:
    datagram = b"".join(struct.pack(">3I6i", *row) for row in rows)
    records = decode_records(datagram)
    table = np.column_stack(
        [records.rdt_sequence, records.ft_sequence, records.status, records.counts]
    )
    assert table.tolist() == [list(row) for row in rows]
    assert encode_records(records) == datagram


@given(st.integers(0, 0xFFFF), st.integers(0, 2**32 - 1))
def test_a_request_survives_the_wire(command: int, sample_count: int) -> None:
    assert decode_request(encode_request(command, sample_count)) == Request(command, sample_count)


@pytest.mark.parametrize("length", [0, 35, 37, 41 * RECORD_BYTES])
def test_a_datagram_without_1_to_40_whole_records_is_malformed(length: int) -> None:
    with pytest.raises(MalformedFrame, match=f"{length} bytes"):
        decode_records(bytes(length))


@pytest.mark.parametrize("count", [0, 41])
def test_more_than_40_records_or_none_cannot_be_sent(count: int) -> None:
    words = np.zeros(count, np.uint32)
    with pytest.raises(NotEncodable, match=f"{count} records"):
        encode_records(Records(words, words, words, np.zeros((count, 6), np.int32)))


def test_a_wrong_header_is_malformed() -> None:
    with pytest.raises(MalformedFrame, match="0x1235"):
        decode_request(bytes.fromhex("1235 0002 00000000"))


@pytest.mark.parametrize(("command", "count"), [(-1, 0), (0x10000, 0), (2, -1), (2, 2**32)])
def test_a_request_beyond_its_fields_is_refused(command: int, count: int) -> None:
    with pytest.raises(NotEncodable):
        encode_request(command, count)


@given(st.binary(max_size=1600))
def test_no_bytes_make_a_decoder_raise_anything_but_its_own_error(data: bytes) -> None:
    for decoder in (decode_request, decode_records):
        try:
            decoder(data)
        except MalformedFrame:
            continue


def test_a_status_word_is_told_bit_by_bit() -> None:
    assert status_text(0) == "status 0x00000000 (healthy)"
    assert status_text(0x80020000) == "status 0x80020000 (transducer saturation or A/D error)"
    assert status_text(0x80000000) == "status 0x80000000 (error, see the other bits)"
    assert "supply too low" in status_text(0x80000020)
    assert "bit 0, not documented" in status_text(1)


@pytest.mark.parametrize(
    ("word", "marked", "text"),
    [
        (0, 0, "status 0x00000000 (healthy)"),
        (0x80010000, 0x80010000, "status 0x80010000 (monitor condition latched)"),
        (0x80000001, 0x80008001, "status 0x80000001 (temperature)"),
        (0x80000002, 0x80008002, "status 0x80000002 (supply voltage)"),
        (0x90000000, 0x90008000, "status 0x90000000 (simulated error)"),
        # Broken gage, gage and load out of range: the values are no forces.
        (0x80000004, 0x80028004, "status 0x80000004 (broken gage)"),
        (0x88000000, 0x88028000, "status 0x88000000 (gage out of range)"),
        (0xC0000000, 0xC0028000, "status 0xc0000000 (force or torque out of range)"),
        # The summary bit is set where an older Axia does not set it.
        (0x08000000, 0x88028000, "status 0x88000000 (gage out of range)"),
        (0x80000200, 0x80008200, "status 0x80000200 (bit 9, not documented)"),
    ],
)
def test_a_status_word_of_an_axia_is_told_by_its_own_table(word, marked, text) -> None:
    (found,) = mark_axia_status(np.array([word], np.uint32))
    assert found == marked
    assert status_text(int(found)) == text
    # The word as it was sent comes back.
    assert int(found) & ~0x28000 in (word, word | 0x80000000)
