"""Driver for a CubeMars / T-Motor AK drive in servo mode on a CAN bus."""

import can
import numpy as np

from rfca_rig.clock import Clock
from rfca_rig.devices.cubemars.codec import error_text, servo
from rfca_rig.devices.cubemars.codec.servo import MAX_ERPM, STATUS_DEG, Packet, Status
from rfca_rig.devices.cubemars.driver import (
    NO_WATCHDOG_REMEDY,
    ServoSettings,
    ServoTorqueOffFrames,
    SpeedCheck,
    WrappedPosition,
    await_standstill,
    describe_light_load,
)
from rfca_rig.devices.cubemars.section import CubemarsServoSection
from rfca_rig.drivers.can_frames import EMERGENCY_STOP_REMEDY
from rfca_rig.drivers.device_time import FrameCount
from rfca_rig.drivers.drive_report import DriveReceiver, check_command
from rfca_rig.drivers.guard import TORQUE_OFF_SHARE, Guard
from rfca_rig.drivers.motor_drive import POLL_S, MotorDrive
from rfca_rig.drivers.reading_check import ReadingCheck, Signal, describe_bad
from rfca_rig.drivers.roles import MotorStatus, ShaftSamples
from rfca_rig.errors import DeviceError
from rfca_rig.guardian.guarded_bus import GuardedBus

# Ends of the 16 bit field, and of the range to which the manual says the position is limited.
RANGE_ENDS = frozenset({-32768, -32000, 32000, 32767})
# Margin in rad at the shaft, on top of the fastest possible motion, before a step counts as a jump.
JUMP_MARGIN_RAD = 0.3

# The ranges that the manual states for the integer fields of the status frame. The position wraps
# instead.
STATUS_SIGNALS = (
    Signal("speed", "ERPM", -320_000.0, 320_000.0),
    Signal("current", "A", -60.0, 60.0),
    Signal("temperature", "degC", -20.0, 127.0),
)

__all__ = ["CubemarsServoMotor", "ServoSettings"]

# Speed and acceleration limits while the drive is energised. A wrong turn counter then shows as
# slow motion.
HOLD_SPEED_RAD_S = 0.3
HOLD_ACCELERATION_RAD_S2 = 10.0
# Watch time and allowed motion: 0.3 rad/s over 0.4 s is 0.12 rad, more than the limit of 0.08 rad.
WATCH_S = 0.4
MAX_MOTION_RAD = 0.08
# Time for which torque or status must be gone before the motor counts as off.
TORQUE_OFF_S = 0.05


