"""Twins of CubeMars / T-Motor AK drives in MIT and in servo mode, on the CAN bus, and the faults
that can be injected into them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import degrees, floor, pi, radians, tau
from typing import ClassVar

import can

from rfca_rig.devices.cubemars.codec import mit, mit_ranges, servo
from rfca_rig.devices.cubemars.codec.mit import POSITION_CODES, MitCommand, MitReply, Special
from rfca_rig.devices.cubemars.codec.servo import Message, OriginMode, Status
from rfca_rig.devices.cubemars.section import CubemarsMitSection, CubemarsServoSection
from rfca_rig.devices.cubemars.tool_fields import CAN_ID, FEEDBACK_RATE
from rfca_rig.errors import BadInput, MalformedFrame
from rfca_rig.twin_server.faults import DRIVE_FAULTS, DriveFaults, Fault, drive_events
from rfca_rig.twins.drive_parts import (
    DriveTwin,
    Encoder,
    LoopGains,
    LoopMode,
    MotorSetPoint,
    MotorThermalModel,
    SpeedLoop,
    ThermalParameters,
    reading_after_power_up,
)
from rfca_rig.twins.wires import SampleGrid, stamp_s
from rfca_rig.twins.world import ShaftDrive, ShaftState, interpolate_motion

# Error codes of the drive.
TOO_HOT = 1
TOO_MUCH_CURRENT = 2
ENCODER = 5
STALLED = 7
# Step of the fault `encoder-jump`, at the shaft.
JUMP_RAD = 0.5 * pi
ZERO_COMMAND = MitCommand(0.0, 0.0, 0.0, 0.0, 0.0)
# Time in s for which the drive does not answer after it has set its zero.
ZEROING_S = 1.0
# Of a new drive. The id is that of the AK driver manual 1.0.8 (section 5.3); the rate is one that
# users have. Neither was read in a drive.
NEW_DRIVE_ID = 1
NEW_STATUS_PERIOD_S = 0.02
# Largest temperature of the signed byte in the status frame.
MAX_TEMPERATURE_degC = 127
# End of the position range of the status frame according to the manual.
MAX_COUNT = 32_000


@dataclass(frozen=True)
class MitTwinSettings:
    """Configuration of the drive, and variant of its firmware.

    With `watchdog_s` None the drive keeps its last command for ever. Otherwise the command is
    zeroed after that silence and the drive stays in MIT mode, as in Ben Katz's firmware (25 ms).
    `reply_id` None replies under the drive's own id. `wraps`: the position field wraps at its ends,
    else it stops there. `tells_errors`: replies carry temperature and error. `entering_error` is
    the error that every attempt to enter MIT mode ends in; 0 for a healthy drive.
    """

    drive_id: int = 1
    model: str = "AK80-9"
    direction: int = 1
    zero_rad: float = 0.0
    zero_policy: str | None = None
    torque_limit_Nm: float | None = None
    watchdog_s: float | None = None
    reply_id: int | None = 0
    wraps: bool = True
    tells_errors: bool = True
    entering_error: int = 0
    warming: ThermalParameters = field(default_factory=lambda: ThermalParameters(air_degC=31.0))


class CubemarsMitTwin(DriveTwin):
    """A `MotorTwin` that answers each frame with the state of the shaft at that time.

    The drive keeps its last command across EXIT and ENTER; a driver that relies on the contrary
    causes a jerk.
    """

    tells_temperature = True

    def __init__(self, bus: can.BusABC, settings: MitTwinSettings) -> None:
        self._bus = bus
        self._settings = settings
        self._ranges = mit_ranges(settings.model)
        self._command = ZERO_COMMAND
        self._entered = False
        self._error = 0
        self._zero_rad = settings.zero_rad
        self._zero_wanted = False
        self._now_s = 0.0
        self._mute_until_s = 0.0
        self._fed_s = 0.0
        self._unanswered = 0
        self._restarts = False
        self.encoder = Encoder()
        self.warmth = MotorThermalModel(settings.warming)

    def take_frames(self, now_s: float) -> None:
        """Executes received frames; invalid ones are ignored. Commands feed the watchdog,
        special frames do not.
        """
        self._now_s = now_s
        while (message := self._bus.recv(timeout=0)) is not None:
            mine = message.arbitration_id == self._settings.drive_id and not message.is_extended_id
            if (
                mine
                and not message.is_error_frame
                and not message.is_remote_frame
                and now_s >= self._mute_until_s
            ):
                self._take(message.data, now_s)
        limit_s = self._settings.watchdog_s
        # Only the command is zeroed; the drive stays in MIT mode.
        if limit_s is not None and now_s - self._fed_s > limit_s:
            self._command = ZERO_COMMAND

    def _take(self, data: bytearray, now_s: float) -> None:
        try:
            order = mit.decode_command(self._ranges, data)
        except MalformedFrame:
            return
        self._unanswered += 1
        if isinstance(order, MitCommand):
            self._command = order
            self._fed_s = now_s
        elif order is Special.ZERO:
            self._zero_wanted = True
            self._mute_until_s = now_s + ZEROING_S
        else:
            entered = order is Special.ENTER
            if entered and self._settings.entering_error:
                self.set_error(self._settings.entering_error)
            elif entered != self._entered:
                self._entered = entered
                self._error = 0

    def type_line(self, line: str) -> str:
        """A field of the maker's tool, as `setup` prints it; returns what the field holds then."""
        name, value = _read_line(line)
        if name == CAN_ID:
            self._settings = replace(self._settings, drive_id=round(value))
        return f"{value:g}"

    def set_error(self, error: int) -> None:
        """Puts the drive into an error: no torque until it enters MIT mode again."""
        self._error = error
        self._entered = False

    def restart(self) -> None:
        """Power cycle: the drive is out of MIT mode and has lost its rotor turn count."""
        self._command = ZERO_COMMAND
        self._entered = False
        self._error = 0
        self._restarts = True

    def leap(self, by_rad: float) -> None:
        """Encoder slip: from now on the reported position is shifted by `by_rad`."""
        self._zero_rad += by_rad

    def refuse_with(self, error: int) -> None:
        """From now on every attempt to enter MIT mode ends in this error."""
        self._settings = replace(self._settings, entering_error=error)

    def drive(self, shaft: ShaftState) -> ShaftDrive:
        """Sends the pending answers; returns the torque law until the next step, limited at the
        present state.
        """
        if self._restarts:
            self._restarts = False
            reported_rad = self._settings.direction * shaft.angle_rad + self._zero_rad
            # The encoder sits before the gear and knows its position within a rotor turn only:
            # whole turns are lost.
            rotor_turn_rad = tau / self._ranges.gear_ratio
            policy = self._settings.zero_policy or "behind-gear"
            self._zero_rad += (
                reading_after_power_up(reported_rad, rotor_turn_rad, policy) - reported_rad
            )
        for _ in range(self._unanswered):
            self._reply(shaft)
        self._unanswered = 0
        if self._zero_wanted:
            self._zero_wanted = False
            self._zero_rad = -self._settings.direction * shaft.angle_rad
        if not self._entered:
            return ShaftDrive()
        free = self._law()
        torque_Nm = abs(free.torque_Nm(shaft.angle_rad, shaft.speed_rad_s))
        limit_Nm = self._limit_Nm
        # Beyond the limit the whole law is scaled down for one step, as in `SpeedLoop`.
        if torque_Nm <= limit_Nm:
            return free
        return free.scale(limit_Nm / torque_Nm)

    def _law(self) -> ShaftDrive:
        command = self._command
        direction = self._settings.direction
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
        if given_Nm is None:
            return self._ranges.torque_Nm
        return min(given_Nm, self._ranges.torque_Nm)

    def advance(
        self,
        elapsed_s: float,
        now_s: float,  # noqa: ARG002
        before: ShaftState,  # noqa: ARG002
        after: ShaftState,
        law: ShaftDrive,  # noqa: ARG002
    ) -> None:
        """Advances the motor temperature. Nothing else becomes due, as the drive replies only
        when asked.
        """
        self.warmth.advance(elapsed_s, after.torque_Nm)

    def _reply(self, shaft: ShaftState) -> None:
        settings = self._settings
        angle_rad, speed_rad_s = self.encoder.report(
            settings.direction * shaft.angle_rad + self._zero_rad, shaft.speed_rad_s
        )
        code = mit.position_code(self._ranges, angle_rad)
        # Firmware differs here: the position code wraps, or is limited to its range.
        if settings.wraps:
            code %= POSITION_CODES
        else:
            code = min(max(code, 0), POSITION_CODES - 1)
        temperature_degC = None
        error = None
        if settings.tells_errors:
            highest_degC = 255 - self._ranges.temperature_offset_degC
            temperature_degC = min(round(self.warmth.reported_degC), highest_degC)
            error = self._error
        reply = MitReply(
            drive_id=settings.drive_id,
            position_code=code,
            position_rad=0.0,
            speed_rad_s=settings.direction * speed_rad_s,
            torque_Nm=settings.direction * shaft.torque_Nm,
            temperature_degC=temperature_degC,
            error=error,
        )
        identifier = settings.reply_id
        if identifier is None:
            identifier = settings.drive_id
        data = mit.encode_reply(self._ranges, reply)
        self._bus.send(
            can.Message(
                arbitration_id=identifier,
                data=data,
                is_extended_id=False,
                timestamp=stamp_s(self._now_s),
            )
        )

    def stale_set_point(self) -> Sequence[can.Message]:
        """A position at a high speed, with torque."""
        data = mit.encode_command(self._ranges, MitCommand(-9.0, 20.0, 100.0, 5.0, 15.0))
        return (
            can.Message(arbitration_id=self._settings.drive_id, data=data, is_extended_id=False),
        )

    def fail(self) -> str:
        self.set_error(TOO_HOT)
        return r"error 1 \(motor too hot\)"

    def refuse(self) -> str:
        self.refuse_with(ENCODER)
        return r"refuses with error 5 \(encoder fault\)"


