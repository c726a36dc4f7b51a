"""Driver for a CubeMars / T-Motor AK drive in servo mode on a CAN bus."""

from math import isfinite

import can

from rfca_rig.clock import Clock
from rfca_rig.codecs import cubemars_servo
from rfca_rig.codecs.cubemars_meanings import error_text
from rfca_rig.drivers.can_frames import send, send_stop
from rfca_rig.drivers.cubemars_last_word import ServoTorqueOffFrames
from rfca_rig.drivers.cubemars_servo_reports import ServoReports
from rfca_rig.drivers.cubemars_settings import ServoSettings
from rfca_rig.drivers.guard import TORQUE_OFF_SHARE, Guard, arm, prove_guard
from rfca_rig.drivers.report_period import PERIODS_PER_ATTEMPT, find_wrong_period
from rfca_rig.drivers.roles import MotorStatus, ShaftSamples
from rfca_rig.drivers.standstill import await_standstill
from rfca_rig.errors import DeviceError

__all__ = ["CubemarsServoMotor", "ServoSettings"]

# Poll interval in s while waiting.
POLL_S = 2e-3
# Speed and acceleration limits while the drive is energised. A wrong turn counter then shows as slow motion.
HOLD_SPEED_RAD_S = 0.3
HOLD_ACCELERATION_RAD_S2 = 10.0
# Watch time and allowed motion: 0.3 rad/s over 0.4 s is 0.12 rad, more than the limit of 0.08 rad.
WATCH_S = 0.4
MAX_MOTION_RAD = 0.08
# Time for which torque or status must be gone before the motor counts as off.
TORQUE_OFF_S = 0.05