class ServoReports(DriveReceiver):
    """Receives the status of one drive.

    `status` is its last frame, received at host time `heard_s`. Angle (continuous over turns),
    speed and torque are those of the shaft.
    """

    def __init__(self, bus: can.BusABC, clock: Clock, settings: ServoSettings) -> None:
        super().__init__(bus, clock, EMERGENCY_STOP_REMEDY)
        self._settings = settings
        # The status frame carries no time and no number, so device time comes from counting frames.
        self._count = FrameCount(settings.status_period_s)
        rad_per_count = abs(settings.angle_rad(1) - settings.angle_rad(0))
        fastest_rad_s = MAX_ERPM / abs(settings.erpm_s_per_rad)
        self._position = WrappedPosition(
            RANGE_ENDS, fastest_rad_s / rad_per_count, JUMP_MARGIN_RAD / rad_per_count
        )
        self._speed = SpeedCheck("gear_ratio and pole_pairs")
        self._check = ReadingCheck("the drive", *STATUS_SIGNALS)
        # Frames that have no time stamp yet.
        self._arrived: list[tuple[Status, float]] = []
        self.status: Status | None = None
        self.heard_s = self.drained_s
        self.position_deg = self.angle_rad = self.speed_rad_s = self.torque_Nm = np.nan
        self.reset_counters()

    def reset_counters(self) -> None:
        """Clears motion faults too."""
        self._position.forgive()
        self._speed.forgive()
        self._foreign: set[int] = set()
        self._standard = False
        self.heard = 0

    def _take(self, message: can.Message, arrived_s: float) -> None:
        if not message.is_extended_id:
            # MIT mode uses standard frames, servo mode extended ones.
            self._standard = True
        elif message.arbitration_id >> 8 == Packet.STATUS:
            drive = servo.drive_of(message.arbitration_id)
            if drive == self._settings.drive_id:
                report = servo.decode(message.arbitration_id, message.data)
            else:
                report = None
            if isinstance(report, Status):
                self._arrived.append((report, arrived_s))
            else:
                self._foreign.add(drive)

    def _stamp(self, is_whole: bool) -> None:
        arrived = self._arrived
        self._arrived = []
        stamps_s = self._count.list_stamps(len(arrived), self.drained_s)
        for (report, arrived_s), device_s in zip(arrived, stamps_s, strict=True):
            self._follow(report, arrived_s, device_s, is_whole)

    def _follow(self, report: Status, arrived_s: float, device_s: float, is_whole: bool) -> None:
        """Takes in one status. After a long pause (`is_whole` False) frames may be missing
        anywhere, so no jump is looked for.
        """
        settings = self._settings
        self.heard_s = self.drained_s
        self.heard += 1
        # An error of the drive is reported as such, whatever its numbers are.
        if report.error:
            self.status = report
        if not self._check.accept(report.speed_erpm, report.current_A, report.temperature_degC):
            return
        self.status = report
        self.speed_rad_s = report.speed_erpm / settings.erpm_s_per_rad
        count = self._position.follow(
            report.position_count, device_s, self.speed_rad_s, judged=is_whole
        )
        self.position_deg = STATUS_DEG * count
        self.angle_rad = settings.angle_rad(count)
        self.torque_Nm = report.current_A * settings.shaft_torque_per_A
        self._speed.follow(device_s, self.angle_rad, self.speed_rad_s)
        self._rows.append((arrived_s, device_s, self.angle_rad, self.speed_rad_s, self.torque_Nm))

    @property
    def lost_frames(self) -> int:
        return self._count.lost

    @property
    def bad_reports(self) -> str:
        """How many reports were refused because of impossible numbers, by signal."""
        return describe_bad(self._check.bad)

    @property
    def silent_s(self) -> float:
        return self.drained_s - self.heard_s

    @property
    def temperature_C(self) -> float | None:
        if self.status is None:
            return None
        return float(self.status.temperature_degC)

    @property
    def motion_fault(self) -> str | None:
        """An error of the reported motion since `reset_counters`, or None."""
        return self._position.fault or self._speed.fault or self._count.fault

    @property
    def zero_lost(self) -> str | None:
        return self._position.leap

    def missing(self) -> str | None:
        drive = self._settings.drive_id
        if self.heard:
            return None
        if self._foreign:
            others = ", ".join(map(str, sorted(self._foreign)))
            return f"status frames of drive {others} but none of drive {drive}; check drive_id"
        if self._standard:
            return (
                f"no status frame of drive {drive}, but frames of MIT mode or of others; "
                "check that it is set to servo mode (CubeMarsTool)"
            )
        return (
            "no frames at all on the CAN bus; check the drive's power, the wiring, the "
            "bit rate (1 Mbit/s), "
            "and that it uploads its status over CAN (CubeMarsTool)"
        )


