"""The moment a picture was taken, from files put together here by the standard."""

import struct
from datetime import UTC, datetime, timedelta, timezone

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rfca_rig.drivers.photo_files import read_time_taken


def tiff(order: str, texts: dict[int, bytes]) -> bytes:
    """First directory with one address, the Exif directory behind it, the texts behind that."""
    mark = b"II" if order == "<" else b"MM"
    exif_at = 26
    texts_at = 26 + 2 + 12 * len(texts) + 4
    document = (
        mark
        + struct.pack(order + "HI", 42, 8)
        + struct.pack(order + "HHHIII", 1, 0x8769, 4, 1, exif_at, 0)
    )
    entries = b""
    tail = b""
    for tag, unended in sorted(texts.items()):
        text = unended + b"\0"
        if len(text) <= 4:
            entries += struct.pack(order + "HHI4s", tag, 2, len(text), text)
        else:
            entries += struct.pack(order + "HHII", tag, 2, len(text), texts_at + len(tail))
            tail += text
    return (
        document
        + struct.pack(order + "H", len(texts))
        + entries
        + struct.pack(order + "I", 0)
        + tail
    )


def jpeg(exif: bytes) -> bytes:
    other = b"\xff\xe0" + struct.pack(">H", 16) + b"JFIF\0" + bytes(9)
    body = b"Exif\0\0" + exif
    return (
        b"\xff\xd8"
        + other
        + b"\xff\xe1"
        + struct.pack(">H", len(body) + 2)
        + body
        + b"\xff\xda\0\0\xff\xd9"
    )


def png(exif: bytes) -> bytes:
    chunks = [(b"IHDR", bytes(13)), (b"eXIf", exif), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + kind + body + bytes(4) for kind, body in chunks
    )


FULL = {0x9003: b"2024:05:06 07:08:09", 0x9011: b"+02:00", 0x9291: b"25"}


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("wrapped", [jpeg, png, lambda exif: exif], ids=["jpeg", "png", "tiff"])
def test_the_moment_with_its_fraction_and_offset(order, wrapped):
    there = timezone(timedelta(hours=2))
    assert read_time_taken(wrapped(tiff(order, FULL))) == datetime(
        2024, 5, 6, 7, 8, 9, 250_000, there
    )


def test_a_moment_without_offset_is_taken_as_utc():
    assert read_time_taken(jpeg(tiff("<", {0x9003: b"2024:05:06 07:08:09"}))) == datetime(
        2024, 5, 6, 7, 8, 9, tzinfo=UTC
    )


def test_an_offset_to_the_west():
    texts = FULL | {0x9011: b"-09:30"}
    assert read_time_taken(jpeg(tiff("<", texts))) == datetime(2024, 5, 6, 16, 38, 9, 250_000, UTC)


@pytest.mark.parametrize(
    "text", [b"0000:00:00 00:00:00", b"    :  :     :  :  ", b"2024-05-06", b"2024:13:01 00:00:00"]
)
def test_a_clock_that_was_never_set_says_nothing(text):
    assert read_time_taken(jpeg(tiff(">", {0x9003: text}))) is None


@given(st.binary(max_size=300))
def test_no_bytes_make_it_fail(content):
    for begun in (
        content,
        b"II*\0" + content,
        b"MM\0*" + content,
        b"\xff\xd8" + content,
        b"\x89PNG\r\n\x1a\n" + content,
        jpeg(content),
    ):
        read_time_taken(begun)


@given(st.integers(0, 200), st.integers(0, 255))
def test_no_changed_byte_makes_it_fail(at, value):
    content = bytearray(jpeg(tiff("<", FULL)))
    content[at % len(content)] = value
    read_time_taken(bytes(content))
