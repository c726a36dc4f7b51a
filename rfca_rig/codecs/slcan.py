"""The ASCII lines of a serial CAN adapter (SLCAN), classic frames; pure. Source: LAWICEL CAN232 manual, version 3, section 4.

tIIILDD.. standard, TIIIIIIIILDD.. extended, r and R the same as remote frames; each line ends in a carriage return.
"""

from rfca_rig.codecs.classic_can import ClassicFrame
from rfca_rig.errors import MalformedFrame

END = b"\r"
REFUSED = b"\a"
LONGEST_LINE = 32
FRAME_LETTERS = frozenset("tTrR")


def split(received: bytes) -> tuple[list[str], bytes]:
    """Complete lines without their ends, and the remaining bytes. Raises MalformedFrame where a line has no end."""
    *whole, rest = received.split(END)
    if len(rest) > LONGEST_LINE:
        raise MalformedFrame(f"serial CAN line of more than {LONGEST_LINE} bytes without an end")
    return [line.decode("ascii", "replace") for line in whole], rest


def decode_frame(line: str) -> ClassicFrame:
    """The frame in a line that begins with one of `FRAME_LETTERS`. Raises MalformedFrame for anything else."""
    if not line or line[0] not in FRAME_LETTERS:
        raise MalformedFrame(f"not a frame of a serial CAN adapter: {line[:40]!r}")
    extended, remote = line[0] in "TR", line[0] in "rR"
    digits = 8 if extended else 3
    can_id, length, data = line[1 : 1 + digits], line[1 + digits : 2 + digits], line[2 + digits :]
    if len(can_id) != digits or not length or not _all_hex(can_id + length + data):
        raise MalformedFrame(f"serial CAN frame cannot be read: {line[:40]!r}")
    # Remote frames state a length and carry no data.
    if len(data) != (0 if remote else 2 * int(length, 16)):
        raise MalformedFrame(f"serial CAN frame of length {length} carries {len(data) / 2:g} bytes: {line[:40]!r}")
    return ClassicFrame(int(can_id, 16), bytes.fromhex(data), extended, remote, int(length, 16))


def encode_frame(frame: ClassicFrame) -> bytes:
    """One line, with its end."""
    letter = "tTrR"[frame.extended + 2 * frame.remote]
    can_id = f"{frame.can_id:08X}" if frame.extended else f"{frame.can_id:03X}"
    return f"{letter}{can_id}{frame.length:X}{frame.data.hex().upper()}\r".encode("ascii")


def _all_hex(text: str) -> bool:
    return all(letter in "0123456789abcdefABCDEF" for letter in text)