class CubemarsServoMotor(MotorDrive):
    """Commands an AK drive in servo mode.

    The control loops run in the drive, with gains set by CubeMarsTool. It accepts commands at any
    time: there is no enable frame, and a current of zero disables the motor. Commanded positions
    are absolute over many turns, but the status frame reports them in 16 bits. After more than nine
    turns in an earlier session the reported position is off by 6553.6 degrees; `enable` detects
    this.
    """

    report_name = "status frame"

    _reports: ServoReports

    def __init__(
        self, bus: can.BusABC, clock: Clock, settings: ServoSettings, guard: Guard | None = None
    ) -> None:
        """`guard` is the guardian that holds the bus, if any; hardly any firmware has a watchdog
        of its own.
        """
        super().__init__(bus, clock, settings.status_timeout_s, guard)
        self._settings = settings
        self._last_word = ServoTorqueOffFrames(settings)
        self._reports = ServoReports(bus, clock, settings)

    def enable(self) -> None:
        """Energises the motor and holds the shaft, first by a position command with a low speed
        limit, so that nothing can jump.

        Raises DeviceError, and leaves the motor off, if

        - no frame, or no status of this drive at the configured rate, arrives;
        - the drive refuses with an error;
        - the shaft does not come to rest before;
        - the shaft starts to turn, because the drive's turn counter differs from the position that
          it reports.
        """
        self._begin_enabling()
        self._await_status()
        # Motion while energising is the sign of a wrong turn counter, so the shaft must be at rest
        # before.
        await_standstill(self._clock, self._limp_speed_rad_s)
        self._arm_guardian()
        self._hold_gently(self._reports.position_deg, self._reports.angle_rad)
        self._armed = True

    def _await_status(self) -> None:
        configured_s = self._settings.status_period_s
        measured_s = self._await_cyclic_reports(configured_s, self._settings.enable_timeout_s)
        if measured_s is not None:
            raise DeviceError(
                f"drive not enabled: status frames come every {1e3 * measured_s:.2g} ms, "
                "the settings say "
                f"{1e3 * configured_s:g} ms; set the drive's upload rate or status_period_s"
            )

    def _limp_speed_rad_s(self) -> float:
        self._wait_and_drain()
        return self._reports.speed_rad_s

    def _hold_gently(self, position_deg: float, angle_rad: float) -> None:
        erpm = abs(self._settings.erpm_s_per_rad)
        order = servo.set_position_speed(
            self._settings.drive_id,
            position_deg,
            HOLD_SPEED_RAD_S * erpm,
            HOLD_ACCELERATION_RAD_S2 * erpm,
        )
        until_s = self._clock.now_s() + WATCH_S
        while self._clock.now_s() < until_s:
            self._send_frame(order)
            self._wait_and_drain()
            self._refuse_if_moved(angle_rad)
        self._refuse_if_error()
        # The same position without a speed limit, now that it is known to be the present one.
        self._send_frame(servo.set_position(self._settings.drive_id, position_deg))

    def _refuse_if_moved(self, began_rad: float) -> None:
        moved_rad = self._reports.angle_rad - began_rad
        if abs(moved_rad) > MAX_MOTION_RAD:
            self._refuse(
                f"the shaft moved by {moved_rad:.2f} rad when "
                "commanded to stay; the drive counts its turns otherwise "
                "than it shows: switch it off and on near its zero, or set its origin"
            )

    def _refuse_if_error(self) -> None:
        status = self._reports.status
        if status is not None and status.error:
            self._refuse(f"drive {self._settings.drive_id} refuses with {error_text(status.error)}")

    def command_speed(self, speed_rad_s: float) -> None:
        """Commands a shaft speed. Raises DeviceError if the frame cannot be sent, or beyond 100 000
        ERPM.

        Some firmware disables the motor near a speed of zero; to hold the shaft, command an angle.
        """
        erpm = check_command(speed_rad_s, "speed") * self._settings.erpm_s_per_rad
        self._send_frame(servo.set_speed(self._check_armed(), erpm))

    def command_angle(self, angle_rad: float, speed_rad_s: float = 0.0) -> None:
        """Commands a shaft angle. The drive has no field for the speed of a moving target, so it
        lags by the error of its loop.

        Raises DeviceError if the frame cannot be sent, or beyond 100 turns.
        """
        check_command(speed_rad_s, "speed")
        position_deg = self._settings.deg(check_command(angle_rad, "angle"))
        self._send_frame(servo.set_position(self._check_armed(), position_deg))

    def _check_armed(self) -> int:
        """The drive id, once enabled. Only `enable` verifies that commanded and reported
        positions agree.
        """
        if not self._armed:
            raise DeviceError("drive is not enabled; nothing was sent to it")
        return self._settings.drive_id

    def disable(self) -> None:
        """Disables the motor within 20 ms. Raises DeviceError if the frame cannot be sent; then
        only a guardian can stop it.
        """
        self._stop(self._last_word.frames())

    def _await_torque_off(self, limit_s: float) -> float:
        """Sends nothing until the motor is disabled, by the drive itself or by its guardian;
        returns the time in s that this took.

        The status does not report torque off, and not every firmware has a watchdog. The evidence
        is a load, the leg's weight, that the motor held before and no longer holds. A status that
        ends, because a relay cut the supply, is evidence too. Raises DeviceError if the motor still
        holds, or held too little to decide. With a guardian and no load, it is enough that the bus
        took the guardian's frames; `identity` records this.
        """
        self._reports.drain()
        held_Nm = self._reports.torque_Nm
        started_s = self._clock.now_s()
        if self._guard is not None:
            return self._prove_guardian(
                self._guard, self._last_word, held_Nm, limit_s, answers=False
            )
        holding_s = started_s
        while self._clock.now_s() - started_s <= limit_s:
            self._wait_and_drain()
            if (
                abs(self._reports.torque_Nm) >= TORQUE_OFF_SHARE * abs(held_Nm)
                and self._reports.silent_s < TORQUE_OFF_S
            ):
                # Still holding: a good share of the torque, reported recently.
                holding_s = self._clock.now_s()
            if self._clock.now_s() - holding_s > TORQUE_OFF_S and (
                self._is_loaded(held_Nm) or self._reports.silent_s > TORQUE_OFF_S
            ):
                # The torque disappeared within one poll after the last time that it was seen.
                return holding_s - started_s + POLL_S
        raise DeviceError(self._refusal(held_Nm, limit_s))

    def _is_loaded(self, held_Nm: float) -> bool:
        return abs(held_Nm) >= self._last_word.min_visible_torque_Nm()

    def _refusal(self, held_Nm: float, limit_s: float) -> str:
        if self._is_loaded(held_Nm):
            return (
                f"drive has no watchdog that stopped it within {limit_s:g} s of silence; set "
                f"its CAN timeout if it has one, or {NO_WATCHDOG_REMEDY}"
            )
        return describe_light_load(held_Nm, self._last_word.min_visible_torque_Nm())

    def read(self) -> ShaftSamples:
        """Samples (m,) since the last call. Raises DeviceError if the bus fails or a frame
        cannot be decoded.
        """
        self._reports.drain()
        return self._reports.samples()

    def status(self) -> MotorStatus:
        """State of the drive. The state text is what was commanded: the drive reports errors
        only.
        """
        status = self._reports.status
        error = None
        if status is not None and status.error:
            error = error_text(status.error)
        # Before enabling, a position that jumps does no harm, and `enable` checks it again.
        state = "servo mode" if self._armed else "off"
        return self._make_status(state, error, self._reports.motion_fault)

    def identity(self) -> dict[str, str]:
        """For the recording."""
        settings = self._settings
        status = self._reports.status
        temperature = "unknown"
        if status is not None:
            temperature = str(status.temperature_degC)
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
            "temperature_degC": temperature,
            "status_frames_lost": str(self._reports.lost_frames),
            "bad_reports": self._reports.bad_reports,
            "guardian": self._describe_guardian(),
            "guardian_proof": self._guardian_proof,
            **self._reports.health.facts(),
        }

    def _send_frame(self, frame: servo.Frame) -> None:
        self._send(_message(frame))


def _message(frame: servo.Frame) -> can.Message:
    return can.Message(arbitration_id=frame[0], data=frame[1], is_extended_id=True)


def make_driver(
    keys: CubemarsServoSection, bus: can.BusABC, clock: Clock, silent_s: float
) -> CubemarsServoMotor:
    """The driver of the drive that [motor] names."""
    return CubemarsServoMotor(
        bus,
        clock,
        keys.to_dataclass(
            ServoSettings, status_period_s=keys.status_period_ms / 1e3, status_timeout_s=silent_s
        ),
        bus if isinstance(bus, GuardedBus) else None,
    )


def make_torque_off(keys: CubemarsServoSection, silent_s: float) -> ServoTorqueOffFrames:
    """What a guardian sends to that drive."""
    return ServoTorqueOffFrames(
        keys.to_dataclass(
            ServoSettings, status_period_s=keys.status_period_ms / 1e3, status_timeout_s=silent_s
        )
    )
