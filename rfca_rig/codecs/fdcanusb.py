"""The ASCII lines of a fdcanusb, a serial adapter for CAN-FD; some drives use the same protocol on
their own UART. Pure.

Sources: mjbots fdcanusb README, "Protocol", and the reference of the drives of mjbots, "UART"
(checksums). A client sends `can send ID DATA [flags]` and receives `OK` or `ERR ...`; a frame from
the bus is `rcv ID DATA flags`. Lines may end in ` *XX`, a CRC-8 of everything before the star.
"""

from dataclasses import dataclass

from rfca_rig.codecs.classic_can import STANDARD_ID_BITS, check_identifier
from rfca_rig.errors import MalformedFrame

# Data lengths of CAN-FD, in bytes.
FD_LENGTHS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)
POLYNOMIAL = 0x97
LONGEST_LINE = 256
_END = b"\r\n"


@dataclass(frozen=True, slots=True)
class FdFrame:
    """A CAN-FD data frame. Raises MalformedFrame for an impossible frame."""

    can_id: int
    data: bytes
    extended: bool = True
    bitrate_switch: bool = True

    def __post_init__(self) -> None:
        check_identifier(self.can_id, self.extended)
        if len(self.data) not in FD_LENGTHS:
            raise MalformedFrame(
                f"CAN-FD frame of {len(self.data)} bytes, which CAN-FD does not have"
            )


def crc8(data: bytes) -> int:
    """CRC-8 with POLYNOMIAL, most significant bit first, initial value 0."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            carry = crc & 0x80
            crc = crc << 1 & 0xFF
            if carry:
                crc ^= POLYNOMIAL
    return crc


def encode_line(text: str) -> bytes:
    """A line with its checksum and end."""
    guarded = f"{text} ".encode("ascii", "replace")
    return guarded + f"*{crc8(guarded):02X}".encode("ascii") + _END


def split(received: bytes) -> tuple[list[bytes], bytes]:
    """Complete lines without their ends, none empty, and the remaining bytes. Raises
    MalformedFrame where a line has no end.
    """
    # Either character ends a line; the empty lines between CR and LF are dropped.
    *whole, rest = received.replace(b"\r", b"\n").split(b"\n")
    if len(rest) > LONGEST_LINE:
        raise MalformedFrame(f"line of more than {LONGEST_LINE} bytes without an end")
    return [line for line in whole if line], rest


def parse_line(line: bytes) -> tuple[str, bool]:
    """The text of a line, and whether it carried a checksum. Raises MalformedFrame for a wrong
    checksum.
    """
    guarded, star, digits = line.rpartition(b"*")
    # Two hexadecimal digits after the star; any other star is part of the text.
    has_checksum = bool(star) and len(digits) == 2 and _all_hex(digits.decode("latin1"))
    if not has_checksum:
        return line.decode("latin1").strip(" \t"), False
    if int(digits, 16) != crc8(guarded):
        raise MalformedFrame(
            f"checksum mismatch, {digits.decode('ascii')} where {crc8(guarded):02X} was due"
        )
    return guarded.decode("latin1").strip(" \t"), True


def encode_send(frame: FdFrame) -> bytes:
    """The line with which a client sends a frame."""
    return encode_line(f"can send {frame.can_id:04x} {frame.data.hex().upper()} {_flags(frame)}")


def decode_send(text: str) -> FdFrame:
    """The frame in a client's `can send`. Raises MalformedFrame for anything else."""
    words = _words(text)
    if words[:2] != ["can", "send"]:
        raise MalformedFrame(f"not an order to send a frame: {text[:40]!r}")
    return _frame(words[2:], text)


def encode_received(frame: FdFrame) -> bytes:
    """The line with which a client receives a frame from the bus."""
    return encode_line(f"rcv {frame.can_id:04x} {frame.data.hex().upper()} {_flags(frame)}")


def decode_received(text: str) -> FdFrame:
    """The frame from the bus. Raises MalformedFrame for anything else."""
    words = _words(text)
    if words[:1] != ["rcv"]:
        raise MalformedFrame(f"not a frame from the bus: {text[:40]!r}")
    return _frame(words[1:], text)


def _words(text: str) -> list[str]:
    """Words separated by spaces and tabs."""
    # Not `split()`: other characters that Python counts as white space are not valid here.
    return [word for word in text.replace("\t", " ").split(" ") if word]


def _flags(frame: FdFrame) -> str:
    return f"{'E' if frame.extended else 'e'} {'B' if frame.bitrate_switch else 'b'} F"


def _frame(words: list[str], text: str) -> FdFrame:
    """A frame from its words. Without flags, an identifier is extended if it needs to be, and
    bit rates are switched.
    """
    flags = "".join(words[2:])
    if (
        len(words) < 2
        or not all(map(_all_hex, words[:2]))
        or len(words[0]) > 8
        or len(words[1]) % 2
    ):
        raise MalformedFrame(f"frame cannot be read: {text[:40]!r}")
    can_id = int(words[0], 16)
    extended = "E" in flags or ("e" not in flags and can_id >= 1 << STANDARD_ID_BITS)
    return FdFrame(can_id, bytes.fromhex(words[1]), extended, "b" not in flags)


def _all_hex(text: str) -> bool:
    return bool(text) and all(letter in "0123456789abcdefABCDEF" for letter in text)
