"""Driver for a CubeMars / T-Motor AK drive in MIT mode on a CAN bus. Each reply is stamped with
the time of its request.
"""

from collections import deque

import can
import numpy as np

from rfca_rig.clock import Clock
from rfca_rig.devices.cubemars.codec import error_text, servo
from rfca_rig.devices.cubemars.codec.mit import (
    MitCommand,
    MitReply,
    Special,
    decode_reply,
    encode_command,
    encode_special,
    nearest_speed,
    position_of,
)
from rfca_rig.devices.cubemars.driver import (
    CODES,
    NO_WATCHDOG_REMEDY,
    MitSettings,
    MitTorqueOffFrames,
    SpeedCheck,
    WrappedPosition,
    await_standstill,
    describe_light_load,
)
from rfca_rig.devices.cubemars.section import CubemarsMitSection
from rfca_rig.drivers.can_frames import EMERGENCY_STOP_REMEDY
from rfca_rig.drivers.drive_report import DriveReceiver, check_command
from rfca_rig.drivers.guard import TORQUE_OFF_SHARE, Guard
from rfca_rig.drivers.motor_drive import MotorDrive
from rfca_rig.drivers.roles import MotorStatus, ShaftSamples
from rfca_rig.errors import DeviceError
from rfca_rig.guardian.guarded_bus import GuardedBus

__all__ = ["CubemarsMitMotor", "MitSettings"]

# Watch time after energising, and the motion in that time from which the scale or sign must be
# wrong.
WATCH_S = 0.05
MAX_MOTION_RAD = 0.1
# A request open for longer than this counts as lost: a drive answers each frame at once.
RESYNC_S = 0.02
# Number of open requests that are kept, so that a silent drive costs no memory.
MAX_OPEN_REQUESTS = 64
# For which `ask` listens before it sends its first frame: several periods of any controller.
LISTEN_S = 0.3
# Margin in rad at the shaft, on top of the fastest possible motion, before a step counts as a jump.
JUMP_MARGIN_RAD = 0.3


