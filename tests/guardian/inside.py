"""A guardian in this process, on a wire and a clock of the test's own: every round is called by
the test.
"""

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import can

from rfca_rig.clock import TwinClock
from rfca_rig.devices.cubemars.codec.mit import MitReply, encode_reply
from rfca_rig.devices.cubemars.driver import MitSettings, MitTorqueOffFrames
from rfca_rig.guardian.link import GuardianLink, GuardianRecord, RecordKind, from_frame
from rfca_rig.guardian.process import Guardian
from rfca_rig.twins.wires import can_wire

SETTINGS = MitSettings(1, "AK80-9")
LAST_WORD = MitTorqueOffFrames(SETTINGS)
LIMP, EXIT = (bytes(message.data) for message in LAST_WORD.frames())
SILENCE_S = 0.1


def command(number: int = 0) -> can.Message:
    return can.Message(arbitration_id=1, data=number.to_bytes(8, "big"), is_extended_id=False)


def reply(torque_Nm: float) -> can.Message:
    data = encode_reply(SETTINGS.ranges, MitReply(1, 0x8000, 0.0, 0.0, torque_Nm, 30, 0))
    return can.Message(arbitration_id=0, data=data, is_extended_id=False)


@dataclass
class Inside:
    """`drive` is the other end of the bus, `parent` the other end of the link."""

    clock: TwinClock
    guardian: Guardian
    drive: can.BusABC
    parent: GuardianLink
    said: list[GuardianRecord] = field(default_factory=list)

    def arm(self, number: int = 1) -> None:
        self.put(GuardianRecord(RecordKind.ARM, self.clock.now_s(), number=number))

    def command(self, number: int = 0) -> None:
        self.put(from_frame(command(number), self.clock.now_s()))

    def put(self, record: GuardianRecord) -> None:
        self.parent.put(record)
        self.parent.flush()

    def confirmed(self, message: can.Message) -> str:
        self.put(from_frame(message, self.clock.now_s(), RecordKind.FRAME_TO_CONFIRM, 1))
        self.guardian.round(self.clock.now_s())
        return self.told(RecordKind.CONFIRMED)[-1].text

    def rounds(self, seconds: float, every_s: float = 1e-3) -> None:
        for _ in range(round(seconds / every_s)):
            self.clock.wait_until(self.clock.now_s() + every_s)
            self.guardian.round(self.clock.now_s())

    def told(self, kind: RecordKind) -> list[GuardianRecord]:
        while new := self.parent.take():
            self.said += new
            self.guardian._link.flush()
        return [record for record in self.said if record.kind == kind]

    def heard(self) -> list[bytes]:
        """What reached the drive since the last call."""
        return [bytes(message.data) for message in iter(lambda: self.drive.recv(timeout=0), None)]


@contextmanager
def inside(bus: can.BusABC | None = None) -> Iterator[Inside]:
    """`bus` in place of the wire's end, for a guardian with a bus that fails."""
    clock = TwinClock()
    here, there = socket.socketpair()
    with here, there, can_wire() as (guardians_end, drive):
        guardian = Guardian(bus or guardians_end, GuardianLink(there), LAST_WORD, SILENCE_S, clock)
        yield Inside(clock, guardian, drive, GuardianLink(here))
