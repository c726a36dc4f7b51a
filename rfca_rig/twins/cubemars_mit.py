"""Twin of a CubeMars / T-Motor AK drive in MIT mode, on the CAN bus."""

from dataclasses import dataclass, field, replace
from math import remainder, tau

import can

from rfca_rig.codecs import cubemars_mit
from rfca_rig.codecs.cubemars_drives import mit_ranges
from rfca_rig.codecs.cubemars_mit import POSITION_CODES, MitCommand, MitReply, Special
from rfca_rig.errors import MalformedFrame
from rfca_rig.twins.drive_parts import Encoder, MotorThermalModel, ThermalParameters
from rfca_rig.twins.world import ShaftDrive, ShaftState

ZERO_COMMAND = MitCommand(0.0, 0.0, 0.0, 0.0, 0.0)
# Time in s for which the drive does not answer after it has set its zero.
ZEROING_S = 1.0
# One rotor turn at the shaft: the encoder sits before the gear.
ROTOR_TURN_RAD = tau / 9.0


@dataclass(frozen=True)
class MitTwinSettings:
    """Configuration of the drive, and variant of its firmware.

    With `watchdog_s` None the drive keeps its last command for ever. Otherwise the command is zeroed after that silence and the drive
    stays in MIT mode, as in Ben Katz's firmware (25 ms). `reply_id` None replies under the drive's own id. `wraps`: the position
    field wraps at its ends, else it stops there. `tells_errors`: replies carry temperature and error. `entering_error` is the error
    that every attempt to enter MIT mode ends in; 0 for a healthy drive.
    """

    drive_id: int = 1
    model: str = "AK80-9"
    direction: int = 1
    zero_rad: float = 0.0
    torque_limit_Nm: float | None = None
    watchdog_s: float | None = None
    reply_id: int | None = 0
    wraps: bool = True
    tells_errors: bool = True
    entering_error: int = 0
    warming: ThermalParameters = field(default_factory=lambda: ThermalParameters(air_degC=31.0))


