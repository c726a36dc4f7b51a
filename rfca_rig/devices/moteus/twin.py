"""Twin of a moteus drive, on a CAN-FD bus, and the faults that can be injected into it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf, isinf, isnan, nan, tau

import can

from rfca_rig.devices import USUAL_WATCHDOG_S
from rfca_rig.devices.moteus import codec, console
from rfca_rig.devices.moteus.codec import (
    ClientStreamData,
    Mode,
    Read,
    Refusal,
    Register,
    Reply,
    Route,
    ServerStreamData,
    StreamPoll,
    Subframe,
    Width,
    Write,
)
from rfca_rig.devices.moteus.section import MoteusSection
from rfca_rig.devices.moteus.twin_console import MoteusConsole
from rfca_rig.errors import MalformedFrame
from rfca_rig.twin_server.faults import (
    DRIVE_FAULTS,
    DriveDialect,
    DriveFaults,
    Fault,
    drive_events,
    replace_data,
)
from rfca_rig.twins.drive_parts import (
    DriveTwin,
    Encoder,
    LoopGains,
    MotorThermalModel,
    ThermalParameters,
    reading_after_power_up,
)
from rfca_rig.twins.world import ShaftDrive, ShaftState

# Error codes of a refused register access.
UNKNOWN_REGISTER = 1
NOT_WRITEABLE = 2
NOT_ALLOWED = 3
IDENTITY_REGISTERS: dict[int, float] = {
    Register.MODEL_NUMBER: 1,
    Register.FIRMWARE_VERSION: 0x010304,
    Register.REGISTER_MAP_VERSION: 5,
    Register.SERIAL_NUMBER_1: 1,
    Register.SERIAL_NUMBER_2: 2,
    Register.SERIAL_NUMBER_3: 3,
}
# Fault codes.
NOT_CONFIGURED = 36
OVER_TEMPERATURE = 38
OUTSIDE_LIMIT = 39
OTHER_PROGRAM_ID = 5
# Step of the fault `encoder-jump`.
JUMP_TURNS = 1.0
COMMANDABLE = frozenset({Mode.STOPPED, Mode.POSITION, Mode.ZERO_VELOCITY})
# For all other command registers NaN means the default.
NAN_NOT_ALLOWED = frozenset(
    {Register.COMMAND_FEEDFORWARD_TORQUE, Register.COMMAND_KP_SCALE, Register.COMMAND_KD_SCALE}
)


@dataclass(frozen=True)
class MoteusGains:
    """Gains of servo.pid_position, converted to the shaft, and the torque that
    servo.max_current_A allows.
    """

    kp_Nm_per_rad: float = 160.0
    ki_Nm_per_rad_s: float = 0.0
    kd_Nm_s_per_rad: float = 8.0
    torque_limit_Nm: float = 40.0


@dataclass(frozen=True)
class PositionCommand:
    """Command registers after a frame that writes the mode, converted to the shaft. Fields not
    written have these defaults.
    """

    angle_rad: float = 0.0
    speed_rad_s: float = 0.0
    feed_forward_Nm: float = 0.0
    kp_scale: float = 1.0
    kd_scale: float = 1.0
    torque_limit_Nm: float = nan
    timeout_s: float = 0.0


class MoteusLoop:
    """Control loop with a moving target. `law` is the torque until the next step; `advance`
    advances the target.

    A target at rest acts like a spring during the whole step; a moving one with its force at the
    beginning of the step. The target does not wait for a blocked shaft (servo.max_position_slip is
    off, the factory setting).
    """

    def __init__(self, gains: MoteusGains) -> None:
        self._gains = gains
        self._command = PositionCommand()
        # Limits of the target in rad (servopos.position_min and position_max).
        self._lowest_rad = -inf
        self._highest_rad = inf
        self.reset()

    def limit_target(self, lowest_rad: float, highest_rad: float) -> None:
        """From now on the target stays within these limits."""
        self._lowest_rad = lowest_rad
        self._highest_rad = highest_rad

    def reset(self) -> None:
        """Clears target and integrator, as every mode without a position does."""
        self._target_rad = nan
        self._integral_Nm = 0.0
        self._limited = False

    def take(self, command: PositionCommand) -> None:
        """Takes a command. A commanded angle becomes the target at once; without one the target
        continues from its present value.
        """
        if isnan(command.speed_rad_s):
            command = replace(command, speed_rad_s=0.0)
        self._command = command
        if not isnan(command.angle_rad):
            self._target_rad = self._clip(command.angle_rad)

    def _clip(self, target_rad: float) -> float:
        return min(max(target_rad, self._lowest_rad), self._highest_rad)

    def law(self, shaft: ShaftState) -> ShaftDrive:
        """Torque law, limited at the beginning of the step. Beyond the limit the whole law is
        scaled down, as in `SpeedLoop`.
        """
        # Without a target, after a reset, the loop starts from the measured angle.
        if isnan(self._target_rad):
            self._target_rad = shaft.angle_rad
        free = self._law_without_limit(shaft)
        torque_Nm = abs(free.torque_Nm(shaft.angle_rad, shaft.speed_rad_s))
        limit_Nm = self._limit_Nm()
        self._limited = torque_Nm > limit_Nm
        if self._limited:
            return free.scale(limit_Nm / torque_Nm)
        return free

    def _law_without_limit(self, shaft: ShaftState) -> ShaftDrive:
        command = self._command
        gains = self._gains
        kp = gains.kp_Nm_per_rad * command.kp_scale
        speed_rad_s = self._target_speed_rad_s()
        feed_Nm = command.feed_forward_Nm + self._integral_Nm
        # A spring to a fixed angle would lag behind a moving target, so its force is held for the
        # step.
        if speed_rad_s != 0.0:
            feed_Nm += kp * (self._target_rad - shaft.angle_rad)
            kp = 0.0
        return ShaftDrive(
            feed_Nm=feed_Nm,
            angle_gain_Nm_per_rad=kp,
            angle_rad=self._target_rad,
            speed_gain_Nm_s_per_rad=gains.kd_Nm_s_per_rad * command.kd_scale,
            speed_rad_s=speed_rad_s,
        )

    def _target_speed_rad_s(self) -> float:
        """Speed of the target; none at a limit that it runs into."""
        speed_rad_s = self._command.speed_rad_s
        if speed_rad_s > 0.0 and self._target_rad >= self._highest_rad:
            return 0.0
        if speed_rad_s < 0.0 and self._target_rad <= self._lowest_rad:
            return 0.0
        return speed_rad_s

    def _limit_Nm(self) -> float:
        if isnan(self._command.torque_limit_Nm):
            commanded_Nm = inf
        else:
            commanded_Nm = self._command.torque_limit_Nm
        return min(commanded_Nm, self._gains.torque_limit_Nm)

    def advance(self, elapsed_s: float, before: ShaftState, after: ShaftState) -> None:
        """Advances the target, and the integrator by the mean error of the step; at the torque
        limit it is held (anti-windup).
        """
        moved_rad = self._target_speed_rad_s() * elapsed_s
        # Mean error of the step: target and shaft at their middle (trapezoidal rule).
        error_rad = self._target_rad + 0.5 * moved_rad - 0.5 * (before.angle_rad + after.angle_rad)
        if not self._limited:
            self._integral_Nm += self._gains.ki_Nm_per_rad_s * error_rad * elapsed_s
        self._target_rad = self._clip(self._target_rad + moved_rad)


def damping(gains: MoteusGains, shaft: ShaftState, limit_Nm: float) -> ShaftDrive:
    """Torque law of a drive that brakes towards speed zero, with at most `limit_Nm`."""
    free = ShaftDrive(speed_gain_Nm_s_per_rad=gains.kd_Nm_s_per_rad)
    torque_Nm = abs(free.torque_Nm(shaft.angle_rad, shaft.speed_rad_s))
    if torque_Nm > limit_Nm:
        return free.scale(limit_Nm / torque_Nm)
    return free


@dataclass(frozen=True)
class MoteusTwinSettings:
    """Configuration of the drive. `default_timeout_s` (servo.default_timeout_s) applies if a
    command gives none.

    With `keeps_timeouts` False the drive has no watchdog. `arming_fault` is the fault code that
    every attempt to start ends in; 0 for a healthy drive. In a timeout the drive brakes with at
    most `timeout_torque_Nm` (servo.timeout_max_torque_Nm). With `is_new` it has the settings of the
    factory instead, until others are written and saved.
    """

    drive_id: int = 1
    can_prefix: int = 0
    gear_ratio: float = 1.0
    direction: int = 1
    zero_turns: float = 0.0
    zero_policy: str | None = None
    rotor_to_output_ratio: float = 1.0
    gains: MoteusGains = field(default_factory=MoteusGains)
    default_timeout_s: float = 0.1
    timeout_torque_Nm: float = 5.0
    starting_s: float = 0.02
    voltage_V: float = 24.0
    temperature_degC: float = 30.0
    keeps_timeouts: bool = True
    arming_fault: int = 0
    is_new: bool = False
    warming: ThermalParameters = field(default_factory=ThermalParameters)


class MoteusTwin(DriveTwin):
    """A `MotorTwin` that answers queries.

    A world advances it in steps: `take_frames`, `drive`, then, after the plant has moved,
    `advance`. Answers are sent in `drive`. They show the shaft at that time, and the mode before
    the command in the same frame, as the firmware does. Trajectories under velocity or acceleration
    limits are not planned: targets take effect at once. The diagnostic stream takes the commands of
    `MoteusConsole`; id, prefix, timeout and limits of the position act as set there.
    """

    tells_temperature = True

    def __init__(self, bus: can.BusABC, settings: MoteusTwinSettings) -> None:
        self._bus = bus
        self._settings = settings
        self._loop = MoteusLoop(settings.gains)
        self._mode = self._wanted = Mode.STOPPED
        self._fault = 0
        self._command = self._in_force = PositionCommand()
        self._commanded_s = self._now_s = self._powered_s = 0.0
        self._started_s = 0.0
        self._restarts = False
        # The position that the drive reports with the leg horizontal.
        self._zero_turns = settings.zero_turns
        self.encoder = Encoder()
        self.warmth = MotorThermalModel(settings.warming)
        self._answers: list[Callable[[ShaftState], None]] = []
        self._console = MoteusConsole(
            _saved_settings(settings), partial(self._stop, Mode.STOPPED, 0)
        )
        if settings.is_new:
            self._console.reset_to_factory()

    def take_frames(self, now_s: float) -> None:
        """Executes received frames; invalid ones are ignored. Commands feed the watchdog,
        queries do not.
        """
        self._now_s = now_s
        while (message := self._bus.recv(timeout=0)) is not None:
            route = codec.route_of(message.arbitration_id)
            if not message.is_remote_frame and not message.is_error_frame and self._is_mine(route):
                self._take(route, message.data)
        if (
            self._mode == Mode.CALIBRATING
            and self._now_s - self._started_s >= self._settings.starting_s
        ):
            self._mode = self._wanted
        self._check_watchdog()

    def _is_mine(self, route: Route) -> bool:
        return route.destination == self._drive_id and route.prefix == self._can_prefix

    @property
    def _drive_id(self) -> int:
        return int(self._console[console.ID])

    @property
    def _can_prefix(self) -> int:
        return int(self._console[console.CAN_PREFIX])

    def _take(self, route: Route, data: bytes | bytearray) -> None:
        try:
            subframes = codec.decode(data)
        except MalformedFrame:
            # The firmware does not report invalid frames either.
            return
        self._pass_on_stream(route, subframes)
        reads = [item for item in subframes if isinstance(item, Read)]
        # Saved before the writes: the answer shows the mode before the command in the same frame.
        mode = self._mode
        fault = self._fault
        refusals = self._obey([item for item in subframes if isinstance(item, Write)])
        if route.wants_reply and (reads or refusals):
            self._answers.append(
                lambda shaft: self._answer(
                    route, [*refusals, *self._read_registers(reads, mode, fault, shaft)]
                )
            )

    def _pass_on_stream(self, route: Route, subframes: list[Subframe]) -> None:
        """Passes the bytes of a stream to the console, and its answers back. Data are answered as
        polls are, if a reply is wanted.
        """
        for item in subframes:
            if isinstance(item, ClientStreamData) and item.channel == console.CHANNEL:
                self._console.take(item.data)
                max_bytes = codec.MAX_STREAM_BYTES
            elif isinstance(item, StreamPoll) and item.channel == console.CHANNEL:
                max_bytes = min(item.max_bytes, codec.MAX_STREAM_BYTES)
            else:
                continue
            if route.wants_reply:
                answer = ServerStreamData(item.channel, self._console.give(max_bytes))
                self._answer(route, [answer])

    def _obey(self, writes: list[Write]) -> list[Refusal]:
        """Executes writes; returns the refused ones. Writing the mode resets all command
        registers; later writes set them again.
        """
        refusals: list[Refusal] = []
        ordered: int | None = None
        for write in writes:
            if write.register == Register.MODE and write.value in COMMANDABLE:
                ordered = int(write.value)
                self._command = PositionCommand()
            elif write.register == Register.MODE:
                refusals.append(Refusal(write.register, NOT_ALLOWED, of_write=True))
            elif (code := self._write(write)) != 0:
                refusals.append(Refusal(write.register, code, of_write=True))
        if ordered is not None:
            self._order(ordered)
        return refusals

    def _write(self, write: Write) -> int:
        """Writes a command register; returns 0, or the error code."""
        rad = self._rad_per_turn
        ratio = self._torque_ratio
        value = write.value
        changes: dict[int, dict[str, float]] = {
            Register.COMMAND_POSITION: {"angle_rad": (value - self._zero_turns) * rad},
            Register.COMMAND_VELOCITY: {"speed_rad_s": value * rad},
            Register.COMMAND_FEEDFORWARD_TORQUE: {"feed_forward_Nm": value * ratio},
            Register.COMMAND_KP_SCALE: {"kp_scale": value},
            Register.COMMAND_KD_SCALE: {"kd_scale": value},
            Register.COMMAND_MAXIMUM_TORQUE: {"torque_limit_Nm": value * abs(ratio)},
            Register.COMMAND_TIMEOUT: {"timeout_s": value},
            Register.COMMAND_STOP_POSITION: {},
            Register.COMMAND_VELOCITY_LIMIT: {},
            Register.COMMAND_ACCELERATION_LIMIT: {},
        }
        change = changes.get(write.register)
        if change is None:
            if write.register in set(Register):
                return NOT_WRITEABLE
            return UNKNOWN_REGISTER
        if isinf(value) or (isnan(value) and write.register in NAN_NOT_ALLOWED):
            return NOT_ALLOWED
        self._command = replace(self._command, **change)
        return 0

    def _order(self, mode: int) -> None:
        self._commanded_s = self._now_s
        self._in_force = self._command
        if mode == Mode.STOPPED:
            self._stop(Mode.STOPPED, 0)
        elif self._mode in {Mode.FAULT, Mode.TIMEOUT}:
            # Latched until the drive is stopped.
            return
        elif self._settings.arming_fault:
            self.set_error(self._settings.arming_fault)
        else:
            self._run(Mode(mode))

    def _run(self, mode: Mode) -> None:
        if self._mode == Mode.STOPPED:
            self._mode = Mode.CALIBRATING
            self._started_s = self._now_s
        elif self._mode != Mode.CALIBRATING:
            self._mode = mode
        self._wanted = mode
        if mode == Mode.POSITION:
            self._loop.limit_target(*self._limits_rad())
            self._loop.take(self._in_force)

    def _limits_rad(self) -> tuple[float, float]:
        """The lowest and the highest angle that servopos allows."""
        limits_rad = [
            (turns - self._zero_turns) * self._rad_per_turn
            for turns in (self._console[console.POSITION_MIN], self._console[console.POSITION_MAX])
        ]
        # The drive may count against the angle.
        if self._rad_per_turn < 0.0:
            limits_rad.reverse()
        lowest_rad, highest_rad = limits_rad
        return (
            -inf if isnan(lowest_rad) else lowest_rad,
            inf if isnan(highest_rad) else highest_rad,
        )

    def _check_watchdog(self) -> None:
        # A command without a timeout uses the default; NaN switches the timeout off.
        running = self._mode not in {Mode.STOPPED, Mode.FAULT, Mode.TIMEOUT}
        limit_s = self._in_force.timeout_s or self._console[console.DEFAULT_TIMEOUT]
        if (
            running
            and self._settings.keeps_timeouts
            and not isnan(limit_s)
            and self._now_s - self._commanded_s > limit_s
        ):
            self.time_out()

    def time_out(self) -> None:
        """Watchdog timeout: the drive brakes until it is stopped."""
        self._stop(Mode.TIMEOUT, 0)

    def set_error(self, code: int) -> None:
        """Puts the drive into a fault: no torque until it is stopped and commanded again."""
        self._stop(Mode.FAULT, code)

    def restart(self) -> None:
        """Power cycle: no torque, the millisecond counter starts at zero, and settings that were
        not saved are lost. The position of no stated policy stays.
        """
        self._stop(Mode.STOPPED, 0)
        self._console.start()
        self._powered_s = self._now_s
        self._restarts = True

    def _stop(self, mode: Mode, fault: int) -> None:
        self._mode = mode
        self._fault = fault
        self._loop.reset()

    def drive(self, shaft: ShaftState) -> ShaftDrive:
        """Sends the pending answers; returns the torque law on the shaft until the next step."""
        if self._restarts:
            self._restarts = False
            turns = self._zero_turns + shaft.angle_rad / self._rad_per_turn
            self._zero_turns += (
                reading_after_power_up(
                    turns,
                    self._settings.rotor_to_output_ratio,
                    self._settings.zero_policy or "absolute",
                )
                - turns
            )
        answers = self._answers
        self._answers = []
        for answer in answers:
            answer(shaft)
        if self._mode == Mode.CALIBRATING and self._wanted == Mode.POSITION:
            self._check_limits(shaft)
        if self._mode == Mode.POSITION:
            return self._loop.law(shaft)
        if self._mode in {Mode.TIMEOUT, Mode.ZERO_VELOCITY}:
            return damping(self._settings.gains, shaft, self._console[console.TIMEOUT_TORQUE])
        return ShaftDrive()

    def _check_limits(self, shaft: ShaftState) -> None:
        """A drive outside the limits of its position does not start."""
        lowest_rad, highest_rad = self._limits_rad()
        if not lowest_rad <= shaft.angle_rad <= highest_rad:
            self.set_error(OUTSIDE_LIMIT)

    def reset_to_factory(self) -> None:
        """The drive as it is delivered, with the power just switched on."""
        self._console.reset_to_factory()
        self.restart()

    def advance(
        self,
        elapsed_s: float,
        now_s: float,  # noqa: ARG002
        before: ShaftState,
        after: ShaftState,
        law: ShaftDrive,  # noqa: ARG002
    ) -> None:
        """Takes in a step of the plant. A moteus sends no reports unasked."""
        self.warmth.advance(elapsed_s, after.torque_Nm)
        if self._mode == Mode.POSITION:
            self._loop.advance(elapsed_s, before, after)

    def _read_registers(
        self, reads: list[Read], mode: int, fault: int, shaft: ShaftState
    ) -> list[Subframe]:
        values = self._values(mode, fault, shaft)
        answers: list[Subframe] = []
        for read in reads:
            if read.register in values:
                value = codec.clip_to_register(read.register, read.width, values[read.register])
                answers.append(Reply(read.register, read.width, value))
            else:
                answers.append(Refusal(read.register, UNKNOWN_REGISTER, of_write=False))
        return answers

    def _values(self, mode: int, fault: int, shaft: ShaftState) -> dict[int, float]:
        angle_rad, speed_rad_s = self.encoder.report(shaft.angle_rad, shaft.speed_rad_s)
        return {
            **IDENTITY_REGISTERS,
            Register.MODE: mode,
            Register.POSITION: self._zero_turns + angle_rad / self._rad_per_turn,
            Register.VELOCITY: speed_rad_s / self._rad_per_turn,
            Register.TORQUE: shaft.torque_Nm / self._torque_ratio,
            Register.Q_CURRENT: nan,
            Register.D_CURRENT: nan,
            Register.POWER: shaft.torque_Nm * shaft.speed_rad_s,
            Register.MOTOR_TEMPERATURE: self.warmth.reported_degC,
            Register.TRAJECTORY_COMPLETE: 1,
            Register.HOME_STATE: 1,
            Register.VOLTAGE: self._settings.voltage_V,
            Register.TEMPERATURE: self._settings.temperature_degC,
            Register.FAULT: fault,
            Register.COMMAND_TIMEOUT: self._in_force.timeout_s,
            Register.MILLISECOND_COUNTER: _wrap(int((self._now_s - self._powered_s) * 1e3 + 1e-6)),
        }

    def _answer(self, route: Route, subframes: list[Subframe]) -> None:
        identifier = codec.arbitration_id(
            Route(self._drive_id, route.source, prefix=self._can_prefix)
        )
        self._bus.send(
            can.Message(
                arbitration_id=identifier,
                is_extended_id=identifier > 0x7FF,
                is_fd=True,
                bitrate_switch=True,
                data=codec.encode(subframes),
            )
        )

    def stale_set_point(self) -> Sequence[can.Message]:
        """A position at a high speed, from another program."""
        order = (
            Write(Register.MODE, Width.INT8, Mode.POSITION),
            Write(Register.COMMAND_POSITION, Width.FLOAT, -3.0),
            Write(Register.COMMAND_VELOCITY, Width.FLOAT, 5.0),
        )
        identifier = codec.arbitration_id(
            Route(OTHER_PROGRAM_ID, self._drive_id, prefix=self._can_prefix)
        )
        return (
            can.Message(
                arbitration_id=identifier, is_extended_id=True, is_fd=True, data=codec.encode(order)
            ),
        )

    def fail(self) -> str:
        self.set_error(OVER_TEMPERATURE)
        return r"fault 38 \(over temperature: board or motor above its limit"

    def refuse(self) -> str:
        self._settings = replace(self._settings, arming_fault=NOT_CONFIGURED)
        return (
            r"refuses position mode with fault 36 \(motor not configured: run moteus_tool "
            r"--calibrate.*\), mode fault"
        )

    @property
    def _rad_per_turn(self) -> float:
        return self._settings.direction * tau / self._settings.gear_ratio

    @property
    def _torque_ratio(self) -> float:
        return self._settings.direction * self._settings.gear_ratio


def _saved_settings(settings: MoteusTwinSettings) -> dict[str, float]:
    """Settings of a drive that was set up for its rig, by their names in the drive."""
    return {
        console.ID: settings.drive_id,
        console.CAN_PREFIX: settings.can_prefix,
        console.POSITION_MIN: nan,
        console.POSITION_MAX: nan,
        console.DEFAULT_TIMEOUT: settings.default_timeout_s,
        console.TIMEOUT_TORQUE: settings.timeout_torque_Nm,
        console.POLES: 14,
    }


def _wrap(count: int) -> int:
    """Wraps a count to a signed 32 bit number, as the register holds it."""
    return (count + (1 << 31)) % (1 << 32) - (1 << 31)


class MoteusDialect(DriveDialect):
    """Interprets the frames of a moteus, which has no heartbeat, for the bus faults."""

    def shift_encoder(self, message: can.Message) -> can.Message:
        """The frame with the reported position shifted by one turn."""
        return replace_data(
            message, codec.encode([_shift_position(item) for item in codec.decode(message.data)])
        )


def _shift_position(item: Subframe) -> Subframe:
    if not isinstance(item, Reply) or item.register != Register.POSITION:
        return item
    return replace(
        item, value=codec.clip_to_register(item.register, item.width, item.value + JUMP_TURNS)
    )


def moteus_events(motor: MoteusTwin) -> Mapping[str, Callable[[], None]]:
    """One-time events inside the drive, by the name of the fault."""
    return {
        "watchdog-trip": motor.time_out,
        "over-temperature": lambda: motor.set_error(OVER_TEMPERATURE),
        "factory-settings": motor.reset_to_factory,
        **drive_events(motor),
    }


FAULTS = DriveFaults(
    (
        Fault("encoder-jump", "the drive's position reads one turn more"),
        Fault("watchdog-trip", "the drive times out, though commands reach it", once=True),
        Fault("over-temperature", "the drive stops with fault 38, over temperature", once=True),
        Fault("factory-settings", "the drive has its settings from the factory, id 1", once=True),
        *DRIVE_FAULTS,
    ),
    moteus_events,
    MoteusDialect(),
)


def make_twin(
    bus: can.BusABC, keys: MoteusSection, gains: LoopGains, watchdog_s: float | None
) -> MoteusTwin:
    """The twin of the drive that [motor] names."""
    return MoteusTwin(bus, _twin_settings(keys, gains, watchdog_s))


def make_new_twin(bus: can.BusABC, keys: MoteusSection, gains: LoopGains) -> MoteusTwin:
    """The same drive as it leaves its maker, whose own watchdog is on."""
    settings = _twin_settings(keys, gains, USUAL_WATCHDOG_S)
    return MoteusTwin(bus, replace(settings, is_new=True))


def _twin_settings(
    keys: MoteusSection, gains: LoopGains, watchdog_s: float | None
) -> MoteusTwinSettings:
    """Its one PID loop acts on an angle as the cascade of `gains` does."""
    # Cascade: torque = (kv + ki / s) (ka e - w) with kv the speed gain, ki its integral gain, ka
    # the angle gain. For a target at rest, its terms in e, in the integral of e and in w are kp, ki
    # and kd.
    own_gains = MoteusGains(
        kp_Nm_per_rad=gains.speed_gain_Nm_s_per_rad * gains.angle_gain_per_s
        + gains.integral_gain_Nm_per_rad,
        ki_Nm_per_rad_s=gains.integral_gain_Nm_per_rad * gains.angle_gain_per_s,
        kd_Nm_s_per_rad=gains.speed_gain_Nm_s_per_rad,
        torque_limit_Nm=gains.torque_limit_Nm,
    )
    return keys.to_dataclass(
        MoteusTwinSettings,
        gains=own_gains,
        # How long it waits comes with every command.
        keeps_timeouts=watchdog_s is not None,
    )