class CubemarsServoMotor:
    """A `ShaftMotor` over any `can.BusABC`. Waits only through the clock, and only in `enable` and `prove_watchdog`.

    The control loops run in the drive, with gains set by CubeMarsTool. It accepts commands at any time: there is no enable frame, and
    a current of zero disables the motor. Commanded positions are absolute over many turns, but the status frame reports them in
    16 bits. After more than nine turns in an earlier session the reported position is off by 6553.6 degrees; `enable` detects this.
    """

    def __init__(self, bus: can.BusABC, clock: Clock, settings: ServoSettings, guard: Guard | None = None) -> None:
        """`guard` is the guardian that holds the bus, if any; hardly any firmware has a watchdog of its own."""
        self._bus = bus
        self._clock = clock
        self._settings = settings
        self._guard = guard
        self._proof = "none"
        self._last_word = ServoTorqueOffFrames(settings)
        self._reports = ServoReports(bus, clock, settings)
        self._armed = False

    def enable(self) -> None:
        """Energises the motor and holds the shaft, first by a position command with a low speed limit, so that nothing can jump.

        Raises DeviceError, and leaves the motor off, if

        - no frame, or no status of this drive at the configured rate, arrives;
        - the drive refuses with an error;
        - the shaft does not come to rest before;
        - the shaft starts to turn, because the drive's turn counter differs from the position that it reports.
        """
        self.disable()
        if self._reports.zero_lost is not None:
            raise DeviceError(f"drive not enabled: {self._reports.zero_lost}, then start anew")
        self._await_status()
        # Motion while energising is the sign of a wrong turn counter, so the shaft must be at rest before.
        await_standstill(self._clock, self._limp_speed_rad_s)
        if self._guard is not None:
            # Before the first frame that energises: from here on a silence must disable the motor.
            arm(self._guard)
        self._hold_gently(self._reports.position_deg, self._reports.angle_rad)
        self._armed = True

    def _await_status(self) -> None:
        self._reports.drain()
        # Frames that piled up during a pause may have gaps, so they are discarded.
        self._reports.samples()
        configured_s = self._settings.status_period_s
        measured_s = find_wrong_period(self._measure_period_s, configured_s)
        if measured_s is not None:
            raise DeviceError(
                f"drive not enabled: status frames come every {1e3 * measured_s:.2g} ms, the settings say "
                f"{1e3 * configured_s:g} ms; set the drive's upload rate or status_period_s"
            )

    def _measure_period_s(self) -> float:
        self._reports.reset_counters()
        started_s, timeout_s = self._clock.now_s(), self._settings.enable_timeout_s
        look_s = PERIODS_PER_ATTEMPT * self._settings.status_period_s
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
        order = cubemars_servo.set_position_speed(
            self._settings.drive_id, position_deg, HOLD_SPEED_RAD_S * erpm, HOLD_ACCELERATION_RAD_S2 * erpm
        )
        until_s = self._clock.now_s() + WATCH_S
        while self._clock.now_s() < until_s:
            self._send(order)
            self._wait_and_drain()
            self._refuse_if_moved(angle_rad)
        self._refuse_if_error()
        # The same position without a speed limit, now that it is known to be the present one.
        self._send(cubemars_servo.set_position(self._settings.drive_id, position_deg))

    def _refuse_if_moved(self, began_rad: float) -> None:
        moved_rad = self._reports.angle_rad - began_rad
        if abs(moved_rad) > MAX_MOTION_RAD:
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
        """Commands a shaft speed. Raises DeviceError if the frame cannot be sent, or beyond 100 000 ERPM.

        Some firmware disables the motor near a speed of zero; to hold the shaft, command an angle.
        """
        erpm = _finite(speed_rad_s, "speed") * self._settings.erpm_s_per_rad
        self._send(cubemars_servo.set_speed(self._check_armed(), erpm))

    def command_angle(self, angle_rad: float, speed_rad_s: float = 0.0) -> None:
        """Commands a shaft angle. The drive has no field for the speed of a moving target, so it lags by the error of its loop.

        Raises DeviceError if the frame cannot be sent, or beyond 100 turns.
        """
        _finite(speed_rad_s, "speed")
        position_deg = self._settings.deg(_finite(angle_rad, "angle"))
        self._send(cubemars_servo.set_position(self._check_armed(), position_deg))

    def _check_armed(self) -> int:
        """The drive id, once enabled. Only `enable` verifies that commanded and reported positions agree."""
        if not self._armed:
            raise DeviceError("drive is not enabled; nothing was sent to it")
        return self._settings.drive_id

    def disable(self) -> None:
        """Disables the motor within 20 ms. Raises DeviceError if the frame cannot be sent; then only a guardian can stop it."""
        self._armed = False
        send_stop(self._bus, self._clock, self._last_word.frames())

    def prove_watchdog(self, limit_s: float) -> float:
        """Sends nothing until the motor is disabled, by the drive itself or by its guardian; returns the time in s that this took.

        The status does not report torque off, and not every firmware has a watchdog. The evidence is a load, the leg's weight, that
        the motor held before and no longer holds. A status that ends, because a relay cut the supply, is evidence too. The motor is
        off afterwards. Raises DeviceError if the motor still holds, or held too little to decide. With a guardian and no load, it is enough
        that the bus took the guardian's frames; `identity` records this.
        """
        self._reports.drain()
        held_Nm, started_s = self._reports.torque_Nm, self._clock.now_s()
        if self._guard is not None:
            return self._prove_guard(self._guard, held_Nm, limit_s)
        holding_s = started_s
        while self._clock.now_s() - started_s <= limit_s:
            self._wait_and_drain()
            if abs(self._reports.torque_Nm) >= TORQUE_OFF_SHARE * abs(held_Nm) and self._reports.silent_s < TORQUE_OFF_S:
                # Still holding: a good share of the torque, reported recently.
                holding_s = self._clock.now_s()
            if self._clock.now_s() - holding_s > TORQUE_OFF_S and (self._is_loaded(held_Nm) or self._reports.silent_s > TORQUE_OFF_S):
                self.disable()
                # The torque disappeared within one poll after the last time that it was seen.
                return holding_s - started_s + POLL_S
        self.disable()
        raise DeviceError(self._refusal(held_Nm, limit_s))

    def _prove_guard(self, guard: Guard, held_Nm: float, limit_s: float) -> float:
        try:
            proof = prove_guard(guard, held_Nm, self._last_word.min_visible_torque_Nm(), limit_s, answers=False)
        finally:
            self.disable()
        self._proof = proof.seen
        return proof.took_s

    def _is_loaded(self, held_Nm: float) -> bool:
        return abs(held_Nm) >= self._last_word.min_visible_torque_Nm()

    def _refusal(self, held_Nm: float, limit_s: float) -> str:
        remedy = "let a guardian hold its bus (guardian = true), or put a relay into its supply that opens when this computer falls silent"
        if self._is_loaded(held_Nm):
            return f"drive has no watchdog that stopped it within {limit_s:g} s of silence; set its CAN timeout if it has one, or {remedy}"
        return (
            f"drive's watchdog not proven: the motor held {abs(held_Nm):.3f} N m, too little to see it let go (at least "
            f"{self._last_word.min_visible_torque_Nm():.3f}); park the leg off the vertical, or {remedy}"
        )

    def read(self) -> ShaftSamples:
        """Samples (m,) since the last call. Raises DeviceError if the bus fails or a frame cannot be decoded."""
        self._reports.drain()
        return self._reports.samples()

    def status(self) -> MotorStatus:
        """State of the drive. The state text is what was commanded: the drive reports errors only."""
        status = self._reports.status
        temperature_C = None if status is None else float(status.temperature_degC)
        return MotorStatus("servo mode" if self._armed else "off", self._fault(), self._reports.silent_s, temperature_C)

    def _fault(self) -> str | None:
        status, silent_s, limit_s = self._reports.status, self._reports.silent_s, self._settings.status_timeout_s
        if status is not None and status.error:
            return error_text(status.error)
        # Before enabling, a position that jumps does no harm, and `enable` checks it again.
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
