"""Time at which a picture was taken, as stored by the camera: Exif 2.32 (CIPA DC-008) in JPEG, TIFF and PNG.

Only the time is read: DateTimeOriginal with its fraction of a second and its offset from UTC. It is in a JPEG's APP1 segment, a PNG's eXIf
chunk, or a TIFF's own directories. Unreadable data count as absent, because a picture is usable without its time.
"""

import re
import struct
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta, timezone

# Exif tags: pointer to the Exif directory, DateTimeOriginal, its offset from UTC, its fraction of a second.
EXIF_DIRECTORY = 0x8769
DATE_TIME_ORIGINAL = 0x9003
OFFSET_TIME_ORIGINAL = 0x9011
SUBSEC_TIME_ORIGINAL = 0x9291

# Types of directory entries.
TEXT, LONG = 2, 4
EXIF_MARK = b"Exif\0\0"
# Limit against damaged counts; no real directory has so many entries.
MAX_ENTRIES = 512

_MOMENT = re.compile(r"(\d{4}):(\d\d):(\d\d) (\d\d):(\d\d):(\d\d)")
_OFFSET = re.compile(r"([+-])(\d\d):(\d\d)")


def read_time_taken(content: bytes) -> datetime | None:
    """Time at which a JPEG, PNG or TIFF file was taken, or None where it states none. The beginning up to the picture data is enough.

    Exif had no time zones before 2016. A time without offset is taken as UTC; differences between such times are still right.
    """
    tiff = _tiff_part(content)
    if tiff is None:
        return None
    try:
        return _moment(_texts(tiff))
    except (struct.error, ValueError, OverflowError):
        return None


def _tiff_part(content: bytes) -> bytes | None:
    if content.startswith((b"II*\0", b"MM\0*")):
        return content
    if content.startswith(b"\xff\xd8"):
        return next((body[len(EXIF_MARK) :] for body in _app1_segments(content) if body.startswith(EXIF_MARK)), None)
    if content.startswith(b"\x89PNG\r\n\x1a\n"):
        return next((body for kind, body in _png_chunks(content) if kind == b"eXIf"), None)
    return None


def _app1_segments(content: bytes) -> Iterator[bytes]:
    """Contents of the APP1 segments before the start of the scan (0xDA); none follows it."""
    # A segment is 0xFF, its kind, and a length that includes its own two bytes.
    at = 2
    while at + 4 <= len(content) and content[at] == 0xFF and content[at + 1] != 0xDA:
        length = int.from_bytes(content[at + 2 : at + 4], "big")
        if content[at + 1] == 0xE1:
            yield content[at + 4 : at + 2 + length]
        at += 2 + length


def _png_chunks(content: bytes) -> Iterator[tuple[bytes, bytes]]:
    # After the signature: chunks of length, kind, content and a CRC of four bytes.
    at = 8
    while at + 8 <= len(content):
        length = int.from_bytes(content[at : at + 4], "big")
        yield content[at + 4 : at + 8], content[at + 8 : at + 8 + length]
        at += 12 + length


def _texts(tiff: bytes) -> dict[int, str]:
    """The texts of the Exif directory, by tag. Raises struct.error where an address is outside the file."""
    order = "<" if tiff.startswith(b"II") else ">"
    first = struct.unpack_from(order + "I", tiff, 4)[0]
    found: dict[int, str] = {}
    for tag, kind, _, value in _directory(tiff, first, order):
        if tag == EXIF_DIRECTORY and kind == LONG:
            entries = _directory(tiff, struct.unpack(order + "I", value)[0], order)
            found |= {tag: _text(tiff, count, value, order) for tag, kind, count, value in entries if kind == TEXT}
    return found


def _directory(tiff: bytes, at: int, order: str) -> Iterator[tuple[int, int, int, bytes]]:
    """(tag, type, count, four bytes of the value or of its address) of each entry."""
    count = struct.unpack_from(order + "H", tiff, at)[0]
    for entry in range(min(count, MAX_ENTRIES)):
        yield struct.unpack_from(order + "HHI4s", tiff, at + 2 + 12 * entry)


def _text(tiff: bytes, count: int, value: bytes, order: str) -> str:
    # Values of more than four bytes are elsewhere in the file. No time needs 64 characters.
    if count > 4:
        address = struct.unpack(order + "I", value)[0]
        value = tiff[address : address + min(count, 64)]
    return value[:count].split(b"\0")[0].decode("ascii", "replace").strip()


def _moment(texts: dict[int, str]) -> datetime | None:
    match = _MOMENT.fullmatch(texts.get(DATE_TIME_ORIGINAL, ""))
    if match is None:
        return None
    fraction = texts.get(SUBSEC_TIME_ORIGINAL, "")
    micros = int(fraction[:6].ljust(6, "0")) if fraction.isascii() and fraction.isdigit() else 0
    return datetime(*(int(part) for part in match.groups()), microsecond=micros, tzinfo=_zone(texts.get(OFFSET_TIME_ORIGINAL, "")))  # type: ignore[misc, arg-type]


def _zone(text: str) -> timezone:
    match = _OFFSET.fullmatch(text)
    if match is None:
        return UTC
    ahead = timedelta(hours=int(match[2]), minutes=int(match[3]))
    return timezone(ahead if match[1] == "+" else -ahead)
