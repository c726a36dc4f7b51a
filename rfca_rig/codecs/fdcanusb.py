"""The ASCII lines of a fdcanusb, a serial adapter for CAN-FD; some drives use the same protocol on
their own UART. Pure.

Sources: mjbots fdcanusb README, "Protocol", its firmware (can_manager.cc: flags of `can send`), and
the reference of the drives of mjbots, "UART" (checksums). A client sends `can send ID DATA [flags]`
and receives `OK` or `ERR ...`; a frame from the bus is `rcv ID DATA flags`, from a UART without
flags. The length of the id follows from its value; `can std` and `can ext` say it instead, not to
a UART. Lines may end in ` *XX`, a CRC-8 of everything before the star: those of a UART do once a
client's did, those of an adapter never.
"""

import re
from dataclasses import dataclass

from rfca_rig.codecs.classic_can import STANDARD_ID_BITS, check_identifier
from rfca_rig.errors import MalformedFrame

# Data lengths of CAN-FD, in bytes.
FD_LENGTHS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)
POLYNOMIAL = 0x97
LONGEST_LINE = 256
MAX_CLASSIC_BYTES = 8
_END = b"\r\n"
# Of a received frame: the adapter's own time, and the filter that the frame passed.
_TIME_OR_FILTER = re.compile(r"[tf]-?\d+")


@dataclass(frozen=True, slots=True)
class AdapterFrame:
    """A frame of CAN-FD, or a classic one without `fd`. Raises MalformedFrame for an impossible
    frame.
    """

    can_id: int
    data: bytes
    extended: bool = True
    bitrate_switch: bool = True
    fd: bool = True
    remote: bool = False

    def __post_init__(self) -> None:
        check_identifier(self.can_id, self.extended)
        if self.fd and len(self.data) not in FD_LENGTHS:
            raise MalformedFrame(
                f"CAN-FD frame of {len(self.data)} bytes, which CAN-FD does not have"
            )
        if not self.fd and (len(self.data) > MAX_CLASSIC_BYTES or self.bitrate_switch):
            raise MalformedFrame(
                f"classic CAN frame of {len(self.data)} bytes, bit rate switch "
                f"{self.bitrate_switch}; it has {MAX_CLASSIC_BYTES} bytes at most, and no switch"
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


def encode_line(text: str, with_checksum: bool = True) -> bytes:
    """A line with its end, and its checksum."""
    line = text.encode("ascii", "replace")
    if with_checksum:
        guarded = line + b" "
        line = guarded + f"*{crc8(guarded):02X}".encode("ascii")
    return line + _END


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


def encode_send(frame: AdapterFrame, with_checksum: bool = True) -> bytes:
    """The line with which a client sends a frame. Raises MalformedFrame for a frame without data,
    which an adapter refuses.
    """
    if not frame.data:
        raise MalformedFrame(f"a fdcanusb sends no frame without data; {frame.can_id:#x} has none")
    order = "send"
    if frame.extended != _needs_extended(frame.can_id):
        order = "ext" if frame.extended else "std"
    # Letters in one word: an adapter takes a space between them for an unknown flag.
    # Without "r", which every adapter knows, but not every UART.
    flags = "".join(_flags(frame)[1:]).removesuffix("r")
    return encode_line(
        f"can {order} {frame.can_id:04x} {frame.data.hex().upper()} {flags}", with_checksum
    )


def decode_send(text: str) -> AdapterFrame:
    """The frame in a client's order to send one. Raises MalformedFrame for anything else.

    Without flags it is a CAN-FD frame that switches the bit rate.
    """
    match _words(text):
        case ["can", ("send" | "std" | "ext") as order, identifier, data, *flags]:
            letters = set("".join(flags))
            if letters - set("BbFfRr"):
                raise MalformedFrame(f"unknown flag in {text[:40]!r}")
            extended = order == "ext"
            if order == "send":
                extended = _needs_extended(_identifier(identifier, text))
            return _frame(identifier, data, extended, letters, text)
    raise MalformedFrame(f"not an order to send a frame: {text[:40]!r}")


def encode_received(frame: AdapterFrame) -> bytes:
    """The line with which a client receives a frame from the bus."""
    words = ("rcv", f"{frame.can_id:04x}", frame.data.hex().upper(), *_flags(frame))
    return encode_line(" ".join(word for word in words if word))


def _flags(frame: AdapterFrame) -> tuple[str, str, str, str]:
    return (
        "E" if frame.extended else "e",
        "B" if frame.bitrate_switch else "b",
        "F" if frame.fd else "f",
        "R" if frame.remote else "r",
    )


def decode_received(text: str) -> AdapterFrame:
    """The frame from the bus. Raises MalformedFrame for anything else."""
    match _words(text):
        case ["rcv", identifier, *words]:
            # A frame without data has no word for them; flags have one letter each.
            data = ""
            if words and len(words[0]) > 1:
                data = words.pop(0)
            letters = set("".join(word for word in words if not _TIME_OR_FILTER.fullmatch(word)))
            if letters - set("EeBbFfRr"):
                raise MalformedFrame(f"unknown flag in {text[:40]!r}")
            extended = "E" in letters
            if not letters & {"E", "e"}:
                extended = _needs_extended(_identifier(identifier, text))
            return _frame(identifier, data, extended, letters, text)
    raise MalformedFrame(f"not a frame from the bus: {text[:40]!r}")


def _words(text: str) -> list[str]:
    """Words separated by spaces and tabs."""
    # Not `split()`: other characters that Python counts as white space are not valid here.
    return [word for word in text.replace("\t", " ").split(" ") if word]


def _needs_extended(identifier: int) -> bool:
    return identifier >= 1 << STANDARD_ID_BITS


def _identifier(word: str, text: str) -> int:
    if not _all_hex(word) or len(word) > 8:
        raise MalformedFrame(f"frame cannot be read: {text[:40]!r}")
    return int(word, 16)


def _frame(
    identifier: str, data: str, extended: bool, letters: set[str], text: str
) -> AdapterFrame:
    if data and (not _all_hex(data) or len(data) % 2):
        raise MalformedFrame(f"frame cannot be read: {text[:40]!r}")
    is_fd = "f" not in letters
    return AdapterFrame(
        _identifier(identifier, text),
        bytes.fromhex(data),
        extended,
        bitrate_switch=is_fd and "b" not in letters,
        fd=is_fd,
        remote="R" in letters,
    )


def _all_hex(text: str) -> bool:
    return bool(text) and all(letter in "0123456789abcdefABCDEF" for letter in text)
