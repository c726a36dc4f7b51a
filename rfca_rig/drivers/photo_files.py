"""Photos in files (JPEG, PNG, TIFF): reading with a check for truncation, their Exif time, and
folders of them in place of a camera.
"""

import re
import struct
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from types import TracebackType

import cv2
import numpy as np
from numpy.typing import NDArray

from rfca_rig.drivers.roles import Photo
from rfca_rig.errors import BadInput, DeviceError

# Exif tags: pointer to the Exif directory, DateTimeOriginal, its offset from UTC, its fraction of a
# second.
EXIF_DIRECTORY = 0x8769
DATE_TIME_ORIGINAL = 0x9003
OFFSET_TIME_ORIGINAL = 0x9011
SUBSEC_TIME_ORIGINAL = 0x9291

# Types of directory entries.
TEXT = 2
LONG = 4
EXIF_MARK = b"Exif\0\0"
# Limit against damaged counts; no real directory has so many entries.
MAX_ENTRIES = 512

_MOMENT = re.compile(r"(\d{4}):(\d\d):(\d\d) (\d\d):(\d\d):(\d\d)")
_OFFSET = re.compile(r"([+-])(\d\d):(\d\d)")


def read_time_taken(content: bytes) -> datetime | None:
    """Time at which a JPEG, PNG or TIFF file was taken, or None where it states none. The beginning
    up to the picture data is enough.

    Exif had no time zones before 2016. A time without offset is taken as UTC; differences between
    such times are still right.
    """
    tiff = _tiff_part(content)
    if tiff is None:
        return None
    try:
        # struct.error is raised where an address is outside the file.
        order = _byte_order(tiff)
        first = struct.unpack_from(order + "I", tiff, 4)[0]
        texts: dict[int, str] = {}
        for tag, kind, _, value in _directory(tiff, first, order):
            if tag == EXIF_DIRECTORY and kind == LONG:
                entries = _directory(tiff, struct.unpack(order + "I", value)[0], order)
                texts |= {
                    tag: _text(tiff, count, value, order)
                    for tag, kind, count, value in entries
                    if kind == TEXT
                }
        return _moment(texts)
    except (struct.error, ValueError, OverflowError):
        return None


def _byte_order(tiff: bytes) -> str:
    """The sign of `struct` for the byte order that a TIFF part states."""
    if tiff.startswith(b"II"):
        return "<"
    return ">"


def _tiff_part(content: bytes) -> bytes | None:
    if content.startswith((b"II*\0", b"MM\0*")):
        return content
    if content.startswith(b"\xff\xd8"):
        return next(
            (
                body[len(EXIF_MARK) :]
                for body in _app1_segments(content)
                if body.startswith(EXIF_MARK)
            ),
            None,
        )
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
    if fraction.isascii() and fraction.isdigit():
        micros = int(fraction[:6].ljust(6, "0"))
    else:
        micros = 0
    year, month, day, hour, minute, second = (int(part) for part in match.groups())
    zone = _zone(texts.get(OFFSET_TIME_ORIGINAL, ""))
    return datetime(year, month, day, hour, minute, second, micros, zone)


def _zone(text: str) -> timezone:
    match = _OFFSET.fullmatch(text)
    if match is None:
        return UTC
    ahead = timedelta(hours=int(match[2]), minutes=int(match[3]))
    if match[1] != "+":
        ahead = -ahead
    return timezone(ahead)


Image = NDArray[np.uint8]

ENDINGS = (".jpg", ".jpeg", ".png", ".tif", ".tiff")
# In a JPEG the Exif block precedes the image and has at most 64 kB.
HEAD_BYTES = 1 << 18

# A picture is unpacked as a whole. The largest sensors on sale have 151 million pixels (2026), and
# 3 bytes a pixel.
MOST_PIXELS = 160_000_000
MOST_BYTES = 3 * MOST_PIXELS

_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8\xff"
_TIFF = (b"II*\0", b"MM\0*")


@dataclass(frozen=True)
class PictureTime:
    """When a picture was taken: from Exif if `from_exif`, else the modification time of the
    file.
    """

    at: datetime
    from_exif: bool


