"""Driver for a CubeMars / T-Motor AK drive in MIT mode on a CAN bus."""

from math import isfinite

import can

from rfca_rig.clock import Clock
from rfca_rig.codecs.cubemars_drives import error_text
from rfca_rig.codecs.cubemars_mit import MitCommand, Special, encode_command, encode_special, nearest_speed
from rfca_rig.drivers.can_frames import send, send_stop
from rfca_rig.drivers.guard import TORQUE_OFF_SHARE, Guard, arm, prove_guard
from rfca_rig.drivers.motors.cubemars import MitSettings, MitTorqueOffFrames, await_standstill
from rfca_rig.drivers.motors.cubemars_mit_replies import MitReplies
from rfca_rig.drivers.roles import MotorStatus, ShaftSamples
from rfca_rig.errors import DeviceError

__all__ = ["CubemarsMitMotor", "MitSettings"]

POLL_S = 2e-3
# Watch time after energising, and the motion in that time from which the scale or sign must be wrong.
WATCH_S = 0.05
MAX_MOTION_RAD = 0.1


class MovingTarget:
    """Outer loop that converts angle errors to speed: demanded speed = commanded speed + gain * (target - angle).

    Under a commanded speed the target moves at that speed, so the lag that a load causes is made up later. Together with a drive
    whose torque is proportional to the speed error, this is a speed loop with an integrator. The target stays within
    `max_lag_rad` of the shaft, where the drive gives its largest torque; this is the anti-windup.
    """

    def __init__(self, gain_per_s: float, most_behind_rad: float, angle_rad: float, now_s: float) -> None:
        self._gain_per_s = gain_per_s
        self._most_behind_rad = most_behind_rad
        self._target_rad = angle_rad
        self._speed_rad_s = 0.0
        self._since_s = now_s

    def speed_to_angle(self, target_rad: float, speed_rad_s: float, angle_rad: float, now_s: float) -> float:
        """Speed in rad/s towards a target that moves at `speed_rad_s`, with the shaft at `angle_rad` now."""
        self._target_rad, self._speed_rad_s, self._since_s = target_rad, speed_rad_s, now_s
        return speed_rad_s + self._gain_per_s * (target_rad - angle_rad)

    def speed_for(self, speed_rad_s: float, angle_rad: float, now_s: float) -> float:
        """Speed in rad/s that makes the shaft keep up with a commanded speed, with the shaft at `angle_rad` now."""
        moved_rad = self._target_rad + self._speed_rad_s * (now_s - self._since_s)
        # Anti-windup: beyond this error the torque is saturated, and a larger one would only cause overshoot later.
        nearest_rad = min(max(moved_rad, angle_rad - self._most_behind_rad), angle_rad + self._most_behind_rad)
        return self.speed_to_angle(nearest_rad, speed_rad_s, angle_rad, now_s)


