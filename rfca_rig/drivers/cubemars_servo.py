"""A CubeMars / T-Motor AK drive in servo mode on a CAN bus as the motor on the shaft."""

from math import isfinite

import can

from rfca_rig.clock import Clock
from rfca_rig.codecs import cubemars_servo
from rfca_rig.codecs.cubemars_meanings import error_text
from rfca_rig.drivers.can_frames import send, send_stop
from rfca_rig.drivers.cubemars_last_word import ServoLastWord
from rfca_rig.drivers.cubemars_servo_reports import ServoReports
from rfca_rig.drivers.cubemars_settings import ServoSettings
from rfca_rig.drivers.guard import LET_GO, Guard, arm, prove_guard
from rfca_rig.drivers.report_period import LOOK_REPORTS, period_fault
from rfca_rig.drivers.roles import MotorStatus, ShaftSamples
from rfca_rig.drivers.standstill import await_standing
from rfca_rig.errors import DeviceError

__all__ = ["CubemarsServoMotor", "ServoSettings"]

POLL_S = 2e-3
GENTLY_RAD_S = 0.3  # at most, while the drive is energised: a position counter that is off shows by motion
GENTLY_RAD_S2 = 10.0
HELD_S = 0.4
MOST_MOVED_RAD = 0.08
LET_GO_S = 0.05


