"""Random and damaged frames into every decoder.

Run: python -m tests.benchmarks.decoders [--frames 1000000]

Half of what each is given is noise of any length, half a good frame that was damaged: bits turned,
bytes lost, doubled or added. What it takes must have a length and a checksum that its protocol
allows, worked out here anew from the bytes; what it refuses must be refused with its own error.
Printed are the shares taken and refused, and frames/s; any other exception or a wrong frame taken
ends it.
"""

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from rfca_rig.codecs import classic_can, fdcanusb
from rfca_rig.devices.ati_serial import codec as ati_serial
from rfca_rig.devices.ati_serial.codec import AsciiStream, BinaryStream
from rfca_rig.devices.cubemars.codec import mit as cubemars_mit
from rfca_rig.devices.cubemars.codec import mit_ranges
from rfca_rig.devices.cubemars.codec import servo as cubemars_servo
from rfca_rig.devices.moteus import codec as moteus
from rfca_rig.devices.netft import codec as netft
from rfca_rig.devices.odrive import codec as cansimple
from rfca_rig.errors import MalformedFrame

RANGES = mit_ranges("AK80-9")
FD = {*range(9), 12, 16, 20, 24, 32, 48, 64}
RECORD = ati_serial.AtiRecord(0, (1, -2, 300, -400, 5, -6))
PAGE = (
    b"<netft><prodname>Net F/T</prodname><scfgfu>N</scfgfu><scfgtu>Nm</scfgtu>"
    b"<cfgcpf>1000000</cfgcpf><cfgcpt>1000000</cfgcpt><comrdtrate>7000</comrdtrate></netft>"
)
STRUCTURED_BYTES = b"0123456789ABCDEFabcdef ,*<>tTrR\r\n-+sendrcv"


@dataclass(frozen=True)
class Decoder:
    """`decode` returns None for what is not for it; `good` are frames as a device sends them;
    `allowed` judges what was taken.

    A stream that must find its step again is harmed by every so manieth frame only.
    """

    name: str
    decode: Callable[[bytes], object]
    good: tuple[bytes, ...]
    allowed: Callable[[bytes], bool]
    longest: int = 80
    harmed_every: int = 1


def _length(*lengths: int) -> Callable[[bytes], bool]:
    return lambda data: len(data) in lengths


def _odrive(dialect: cansimple.OdriveFirmware) -> Decoder:
    lengths = {0x02: {0, 8}, 0x07: {4, 8}, 0x0E: {4, 8}, 0x18: {0, 1, 8}, 0x16: {0, 8}}
    if dialect is cansimple.OdriveFirmware.V0_6:
        # An endpoint has one to four bytes behind the four of its number.
        of_endpoint = {4, 5, 6, 7, 8}
        lengths |= {0x04: of_endpoint, 0x05: of_endpoint, 0x06: {7, 8}, 0x16: {1, 8}}

    def decode(data: bytes) -> object:
        return cansimple.decode(data[0] if data else 0, data[1:], dialect)

    def allowed(data: bytes) -> bool:
        return len(data) - 1 in lengths.get(data[0] & 0x1F, {8})

    good = tuple(bytes([command]) + bytes(8) for command in range(0x20))
    return Decoder(f"ODrive CANSimple {dialect}", decode, good, allowed, 12)


def _servo(data: bytes) -> object:
    return cubemars_servo.decode((data[0] % 50 if data else 0) << 8 | 1, data[1:])


def _servo_allowed(data: bytes) -> bool:
    return len(data) - 1 == {5: 1, 6: 8, 41: 8}.get(data[0] % 50, 4)


def _serial(form: ati_serial.RecordForm) -> Decoder:
    def allowed(data: bytes) -> bool:
        if form is ati_serial.RecordForm.ASCII:
            return data.count(b",") == 6 and all(
                part.strip().lstrip(b"-").isdigit() for part in data.split(b",")
            )
        whole = len(data) == (14 if form is ati_serial.RecordForm.BINARY_CHECKSUM else 13)
        return whole and (form is ati_serial.RecordForm.BINARY or sum(data[:-1]) % 256 == data[-1])

    return Decoder(
        f"F/T record, {form}",
        lambda data: ati_serial.decode_record(data, form),
        (ati_serial.encode_record(RECORD, form),),
        allowed,
    )