@dataclass(frozen=True)
class ServoTwinSettings:
    """Configuration of the drive, and variant of its firmware.

    With `watchdog_s` None the drive keeps its last command for ever, otherwise it is disabled after
    that silence. `wraps`: the position of the status frame wraps at 16 bits, else it stops at
    +-3200 degrees. `ordered_error` is the error that every motion command ends in; 0 for a healthy
    drive.
    """

    drive_id: int = 1
    gear_ratio: float = 9.0
    pole_pairs: int = 21
    torque_constant_Nm_per_A: float = 0.115
    direction: int = 1
    zero_deg: float = 0.0
    zero_policy: str | None = None
    gains: LoopGains = field(default_factory=LoopGains)
    status_period_s: float = 2e-3
    watchdog_s: float | None = None
    wraps: bool = True
    ordered_error: int = 0
    warming: ThermalParameters = field(default_factory=lambda: ThermalParameters(air_degC=31.0))


class CubemarsServoTwin(DriveTwin):
    """A `MotorTwin` that sends its status cyclically.

    Commands take effect at once and stay in force. A position is absolute, however many turns the
    shaft has made before.
    """

    tells_temperature = True
    # One count of position is 1.7 mrad, with an angle gain of 160 N m/rad. The loop has no speed of
    # a target: 2 rad/s over a gain of 20/s. The status shows nine turns; beyond them the driver
    # refuses to enable it.
    tolerances: ClassVar = {
        "ANGLE_TOLERANCE_RAD": 4e-3,
        "ENABLING_TORQUE_Nm": 0.4,
        "FOLLOWING_TOLERANCE_RAD": 0.12,
        "LARGEST_ANGLE_RAD": 50.0,
    }

    def __init__(self, bus: can.BusABC, settings: ServoTwinSettings) -> None:
        self._bus = bus
        self._settings = settings
        self._loop = SpeedLoop(settings.gains)
        self._wanted = MotorSetPoint(LoopMode.TORQUE)
        # Target of a position command with a speed limit; the set-point moves there.
        self._goal_rad: float | None = None
        self._pace_rad_s = 0.0
        self._starts_pacing = False
        self._looping = False
        self._zero_deg = settings.zero_deg
        self._origin_wanted = False
        self._error = 0
        self._fed_s = 0.0
        self._now_s = 0.0
        self._status_ticks = SampleGrid(settings.status_period_s)
        self._restarts = False
        self.encoder = Encoder()
        self.warmth = MotorThermalModel(settings.warming)

    def take_frames(self, now_s: float) -> None:
        """Executes received frames; invalid ones are ignored."""
        while (message := self._bus.recv(timeout=0)) is not None:
            mine = (
                message.is_extended_id
                and servo.drive_of(message.arbitration_id) == self._settings.drive_id
            )
            if mine and not message.is_error_frame and not message.is_remote_frame:
                self._fed_s = now_s
                self._take(message)
        limit_s = self._settings.watchdog_s
        if limit_s is not None and now_s - self._fed_s > limit_s:
            self._push(0.0)

    def _take(self, message: can.Message) -> None:
        try:
            self._obey(servo.decode(message.arbitration_id, message.data))
        except MalformedFrame:
            # The firmware does not report invalid frames either.
            return

    def _obey(self, order: Message | None) -> None:
        match order:
            case servo.SetCurrent():
                self._push(order.current_A)
            case servo.SetOrigin():
                self._origin_wanted = order.origin != OriginMode.FACTORY
            case servo.SetSpeed():
                self._turn(LoopMode.VELOCITY, speed_rad_s=order.speed_erpm / self._erpm_s_per_rad)
            case servo.SetPosition():
                self._turn(LoopMode.POSITION, angle_rad=self._angle_rad(order.position_deg))
            case servo.SetPositionSpeed():
                self._pace_rad_s = abs(order.speed_erpm / self._erpm_s_per_rad)
                goal_rad = self._angle_rad(order.position_deg)
                self._turn(LoopMode.POSITION, angle_rad=self._wanted.angle_rad, goal_rad=goal_rad)

    def _push(self, current_A: float) -> None:
        """Current control. Zero disables the motor and clears an error."""
        self._wanted = MotorSetPoint(LoopMode.TORQUE, torque_Nm=current_A * self._torque_per_A)
        self._goal_rad = None
        self._looping = False
        if current_A == 0.0:
            self._error = 0

    def _turn(
        self,
        mode: int,
        angle_rad: float = 0.0,
        speed_rad_s: float = 0.0,
        goal_rad: float | None = None,
    ) -> None:
        if self._settings.ordered_error:
            self._error = self._settings.ordered_error
        if self._error:
            return
        self._starts_pacing |= goal_rad is not None and self._goal_rad is None
        self._wanted = MotorSetPoint(mode, angle_rad, speed_rad_s)
        self._goal_rad = goal_rad
        if not self._looping:
            self._loop.reset()
        self._looping = True

    def type_line(self, line: str) -> str:
        """A field of the maker's tool, as `setup` prints it; returns what the field holds then."""
        name, value = _read_line(line)
        if name == CAN_ID:
            self._settings = replace(self._settings, drive_id=round(value))
        elif name == FEEDBACK_RATE and value > 0.0:
            self._status_ticks = SampleGrid(1.0 / value)
            self._status_ticks.skip_to(self._now_s)
        return f"{value:g}"

    def set_error(self, error: int) -> None:
        """Puts the drive into an error: it is disabled, and ignores motion commands until a zero
        current clears it.
        """
        self._push(0.0)
        self._error = error

    def restart(self) -> None:
        """Power cycle: the drive is disabled and has lost its rotor turn count."""
        self._push(0.0)
        self._restarts = True

    def leap(self, by_rad: float) -> None:
        """Encoder slip: from now on the reported position is shifted by `by_rad`."""
        self._zero_deg += degrees(by_rad)

    def refuse_with(self, error: int) -> None:
        """From now on every motion command ends in this error."""
        self._settings = replace(self._settings, ordered_error=error)

    def drive(self, shaft: ShaftState) -> ShaftDrive:
        """Torque law on the shaft until the next step."""
        if self._restarts:
            self._restarts = False
            reported_deg = self._zero_deg + self._settings.direction * degrees(shaft.angle_rad)
            # A single-turn encoder knows its position within a rotor turn only: whole turns are
            # lost.
            rotor_turn_deg = 360.0 / self._settings.gear_ratio
            policy = self._settings.zero_policy or "behind-gear"
            self._zero_deg += (
                reading_after_power_up(reported_deg, rotor_turn_deg, policy) - reported_deg
            )
        if self._origin_wanted:
            self._origin_wanted = False
            self._zero_deg = -self._settings.direction * degrees(shaft.angle_rad)
        if self._goal_rad is not None and self._starts_pacing:
            # The moving set-point starts where the shaft is, not at an old set-point.
            self._wanted.angle_rad = shaft.angle_rad
        self._starts_pacing = False
        return self._loop.law(self._wanted, shaft)

    def advance(
        self, elapsed_s: float, now_s: float, before: ShaftState, after: ShaftState, law: ShaftDrive
    ) -> None:
        """Takes in a step of the plant under `law` that ended at `now_s`, and sends the reports
        that became due in it.
        """
        self._now_s = now_s
        self._loop.advance(self._wanted, elapsed_s, before, after)
        self.warmth.advance(elapsed_s, after.torque_Nm)
        if self._goal_rad is not None:
            way_rad = self._goal_rad - self._wanted.angle_rad
            most_rad = self._pace_rad_s * elapsed_s
            self._wanted.angle_rad += min(max(way_rad, -most_rad), most_rad)
        due_s = self._status_ticks.until(now_s).tolist()
        motion = interpolate_motion(due_s, elapsed_s, now_s, before, after)
        for at_s, (angle_rad, speed_rad_s) in zip(due_s, motion, strict=True):
            self._report(at_s, angle_rad, speed_rad_s, law.torque_Nm(angle_rad, speed_rad_s))

    def _report(self, at_s: float, angle_rad: float, speed_rad_s: float, torque_Nm: float) -> None:
        reported_deg, speed_rad_s = self.encoder.report(
            self._zero_deg + self._settings.direction * degrees(angle_rad), speed_rad_s
        )
        count = floor(reported_deg / servo.STATUS_DEG)
        if self._settings.wraps:
            half = servo.STATUS_COUNTS // 2
            count = (count + half) % servo.STATUS_COUNTS - half
        else:
            count = min(max(count, -MAX_COUNT), MAX_COUNT)
        status = Status(
            position_count=count,
            speed_erpm=speed_rad_s * self._erpm_s_per_rad,
            current_A=torque_Nm / self._torque_per_A,
            temperature_degC=min(round(self.warmth.reported_degC), MAX_TEMPERATURE_degC),
            error=self._error,
        )
        frame = servo.status(self._settings.drive_id, status)
        self._bus.send(
            can.Message(
                arbitration_id=frame[0],
                data=frame[1],
                is_extended_id=True,
                timestamp=stamp_s(at_s),
            )
        )

    def _angle_rad(self, position_deg: float) -> float:
        return self._settings.direction * radians(position_deg - self._zero_deg)

    @property
    def _erpm_s_per_rad(self) -> float:
        return (
            self._settings.direction
            * self._settings.gear_ratio
            * self._settings.pole_pairs
            * 60.0
            / tau
        )

    @property
    def _torque_per_A(self) -> float:
        return (
            self._settings.direction
            * self._settings.gear_ratio
            * self._settings.torque_constant_Nm_per_A
        )

    def stale_set_point(self) -> Sequence[can.Message]:
        """None stays: the driver takes the torque away before it enables the drive."""
        return ()

    def fail(self) -> str:
        self.set_error(TOO_MUCH_CURRENT)
        return r"error 2 \(motor current above its limit\)"

    def refuse(self) -> str:
        self.refuse_with(ENCODER)
        return r"refuses with error 5 \(encoder fault\)"