class MitReplies(DriveReceiver):
    """Receives the replies of one drive. The drive answers each frame once and at once, so a reply
    shows the shaft at its request.

    `angle_rad` (continuous over turns), `speed_rad_s` and `torque_Nm` are those of the shaft at
    time `at_s`; `reply` is the last reply.
    """

    def __init__(self, bus: can.BusABC, clock: Clock, settings: MitSettings) -> None:
        super().__init__(bus, clock, EMERGENCY_STOP_REMEDY)
        self._settings = settings
        # 16 bits over the range -position_rad..position_rad.
        counts_per_rad = (CODES - 1) / (2.0 * settings.ranges.position_rad)
        fastest = settings.ranges.speed_rad_s * counts_per_rad
        self._position = WrappedPosition(
            frozenset({0, CODES - 1}), fastest, JUMP_MARGIN_RAD * counts_per_rad
        )
        self._speed = SpeedCheck("model: it decides the scale of the speed")
        self._asked_s: deque[float] = deque(maxlen=MAX_OPEN_REQUESTS)
        self._unanswered_s: float | None = None
        # Last time at which no request was open.
        self._whole_s = self.drained_s
        self._first_s: float | None = None
        # Replies that have no time stamp yet.
        self._arrived: list[tuple[MitReply, float]] = []
        self.reply: MitReply | None = None
        self.at_s = -np.inf
        self.angle_rad = self.speed_rad_s = self.torque_Nm = np.nan
        self.lost = 0
        self.reset_counters()

    def reset_counters(self) -> None:
        """Clears motion faults too."""
        self._position.forgive()
        self._speed.forgive()
        self._foreign: set[int] = set()
        self._masters: set[int] = set()
        self._servo: set[int] = set()
        self.heard = 0
        # The next reply counts, even if its request has the same time as an older one.
        self.at_s = -np.inf
        self._reports_errors = self._is_cut = False

    def note_query(self) -> None:
        """Notes a frame sent to the drive: each one is answered."""
        if not self._asked_s:
            self._whole_s = self._clock.now_s()
        self._asked_s.append(self._clock.now_s())
        if self._unanswered_s is None:
            self._unanswered_s = self._clock.now_s()

    def _take(self, message: can.Message, arrived_s: float) -> None:
        identifier = message.arbitration_id
        data = message.data
        drive = self._settings.drive_id
        # Status frames of servo mode show that the drive is in the wrong mode, which `missing`
        # reports.
        if message.is_extended_id:
            if identifier >> 8 == servo.Packet.STATUS:
                self._servo.add(servo.drive_of(identifier))
        elif not data:
            return
        elif identifier in {0, drive} and data[0] == drive:
            self._arrived.append((decode_reply(self._settings.ranges, data), arrived_s))
        elif data[0] == drive:
            # A reply of this drive under a third id: its master id is set otherwise.
            self._masters.add(identifier)
        else:
            self._foreign.add(data[0] if identifier == 0 else identifier)

    def _stamp(self, is_whole: bool) -> None:  # noqa: ARG002 (a reply shows the shaft at its request)
        replies = self._arrived
        self._arrived = []
        times_s = self._assign_requests(len(replies))
        self.heard += len(replies)
        timed = replies[len(replies) - len(times_s) :]
        for (reply, arrived_s), t_s in zip(timed, times_s, strict=True):
            self._follow(reply, arrived_s, t_s)

    def _assign_requests(self, count: int) -> list[float]:
        """Request times of `count` replies. They are matched in order, as a bus keeps it and a slow
        adapter may only delay replies.

        If a request has stayed open for `RESYNC_S`, a reply was lost; the newest replies then
        belong to the newest requests.
        """
        requests_s = list(self._asked_s)
        is_lost = 0 < count < len(requests_s) and self.drained_s - self._whole_s > RESYNC_S
        if is_lost:
            answered_s = requests_s[-count:]
            open_s = []
            self.lost += len(requests_s) - count
        else:
            answered_s = requests_s[:count]
            open_s = requests_s[count:]
        if count:
            self._asked_s = deque(open_s, MAX_OPEN_REQUESTS)
            self._unanswered_s = open_s[0] if open_s else None
        if not self._asked_s:
            self._whole_s = self.drained_s
        return answered_s

    def _follow(self, reply: MitReply, arrived_s: float, t_s: float) -> None:
        self.reply = reply
        self._is_cut |= self._reports_errors and reply.error is None
        self._reports_errors |= reply.error is not None
        if t_s <= self.at_s:
            # Two requests at the same time: the second reply is the same.
            return
        settings = self._settings
        count = self._position.follow(reply.position_code, t_s, reply.speed_rad_s)
        if self._first_s is None:
            self._first_s = t_s
        self.at_s = t_s
        self.angle_rad = settings.direction * (
            position_of(settings.ranges, count) - settings.zero_rad
        )
        self.speed_rad_s = settings.direction * reply.speed_rad_s
        self.torque_Nm = settings.direction * reply.torque_Nm
        self._speed.follow(t_s, self.angle_rad, self.speed_rad_s)
        self._rows.append(
            (arrived_s, t_s - self._first_s, self.angle_rad, self.speed_rad_s, self.torque_Nm)
        )

    def angle_at(self, now_s: float) -> float:
        """Shaft angle in rad, extrapolated to `now_s` at the last speed."""
        return self.angle_rad + self.speed_rad_s * (now_s - self.at_s)

    @property
    def silent_s(self) -> float:
        if self._unanswered_s is None:
            return 0.0
        return max(self.drained_s - self._unanswered_s, 0.0)

    @property
    def temperature_C(self) -> float | None:
        if self.reply is None or self.reply.temperature_degC is None:
            return None
        return float(self.reply.temperature_degC)

    @property
    def motion_fault(self) -> str | None:
        """An error of the reported motion since `reset_counters`, or None."""
        return self._position.fault or self._speed.fault

    @property
    def zero_lost(self) -> str | None:
        return self._position.leap

    @property
    def form_fault(self) -> str | None:
        """Set if replies have lost the error byte that they carried since `reset_counters`: an
        error would stay hidden.
        """
        if self._is_cut:
            return (
                "replies lost their bytes for temperature and error; check the CAN wiring "
                "and what else talks on it"
            )
        return None

    @property
    def has_heard_anything(self) -> bool:
        """Whether a frame of anybody has arrived since `reset_counters`."""
        return bool(self.heard or self._foreign or self._masters or self._servo)

    def missing(self) -> str | None:
        drive = self._settings.drive_id
        if self.heard:
            return None
        if drive in self._servo:
            return (
                f"drive {drive} sends status frames of servo mode; check that it is set to "
                "MIT mode (CubeMarsTool), or use cubemars-servo"
            )
        if self._masters:
            return (
                f"drive {drive} replies under id {_join_numbers(self._masters)}; check its "
                "master id, which must be 0 or its own"
            )
        if self._foreign or self._servo:
            return (
                f"frames of {_join_numbers(self._foreign | self._servo)} but no reply from "
                f"drive {drive}; check drive_id"
            )
        return (
            "no frames at all on the CAN bus; check the drive's power, the wiring, the "
            "termination and the bit rate (1 Mbit/s)"
        )


