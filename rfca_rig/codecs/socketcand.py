"""The text protocol of socketcand over TCP, raw mode; pure. Source: linux-can/socketcand, doc/protocol.md.

Messages are between "<" and ">". The protocol carries no remote frames. An identifier of three digits is a standard one,
of eight an extended one.
"""

from rfca_rig.codecs.classic_can import ClassicFrame
from rfca_rig.errors import MalformedFrame

PORT = 29536
GREETING = b"< hi >"
OK = b"< ok >"
LONGEST_MESSAGE = 512


def split(received: bytes) -> tuple[list[list[str]], bytes]:
    """The words of each complete message, and the remaining bytes. Raises MalformedFrame where a message has no end."""
    messages = []
    *whole, rest = received.split(b">")
    for text in whole:
        # From the last "<": text before it belongs to no message.
        _, found, inside = text.rpartition(b"<")
        if found:
            messages.append([word.decode("ascii", "replace") for word in inside.split()])
    if len(rest) > LONGEST_MESSAGE:
        raise MalformedFrame(f"socketcand message of more than {LONGEST_MESSAGE} bytes without an end")
    return messages, rest


def decode_send(words: list[str]) -> ClassicFrame:
    """The frame in the words of a `send ID LENGTH BYTE ...`. Raises MalformedFrame for anything else."""
    if len(words) < 3 or words[0] != "send":
        raise MalformedFrame(f"not a socketcand send: {' '.join(words)[:60]!r}")
    can_id, length, *data = (_hex(word) for word in words[1:])
    if length != len(data) or any(byte > 0xFF for byte in data):
        raise MalformedFrame(f"socketcand send says {length} bytes: {' '.join(words)[:60]!r}")
    return ClassicFrame(can_id, bytes(data), extended=len(words[1]) > 3)


def encode_frame(frame: ClassicFrame, t_s: float) -> bytes:
    """A received frame, as the server reports it; `t_s` since the epoch. Raises MalformedFrame for a remote frame."""
    if frame.remote:
        raise MalformedFrame(f"socketcand carries no remote frames; {frame.can_id:#x} is one")
    can_id = f"{frame.can_id:08X}" if frame.extended else f"{frame.can_id:03X}"
    return f"< frame {can_id} {t_s:.6f} {frame.data.hex().upper()} >".encode("ascii")


def error(reason: str) -> bytes:
    """The server's refusal of a command."""
    return f"< error {reason} >".encode("ascii")


def _hex(word: str) -> int:
    if not word or any(letter not in "0123456789abcdefABCDEF" for letter in word) or len(word) > 8:
        raise MalformedFrame(f"not a hexadecimal number: {word[:20]!r}")
    return int(word, 16)
