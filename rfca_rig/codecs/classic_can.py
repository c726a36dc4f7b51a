"""Frames of classic CAN as text: lines of a serial adapter (SLCAN), and messages of socketcand over
TCP in raw mode; pure.

SLCAN: tIIILDD.. standard, TIIIIIIIILDD.. extended, r and R the same as remote frames; each line
ends in a carriage return. Source: LAWICEL CAN232 manual, version 3, section 4.

socketcand: source linux-can/socketcand, doc/protocol.md. Messages are between "<" and ">". The
protocol carries no remote frames. An identifier of three digits is a standard one, of eight an
extended one.
"""

from dataclasses import dataclass

from rfca_rig.errors import MalformedFrame

STANDARD_ID_BITS = 11
EXTENDED_ID_BITS = 29
STANDARD_ID_DIGITS = 3
EXTENDED_ID_DIGITS = 8
MAX_BYTES = 8

END = b"\r"
REFUSED = b"\a"
LONGEST_LINE = 32
FRAME_LETTERS = frozenset("tTrR")

PORT = 29536
GREETING = b"< hi >"
OK = b"< ok >"
LONGEST_MESSAGE = 512


def check_identifier(can_id: int, extended: bool) -> None:
    """Raises MalformedFrame for an identifier that has more bits than CAN gives it."""
    bits = STANDARD_ID_BITS
    if extended:
        bits = EXTENDED_ID_BITS
    if not 0 <= can_id < 1 << bits:
        raise MalformedFrame(f"CAN identifier {can_id:#x} does not fit {bits} bits")


@dataclass(frozen=True, slots=True)
class ClassicFrame:
    """A frame. `remote` frames carry no data, only the `length` that they request. Raises
    MalformedFrame for an impossible frame.
    """

    can_id: int
    data: bytes = b""
    extended: bool = False
    remote: bool = False
    length: int = -1

    def __post_init__(self) -> None:
        # A frozen dataclass can set a default that depends on another field only this way.
        if self.length < 0:
            object.__setattr__(self, "length", len(self.data))
        check_identifier(self.can_id, self.extended)
        n_bytes = self.length
        # Remote frames state a length and carry no data.
        if self.remote:
            n_bytes = 0
        if self.length > MAX_BYTES or len(self.data) != n_bytes:
            raise MalformedFrame(
                f"CAN frame of length {self.length} with {len(self.data)} data bytes, "
                f"limit {MAX_BYTES}"
            )


def split_slcan(received: bytes) -> tuple[list[str], bytes]:
    """Complete lines without their ends, and the remaining bytes. Raises MalformedFrame where a
    line has no end.
    """
    *whole, rest = received.split(END)
    if len(rest) > LONGEST_LINE:
        raise MalformedFrame(f"serial CAN line of more than {LONGEST_LINE} bytes without an end")
    return [line.decode("ascii", "replace") for line in whole], rest


def decode_frame(line: str) -> ClassicFrame:
    """The frame in a line that begins with one of `FRAME_LETTERS`. Raises MalformedFrame for
    anything else.
    """
    if not line or line[0] not in FRAME_LETTERS:
        raise MalformedFrame(f"not a frame of a serial CAN adapter: {line[:40]!r}")
    extended = line[0] in "TR"
    remote = line[0] in "rR"
    digits = STANDARD_ID_DIGITS
    if extended:
        digits = EXTENDED_ID_DIGITS
    can_id = line[1 : 1 + digits]
    length = line[1 + digits : 2 + digits]
    data = line[2 + digits :]
    if len(can_id) != digits or not length or not _all_hex(can_id + length + data):
        raise MalformedFrame(f"serial CAN frame cannot be read: {line[:40]!r}")
    n_bytes = int(length, 16)
    if remote:
        n_bytes = 0
    if len(data) != 2 * n_bytes:
        raise MalformedFrame(
            f"serial CAN frame of length {length} carries {len(data) / 2:g} bytes: {line[:40]!r}"
        )
    return ClassicFrame(int(can_id, 16), bytes.fromhex(data), extended, remote, int(length, 16))


def encode_slcan(frame: ClassicFrame) -> bytes:
    """One line, with its end."""
    letter = "tTrR"[frame.extended + 2 * frame.remote]
    if frame.extended:
        can_id = f"{frame.can_id:08X}"
    else:
        can_id = f"{frame.can_id:03X}"
    return f"{letter}{can_id}{frame.length:X}{frame.data.hex().upper()}\r".encode("ascii")


def _all_hex(text: str) -> bool:
    return all(letter in "0123456789abcdefABCDEF" for letter in text)


def split_socketcand(received: bytes) -> tuple[list[list[str]], bytes]:
    """The words of each complete message, and the remaining bytes. Raises MalformedFrame where a
    message has no end.
    """
    messages = []
    *whole, rest = received.split(b">")
    for text in whole:
        # From the last "<": text before it belongs to no message.
        _, separator, inside = text.rpartition(b"<")
        if separator:
            messages.append([word.decode("ascii", "replace") for word in inside.split()])
    if len(rest) > LONGEST_MESSAGE:
        raise MalformedFrame(
            f"socketcand message of more than {LONGEST_MESSAGE} bytes without an end"
        )
    return messages, rest


def decode_send(words: list[str]) -> ClassicFrame:
    """The frame in the words of a `send ID LENGTH BYTE ...`. Raises MalformedFrame for anything
    else.
    """
    if len(words) < 3 or words[0] != "send":
        raise MalformedFrame(f"not a socketcand send: {' '.join(words)[:60]!r}")
    can_id, length, *data = (_hex(word) for word in words[1:])
    if length != len(data) or any(byte > 0xFF for byte in data):
        raise MalformedFrame(f"socketcand send says {length} bytes: {' '.join(words)[:60]!r}")
    return ClassicFrame(can_id, bytes(data), extended=len(words[1]) > 3)


def encode_socketcand(frame: ClassicFrame, t_s: float) -> bytes:
    """A received frame, as the server reports it; `t_s` since the epoch. Raises MalformedFrame
    for a remote frame.
    """
    if frame.remote:
        raise MalformedFrame(f"socketcand carries no remote frames; {frame.can_id:#x} is one")
    if frame.extended:
        can_id = f"{frame.can_id:08X}"
    else:
        can_id = f"{frame.can_id:03X}"
    return f"< frame {can_id} {t_s:.6f} {frame.data.hex().upper()} >".encode("ascii")


def error(reason: str) -> bytes:
    """The server's refusal of a command."""
    return f"< error {reason} >".encode("ascii")


def _hex(word: str) -> int:
    if not word or any(letter not in "0123456789abcdefABCDEF" for letter in word) or len(word) > 8:
        raise MalformedFrame(f"not a hexadecimal number: {word[:20]!r}")
    return int(word, 16)