def _read_line(line: str) -> tuple[str, float]:
    """Name and value of `NAME = VALUE UNIT`; on and off are 1 and 0. The tool keeps what is
    entered at once, so that there is nothing to be saved.
    """
    if line.strip() == "save":
        return "save", 1.0
    name, _, text = line.partition("=")
    words = text.split()
    if words and words[0] in ("on", "off"):
        return name.strip(), float(words[0] == "on")
    try:
        return name.strip(), float(words[0])
    except (IndexError, ValueError):
        raise BadInput(f"the tool has no field for {line.strip()[:80]!r}") from None


def cubemars_events(motor: CubemarsMitTwin | CubemarsServoTwin) -> Mapping[str, Callable[[], None]]:
    """One-time events inside the drive, by the name of the fault."""
    return {
        "encoder-jump": lambda: motor.leap(JUMP_RAD),
        "over-temperature": lambda: motor.set_error(TOO_HOT),
        "encoder-lost": lambda: motor.set_error(ENCODER),
        "stalled": lambda: motor.set_error(STALLED),
        "refuses": lambda: motor.refuse_with(TOO_HOT),
        **drive_events(motor),
    }


FAULTS = DriveFaults(
    (
        Fault(
            "encoder-jump",
            "the encoder slips: the drive's position reads a quarter of a turn more from now on",
            once=True,
        ),
        Fault("over-temperature", "the drive stops with error 1, motor too hot", once=True),
        Fault("encoder-lost", "the drive stops with error 5, encoder fault", once=True),
        Fault("stalled", "the drive stops with error 7, motor stalled", once=True),
        Fault("refuses", "every later attempt to enable the drive ends in error 1", once=True),
        *DRIVE_FAULTS,
    ),
    cubemars_events,
)