def _stream(
    name: str, make: Callable[[], AsciiStream | BinaryStream], form: ati_serial.RecordForm
) -> Decoder:
    """Fed on and on; what it finds is judged by its counters in the tests, here it must only
    never fail nor hoard.
    """
    stream = make()

    def feed(data: bytes) -> object:
        found = stream.feed(data)
        assert len(stream._held) < 4096, "it hoards what it was fed"
        return found or None

    return Decoder(
        name, feed, (ati_serial.encode_record(RECORD, form),), lambda _: True, harmed_every=12
    )


def _socketcand(data: bytes) -> object:
    messages, _ = classic_can.split_socketcand(data)
    return [classic_can.decode_send(words) for words in messages] or None


def _socketcand_allowed(data: bytes) -> bool:
    frames = [part.rpartition(b"<")[2].split() for part in data.split(b">")[:-1] if b"<" in part]
    return all(len(words) >= 3 and int(words[2], 16) == len(words) - 3 for words in frames)


def _slcan(data: bytes) -> object:
    lines, _ = classic_can.split_slcan(data)
    return [classic_can.decode_frame(line) for line in lines if line] or None


def _slcan_allowed(data: bytes) -> bool:
    for line in (one for one in data.split(b"\r")[:-1] if one):
        head = 9 if line[:1] in b"TR" else 4
        if line[:1] in b"rR":
            carried = 0
        else:
            carried = 2 * int(line[head : head + 1], 16)
        if len(line) != head + 1 + carried:
            return False
    return True


def _fdcanusb(data: bytes) -> object:
    lines, _ = fdcanusb.split(data)
    return [fdcanusb.decode_received(fdcanusb.parse_line(line)[0]) for line in lines] or None


def _fdcanusb_allowed(data: bytes) -> bool:
    """A checksum is the protocol's own, CRC-8 with polynomial 0x97, where a line carries one."""
    for line in (one for one in data.replace(b"\r", b"\n").split(b"\n")[:-1] if one):
        guarded, star, digits = line.rpartition(b"*")
        if (
            star
            and len(digits) == 2
            and all(letter in b"0123456789abcdefABCDEF" for letter in digits)
            and int(digits, 16) != _crc(guarded)
        ):
            return False
    return True


def _crc(data: bytes) -> int:
    crc = 0
    for byte in data:
        for bit in range(7, -1, -1):
            carry = (crc >> 7) ^ (byte >> bit & 1)
            crc = (crc << 1 & 0xFF) ^ (0x97 if carry else 0)
    return crc


DECODERS = (
    _odrive(cansimple.OdriveFirmware.V0_5),
    _odrive(cansimple.OdriveFirmware.V0_6),
    Decoder(
        "CubeMars MIT reply",
        lambda data: cubemars_mit.decode_reply(RANGES, data),
        (bytes(8), bytes(6)),
        _length(6, 7, 8),
        12,
    ),
    Decoder(
        "CubeMars MIT command",
        lambda data: cubemars_mit.decode_command(RANGES, data),
        (bytes(8), b"\xff" * 7 + b"\xfc"),
        _length(8),
        12,
    ),
    Decoder(
        "CubeMars servo",
        _servo,
        tuple(bytes([p]) + bytes(8) for p in range(50)),
        _servo_allowed,
        12,
    ),
    Decoder(
        "moteus",
        moteus.decode,
        (bytes.fromhex("240400110f5050"), bytes.fromhex("27040a00aabb2f01")),
        lambda data: len(data) in FD,
    ),
    Decoder(
        "RDT records",
        netft.decode_records,
        (bytes(36), bytes(1440)),
        lambda d: len(d) % 36 == 0 < len(d) <= 1440,
        1500,
    ),
    Decoder(
        "RDT request",
        netft.decode_request,
        (netft.encode_request(2, 7),),
        lambda d: len(d) == 8 and d[:2] == b"\x12\x34",
        12,
    ),
    Decoder(
        "Net F/T command", netft.decode_command, (bytes(20), b"\x01" + bytes(19)), _length(20), 32
    ),
    Decoder(
        "Net F/T reading",
        netft.decode_reading,
        (b"\x12\x34" + bytes(14),),
        lambda d: len(d) == 16 and d[:2] == b"\x12\x34",
        32,
    ),
    Decoder(
        "Net F/T calibration",
        netft.decode_calibration,
        (b"\x12\x34\x02\x03" + b"\x00\x0f\x42\x40" * 2 + b"\x00\x01" * 6,),
        lambda d: len(d) == 24 and d[:2] == b"\x12\x34",
        32,
    ),
    Decoder(
        "Net F/T configuration", netft.decode_configuration, (PAGE,), lambda d: b"cfgcpf" in d, 220
    ),
    *(_serial(form) for form in ati_serial.RecordForm),
    _stream("F/T stream of lines", AsciiStream, ati_serial.RecordForm.ASCII),
    _stream(
        "F/T stream of records",
        lambda: BinaryStream(ati_serial.RecordForm.BINARY_CHECKSUM),
        ati_serial.RecordForm.BINARY_CHECKSUM,
    ),
    Decoder(
        "socketcand", _socketcand, (b"< send 123 2 1 ff >", b"< send 1 0 >"), _socketcand_allowed
    ),
    Decoder(
        "serial CAN (slcan)",
        _slcan,
        (b"t1232AABB\r", b"T0000012310A\r", b"r1230\r"),
        _slcan_allowed,
    ),
    Decoder(
        "fdcanusb",
        _fdcanusb,
        (fdcanusb.encode_line("rcv 0123 AABB e b f"), b"rcv 12 0011\n"),
        _fdcanusb_allowed,
    ),
)


