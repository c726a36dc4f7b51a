"""A drive that speaks CANopen's profile for drives, CiA 402, as maxon, Nanotec, Faulhaber and
others make them.

Set in the drive, with its own tool: a velocity mode (3 or 9), speeds in 0.001 rpm (object 60A9h),
heartbeats of node 127 watched (1016h: 127, 100 ms; the reaction to their loss, 6007h, a fault), and
three messages: RPDO1 6040h 60FFh; TPDO1, every report_period_ms, 6041h 6064h 6077h; TPDO2, at the
same rate, 606Ch 603Fh.
"""

import struct
from typing import Annotated

import can
from pydantic import Field

from rfca_rig.own import MotorKeys, Positive, Report, SpeedDrive

HEARTBEAT_OF_THIS_COMPUTER = can.Message(arbitration_id=0x77F, data=[5], is_extended_id=False)
MILLI_RPM = 60e3  # in a turn per second
STATES = {
    0x40: "switch on disabled",
    0x21: "ready to switch on",
    0x23: "switched on",
    0x27: "operation enabled",
    0x07: "quick stop",
}
STEPS = {0x40: 0x06, 0x21: 0x07, 0x23: 0x0F}  # from each state towards operation enabled
ERRORS = {
    0x2310: "current too high",
    0x3210: "supply voltage too high",
    0x3220: "supply voltage too low",
    0x4210: "drive too hot",
    0x4310: "motor too hot",
    0x7320: "position sensor",
    0x8130: "heartbeat of this computer lost",
}


class OurKeys(MotorKeys):
    """What stands in [motor] besides the usual."""

    node_id: Annotated[int, Field(ge=1, le=126)]
    counts_per_turn: Positive
    rated_torque_Nm: Positive

    def driver(self, bus, clock, silent_s):
        return OurMotor(bus, clock, self, silent_s)


class OurMotor(SpeedDrive[OurKeys]):
    make = "CANopen drive, CiA 402"
    speed = 0
    error = 0

    def to_clear(self):
        return [self.frame(0x000, "BB", 1, self.keys.node_id), *self.control(0x80)]

    def to_energise(self, last):
        state = next((word for word, name in STATES.items() if name == last.state), 0)
        return self.control(STEPS.get(state, 0x00))

    def to_turn(self, turns_s):
        return self.control(0x0F, turns_s)

    def to_let_go(self):
        return self.control(0x00)

    def control(self, word, turns_s=0.0):
        return [
            HEARTBEAT_OF_THIS_COMPUTER,
            self.frame(0x200 + self.keys.node_id, "<Hi", word, round(turns_s * MILLI_RPM)),
        ]

    def frame(self, identifier, form, *values):
        return can.Message(
            arbitration_id=identifier, data=struct.pack(form, *values), is_extended_id=False
        )

    def hear(self, message):
        kind = message.arbitration_id & 0x780
        node = message.arbitration_id & 0x7F
        if node != self.keys.node_id or message.is_extended_id:
            return None
        if kind == 0x700 and message.data == b"\0":
            self.restarted()
        elif kind == 0x280:
            self.speed, self.error = struct.unpack("<iH", message.data)
        elif kind == 0x180:
            return self.report(*struct.unpack("<Hih", message.data))
        return None

    def report(self, status, position, per_mille):
        # Bit 5 belongs to the state only where it is set.
        state = STATES.get(status & (0x6F if status & 0x20 else 0x4F), f"0x{status:04x}")
        fault = None
        if status & 0x08:
            state = "fault"
            fault = f"error 0x{self.error:04X} ({ERRORS.get(self.error, 'see its manual')})"
        turns = position / self.keys.counts_per_turn
        turns_s = self.speed / MILLI_RPM
        torque_Nm = 1e-3 * per_mille * self.keys.rated_torque_Nm
        return Report(turns, turns_s, torque_Nm, state == STATES[0x27], state, fault)


MOTOR = OurKeys
