"""A Bota Systems force-torque sensor (Rokubi, SensONE; serial, 460 800 bit/s).

It measures 51 200 / n times a second, where n, the length of its filter, is 64 for 800 Hz. A record
is 37 bytes: 0xAA, status, six values in N and N m, its clock in microseconds, its temperature, and
a checksum (CRC-16/X-25).
"""

import struct
from binascii import crc_hqx
from typing import Literal

from rfca_rig.own import ForceSensorKeys, Record, RecordStream

# in the status word
OVERRANGE = 0x0002
INVALID = 0x0004
MIRRORED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


class OurKeys(ForceSensorKeys):
    """What stands in [force_sensor] besides the usual; counts are ours: so many in a newton."""

    filter_length: Literal[51, 64, 128, 256, 512] = 64
    bits_per_s: int = 460_800

    def driver(self, port, clock):
        return OurSensor(port, clock, self)


class OurSensor(RecordStream[OurKeys]):
    make = "Bota Systems, serial"
    header = b"\xaa"
    record_bytes = 37
    clock_wraps_s = 2**32 * 1e-6

    def to_start(self):
        filters = (
            f"f,{self.keys.filter_length},0,0,1".encode()
        )  # no chopping, no fast settling, no further filter
        return [
            (b"C", b"r,0,C,0"),
            (b"c,0,1,0,4", b"r,0,c,0"),
            (filters, b"r,0,f,0"),
            (b"R", b"r,0,R,0"),
        ]

    def to_stop(self):
        return b"C"

    def decode(self, record):
        _, status, *wrench, clock_us, _, checksum = struct.unpack("<BH6fIfH", record)
        if checksum != crc_x25(record[1:-2]):
            return None
        scale = [self.keys.counts_per_N] * 3 + [self.keys.counts_per_Nm] * 3
        counts = [value * per_unit for value, per_unit in zip(wrench, scale, strict=True)]
        return Record(counts, bool(status & OVERRANGE), bool(status & INVALID), 1e-6 * clock_us)


def crc_x25(data):
    """The library's CCITT checksum, of bytes mirrored on the way in and on the way out."""
    mirrored = crc_hqx(data.translate(MIRRORED), 0xFFFF)
    return int(f"{mirrored:016b}"[::-1], 2) ^ 0xFFFF


FORCE_SENSOR = OurKeys