def frames(decoder: Decoder, count: int, random: np.random.Generator) -> Iterator[bytes]:
    """Noise and damaged frames by turns, some of the noise in the letters that texts are made
    of.
    """
    letters = np.frombuffer(STRUCTURED_BYTES, np.uint8)
    pool = random.integers(0, 256, 1 << 20, dtype=np.uint8).tobytes()
    texts = letters[random.integers(0, len(letters), 1 << 20)].tobytes()
    lengths = random.integers(0, decoder.longest + 1, count)
    places = random.integers(0, (1 << 20) - 2048, count)
    harm = random.integers(0, 5, count)
    for i in range(count):
        length = int(lengths[i])
        place = int(places[i])
        if i % decoder.harmed_every:
            yield decoder.good[0]
        elif (i // decoder.harmed_every) % 2:
            yield (pool if i % 4 == 1 else texts)[place : place + length]
        else:
            good = decoder.good[place % len(decoder.good)]
            yield _damaged(good, int(harm[i]), pool[place : place + 4])


def _damaged(good: bytes, harm: int, noise: bytes) -> bytes:
    at = (noise[0] | noise[1] << 8) % (len(good) + 1)
    if harm == 0:
        return good
    if harm == 1:
        return good[:at] + bytes([noise[2]]) + good[at + 1 :]
    if harm == 2:
        return good[:at] + good[at + 1 + noise[2] % 3 :]
    return (
        good[:at]
        + (noise[: 1 + noise[2] % 3] if harm == 3 else good[max(at - 2, 0) : at])
        + good[at:]
    )


def tried(decoder: Decoder, count: int, seed: int) -> tuple[int, int, float]:
    """(taken, refused, seconds in the decoder). Raises AssertionError for a frame taken wrongly,
    anything for a crash.
    """
    taken = refused = 0
    spent = 0.0
    for data in frames(decoder, count, np.random.default_rng(seed)):
        begin = time.perf_counter()
        try:
            found = decoder.decode(data)
        except MalformedFrame:
            refused += 1
            continue
        finally:
            spent += time.perf_counter() - begin
        if found is not None:
            assert decoder.allowed(data), f"{decoder.name} took {data!r} as {found!r}"
            taken += 1
    return taken, refused, spent


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    for decoder in DECODERS:
        taken, refused, spent = tried(decoder, asked.frames, asked.seed)
        rate = asked.frames / spent
        share = f"taken {taken / asked.frames:6.1%}, refused {refused / asked.frames:6.1%}"
        print(
            f"{decoder.name:26s} {asked.frames:9d} frames   {share}   {rate:10.0f} frames/s",
            flush=True,
        )


if __name__ == "__main__":
    main()