def _join_numbers(numbers: set[int]) -> str:
    return ", ".join(map(str, sorted(numbers)))


class MovingTarget:
    """Outer loop that converts angle errors to speed: demanded speed = commanded speed + gain *
    (target - angle).

    Under a commanded speed the target moves at that speed, so the lag that a load causes is made up
    later. Together with a drive whose torque is proportional to the speed error, this is a speed
    loop with an integrator. The target stays within `max_lag_rad` of the shaft, where the drive
    gives its largest torque; this is the anti-windup.
    """

    def __init__(
        self, gain_per_s: float, most_behind_rad: float, angle_rad: float, now_s: float
    ) -> None:
        self._gain_per_s = gain_per_s
        self._most_behind_rad = most_behind_rad
        self._target_rad = angle_rad
        self._speed_rad_s = 0.0
        self._since_s = now_s

    def speed_to_angle(
        self, target_rad: float, speed_rad_s: float, angle_rad: float, now_s: float
    ) -> float:
        """Speed in rad/s towards a target that moves at `speed_rad_s`, with the shaft at
        `angle_rad` now.
        """
        self._target_rad = target_rad
        self._speed_rad_s = speed_rad_s
        self._since_s = now_s
        return speed_rad_s + self._gain_per_s * (target_rad - angle_rad)

    def speed_for(self, speed_rad_s: float, angle_rad: float, now_s: float) -> float:
        """Speed in rad/s that makes the shaft keep up with a commanded speed, with the shaft at
        `angle_rad` now.
        """
        moved_rad = self._target_rad + self._speed_rad_s * (now_s - self._since_s)
        # Anti-windup: beyond this error the torque is saturated, and a larger one would only cause
        # overshoot later.
        nearest_rad = min(
            max(moved_rad, angle_rad - self._most_behind_rad), angle_rad + self._most_behind_rad
        )
        return self.speed_to_angle(nearest_rad, speed_rad_s, angle_rad, now_s)