def make_mit_twin(
    bus: can.BusABC, keys: CubemarsMitSection, gains: LoopGains, watchdog_s: float | None
) -> CubemarsMitTwin:
    """The twin of a drive in MIT mode that [motor] names. Its gains come over the wire; of
    `gains` it only uses the torque limit.
    """
    settings = keys.to_dataclass(
        MitTwinSettings, torque_limit_Nm=gains.torque_limit_Nm, watchdog_s=watchdog_s
    )
    return CubemarsMitTwin(bus, settings)


def make_servo_twin(
    bus: can.BusABC, keys: CubemarsServoSection, gains: LoopGains, watchdog_s: float | None
) -> CubemarsServoTwin:
    """The twin of a drive in servo mode that [motor] names."""
    settings = keys.to_dataclass(
        ServoTwinSettings,
        gains=gains,
        status_period_s=keys.status_period_ms / 1e3,
        watchdog_s=watchdog_s,
    )
    return CubemarsServoTwin(bus, settings)


def make_new_mit_twin(
    bus: can.BusABC, keys: CubemarsMitSection, gains: LoopGains
) -> CubemarsMitTwin:
    """The same drive as it leaves its maker."""
    settings = keys.to_dataclass(MitTwinSettings, torque_limit_Nm=gains.torque_limit_Nm)
    return CubemarsMitTwin(bus, replace(settings, drive_id=NEW_DRIVE_ID))


def make_new_servo_twin(
    bus: can.BusABC, keys: CubemarsServoSection, gains: LoopGains
) -> CubemarsServoTwin:
    """The same drive as it leaves its maker."""
    settings = keys.to_dataclass(
        ServoTwinSettings, gains=gains, status_period_s=NEW_STATUS_PERIOD_S
    )
    return CubemarsServoTwin(bus, replace(settings, drive_id=NEW_DRIVE_ID))
