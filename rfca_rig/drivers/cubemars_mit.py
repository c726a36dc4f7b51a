"""A CubeMars / T-Motor AK drive in MIT mode on a CAN bus as the motor on the shaft."""

from math import isfinite

import can

from rfca_rig.clock import Clock
from rfca_rig.codecs.cubemars_meanings import error_text
from rfca_rig.codecs.cubemars_mit import MitCommand, Special, encode_command, encode_special, nearest_speed
from rfca_rig.drivers.can_frames import send, send_stop
from rfca_rig.drivers.cubemars_last_word import MitLastWord
from rfca_rig.drivers.cubemars_mit_replies import MitReplies
from rfca_rig.drivers.cubemars_settings import MitSettings
from rfca_rig.drivers.guard import LET_GO, Guard, arm, prove_guard
from rfca_rig.drivers.roles import MotorStatus, ShaftSamples
from rfca_rig.drivers.standstill import await_standing
from rfca_rig.errors import DeviceError

__all__ = ["CubemarsMitMotor", "MitSettings"]

POLL_S = 2e-3
HELD_S = 0.05  # how long the drive is watched after it was energised
MOST_MOVED_RAD = 0.1


class MovingTarget:
    """Turns angle errors into speed: demanded speed = commanded speed + gain * (target - angle).

    Under a commanded speed the target moves along with it, so what a load holds the shaft back is made up for: together with a
    drive that gives torque in proportion to speed error this is a speed loop with an integrator. The target never gets further
    from the shaft than `most_behind_rad`, where the drive gives all it has: nothing winds up.
    """

    def __init__(self, gain_per_s: float, most_behind_rad: float, angle_rad: float, now_s: float) -> None:
        self._gain_per_s = gain_per_s
        self._most_behind_rad = most_behind_rad
        self._target_rad = angle_rad
        self._speed_rad_s = 0.0
        self._since_s = now_s

    def speed_to_angle(self, target_rad: float, speed_rad_s: float, angle_rad: float, now_s: float) -> float:
        """The speed that leads to an angle moving at `speed_rad_s`, with the shaft at `angle_rad` now."""
        self._target_rad, self._speed_rad_s, self._since_s = target_rad, speed_rad_s, now_s
        return speed_rad_s + self._gain_per_s * (target_rad - angle_rad)

    def speed_for(self, speed_rad_s: float, angle_rad: float, now_s: float) -> float:
        """The speed that keeps up with a commanded speed, with the shaft at `angle_rad` now."""
        moved_rad = self._target_rad + self._speed_rad_s * (now_s - self._since_s)
        nearest_rad = min(max(moved_rad, angle_rad - self._most_behind_rad), angle_rad + self._most_behind_rad)
        return self.speed_to_angle(nearest_rad, speed_rad_s, angle_rad, now_s)