class CubemarsMitMotor:
    """A `ShaftMotor` over any `can.BusABC`. Waits only through the clock, and only in `enable` and `prove_watchdog`.

    The drive's position field is not used (kp = 0). It covers only +-12.5 rad while the shaft turns further, and firmware differs
    in how it treats a target beyond. With kp = 0 a position wrong by a turn cannot become a torque. The drive controls speed (kd);
    the driver computes that speed from the angle error at each call. The rounding error of the speed field goes into the torque
    field. The drive sends nothing unasked and does not report whether it is in MIT mode: missing torque shows as a shaft that does
    not follow.
    """

    def __init__(self, bus: can.BusABC, clock: Clock, settings: MitSettings, guard: Guard | None = None) -> None:
        """`guard` is the guardian that holds the bus, if any; hardly any firmware has a watchdog of its own."""
        self._bus = bus
        self._clock = clock
        self._settings = settings
        self._guard = guard
        self._proof = "none"
        self._last_word = MitTorqueOffFrames(settings)
        self._replies = MitReplies(bus, clock, settings)
        self._target: MovingTarget | None = None

    def enable(self) -> None:
        """Energises the motor and holds the shaft. A command with zero gains first overwrites the one that the drive remembers.

        Raises DeviceError, and leaves the motor off, if

        - no frame or no reply of this drive arrives, or it is not in MIT mode;
        - the drive refuses with an error;
        - the shaft does not come to rest before, or moves afterwards.
        """
        self.disable()
        if self._replies.zero_lost is not None:
            raise DeviceError(f"drive not enabled: {self._replies.zero_lost}, then start again")
        self._await_replies()
        await_standstill(self._clock, self._limp_speed_rad_s)
        self._target = MovingTarget(
            self._settings.angle_gain_per_s, self._settings.max_lag_rad, self._replies.angle_rad, self._clock.now_s()
        )
        began_rad, until_s = self._replies.angle_rad, self._clock.now_s() + WATCH_S
        # The guardian is armed before the frame that energises, so that no gap is left unguarded.
        if self._guard is not None:
            arm(self._guard)
        # ENTER puts the last command into force; the commands without gains sent before make it harmless.
        self._send(encode_special(Special.ENTER))
        while self._clock.now_s() < until_s:
            self._command_angle(began_rad, 0.0)
            self._wait_and_drain()
            self._refuse_if_moved(began_rad)
        self._refuse_if_error()

    def _await_replies(self) -> None:
        self._replies.drain()
        # Replies from before a pause could be assigned to requests made now, so they are discarded.
        self._replies.samples()
        self._replies.reset_counters()
        deadline_s = self._clock.now_s() + self._settings.enable_timeout_s
        while self._replies.missing() is not None:
            if self._clock.now_s() > deadline_s:
                raise DeviceError(f"drive not enabled: within {self._settings.enable_timeout_s:g} s {self._replies.missing()}")
            self._ask_limp()

    def _ask_limp(self) -> None:
        self._send(self._last_word.zero_gain_command().data)
        self._wait_and_drain()

    def _limp_speed_rad_s(self) -> float:
        self._ask_limp()
        return self._replies.speed_rad_s

    def _refuse_if_moved(self, began_rad: float) -> None:
        moved_rad = self._replies.angle_rad - began_rad
        if abs(moved_rad) > MAX_MOTION_RAD:
            self.disable()
            raise DeviceError(f"drive not enabled: the shaft moved by {moved_rad:.2f} rad when energised; check direction and model")

    def _refuse_if_error(self) -> None:
        reply = self._replies.reply
        if reply is not None and reply.error:
            self.disable()
            raise DeviceError(f"drive not enabled: drive {self._settings.drive_id} refuses with {error_text(reply.error)}")

    def command_speed(self, speed_rad_s: float) -> None:
        """Commands a shaft speed. Raises DeviceError if the frame cannot be sent, or beyond the drive's speed range."""
        target, now_s = self._require_enabled(_finite(speed_rad_s, "speed")), self._clock.now_s()
        self._send_speed(target.speed_for(speed_rad_s, self._replies.angle_at(now_s), now_s))

    def command_angle(self, angle_rad: float, speed_rad_s: float = 0.0) -> None:
        """Commands a shaft angle. Raises DeviceError if the frame cannot be sent, or beyond the drive's speed range."""
        self._command_angle(_finite(angle_rad, "angle"), _finite(speed_rad_s, "speed"))

    def _command_angle(self, angle_rad: float, speed_rad_s: float) -> None:
        target, now_s = self._require_enabled(speed_rad_s), self._clock.now_s()
        self._send_speed(target.speed_to_angle(angle_rad, speed_rad_s, self._replies.angle_at(now_s), now_s))

    def _require_enabled(self, speed_rad_s: float) -> MovingTarget:
        limit_rad_s = self._settings.ranges.speed_rad_s
        if self._target is None:
            raise DeviceError("drive is not enabled; nothing was sent to it")
        if abs(speed_rad_s) > limit_rad_s:
            raise DeviceError(f"commanded speed {speed_rad_s:g} rad/s, limit {limit_rad_s:g} ({self._settings.model}); nothing was sent")
        self._replies.drain()
        return self._target

    def _send_speed(self, speed_rad_s: float) -> None:
        ranges, gain, direction = self._settings.ranges, self._settings.speed_gain_Nm_s_per_rad, self._settings.direction
        clipped_rad_s = direction * min(max(speed_rad_s, -ranges.speed_rad_s), ranges.speed_rad_s)
        encoded_rad_s = nearest_speed(ranges, clipped_rad_s)
        # The 12 bit speed field is coarse; kd times its rounding error as feed-forward torque makes up for it.
        compensation_Nm = gain * (clipped_rad_s - encoded_rad_s)
        self._send(encode_command(ranges, MitCommand(0.0, encoded_rad_s, 0.0, gain, compensation_Nm)))

    def disable(self) -> None:
        """Disables the motor within 20 ms. Raises DeviceError if a frame cannot be sent; then only a guardian can stop it."""
        self._target = None
        try:
            # The drive answers both torque-off frames, so two requests are noted afterwards.
            send_stop(self._bus, self._clock, self._last_word.frames())
        finally:
            self._replies.note_query()
            self._replies.note_query()

    def prove_watchdog(self, limit_s: float) -> float:
        """Sends nothing for `limit_s`, then asks once; returns the time in s, within which the motor was disabled.

        With a guardian, it sends nothing until the guardian has acted and the drive has answered it. It then returns the time until
        the reports showed no torque; `identity` records the evidence.

        A drive in MIT mode does not report its state, and not every firmware has a watchdog. The evidence is a load, the leg's
        weight, that the motor held before and no longer holds. A drive that does not answer, because its supply was cut, is evidence
        too. The motor is off afterwards. Raises DeviceError if it still holds, or held too little to decide.
        """
        self._replies.drain()
        held_Nm = self._replies.torque_Nm
        if self._guard is not None:
            return self._prove_guard(self._guard, held_Nm, limit_s)
        started_s = self._clock.now_s()
        self._clock.wait_until(started_s + limit_s)
        has_answered = self._ask_once()
        elapsed_s = self._clock.now_s() - started_s
        is_off = not has_answered or abs(self._replies.torque_Nm) < TORQUE_OFF_SHARE * abs(held_Nm)
        self.disable()
        if has_answered:
            self._refuse_proof(held_Nm, is_off, limit_s)
        return elapsed_s

    def _prove_guard(self, guard: Guard, held_Nm: float, limit_s: float) -> float:
        try:
            proof = prove_guard(guard, held_Nm, self._last_word.min_visible_torque_Nm(), limit_s, answers=True)
        finally:
            self.disable()
        self._proof = proof.seen
        return proof.took_s

    def _ask_once(self) -> bool:
        """Requests one reply by ENTER, which changes neither set-points nor the watchdog count; returns whether it came."""
        self._replies.drain()
        self._replies.reset_counters()
        self._send(encode_special(Special.ENTER))
        # Ten polls of 2 ms: an answer comes at once, plus the delays of adapter and bus.
        for _ in range(10):
            self._wait_and_drain()
        return self._replies.heard > 0

    def _refuse_proof(self, held_Nm: float, is_off: bool, limit_s: float) -> None:
        least_Nm = self._last_word.min_visible_torque_Nm()
        remedy = "let a guardian hold its bus (guardian = true), or put a relay into its supply that opens when this computer falls silent"
        if abs(held_Nm) < least_Nm:
            raise DeviceError(
                f"drive's watchdog not proven: the motor held {abs(held_Nm):.3f} N m, too little to see it let go (at least "
                f"{least_Nm:.3f}); park the leg off the vertical, or {remedy}"
            )
        if not is_off:
            raise DeviceError(
                f"drive has no watchdog that stopped it within {limit_s:g} s of silence, as many AK drives in MIT mode; {remedy}"
            )

    def read(self) -> ShaftSamples:
        """Samples (m,) since the last call. Raises DeviceError if the bus fails or a frame cannot be decoded."""
        self._replies.drain()
        return self._replies.samples()

    def status(self) -> MotorStatus:
        """State of the drive. The state text is what was commanded: the drive reports errors only."""
        state = "off" if self._target is None else "MIT mode"
        reply = self._replies.reply
        temperature_C = None if reply is None or reply.temperature_degC is None else float(reply.temperature_degC)
        return MotorStatus(state, self._fault(), self._replies.silent_s, temperature_C)

    def _fault(self) -> str | None:
        reply, silent_s, limit_s = self._replies.reply, self._replies.silent_s, self._settings.reply_timeout_s
        if reply is not None and reply.error:
            return error_text(reply.error)
        # Motion faults count only while enabled: before, the drive is asked rarely and the shaft may be moved by hand.
        if self._target is not None and (fault := self._replies.form_fault or self._replies.motion_fault) is not None:
            return fault
        if silent_s > limit_s:
            return f"no reply for {silent_s:.2f} s, limit {limit_s:g} s; check the drive's power and the CAN wiring"
        return self._replies.health.fault

    def identity(self) -> dict[str, str]:
        """For the recording. Whether the firmware sends errors is known after `enable`."""
        settings, reply = self._settings, self._replies.reply
        return {
            "make": "CubeMars AK, MIT mode",
            "bus": str(self._bus.channel_info),
            "drive_id": str(settings.drive_id),
            "model": settings.model,
            "direction": str(settings.direction),
            "zero_rad": repr(settings.zero_rad),
            "speed_gain_Nm_s_per_rad": repr(settings.speed_gain_Nm_s_per_rad),
            "angle_gain_per_s": repr(settings.angle_gain_per_s),
            "errors_told": "unknown" if reply is None else "no" if reply.error is None else "yes",
            "temperature_degC": "unknown" if reply is None or reply.temperature_degC is None else str(reply.temperature_degC),
            "replies_lost": str(self._replies.lost),
            "guardian": "none" if self._guard is None else self._guard.describe(),
            "guardian_proof": self._proof,
            **self._replies.health.facts(),
        }

    def _send(self, data: bytes | bytearray) -> None:
        send(self._bus, self._message(data))
        self._replies.note_query()

    def _message(self, data: bytes | bytearray) -> can.Message:
        return can.Message(arbitration_id=self._settings.drive_id, data=data, is_extended_id=False)

    def _wait_and_drain(self) -> None:
        self._clock.wait_until(self._clock.now_s() + POLL_S)
        self._replies.drain()


def _finite(value: float, name: str) -> float:
    if not isfinite(value):
        raise DeviceError(f"commanded {name} is {value}; nothing was sent to the drive")
    return value