class CubemarsServoMotor:
    """A `ShaftMotor` over any `can.BusABC`. Waits only through the clock, and only in `enable` and `prove_watchdog`.

    The loops are the drive's own, with gains set by CubeMarsTool. It takes orders at any time: there is no enabling frame, and
    a current of zero is what takes the torque away. Positions are absolute and of many turns, while the status frame shows them
    in 16 bits: after more than nine turns in an earlier session what it shows is off by 6553.6 degrees. `enable` finds that out.
    """

    def __init__(self, bus: can.BusABC, clock: Clock, settings: ServoSettings, guard: Guard | None = None) -> None:
        """`guard` holds the bus where there is one; nearly no firmware has a watchdog of its own."""
        self._bus = bus
        self._clock = clock
        self._settings = settings
        self._guard = guard
        self._proof = "none"
        self._last_word = ServoLastWord(settings)
        self._reports = ServoReports(bus, clock, settings)
        self._armed = False

    def enable(self) -> None:
        """Energises, holding the shaft where it stands: first as a position with a low limit of speed, so that nothing can jump.

        Raises DeviceError saying what is missing: any frame, this drive's status at the configured rate; with what error the
        drive refuses; that the shaft does not come to rest before; or that it began to turn, because the drive counts its turns
        otherwise than it shows. The motor is off after that.
        """
        self.disable()
        if self._reports.zero_lost is not None:
            raise DeviceError(f"drive not enabled: {self._reports.zero_lost}, then start anew")
        self._await_status()
        await_standing(self._clock, self._limp_speed_rad_s)
        if self._guard is not None:
            arm(self._guard)
        self._hold_gently(self._reports.position_deg, self._reports.angle_rad)
        self._armed = True

    def _await_status(self) -> None:
        self._reports.drain()
        self._reports.samples()  # what has dammed up while nobody looked has holes, and is handed to nobody
        set_s = self._settings.status_period_s
        seen_s = period_fault(self._watched_period_s, set_s)
        if seen_s is not None:
            raise DeviceError(
                f"drive not enabled: status frames come every {1e3 * seen_s:.2g} ms, the settings say "
                f"{1e3 * set_s:g} ms; set the drive's upload rate or status_period_s"
            )

    def _watched_period_s(self) -> float:
        self._reports.recount()
        started_s, timeout_s = self._clock.now_s(), self._settings.enable_timeout_s
        look_s = LOOK_REPORTS * self._settings.status_period_s
        while self._reports.missing() is not None or self._clock.now_s() - started_s < look_s:
            if self._clock.now_s() - started_s > max(timeout_s, look_s):
                raise DeviceError(f"drive not enabled: within {timeout_s:g} s {self._reports.missing()}")
            self._wait_and_drain()
        return (self._clock.now_s() - started_s) / self._reports.heard

    def _limp_speed_rad_s(self) -> float:
        self._wait_and_drain()
        return self._reports.speed_rad_s

    def _hold_gently(self, position_deg: float, angle_rad: float) -> None:
        erpm = abs(self._settings.erpm_s_per_rad)
        order = cubemars_servo.set_position_speed(self._settings.drive_id, position_deg, GENTLY_RAD_S * erpm, GENTLY_RAD_S2 * erpm)
        until_s = self._clock.now_s() + HELD_S
        while self._clock.now_s() < until_s:
            self._send(order)
            self._wait_and_drain()
            self._refuse_if_moved(angle_rad)
        self._refuse_if_error()
        self._send(cubemars_servo.set_position(self._settings.drive_id, position_deg))

    def _refuse_if_moved(self, began_rad: float) -> None:
        moved_rad = self._reports.angle_rad - began_rad
        if abs(moved_rad) > MOST_MOVED_RAD:
            self.disable()
            raise DeviceError(
                f"drive not enabled: the shaft moved by {moved_rad:.2f} rad when told to stay; the drive counts its turns otherwise "
                "than it shows: switch it off and on near its zero, or set its origin"
            )

    def _refuse_if_error(self) -> None:
        status = self._reports.status
        if status is not None and status.error:
            self.disable()
            raise DeviceError(f"drive not enabled: drive {self._settings.drive_id} refuses with {error_text(status.error)}")

    def command_speed(self, speed_rad_s: float) -> None:
        """Asks for a shaft speed. Raises DeviceError when the frame cannot be sent, or beyond 100 000 ERPM.

        Some firmware lets go near a speed of zero; to hold, command an angle.
        """
        erpm = _finite(speed_rad_s, "speed") * self._settings.erpm_s_per_rad
        self._send(cubemars_servo.set_speed(self._check_armed(), erpm))

    def command_angle(self, angle_rad: float, speed_rad_s: float = 0.0) -> None:
        """Asks for a shaft angle; the drive has no field for the speed of a moving target and falls behind by what its loop leaves.

        Raises DeviceError when the frame cannot be sent, or beyond 100 turns.
        """
        _finite(speed_rad_s, "speed")
        position_deg = self._settings.deg(_finite(angle_rad, "angle"))
        self._send(cubemars_servo.set_position(self._check_armed(), position_deg))

    def _check_armed(self) -> int:
        """Not before `enable`: it alone knows that a position means what the status shows."""
        if not self._armed:
            raise DeviceError("drive is not enabled; nothing was sent to it")
        return self._settings.drive_id

    def disable(self) -> None:
        """Takes the torque away, within 20 ms. Raises DeviceError when the frame cannot be sent; only a guardian may stop it then."""
        self._armed = False
        send_stop(self._bus, self._clock, self._last_word.frames())

    def prove_watchdog(self, limit_s: float) -> float:
        """Says nothing until the drive lets go, of itself or told by its guardian, and returns how long that took.

        The status does not tell it, and not every firmware has a watchdog. What shows it is a load that it held before, the leg's
        weight, and holds no more; or that the status ends, because something cut its supply. The motor is off afterwards. Raises
        DeviceError where it still holds, or held nothing from which it could be told; a guardian is believed without a load that
        the bus took its frames, and `identity` says so.
        """
        self._reports.drain()
        held_Nm, started_s = self._reports.torque_Nm, self._clock.now_s()
        if self._guard is not None:
            return self._prove_guard(self._guard, held_Nm, limit_s)
        holding_s = started_s
        while self._clock.now_s() - started_s <= limit_s:
            self._wait_and_drain()
            if abs(self._reports.torque_Nm) >= LET_GO * abs(held_Nm) and self._reports.silent_s < LET_GO_S:
                holding_s = self._clock.now_s()
            if self._clock.now_s() - holding_s > LET_GO_S and (self._loaded(held_Nm) or self._reports.silent_s > LET_GO_S):
                self.disable()
                return holding_s - started_s + POLL_S
        self.disable()
        raise DeviceError(self._refusal(held_Nm, limit_s))

    def _prove_guard(self, guard: Guard, held_Nm: float, limit_s: float) -> float:
        try:
            proof = prove_guard(guard, held_Nm, self._last_word.least_Nm(), limit_s, answers=False)
        finally:
            self.disable()
        self._proof = proof.seen
        return proof.took_s

    def _loaded(self, held_Nm: float) -> bool:
        return abs(held_Nm) >= self._last_word.least_Nm()

    def _refusal(self, held_Nm: float, limit_s: float) -> str:
        remedy = "let a guardian hold its bus (guardian = true), or put a relay into its supply that opens when this computer falls silent"
        if self._loaded(held_Nm):
            return f"drive has no watchdog that stopped it within {limit_s:g} s of silence; set its CAN timeout if it has one, or {remedy}"
        return (
            f"drive's watchdog not proven: the motor held {abs(held_Nm):.3f} N m, too little to see it let go (at least "
            f"{self._last_word.least_Nm():.3f}); park the leg off the vertical, or {remedy}"
        )

    def read(self) -> ShaftSamples:
        """Samples since the last call. Raises DeviceError on a failing bus or a frame that cannot be read."""
        self._reports.drain()
        return self._reports.samples()

    def status(self) -> MotorStatus:
        """The state is what was ordered: the drive tells only its errors."""
        status = self._reports.status
        temperature_C = None if status is None else float(status.temperature_degC)
        return MotorStatus("servo mode" if self._armed else "off", self._fault(), self._reports.silent_s, temperature_C)

    def _fault(self) -> str | None:
        status, silent_s, limit_s = self._reports.status, self._reports.silent_s, self._settings.status_timeout_s
        if status is not None and status.error:
            return error_text(status.error)
        if self._armed and self._reports.motion_fault is not None:
            return self._reports.motion_fault
        if silent_s > limit_s:
            return f"no status frame for {silent_s:.2f} s, limit {limit_s:g} s; check the drive's power and the CAN wiring"
        return self._reports.health.fault

    def identity(self) -> dict[str, str]:
        """For the recording."""
        settings, status = self._settings, self._reports.status
        return {
            "make": "CubeMars AK, servo mode",
            "bus": str(self._bus.channel_info),
            "drive_id": str(settings.drive_id),
            "gear_ratio": repr(settings.gear_ratio),
            "pole_pairs": str(settings.pole_pairs),
            "torque_constant_Nm_per_A": repr(settings.torque_constant_Nm_per_A),
            "direction": str(settings.direction),
            "zero_deg": repr(settings.zero_deg),
            "status_period_s": repr(settings.status_period_s),
            "temperature_degC": "unknown" if status is None else str(status.temperature_degC),
            "status_frames_lost": str(self._reports.lost_frames),
            "guardian": "none" if self._guard is None else self._guard.describe(),
            "guardian_proof": self._proof,
            **self._reports.health.facts(),
        }

    def _send(self, frame: cubemars_servo.Frame) -> None:
        send(self._bus, _message(frame))

    def _wait_and_drain(self) -> None:
        self._clock.wait_until(self._clock.now_s() + POLL_S)
        self._reports.drain()


def _message(frame: cubemars_servo.Frame) -> can.Message:
    return can.Message(arbitration_id=frame[0], data=frame[1], is_extended_id=True)


def _finite(value: float, name: str) -> float:
    if not isfinite(value):
        raise DeviceError(f"commanded {name} is {value}; nothing was sent to the drive")
    return value
