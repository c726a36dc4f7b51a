"""The other end of the wire: a CiA 402 drive as `our_motor.py` wants it set."""

import struct

import can

from rfca_rig.own import SpeedDriveTwin

DISABLED = 0x40
READY = 0x21
SWITCHED_ON = 0x23
ENABLED = 0x27
FAULT = 0x08
TRANSITIONS = {(DISABLED, 0x06): READY, (READY, 0x07): SWITCHED_ON, (SWITCHED_ON, 0x0F): ENABLED}


class OurTwin(SpeedDriveTwin):
    def __init__(self, bus, keys, gains, watchdog_s):
        super().__init__(bus, keys, gains, watchdog_s)
        self.keys = keys
        self.state = DISABLED
        self.last_word = 0

    def obey(self, message):
        if message.arbitration_id == 0x77F:
            self.feed()
        elif message.arbitration_id == 0x200 + self.keys.node_id:
            word, milli_rpm = struct.unpack("<Hi", message.data)
            self.turn(milli_rpm / 60e3)
            self.control(word)

    def control(self, word):
        if self.state == FAULT:
            if word & 0x80 and not self.last_word & 0x80:
                self.state = DISABLED
                self.fault = 0
        elif not word & 0x02:
            self.let_go(DISABLED)
        else:
            self.state = TRANSITIONS.get((self.state, word), self.state)
        self.last_word = word
        if self.state == ENABLED and self.refuses_with:
            self.break_down(self.refuses_with)
        elif self.state == ENABLED:
            self.switch_on()

    def let_go(self, state):
        self.state = state
        self.is_on = False

    def break_down(self, error):
        self.fault = error
        self.let_go(FAULT)

    def starve(self):
        self.break_down(0x8130)

    def report(self, turns, turns_s, torque_Nm):
        node = self.keys.node_id
        per_mille = round(1e3 * torque_Nm / self.keys.rated_torque_Nm)
        limited = max(-32768, min(32767, per_mille))
        speed = struct.pack("<iH", round(60e3 * turns_s), self.fault)
        position = struct.pack(
            "<Hih", 0x0200 | self.state, round(turns * self.keys.counts_per_turn), limited
        )
        return [self.frame(0x280 + node, speed), self.frame(0x180 + node, position)]

    def reboot(self):
        self.state = DISABLED
        return [self.frame(0x700 + self.keys.node_id, b"\0")]

    def frame(self, identifier, data):
        return can.Message(arbitration_id=identifier, data=data, is_extended_id=False)

    # for the contract

    def stale_set_point(self):
        return [self.frame(0x200 + self.keys.node_id, struct.pack("<Hi", 0x06, 300_000))]

    def fail(self):
        self.break_down(0x4310)
        return r"error 0x4310 \(motor too hot\)"

    def refuse(self):
        self.refuses_with = 0x7320
        return r"refuses with error 0x7320 \(position sensor\)"


TWIN = OurTwin