class CubemarsMitTwin:
    """A `MotorTwin` that answers each frame with the state of the shaft at that time.

    The drive keeps its last command across EXIT and ENTER; a driver that relies on the contrary causes a jerk.
    """

    def __init__(self, bus: can.BusABC, settings: MitTwinSettings) -> None:
        self._bus = bus
        self._settings = settings
        self._ranges = mit_ranges(settings.model)
        self._command = ZERO_COMMAND
        self._entered = False
        self._error = 0
        self._zero_rad = settings.zero_rad
        self._zero_wanted = False
        self._mute_until_s = 0.0
        self._fed_s = 0.0
        self._unanswered = 0
        self._restarts = False
        self.encoder = Encoder()
        self.warmth = MotorThermalModel(settings.warming)

    def take_frames(self, now_s: float) -> None:
        """Executes received frames; invalid ones are ignored. Commands feed the watchdog, special frames do not."""
        while (message := self._bus.recv(timeout=0)) is not None:
            mine = message.arbitration_id == self._settings.drive_id and not message.is_extended_id
            if mine and not message.is_error_frame and not message.is_remote_frame and now_s >= self._mute_until_s:
                self._take(message.data, now_s)
        limit_s = self._settings.watchdog_s
        # Only the command is zeroed; the drive stays in MIT mode.
        if limit_s is not None and now_s - self._fed_s > limit_s:
            self._command = ZERO_COMMAND

    def _take(self, data: bytearray, now_s: float) -> None:
        try:
            order = cubemars_mit.decode_command(self._ranges, data)
        except MalformedFrame:
            return
        self._unanswered += 1
        if isinstance(order, MitCommand):
            self._command, self._fed_s = order, now_s
        elif order is Special.ZERO:
            self._zero_wanted, self._mute_until_s = True, now_s + ZEROING_S
        else:
            entered = order is Special.ENTER
            if entered and self._settings.entering_error:
                self.fail(self._settings.entering_error)
            elif entered != self._entered:
                self._entered, self._error = entered, 0

    def fail(self, error: int) -> None:
        """Puts the drive into an error: no torque until it enters MIT mode again."""
        self._error, self._entered = error, False

    def restart(self) -> None:
        """Power cycle: the drive is out of MIT mode and has lost its rotor turn count."""
        self._command, self._entered, self._error, self._restarts = ZERO_COMMAND, False, 0, True

    def leap(self, by_rad: float) -> None:
        """Encoder slip: from now on the reported position is shifted by `by_rad`."""
        self._zero_rad += by_rad

    def refuse_with(self, error: int) -> None:
        """From now on every attempt to enter MIT mode ends in this error."""
        self._settings = replace(self._settings, entering_error=error)

    def drive(self, shaft: ShaftState) -> ShaftDrive:
        """Sends the pending answers; returns the torque law until the next step, limited at the present state."""
        if self._restarts:
            self._restarts, reported_rad = False, self._settings.direction * shaft.angle_rad + self._zero_rad
            # A single-turn encoder knows its position within a rotor turn only: whole turns are lost.
            self._zero_rad += remainder(reported_rad, ROTOR_TURN_RAD) - reported_rad
        for _ in range(self._unanswered):
            self._reply(shaft)
        self._unanswered = 0
        if self._zero_wanted:
            self._zero_wanted, self._zero_rad = False, -self._settings.direction * shaft.angle_rad
        if not self._entered:
            return ShaftDrive()
        free = self._law()
        torque_Nm, limit_Nm = abs(free.torque_Nm(shaft.angle_rad, shaft.speed_rad_s)), self._limit_Nm
        # Beyond the limit the whole law is scaled down for one step, as in `SpeedLoop`.
        return free if torque_Nm <= limit_Nm else _scale(free, limit_Nm / torque_Nm)

    def _law(self) -> ShaftDrive:
        command, direction = self._command, self._settings.direction
        return ShaftDrive(
            feed_Nm=direction * command.torque_Nm,
            angle_gain_Nm_per_rad=command.kp_Nm_per_rad,
            angle_rad=direction * (command.position_rad - self._zero_rad),
            speed_gain_Nm_s_per_rad=command.kd_Nm_s_per_rad,
            speed_rad_s=direction * command.speed_rad_s,
        )

    @property
    def _limit_Nm(self) -> float:
        given_Nm = self._settings.torque_limit_Nm
        return self._ranges.torque_Nm if given_Nm is None else min(given_Nm, self._ranges.torque_Nm)

    def advance(self, elapsed_s: float, now_s: float, before: ShaftState, after: ShaftState, law: ShaftDrive) -> None:  # noqa: ARG002
        """Advances the motor temperature. Nothing else becomes due, as the drive replies only when asked."""
        self.warmth.advance(elapsed_s, after.torque_Nm)

    def _reply(self, shaft: ShaftState) -> None:
        settings, has_errors = self._settings, self._settings.tells_errors
        angle_rad, speed_rad_s = self.encoder.report(settings.direction * shaft.angle_rad + self._zero_rad, shaft.speed_rad_s)
        code = cubemars_mit.position_code(self._ranges, angle_rad)
        reply = MitReply(
            drive_id=settings.drive_id,
            # Firmware differs here: the position code wraps, or is limited to its range.
            position_code=code % POSITION_CODES if settings.wraps else min(max(code, 0), POSITION_CODES - 1),
            position_rad=0.0,
            speed_rad_s=settings.direction * speed_rad_s,
            torque_Nm=settings.direction * shaft.torque_Nm,
            temperature_degC=min(round(self.warmth.reported_degC), 255 - self._ranges.temperature_offset_degC) if has_errors else None,
            error=self._error if has_errors else None,
        )
        identifier = settings.drive_id if settings.reply_id is None else settings.reply_id
        data = cubemars_mit.encode_reply(self._ranges, reply)
        self._bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))


def _scale(law: ShaftDrive, factor: float) -> ShaftDrive:
    return law._replace(
        feed_Nm=factor * law.feed_Nm,
        angle_gain_Nm_per_rad=factor * law.angle_gain_Nm_per_rad,
        speed_gain_Nm_s_per_rad=factor * law.speed_gain_Nm_s_per_rad,
    )