class CubemarsMitMotor(MotorDrive):
    """Commands an AK drive in MIT mode. The driver closes the position loop.

    The drive's position field is not used (kp = 0). It covers only +-12.5 rad while the shaft turns
    further, and firmware differs in how it treats a target beyond. With kp = 0 a position wrong by
    a turn cannot become a torque. The drive controls speed (kd); the driver computes that speed
    from the angle error at each call. The rounding error of the speed field goes into the torque
    field. The drive sends nothing unasked and does not report whether it is in MIT mode: missing
    torque shows as a shaft that does not follow.
    """

    report_name = "reply"

    _reports: MitReplies

    def __init__(
        self, bus: can.BusABC, clock: Clock, settings: MitSettings, guard: Guard | None = None
    ) -> None:
        """`guard` is the guardian that holds the bus, if any; hardly any firmware has a watchdog
        of its own.
        """
        super().__init__(bus, clock, settings.reply_timeout_s, guard)
        self._settings = settings
        self._last_word = MitTorqueOffFrames(settings)
        self._reports = MitReplies(bus, clock, settings)
        self._target: MovingTarget | None = None
        # For `ask`: both None until it is called, and until it has listened.
        self._listens_until_s: float | None = None
        self._is_bus_quiet: bool | None = None

    def enable(self) -> None:
        """Energises the motor and holds the shaft. A command with zero gains first overwrites the
        one that the drive remembers.

        Raises DeviceError, and leaves the motor off, if

        - no frame or no reply of this drive arrives, or it is not in MIT mode;
        - the drive refuses with an error;
        - the shaft does not come to rest before, or moves afterwards.
        """
        self._begin_enabling()
        self._await_replies()
        await_standstill(self._clock, self._limp_speed_rad_s)
        self._target = MovingTarget(
            self._settings.angle_gain_per_s,
            self._settings.max_lag_rad,
            self._reports.angle_rad,
            self._clock.now_s(),
        )
        began_rad = self._reports.angle_rad
        until_s = self._clock.now_s() + WATCH_S
        self._arm_guardian()
        # ENTER puts the last command into force; the commands without gains sent before make it
        # harmless.
        self._send_data(encode_special(Special.ENTER))
        while self._clock.now_s() < until_s:
            self._command_angle(began_rad, 0.0)
            self._wait_and_drain()
            self._refuse_if_moved(began_rad)
        self._refuse_if_error()
        self._armed = True

    def _await_replies(self) -> None:
        # Replies from before a pause could be assigned to requests made now, so they are discarded.
        self._reports.samples()
        self._reports.reset_counters()
        deadline_s = self._clock.now_s() + self._settings.enable_timeout_s
        while self._reports.missing() is not None:
            if self._clock.now_s() > deadline_s:
                raise DeviceError(
                    f"drive not enabled: within {self._settings.enable_timeout_s:g} s "
                    f"{self._reports.missing()}"
                )
            self._ask_limp()

    def _ask_limp(self) -> None:
        self._send_data(self._last_word.zero_gain_command().data)
        self._wait_and_drain()

    def _limp_speed_rad_s(self) -> float:
        self._ask_limp()
        return self._reports.speed_rad_s

    def _refuse_if_moved(self, began_rad: float) -> None:
        moved_rad = self._reports.angle_rad - began_rad
        if abs(moved_rad) > MAX_MOTION_RAD:
            self._refuse(
                f"the shaft moved by {moved_rad:.2f} rad when energised; check direction and model"
            )

    def _refuse_if_error(self) -> None:
        reply = self._reports.reply
        if reply is not None and reply.error:
            self._refuse(f"drive {self._settings.drive_id} refuses with {error_text(reply.error)}")

    def command_speed(self, speed_rad_s: float) -> None:
        """Commands a shaft speed. Raises DeviceError if the frame cannot be sent, or beyond the
        drive's speed range.
        """
        target = self._require_enabled(check_command(speed_rad_s, "speed"))
        now_s = self._clock.now_s()
        self._send_speed(target.speed_for(speed_rad_s, self._reports.angle_at(now_s), now_s))

    def command_angle(self, angle_rad: float, speed_rad_s: float = 0.0) -> None:
        """Commands a shaft angle. Raises DeviceError if the frame cannot be sent, or beyond the
        drive's speed range.
        """
        self._command_angle(check_command(angle_rad, "angle"), check_command(speed_rad_s, "speed"))

    def _command_angle(self, angle_rad: float, speed_rad_s: float) -> None:
        target = self._require_enabled(speed_rad_s)
        now_s = self._clock.now_s()
        self._send_speed(
            target.speed_to_angle(angle_rad, speed_rad_s, self._reports.angle_at(now_s), now_s)
        )

    def _require_enabled(self, speed_rad_s: float) -> MovingTarget:
        limit_rad_s = self._settings.ranges.speed_rad_s
        if self._target is None:
            raise DeviceError("drive is not enabled; nothing was sent to it")
        if abs(speed_rad_s) > limit_rad_s:
            raise DeviceError(
                f"commanded speed {speed_rad_s:g} rad/s, limit {limit_rad_s:g} "
                f"({self._settings.model}); nothing was sent"
            )
        self._reports.drain()
        return self._target

    def _send_speed(self, speed_rad_s: float) -> None:
        ranges = self._settings.ranges
        gain = self._settings.speed_gain_Nm_s_per_rad
        direction = self._settings.direction
        clipped_rad_s = direction * min(max(speed_rad_s, -ranges.speed_rad_s), ranges.speed_rad_s)
        encoded_rad_s = nearest_speed(ranges, clipped_rad_s)
        # The 12 bit speed field is coarse; kd times its rounding error as feed-forward torque makes
        # up for it.
        compensation_Nm = gain * (clipped_rad_s - encoded_rad_s)
        self._send_data(
            encode_command(ranges, MitCommand(0.0, encoded_rad_s, 0.0, gain, compensation_Nm))
        )

    def disable(self) -> None:
        """Disables the motor within 20 ms. Raises DeviceError if a frame cannot be sent; then
        only a guardian can stop it.
        """
        self._target = None
        try:
            # The drive answers both torque-off frames, so two requests are noted afterwards.
            self._stop(self._last_word.frames())
        finally:
            self._reports.note_query()
            self._reports.note_query()

    def _await_torque_off(self, limit_s: float) -> float:
        """Sends nothing for `limit_s`, then asks once; returns the time in s, within which the
        motor was disabled.

        With a guardian, it sends nothing until the guardian has acted and the drive has answered
        it. It then returns the time until the reports showed no torque; `identity` records the
        evidence.

        A drive in MIT mode does not report its state, and not every firmware has a watchdog. The
        evidence is a load, the leg's weight, that the motor held before and no longer holds. A
        drive that does not answer, because its supply was cut, is evidence too. Raises DeviceError
        if the motor still holds, or held too little to decide.
        """
        self._reports.drain()
        held_Nm = self._reports.torque_Nm
        if self._guard is not None:
            return self._prove_guardian(
                self._guard, self._last_word, held_Nm, limit_s, answers=True
            )
        started_s = self._clock.now_s()
        self._clock.wait_until(started_s + limit_s)
        has_answered = self._ask_once()
        elapsed_s = self._clock.now_s() - started_s
        is_off = not has_answered or abs(self._reports.torque_Nm) < TORQUE_OFF_SHARE * abs(held_Nm)
        if has_answered:
            self._refuse_proof(held_Nm, is_off, limit_s)
        return elapsed_s

    def _ask_once(self) -> bool:
        """Requests one reply by ENTER, which changes neither set-points nor the watchdog count;
        returns whether it came.
        """
        self._reports.drain()
        self._reports.reset_counters()
        self._send_data(encode_special(Special.ENTER))
        # Ten polls of 2 ms: an answer comes at once, plus the delays of adapter and bus.
        for _ in range(10):
            self._wait_and_drain()
        return self._reports.heard > 0

    def _refuse_proof(self, held_Nm: float, is_off: bool, limit_s: float) -> None:
        least_Nm = self._last_word.min_visible_torque_Nm()
        if abs(held_Nm) < least_Nm:
            raise DeviceError(describe_light_load(held_Nm, least_Nm))
        if not is_off:
            raise DeviceError(
                f"drive has no watchdog that stopped it within {limit_s:g} s of silence, "
                f"as many AK drives in MIT mode; {NO_WATCHDOG_REMEDY}"
            )

    def read(self) -> ShaftSamples:
        """Samples (m,) since the last call. Raises DeviceError if the bus fails or a frame
        cannot be decoded.
        """
        self._reports.drain()
        return self._reports.samples()

    def ask(self) -> None:
        """Requests a reply by EXIT, which may remove torque and never adds any: no frame of this
        mode only asks.

        Listens for LISTEN_S first. Where anything is on the bus by then, another program may be
        using the drive, which EXIT would disable: nothing is ever sent.
        """
        now_s = self._clock.now_s()
        if self._listens_until_s is None:
            self._listens_until_s = now_s + LISTEN_S
        if now_s < self._listens_until_s:
            return
        if self._is_bus_quiet is None:
            self._is_bus_quiet = not self._reports.has_heard_anything
        if self._is_bus_quiet:
            self._send_data(encode_special(Special.EXIT))

    def status(self) -> MotorStatus:
        """State of the drive. The state text is what was commanded: the drive reports errors
        only.
        """
        reply = self._reports.reply
        error = None
        if reply is not None and reply.error:
            error = error_text(reply.error)
        # Motion faults count only while enabled: before, the drive is asked rarely and the shaft
        # may be moved by hand.
        motion_fault = self._reports.form_fault or self._reports.motion_fault
        state = "off" if self._target is None else "MIT mode"
        return self._make_status(state, error, motion_fault)

    def identity(self) -> dict[str, str]:
        """For the recording. Whether the firmware sends errors is known after `enable`."""
        settings = self._settings
        reply = self._reports.reply
        errors_told = "unknown"
        temperature = "unknown"
        if reply is not None:
            errors_told = "no" if reply.error is None else "yes"
            if reply.temperature_degC is not None:
                temperature = str(reply.temperature_degC)
        return {
            "make": "CubeMars AK, MIT mode",
            "bus": str(self._bus.channel_info),
            "drive_id": str(settings.drive_id),
            "model": settings.model,
            "direction": str(settings.direction),
            "zero_rad": repr(settings.zero_rad),
            "speed_gain_Nm_s_per_rad": repr(settings.speed_gain_Nm_s_per_rad),
            "angle_gain_per_s": repr(settings.angle_gain_per_s),
            "errors_told": errors_told,
            "temperature_degC": temperature,
            "replies_lost": str(self._reports.lost),
            "guardian": self._describe_guardian(),
            "guardian_proof": self._guardian_proof,
            **self._reports.health.facts(),
        }

    def _send_data(self, data: bytes | bytearray) -> None:
        self._send(self._message(data))
        self._reports.note_query()

    def _message(self, data: bytes | bytearray) -> can.Message:
        return can.Message(arbitration_id=self._settings.drive_id, data=data, is_extended_id=False)


def make_driver(
    keys: CubemarsMitSection, bus: can.BusABC, clock: Clock, silent_s: float
) -> CubemarsMitMotor:
    """The driver of the drive that [motor] names."""
    return CubemarsMitMotor(
        bus,
        clock,
        keys.to_dataclass(MitSettings, reply_timeout_s=silent_s),
        bus if isinstance(bus, GuardedBus) else None,
    )


def make_torque_off(keys: CubemarsMitSection, silent_s: float) -> MitTorqueOffFrames:
    """What a guardian sends to that drive."""
    return MitTorqueOffFrames(keys.to_dataclass(MitSettings, reply_timeout_s=silent_s))