def read_picture(path: Path) -> Image:
    """The image (rows, columns, 3) uint8 in BGR order, in the orientation of the sensor: the Exif
    orientation is ignored.

    Raises BadInput, in one line, for a file that is missing, of another type, truncated or broken.
    """
    content = read_picture_bytes(path)
    if fault := _fault(content):
        raise BadInput(f"{path}: {fault}; take it out of the list or copy it from the camera again")
    image = _decode(content)
    if image is None:
        raise BadInput(
            f"{path}: {len(content)} bytes that are no whole picture; take it out of the "
            "list or copy it from the camera again"
        )
    return image


class _QuietOpenCv:
    """Suppresses OpenCV's messages on the terminal while any thread decodes an image. Their
    level is one for the whole process.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._users = 0
        self._level_before = 0

    def __enter__(self) -> None:
        with self._lock:
            if not self._users:
                self._level_before = cv2.utils.logging.setLogLevel(
                    cv2.utils.logging.LOG_LEVEL_SILENT
                )
            self._users += 1

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with self._lock:
            self._users -= 1
            if not self._users:
                cv2.utils.logging.setLogLevel(self._level_before)


_QUIET = _QuietOpenCv()


def _decode(content: bytes) -> Image | None:
    """Decodes an image; None if OpenCV fails, by returning None or by raising. Its messages on
    the terminal are suppressed.
    """
    try:
        with _QUIET:
            image = cv2.imdecode(
                np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
            )
    except cv2.error:
        return None
    if image is None:
        return None
    return np.asarray(image, np.uint8)


def read_picture_bytes(path: Path) -> bytes:
    """The file's content. Raises BadInput where it cannot be read, or is longer than any
    picture.
    """
    try:
        if path.exists() and not path.is_file():
            raise BadInput(f"{path}: is no file")
        if path.stat().st_size > MOST_BYTES:
            raise BadInput(
                f"{path}: has {path.stat().st_size / 1e6:.0f} MB, where "
                f"{MOST_BYTES / 1e6:.0f} MB are the most"
            )
        return path.read_bytes()
    except OSError as error:
        raise BadInput(f"{path}: cannot be read: {error.strerror}") from None


def _fault(content: bytes) -> str | None:
    """Error visible at the ends of the file, or None. Decoders silently fill a truncated picture
    with grey.
    """
    if not content:
        return "empty file"
    if content.startswith(_JPEG):
        # The end mark (FF D9) must follow the last start of scan (FF DA); the embedded thumbnail
        # has its own end mark.
        if not content.rfind(b"\xff\xd9") > content.rfind(b"\xff\xda") >= 0:
            return "a JPEG that is cut short: it ends before its end mark"
    elif content.startswith(_PNG):
        if content[-12:-4] != b"\0\0\0\0IEND":
            return "a PNG that is cut short: it ends before its end mark"
    elif not content.startswith(_TIFF):
        return "neither JPEG, PNG nor TIFF"
    # A picture of one colour packs a thousand times: the decoder would fill the memory.
    columns, rows = _size(content)
    if columns * rows > MOST_PIXELS:
        return (
            f"claims {columns} x {rows} pixels, where {MOST_PIXELS / 1e6:.0f} million are the most"
        )
    return None


def _size(content: bytes) -> tuple[int, int]:
    """Columns and rows that the head of a picture states; 0 where it states none, which the
    decoder refuses.
    """
    try:
        if content.startswith(_PNG):
            return struct.unpack_from(">II", content, 16)
        if content.startswith(_JPEG):
            return _size_of_jpeg(content)
        order = _byte_order(content)
        at = struct.unpack_from(order + "I", content, 4)[0]
        count = struct.unpack_from(order + "H", content, at)[0]
        entries = [
            struct.unpack_from(order + "HHI4s", content, at + 2 + 12 * entry)
            for entry in range(count)
        ]
    except struct.error:
        return 0, 0
    # A SHORT (type 3) takes the first half of its four bytes.
    values = {
        tag: struct.unpack_from(order + ("H" if kind == 3 else "I"), value)[0]
        for tag, kind, _, value in entries
    }
    return values.get(256, 0), values.get(257, 0)


def _size_of_jpeg(content: bytes) -> tuple[int, int]:
    """Of the first frame: a segment is 0xFF, its kind, and a length that includes its own two
    bytes.
    """
    at = 2
    while content[at : at + 1] == b"\xff":
        if content[at + 1 : at + 2] == b"\xff":
            # Padding before a mark.
            at += 1
            continue
        kind = content[at + 1]
        length = struct.unpack_from(">H", content, at + 2)[0]
        # 0xC0 to 0xCF begin frames, but for three tables among them.
        if 0xC0 <= kind <= 0xCF and kind not in (0xC4, 0xC8, 0xCC):
            rows, columns = struct.unpack_from(">HH", content, at + 5)
            return columns, rows
        at += 2 + length
    return 0, 0


def read_picture_time(path: Path) -> PictureTime:
    """Time at which a picture was taken. Raises BadInput if the file cannot be read."""
    try:
        with path.open("rb") as file:
            # A TIFF may have its Exif directory anywhere, so the whole file is read.
            if path.suffix.lower() not in (".tif", ".tiff"):
                head = file.read(HEAD_BYTES)
            else:
                head = file.read()
        changed_s = path.stat().st_mtime
    except OSError as error:
        raise BadInput(f"{path}: cannot be read: {error.strerror}") from None
    taken = read_time_taken(head)
    if taken:
        return PictureTime(taken, True)
    return PictureTime(datetime.fromtimestamp(changed_s, UTC), False)


def list_photos(folder: Path) -> list[Path]:
    """The pictures in a folder in natural sort order: 9 before 10.

    Raises BadInput if the folder does not exist, or holds no picture.
    """
    pictures = list_pictures(folder)
    if not pictures:
        raise BadInput(
            f"{folder}: holds no picture; expected are files that end in {', '.join(ENDINGS)}"
        )
    return pictures


def list_pictures(folder: Path) -> list[Path]:
    """Like `list_photos`, for a folder that may still be empty. Raises BadInput if the folder
    does not exist.
    """
    try:
        pictures = [
            file
            for file in folder.iterdir()
            if file.suffix.lower() in ENDINGS and not file.name.startswith(".")
        ]
    except OSError as error:
        raise BadInput(
            f"{folder}: cannot be read: {error.strerror}; name the folder that holds the photos"
        ) from None
    return sorted(pictures, key=_natural_sort_key)


def _natural_sort_key(file: Path) -> tuple[list[tuple[int, str]], str]:
    parts = re.findall(r"[0-9]+|[^0-9]+", file.stem.lower())
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts], file.name


class PhotoFolder:
    """Implements `Camera`. `host_s` counts from the earliest photo, by Exif time if every photo has
    one, else by file times.

    The two are never mixed: the clocks of camera and computer differ by more than the duration of a
    stage.
    """

    def __init__(self, folder: Path) -> None:
        """Raises BadInput if the folder holds no photo."""
        self._folder = folder
        self._files = list_photos(folder)
        self._next = 0
        moments = [read_picture_time(file) for file in self._files]
        self._by_exif = all(moment.from_exif for moment in moments)
        if self._by_exif:
            times_s = [moment.at.timestamp() for moment in moments]
        else:
            times_s = [file.stat().st_mtime for file in self._files]
        self._times_s = [time_s - min(times_s) for time_s in times_s]

    def __len__(self) -> int:
        return len(self._files)

    def photo(self) -> Photo:
        """The next photo (rows, columns, 3) in BGR order.

        Raises DeviceError after the last one, and BadInput for a broken one, which the next call
        skips.
        """
        if self._next == len(self._files):
            raise DeviceError(
                f"{self._folder}: no photo after the {self._next} that it holds; add "
                "those that are missing"
            )
        at = self._next
        self._next += 1
        return Photo(read_picture(self._files[at]), self._times_s[at], self._files[at].name)

    def close(self) -> None:
        """Does nothing: no file is held open."""

    def identity(self) -> dict[str, str]:
        time_from = "Exif" if self._by_exif else "times of last change"
        return {
            "camera": f"folder {self._folder.name} of {len(self._files)} photos",
            "camera_time": time_from,
        }
