"""The other end of the line: a Bota sensor as `our_sensor.py` knows it."""

import re
import struct

from rfca_rig.own import RecordStreamTwin

FORM = "<H6fIf"


class OurTwin(RecordStreamTwin):
    full_scale = (500.0, 500.0, 1000.0, 15.0, 15.0, 10.0)
    clock_began_s = 4294.5  # shortly before its 32 bits are full

    def obey(self, data):
        orders = re.findall(rb"[CR]|c,0,1,0,4|f,64,0,0,1", data)
        self.is_streaming = (self.is_streaming, *(order == b"R" for order in orders))[-1]
        return b"".join(b"r,0,%c,0" % order[0] for order in orders)

    def record(self, time_s, wrench, is_saturated):
        clock_us = round(1e6 * (self.clock_began_s + time_s)) % 2**32
        body = struct.pack(FORM, 0x0002 if is_saturated else 0, *wrench, clock_us, 31.0)
        return b"\xaa" + body + struct.pack("<H", checksum(body))


def checksum(data):
    """CRC-16/X-25, bit by bit."""
    register = 0xFFFF
    for byte in data:
        register ^= byte
        for _ in range(8):
            register = register >> 1 ^ (0x8408 if register & 1 else 0)
    return register ^ 0xFFFF


TWIN = OurTwin
