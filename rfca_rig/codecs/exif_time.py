"""When a picture was taken, as the camera wrote it into the file: Exif 2.32 (CIPA DC-008), in JPEG, TIFF and PNG alike.

Only the moment is read: DateTimeOriginal with its fraction of a second and its offset from UTC, from a JPEG's APP1 segment, a
PNG's eXIf chunk, or a TIFF's own directories. What cannot be read counts as not written: a picture is of use without it.
"""

import re
import struct
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta, timezone

EXIF_DIRECTORY = 0x8769
TAKEN = 0x9003
OFFSET = 0x9011
FRACTION = 0x9291

TEXT, LONG = 2, 4
EXIF_MARK = b"Exif\0\0"
MOST_ENTRIES = 512  # a directory of more is not one

_MOMENT = re.compile(r"(\d{4}):(\d\d):(\d\d) (\d\d):(\d\d):(\d\d)")
_OFFSET = re.compile(r"([+-])(\d\d):(\d\d)")


def taken_at(content: bytes) -> datetime | None:
    """The moment a JPEG, PNG or TIFF file says it was taken; its beginning up to the picture is enough. None where it does not say.

    Exif knew no time zones before 2016: a moment without an offset is taken as UTC, whose differences are right all the same.
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
    """Up to the start of the scan, behind which no segment tells of the whole picture."""
    at = 2
    while at + 4 <= len(content) and content[at] == 0xFF and content[at + 1] != 0xDA:
        length = int.from_bytes(content[at + 2 : at + 4], "big")
        if content[at + 1] == 0xE1:
            yield content[at + 4 : at + 2 + length]
        at += 2 + length


def _png_chunks(content: bytes) -> Iterator[tuple[bytes, bytes]]:
    at = 8
    while at + 8 <= len(content):
        length = int.from_bytes(content[at : at + 4], "big")
        yield content[at + 4 : at + 8], content[at + 8 : at + 8 + length]
        at += 12 + length


def _texts(tiff: bytes) -> dict[int, str]:
    """The texts of the Exif directory by tag. Raises struct.error where an address leads out of the file."""
    order = "<" if tiff.startswith(b"II") else ">"
    first = struct.unpack_from(order + "I", tiff, 4)[0]
    found: dict[int, str] = {}
    for tag, kind, _, value in _directory(tiff, first, order):
        if tag == EXIF_DIRECTORY and kind == LONG:
            entries = _directory(tiff, struct.unpack(order + "I", value)[0], order)
            found |= {tag: _text(tiff, count, value, order) for tag, kind, count, value in entries if kind == TEXT}
    return found


def _directory(tiff: bytes, at: int, order: str) -> Iterator[tuple[int, int, int, bytes]]:
    """(tag, type, count, the four bytes of the value or of its address) of each entry."""
    count = struct.unpack_from(order + "H", tiff, at)[0]
    for entry in range(min(count, MOST_ENTRIES)):
        yield struct.unpack_from(order + "HHI4s", tiff, at + 2 + 12 * entry)


def _text(tiff: bytes, count: int, value: bytes, order: str) -> str:
    if count > 4:
        address = struct.unpack(order + "I", value)[0]
        value = tiff[address : address + min(count, 64)]
    return value[:count].split(b"\0")[0].decode("ascii", "replace").strip()


def _moment(texts: dict[int, str]) -> datetime | None:
    said = _MOMENT.fullmatch(texts.get(TAKEN, ""))
    if said is None:
        return None
    fraction = texts.get(FRACTION, "")
    micros = int(fraction[:6].ljust(6, "0")) if fraction.isascii() and fraction.isdigit() else 0
    return datetime(*(int(part) for part in said.groups()), microsecond=micros, tzinfo=_zone(texts.get(OFFSET, "")))  # type: ignore[misc, arg-type]


def _zone(text: str) -> timezone:
    said = _OFFSET.fullmatch(text)
    if said is None:
        return UTC
    ahead = timedelta(hours=int(said[2]), minutes=int(said[3]))
    return timezone(ahead if said[1] == "+" else -ahead)