class CubemarsMitMotor:
    """A `ShaftMotor` over any `can.BusABC`. Waits only through the clock, and only in `enable` and `prove_watchdog`.

    The drive's position field is not used (kp = 0): it reaches 12.5 rad either way, the shaft turns on, and firmware differs in
    what it makes of a target beyond; no position that is wrong by a turn can so become a torque. The drive damps towards a speed
    (kd), the driver makes that speed out of the angle error, at the rate at which it is called. What the speed field rounds away
    goes into the torque field. The drive says nothing unasked, and not whether it is in MIT mode: a missing torque shows as a
    shaft that does not follow.
    """

    def __init__(self, bus: can.BusABC, clock: Clock, settings: MitSettings, guard: Guard | None = None) -> None:
        """`guard` holds the bus where there is one; nearly no firmware has a watchdog of its own."""
        self._bus = bus
        self._clock = clock
        self._settings = settings
        self._guard = guard
        self._proof = "none"
        self._last_word = MitLastWord(settings)
        self._replies = MitReplies(bus, clock, settings)
        self._target: MovingTarget | None = None

    def enable(self) -> None:
        """Energises, holding the shaft where it stands: a command without gains overwrites what the drive remembers before.

        Raises DeviceError saying what is missing: any frame, this drive's replies, MIT mode; with what error the drive refuses;
        or that the shaft does not come to rest before, or moved. The motor is off after a refusal.
        """
        self.disable()
        if self._replies.zero_lost is not None:
            raise DeviceError(f"drive not enabled: {self._replies.zero_lost}, then start anew")
        self._await_replies()
        await_standing(self._clock, self._limp_speed_rad_s)
        self._target = self._target_at(self._replies.angle_rad)
        began_rad, until_s = self._replies.angle_rad, self._clock.now_s() + HELD_S
        self._arm()
        self._send(encode_special(Special.ENTER))
        while self._clock.now_s() < until_s:
            self._command_angle(began_rad, 0.0)
            self._wait_and_drain()
            self._refuse_if_moved(began_rad)
        self._refuse_if_error()

    def _arm(self) -> None:
        if self._guard is not None:
            arm(self._guard)

    def _target_at(self, angle_rad: float) -> MovingTarget:
        return MovingTarget(self._settings.angle_gain_per_s, self._settings.most_behind_rad, angle_rad, self._clock.now_s())

    def _await_replies(self) -> None:
        self._replies.drain()
        self._replies.samples()  # answers to what was asked before a pause, taken for answers to what was asked now
        self._replies.recount()
        deadline_s = self._clock.now_s() + self._settings.enable_timeout_s
        while self._replies.missing() is not None:
            if self._clock.now_s() > deadline_s:
                raise DeviceError(f"drive not enabled: within {self._settings.enable_timeout_s:g} s {self._replies.missing()}")
            self._ask_limp()

    def _ask_limp(self) -> None:
        self._send(self._last_word.limp().data)
        self._wait_and_drain()

    def _limp_speed_rad_s(self) -> float:
        self._ask_limp()
        return self._replies.speed_rad_s

    def _refuse_if_moved(self, began_rad: float) -> None:
        moved_rad = self._replies.angle_rad - began_rad
        if abs(moved_rad) > MOST_MOVED_RAD:
            self.disable()
            raise DeviceError(f"drive not enabled: the shaft moved by {moved_rad:.2f} rad when energised; check direction and model")

    def _refuse_if_error(self) -> None:
        reply = self._replies.reply
        if reply is not None and reply.error:
            self.disable()
            raise DeviceError(f"drive not enabled: drive {self._settings.drive_id} refuses with {error_text(reply.error)}")

    def command_speed(self, speed_rad_s: float) -> None:
        """Asks for a shaft speed. Raises DeviceError when the frame cannot be sent, or beyond the drive's range of speeds."""
        target, now_s = self._enabled(_finite(speed_rad_s, "speed")), self._clock.now_s()
        self._send_speed(target.speed_for(speed_rad_s, self._replies.angle_at(now_s), now_s))

    def command_angle(self, angle_rad: float, speed_rad_s: float = 0.0) -> None:
        """Asks for a shaft angle. Raises DeviceError when the frame cannot be sent, or beyond the drive's range of speeds."""
        self._command_angle(_finite(angle_rad, "angle"), _finite(speed_rad_s, "speed"))

    def _command_angle(self, angle_rad: float, speed_rad_s: float) -> None:
        target, now_s = self._enabled(speed_rad_s), self._clock.now_s()
        self._send_speed(target.speed_to_angle(angle_rad, speed_rad_s, self._replies.angle_at(now_s), now_s))

    def _enabled(self, speed_rad_s: float) -> MovingTarget:
        limit_rad_s = self._settings.ranges.speed_rad_s
        if self._target is None:
            raise DeviceError("drive is not enabled; nothing was sent to it")
        if abs(speed_rad_s) > limit_rad_s:
            raise DeviceError(f"commanded speed {speed_rad_s:g} rad/s, limit {limit_rad_s:g} ({self._settings.model}); nothing was sent")
        self._replies.drain()
        return self._target

    def _send_speed(self, speed_rad_s: float) -> None:
        ranges, gain, direction = self._settings.ranges, self._settings.speed_gain_Nm_s_per_rad, self._settings.direction
        wanted_rad_s = direction * min(max(speed_rad_s, -ranges.speed_rad_s), ranges.speed_rad_s)
        carried_rad_s = nearest_speed(ranges, wanted_rad_s)
        rounded_away_Nm = gain * (wanted_rad_s - carried_rad_s)
        self._send(encode_command(ranges, MitCommand(0.0, carried_rad_s, 0.0, gain, rounded_away_Nm)))

    def disable(self) -> None:
        """Takes the torque away, within 20 ms. Raises DeviceError when a frame cannot be sent; only a guardian may stop it then."""
        self._target = None
        try:
            send_stop(self._bus, self._clock, self._last_word.frames())
        finally:
            self._replies.asked()
            self._replies.asked()

    def prove_watchdog(self, limit_s: float) -> float:
        """Says nothing for `limit_s`, then asks once, and returns the time that passed: the drive let go within it.

        With a guardian, it says nothing until that let go and the drive answered it, and returns the time until it was seen without
        torque; `identity` says what that rests on.

        A drive in MIT mode does not tell what state it is in, and not every firmware has a watchdog. What shows it is a load that
        it held before, the leg's weight, and holds no more; or that it does not answer, because something cut its supply. The
        motor is off afterwards. Raises DeviceError where it still holds, or held nothing from which it could be told.
        """
        self._replies.drain()
        held_Nm = self._replies.torque_Nm
        if self._guard is not None:
            return self._prove_guard(self._guard, held_Nm, limit_s)
        started_s = self._clock.now_s()
        self._clock.wait_until(started_s + limit_s)
        still_there = self._asked_once()
        elapsed_s = self._clock.now_s() - started_s
        let_go = not still_there or abs(self._replies.torque_Nm) < LET_GO * abs(held_Nm)
        self.disable()
        if still_there:
            self._refuse_proof(held_Nm, let_go, limit_s)
        return elapsed_s

    def _prove_guard(self, guard: Guard, held_Nm: float, limit_s: float) -> float:
        try:
            proof = prove_guard(guard, held_Nm, self._last_word.least_Nm(), limit_s, answers=True)
        finally:
            self.disable()
        self._proof = proof.seen
        return proof.took_s

    def _asked_once(self) -> bool:
        """ENTER changes neither set-points nor, in firmware that has a watchdog, its count; but it is answered."""
        self._replies.drain()
        self._replies.recount()
        self._send(encode_special(Special.ENTER))
        for _ in range(10):
            self._wait_and_drain()
        return self._replies.heard > 0

    def _refuse_proof(self, held_Nm: float, let_go: bool, limit_s: float) -> None:
        least_Nm = self._last_word.least_Nm()
        remedy = "let a guardian hold its bus (guardian = true), or put a relay into its supply that opens when this computer falls silent"
        if abs(held_Nm) < least_Nm:
            raise DeviceError(
                f"drive's watchdog not proven: the motor held {abs(held_Nm):.3f} N m, too little to see it let go (at least "
                f"{least_Nm:.3f}); park the leg off the vertical, or {remedy}"
            )
        if not let_go:
            raise DeviceError(
                f"drive has no watchdog that stopped it within {limit_s:g} s of silence, as many AK drives in MIT mode; {remedy}"
            )

    def read(self) -> ShaftSamples:
        """Samples since the last call. Raises DeviceError on a failing bus or a frame that cannot be read."""
        self._replies.drain()
        return self._replies.samples()

    def status(self) -> MotorStatus:
        """The state is what was ordered: the drive tells only its errors."""
        state = "off" if self._target is None else "MIT mode"
        reply = self._replies.reply
        temperature_C = None if reply is None or reply.temperature_degC is None else float(reply.temperature_degC)
        return MotorStatus(state, self._fault(), self._replies.silent_s, temperature_C)

    def _fault(self) -> str | None:
        reply, silent_s, limit_s = self._replies.reply, self._replies.silent_s, self._settings.reply_timeout_s
        if reply is not None and reply.error:
            return error_text(reply.error)
        if self._target is not None and (fault := self._replies.form_fault or self._replies.motion_fault) is not None:
            return fault
        if silent_s > limit_s:
            return f"no reply for {silent_s:.2f} s, limit {limit_s:g} s; check the drive's power and the CAN wiring"
        return self._replies.health.fault

    def identity(self) -> dict[str, str]:
        """For the recording; whether the firmware sends errors is known after `enable`."""
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
        self._replies.asked()

    def _message(self, data: bytes | bytearray) -> can.Message:
        return can.Message(arbitration_id=self._settings.drive_id, data=data, is_extended_id=False)

    def _wait_and_drain(self) -> None:
        self._clock.wait_until(self._clock.now_s() + POLL_S)
        self._replies.drain()


def _finite(value: float, name: str) -> float:
    if not isfinite(value):
        raise DeviceError(f"commanded {name} is {value}; nothing was sent to the drive")
    return value
