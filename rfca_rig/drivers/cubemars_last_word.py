"""Torque-off frames of CubeMars AK drives, and the torque that their reports show afterwards."""

from dataclasses import dataclass

import can

from rfca_rig.codecs import cubemars_servo
from rfca_rig.codecs.cubemars_mit import MitCommand, Special, decode_reply, encode_command, encode_special
from rfca_rig.codecs.cubemars_servo import STATUS_A, Status
from rfca_rig.codecs.malformed import MalformedFrame
from rfca_rig.drivers.cubemars_settings import MitSettings, ServoSettings

# In steps of the reported torque or current: below ten steps a torque is not distinguished from zero.
MIN_LOAD_COUNTS = 10


@dataclass(frozen=True)
class MitTorqueOffFrames:
    """Torque off in MIT mode: a command with zero gains, as the drive remembers the last one, then EXIT. The drive answers both."""

    settings: MitSettings

    def zero_gain_command(self) -> can.Message:
        """Command with zero gains. Zero torque has no code; the nearest one is under 0.001 of the range, and acts only while enabled."""
        return self._to_drive(encode_command(self.settings.ranges, MitCommand(0.0, 0.0, 0.0, 0.0, 0.0)))

    def frames(self) -> tuple[can.Message, ...]:
        return self.zero_gain_command(), self._to_drive(encode_special(Special.EXIT))

    def _to_drive(self, data: bytes) -> can.Message:
        return can.Message(arbitration_id=self.settings.drive_id, data=data, is_extended_id=False)

    def torque_Nm(self, message: can.Message) -> float | None:
        drive = self.settings.drive_id
        # Replies come under id 0 or the drive's own, depending on firmware; the first byte names the drive.
        if message.is_extended_id or message.arbitration_id not in {0, drive} or not message.data or message.data[0] != drive:
            return None
        try:
            return decode_reply(self.settings.ranges, message.data).torque_Nm
        except MalformedFrame:
            return None

    def min_visible_torque_Nm(self) -> float:
        # The torque field has 12 bits over the range -torque_Nm..torque_Nm: 4095 steps.
        return MIN_LOAD_COUNTS * 2.0 * self.settings.ranges.torque_Nm / 4095


@dataclass(frozen=True)
class ServoTorqueOffFrames:
    """Torque off in servo mode: a current of zero. The drive reports its current cyclically."""

    settings: ServoSettings

    def frames(self) -> tuple[can.Message, ...]:
        identifier, data = cubemars_servo.set_current(self.settings.drive_id, 0.0)
        return (can.Message(arbitration_id=identifier, data=data, is_extended_id=True),)

    def torque_Nm(self, message: can.Message) -> float | None:
        if not message.is_extended_id or cubemars_servo.drive_of(message.arbitration_id) != self.settings.drive_id:
            return None
        try:
            report = cubemars_servo.decode(message.arbitration_id, message.data)
        except MalformedFrame:
            return None
        return report.current_A * self.settings.shaft_torque_per_A if isinstance(report, Status) else None

    def min_visible_torque_Nm(self) -> float:
        return MIN_LOAD_COUNTS * STATUS_A * abs(self.settings.shaft_torque_per_A)
