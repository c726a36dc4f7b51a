"""Driver for a moteus on a CAN-FD bus: its settings, its replies and its commands.

Replies are decoded, kept apart from those of other drives, and time-stamped.
"""

from collections import deque
from dataclasses import dataclass, replace
from math import inf, isfinite, nan

import can

from rfca_rig.clock import Clock
from rfca_rig.devices.moteus import codec
from rfca_rig.devices.moteus.codec import (
    LARGEST_ID,
    LARGEST_PREFIX,
    Mode,
    Read,
    Refusal,
    Register,
    Reply,
    Route,
    Subframe,
    Width,
    Write,
    fault_text,
    mode_text,
    name_of,
    register_error_text,
)
from rfca_rig.devices.moteus.section import MoteusSection
from rfca_rig.drivers.can_frames import EMERGENCY_STOP_REMEDY
from rfca_rig.drivers.device_time import CounterClock
from rfca_rig.drivers.drive_report import (
    DriveReceiver,
    EncoderJumpMonitor,
    ShaftGear,
    check_command,
    check_positive,
    refuse_late_answers,
)
from rfca_rig.drivers.motor_drive import MotorDrive
from rfca_rig.drivers.reading_check import (
    POSITION,
    SPEED,
    TEMPERATURE,
    TORQUE,
    OptionalReading,
    ReadingCheck,
    Signal,
    describe_bad,
)
from rfca_rig.drivers.roles import MotorStatus, ShaftSamples
from rfca_rig.errors import BadInput, DeviceError

# A negative limit switches off the drive's own trajectory planning.
NO_LIMIT = -1.0
# Modes that a drive passes through between the first command and position mode.
STARTING = frozenset({Mode.STOPPED, Mode.ENABLING, Mode.CALIBRATING, Mode.CALIBRATED})
# Fault codes from 96 on (limits 96-103) name what limits the output of a running drive; they are no
# faults.
MIN_LIMIT_CODE = 96
# Counts of the millisecond counter.
COUNTER_SPAN = 1 << 32
# The vendor's tools use source id 0, and answers go to the id that asked.
OWN_ID = 0x20

STATE_QUERY = (
    Read(Register.MODE, Width.INT8),
    Read(Register.POSITION, Width.FLOAT),
    Read(Register.VELOCITY, Width.FLOAT),
    Read(Register.TORQUE, Width.FLOAT),
    Read(Register.MOTOR_TEMPERATURE, Width.INT16),
    Read(Register.VOLTAGE, Width.INT16),
    Read(Register.TEMPERATURE, Width.INT16),
    Read(Register.FAULT, Width.INT16),
    Read(Register.MILLISECOND_COUNTER, Width.INT32),
)
# A reply without these registers is no state. Voltage and temperatures are only shown, so they may
# be missing.
_REQUIRED = frozenset(read.register for read in STATE_QUERY) - {
    Register.VOLTAGE,
    Register.TEMPERATURE,
    Register.MOTOR_TEMPERATURE,
}

# The drive's numbers, in the order of STATE_SIGNALS. An integer register that the drive cannot fill
# is NaN.
STATE_REGISTERS = (
    Register.POSITION,
    Register.VELOCITY,
    Register.TORQUE,
    Register.MODE,
    Register.FAULT,
    Register.MILLISECOND_COUNTER,
)
STATE_SIGNALS = (
    POSITION,
    SPEED,
    TORQUE,
    Signal("mode", "(register 0x000)", 0.0, 127.0),
    Signal("fault", "(register 0x00f)", 0.0, 32767.0),
    Signal("millisecond counter", "ms", -(2.0**31), 2.0**32),
)

IDENTITY_QUERY = tuple(
    Read(register, Width.INT32)
    for register in (
        Register.MODEL_NUMBER,
        Register.FIRMWARE_VERSION,
        Register.REGISTER_MAP_VERSION,
        Register.SERIAL_NUMBER_1,
        Register.SERIAL_NUMBER_2,
        Register.SERIAL_NUMBER_3,
    )
)


@dataclass(frozen=True)
class MoteusSettings(ShaftGear):
    """Settings of the drive.

    `gear_ratio` is turns of the drive's output per shaft turn; it is 1 for a gear that
    motor_position.rotor_to_output_ratio already includes. `direction` is +1 or -1, `zero_turns` the
    drive's position with the shaft horizontal. `watchdog_s` is sent with every command: the drive
    stops the motor if no other follows within that time. `torque_limit_Nm` applies at the shaft;
    None keeps the drive's own. Raises BadInput for invalid values.
    """

    drive_id: int = 1
    own_id: int = OWN_ID
    can_prefix: int = 0
    gear_ratio: float = 1.0
    direction: int = 1
    zero_turns: float = 0.0
    watchdog_s: float = 0.1
    torque_limit_Nm: float | None = None
    reply_timeout_s: float = 0.35
    enable_timeout_s: float = 1.0
    bitrate_switch: bool = True

    def __post_init__(self) -> None:
        if not 1 <= self.drive_id <= LARGEST_ID:
            raise BadInput(f"drive: drive_id is {self.drive_id}, must be 1..{LARGEST_ID}")
        if not 0 <= self.own_id <= LARGEST_ID or self.own_id == self.drive_id:
            raise BadInput(
                f"drive: own_id is {self.own_id}, must be 0..{LARGEST_ID} and not the drive's"
            )
        if not 0 <= self.can_prefix <= LARGEST_PREFIX:
            raise BadInput(f"drive: can_prefix is {self.can_prefix}, must be 0..{LARGEST_PREFIX}")
        self.check_gear()
        for name in ("watchdog_s", "reply_timeout_s", "enable_timeout_s"):
            check_positive(name, getattr(self, name))
        if self.torque_limit_Nm is not None:
            check_positive("torque_limit_Nm", self.torque_limit_Nm)


@dataclass(frozen=True)
class MoteusState:
    """The last answer, in the drive's units."""

    mode: int
    fault: int
    position_turns: float
    uptime_s: float
    voltage_V: float
    temperature_degC: float
    motor_temperature_degC: float

    @property
    def warmest_C(self) -> float | None:
        """Higher of board and motor temperature in degrees C; None if neither is reported."""
        reported = [
            value
            for value in (self.temperature_degC, self.motor_temperature_degC)
            if isfinite(value)
        ]
        return max(reported, default=None)


class MoteusReplies(DriveReceiver):
    """Receives replies. `state` is the drive's last answer, `facts` holds its identity registers,
    read when it was enabled.

    A drive answers each query once. An answer therefore belongs to the query whose time fits its
    millisecond counter best; older queries without an answer count as lost. `host_s` of a sample is
    the time of the query, within 1 ms of the time of the measurement.
    """

    def __init__(self, bus: can.BusABC, clock: Clock, settings: MoteusSettings) -> None:
        super().__init__(bus, clock, EMERGENCY_STOP_REMEDY)
        self._settings = settings
        self._time = CounterClock()
        self._asked_s: deque[float] = deque()
        self._stamped_s = -1.0
        self._leap = EncoderJumpMonitor()
        self._check = ReadingCheck("the drive", *STATE_SIGNALS)
        self._temperature = OptionalReading(
            "the drive", replace(TEMPERATURE, name="board temperature")
        )
        self._motor_temperature = OptionalReading(
            "the drive", replace(TEMPERATURE, name="motor temperature")
        )
        self.state: MoteusState | None = None
        self.facts: dict[int, float] = {}
        self.facts_s = -inf
        self.lost = 0
        self.reset_counters()

    def reset_counters(self) -> None:
        """Open queries are forgotten too."""
        self._asked_s.clear()
        self._foreign_ids: set[int] = set()
        self._refusals: dict[int, int] = {}
        self.heard = 0

    def note_query(self) -> None:
        """Notes that a state query has been sent."""
        self._asked_s.append(self._clock.now_s())

    @property
    def silent_s(self) -> float:
        """Age in s of the oldest open query, 0 if none is open. A drive that is not asked sends
        nothing.
        """
        if self._asked_s:
            return self.drained_s - self._asked_s[0]
        return 0.0

    @property
    def bad_reports(self) -> str:
        """How many answers were refused because of impossible numbers, by signal."""
        return describe_bad(
            self._check.bad, self._temperature.check.bad, self._motor_temperature.check.bad
        )

    @property
    def restarts(self) -> int:
        return self._time.restarts

    @property
    def temperature_C(self) -> float | None:
        if self.state is None:
            return None
        return self.state.warmest_C

    @property
    def uptime_s(self) -> float | None:
        if self.state is None:
            return None
        return self.state.uptime_s

    @property
    def doubts(self) -> str | None:
        return self.zero_lost

    @property
    def zero_lost(self) -> str | None:
        if self.restarts:
            return (
                "the drive restarted, its millisecond counter began again; turns that it had "
                "counted are lost: find its zero again"
            )
        return self._leap.fault

    def missing(self) -> str | None:
        drive = self._settings.drive_id
        if self._refusals:
            refused = ", ".join(
                f"{name_of(register)}: {register_error_text(code)}"
                for register, code in self._refusals.items()
            )
            return (
                f"drive {drive} cannot tell {refused}; check that its firmware knows that "
                "register, and update it"
            )
        if self.heard > 0:
            return None
        if self._foreign_ids:
            others = ", ".join(map(str, sorted(self._foreign_ids)))
            return (
                f"CAN frames from id {others} but no answer from drive {drive}; check "
                "drive_id and can_prefix"
            )
        return (
            f"no answer from drive {drive}, and no other frames on the CAN bus; check the "
            "drive's power, the wiring, the termination, "
            "drive_id (a moteus speaks only when asked), and that the interface does "
            "CAN-FD at 1 and 5 Mbit/s"
        )

    def _take(
        self,
        message: can.Message,
        arrived_s: float,  # noqa: ARG002 (an answer shows the shaft at its request)
    ) -> None:
        route = codec.route_of(message.arbitration_id)
        if route.wants_reply or route.source == self._settings.own_id:
            # A request: by another master, or our own echoed by the adapter.
            return
        if (route.source, route.prefix) != (self._settings.drive_id, self._settings.can_prefix):
            self._foreign_ids.add(route.source)
        elif route.destination == self._settings.own_id:
            self._handle_subframes(codec.decode(message.data))

    def _handle_subframes(self, subframes: list[Subframe]) -> None:
        values = {item.register: item.value for item in subframes if isinstance(item, Reply)}
        self._refusals |= {
            item.register: item.code
            for item in subframes
            if isinstance(item, Refusal) and item.register in _REQUIRED
        }
        if values.keys() >= _REQUIRED:
            self._take_state(values)
        else:
            self.facts |= values
            self.facts_s = self.drained_s

    def _take_state(self, values: dict[int, float]) -> None:
        if not self._asked_s:
            # No query is open: the frame was duplicated on the way.
            return
        # A drive whose encoder failed may report NaN; its fault is the cause, and comes first.
        if (
            values[Register.MODE] == Mode.FAULT
            and self.state is not None
            and isfinite(values[Register.FAULT])
        ):
            self.state = replace(self.state, mode=Mode.FAULT, fault=int(values[Register.FAULT]))
        if not self._check.accept(*(values[register] for register in STATE_REGISTERS)):
            # It answers the oldest query as far as one can tell: its counter may be what is wrong.
            self._asked_s.popleft()
            return
        counter = int(values[Register.MILLISECOND_COUNTER])
        asked_s = self._match_query(counter)
        self._temperature.take(values.get(Register.TEMPERATURE, nan))
        self._motor_temperature.take(values.get(Register.MOTOR_TEMPERATURE, nan))
        self.heard += 1
        self.state = MoteusState(
            mode=int(values[Register.MODE]),
            fault=int(values[Register.FAULT]),
            position_turns=values[Register.POSITION],
            # The register is read as a signed number; it wraps after 49.7 days.
            uptime_s=counter % COUNTER_SPAN / 1e3,
            voltage_V=values.get(Register.VOLTAGE, nan),
            temperature_degC=self._temperature.value,
            motor_temperature_degC=self._motor_temperature.value,
        )
        stamp_s = self._time.stamp(counter, asked_s)
        # Two answers with the same time carry the same sample.
        if stamp_s > self._stamped_s:
            self._stamped_s = stamp_s
            self._add_row(
                asked_s,
                stamp_s,
                values[Register.POSITION],
                values[Register.VELOCITY],
                values[Register.TORQUE],
            )

    def _add_row(
        self, asked_s: float, stamp_s: float, turns: float, turns_s: float, torque_Nm: float
    ) -> None:
        settings = self._settings
        per_turn = settings.shaft_rad_per_turn
        self._rows.append(
            (
                asked_s,
                stamp_s,
                (turns - settings.zero_turns) * per_turn,
                turns_s * per_turn,
                torque_Nm * settings.shaft_torque_per_drive_torque,
            )
        )
        # A jump is the same in either direction of the shaft, so the sign is left out here.
        self._leap.follow(asked_s, stamp_s, abs(per_turn) * turns, abs(per_turn) * turns_s)

    def _match_query(self, counter: int) -> float:
        """Time of the open query that the answer with this counter belongs to. Older ones are
        dropped.
        """
        best = min(
            range(len(self._asked_s)),
            key=lambda index: self._time.distance_s(counter, self._asked_s[index]),
        )
        for _ in range(best):
            self._asked_s.popleft()
        self.lost += best
        return self._asked_s.popleft()


class MoteusMotor(MotorDrive):
    """Commands a moteus, which closes the position loop itself. Its bus carries CAN-FD.

    A moteus replies only when asked. Every command requests a reply, and a `read` without a command
    before it sends its own request, so that a reply is there for the next `read`. Only commands
    feed the drive's watchdog. Each command writes the mode first, which resets all other command
    registers, so no old set-point can take effect. The drive's own trajectories
    (servo.default_velocity_limit, default_accel_limit) are switched off in each command, as targets
    come every few milliseconds. Only `enable` starts the drive: once it has stopped for any reason,
    further commands do not move it.
    """

    report_name = "answer"

    _reports: MoteusReplies

    def __init__(self, bus: can.BusABC, clock: Clock, settings: MoteusSettings) -> None:
        super().__init__(bus, clock, settings.reply_timeout_s)
        self._settings = settings
        self._reports = MoteusReplies(bus, clock, settings)
        self._asked = False
        # State of the drive when it left position mode on its own; None while it has not.
        self._exit_state: MoteusState | None = None

    def enable(self) -> None:
        """Energises the motor and holds the shaft: the drive starts from the angle that it measures
        itself at that moment.

        Raises DeviceError, and leaves the motor off, if no answer of this drive arrives or it comes
        late, a register is missing, or the drive refuses with a fault.
        """
        self._begin_enabling()
        self._reports.reset_counters()
        asked_s = self._ask_identity()
        self._await_stopped()
        refuse_late_answers(asked_s, self._ask_identity, self._await_identity)
        self._await_position_mode()
        self._armed = True

    def _ask_identity(self) -> float:
        """Asks for registers that no other question reads; returns when."""
        self._send_query(IDENTITY_QUERY)
        return self._clock.now_s()

    def _await_identity(self, asked_s: float) -> float | None:
        """When the answer came; None where it does not come in time."""
        while self._reports.facts_s <= asked_s:
            if self._clock.now_s() - asked_s > self._settings.enable_timeout_s:
                return None
            self._wait_and_drain()
        return self._reports.facts_s

    def _await_stopped(self) -> None:
        """Waits for the stopped mode. Stopping clears old faults; a persistent one remains."""
        deadline_s = self._clock.now_s() + self._settings.enable_timeout_s
        while self._reports.heard == 0 or self._state().mode != Mode.STOPPED:
            if (
                self._clock.now_s() > deadline_s
                and (missing := self._reports.missing()) is not None
            ):
                raise DeviceError(
                    f"drive not enabled: within {self._settings.enable_timeout_s:g} s {missing}"
                )
            self._refuse_if(
                self._clock.now_s() > deadline_s,
                f"does not stop within {self._settings.enable_timeout_s:g} s:",
            )
            self._ask_and_drain()

    def _await_position_mode(self) -> None:
        deadline_s = self._clock.now_s() + self._settings.enable_timeout_s
        while self._state().mode != Mode.POSITION:
            self._refuse_if(self._state().mode not in STARTING, "refuses position mode with")
            self._refuse_if(
                self._clock.now_s() > deadline_s,
                f"not in position mode after {self._settings.enable_timeout_s:g} s:",
            )
            self._command(nan, 0.0)
            self._wait_and_drain()

    def _refuse_if(self, refused: bool, how: str) -> None:
        if refused:
            state = self._state()
            fault = ""
            if state.fault:
                fault = f"{fault_text(state.fault)}, "
            self._refuse(
                f"drive {self._settings.drive_id} {how} {fault}mode {mode_text(state.mode)}"
            )

    def _state(self) -> MoteusState:
        if self._reports.state is None:
            raise DeviceError(
                f"no answer from drive {self._settings.drive_id} yet; enable the drive first"
            )
        return self._reports.state

    def command_speed(self, speed_rad_s: float) -> None:
        """Commands a shaft speed. Raises DeviceError if the frame cannot be sent."""
        self._move(nan, self._settings.turns_s(check_command(speed_rad_s, "speed")))

    def command_angle(self, angle_rad: float, speed_rad_s: float = 0.0) -> None:
        """Commands a shaft angle that moves on at the given speed. Raises DeviceError if the
        frame cannot be sent.
        """
        turns = self._settings.turns(check_command(angle_rad, "angle"))
        turns_s = self._settings.turns_s(check_command(speed_rad_s, "speed"))
        self._move(turns, turns_s)

    def _move(self, turns: float, turns_s: float) -> None:
        """Sends a command. Any command would restart a stopped moteus, so one that left position
        mode is kept stopped and only queried.

        A fault or timeout is latched until a stop, and a stop would erase it.
        """
        if self._armed and self._exit_state is None:
            self._command(turns, turns_s)
        elif self._exit_state is not None and self._exit_state.mode not in {
            Mode.FAULT,
            Mode.TIMEOUT,
        }:
            self._ask((Write(Register.MODE, Width.INT8, Mode.STOPPED),))
        else:
            self._ask()

    def _command(self, turns: float, turns_s: float) -> None:
        """Sends position mode with a state query. NaN for `turns` lets the drive continue from
        its own target.
        """
        settings = self._settings
        # The limit is set at the shaft; NaN leaves the drive's own limit in force.
        if settings.torque_limit_Nm is None:
            limit_Nm = nan
        else:
            limit_Nm = settings.torque_limit_Nm / settings.gear_ratio
        commands = (
            (Register.COMMAND_POSITION, turns),
            (Register.COMMAND_VELOCITY, turns_s),
            (Register.COMMAND_MAXIMUM_TORQUE, limit_Nm),
            (Register.COMMAND_TIMEOUT, settings.watchdog_s),
            (Register.COMMAND_VELOCITY_LIMIT, NO_LIMIT),
            (Register.COMMAND_ACCELERATION_LIMIT, NO_LIMIT),
        )
        writes = (Write(register, Width.FLOAT, value) for register, value in commands)
        # The mode comes first, as writing it resets the registers that follow.
        mode = Write(Register.MODE, Width.INT8, Mode.POSITION)
        self._send_query((mode, *writes, *STATE_QUERY))
        self._note_request()

    def _ask(self, orders: tuple[Write, ...] = ()) -> None:
        self._send_query((*orders, *STATE_QUERY))
        self._note_request()

    def _note_request(self) -> None:
        self._reports.note_query()
        self._asked = True

    def disable(self) -> None:
        """Disables the motor within 20 ms. Raises DeviceError if the frame cannot be sent; its
        watchdog then stops the motor.
        """
        self._exit_state = None
        stopped = Write(Register.MODE, Width.INT8, Mode.STOPPED)
        self._stop([self._message((stopped,), wants_reply=False)])

    def _await_torque_off(self, limit_s: float) -> float:
        """Sends queries only until the drive reports a timeout."""
        took_s = self._await_watchdog(limit_s, self._has_timed_out, self._ask_and_drain)
        if took_s is None:
            raise DeviceError(
                f"drive's watchdog let it run through {limit_s:g} s of silence, mode "
                f"{mode_text(self._state().mode)}; "
                f"it was set to time out after {self._settings.watchdog_s:g} s "
                "(register 0x027), check its firmware"
            )
        return took_s

    def _has_timed_out(self) -> bool:
        return self._state().mode == Mode.TIMEOUT

    def _ask_and_drain(self) -> None:
        # A query does not feed the watchdog, so the mode can be polled while it runs out.
        self._ask()
        self._wait_and_drain()

    def read(self) -> ShaftSamples:
        """Samples (m,) since the last call. Raises DeviceError if the bus fails or a frame
        cannot be decoded.
        """
        self._reports.drain()
        state = self._reports.state
        if (
            self._armed
            and self._exit_state is None
            and state is not None
            and state.mode != Mode.POSITION
        ):
            self._exit_state = state
        # A command already requested a reply; only a read without one needs its own query.
        if not self._asked:
            self._ask()
        self._asked = False
        return self._reports.samples()

    def status(self) -> MotorStatus:
        """State of the drive. A motor that left position mode on its own is at fault until it is
        enabled again, or disabled.
        """
        state = self._reports.state
        if state is None:
            return self._make_status("unknown")
        last = self._exit_state or state
        error = exit_text = None
        if last.mode == Mode.FAULT:
            error = fault_text(last.fault)
        if self._exit_state is not None and last.mode == Mode.TIMEOUT:
            exit_text = (
                "mode 11 (timeout: no command reached the drive for "
                f"{self._settings.watchdog_s:g} s)"
            )
        elif self._exit_state is not None:
            exit_text = (
                f"left position mode for {mode_text(last.mode)} without a fault; "
                "was it stopped from elsewhere, or restarted?"
            )
        return self._make_status(_state_text(state), error, exit_text)

    def identity(self) -> dict[str, str]:
        """For the recording. Model, firmware and serial number are known after `enable`."""
        settings = self._settings
        facts = self._reports.facts
        return {
            "make": "moteus, multiplex protocol on CAN-FD",
            "bus": str(self._bus.channel_info),
            "drive_id": str(settings.drive_id),
            "model": _hexadecimal(facts.get(Register.MODEL_NUMBER), 1),
            "firmware": _version(facts.get(Register.FIRMWARE_VERSION)),
            "serial_number": "".join(
                _hexadecimal(facts.get(Register.SERIAL_NUMBER_1 + at), 8) for at in (2, 1, 0)
            ),
            "gear_ratio": repr(settings.gear_ratio),
            "direction": str(settings.direction),
            "zero_turns": repr(settings.zero_turns),
            "watchdog_s": repr(settings.watchdog_s),
            "answers_lost": str(self._reports.lost),
            "bad_reports": self._reports.bad_reports,
            "restarts": str(self._reports.restarts),
            **self._reports.health.facts(),
        }

    def _send_query(self, subframes: tuple[Subframe, ...]) -> None:
        self._send(self._message(subframes, wants_reply=True))

    def _message(self, subframes: tuple[Subframe, ...], wants_reply: bool) -> can.Message:
        settings = self._settings
        identifier = codec.arbitration_id(
            Route(settings.own_id, settings.drive_id, wants_reply, settings.can_prefix)
        )
        return can.Message(
            arbitration_id=identifier,
            is_extended_id=True,
            is_fd=True,
            bitrate_switch=settings.bitrate_switch,
            data=codec.encode(subframes),
        )


def _state_text(state: MoteusState) -> str:
    """Mode as text. Fault codes of a running drive name what limits its output at the moment."""
    limited = state.mode != Mode.FAULT and state.fault >= MIN_LIMIT_CODE
    if limited:
        return f"{mode_text(state.mode)}, {fault_text(state.fault)}"
    return mode_text(state.mode)


def _hexadecimal(value: float | None, digits: int) -> str:
    if value is None:
        return "unknown"
    return f"{int(value) & 0xFFFFFFFF:0{digits}x}"


def _version(value: float | None) -> str:
    number = int(value or 0)
    # The register packs major, minor and micro version into one byte each.
    if value is None:
        return "unknown"
    return f"{number >> 16}.{number >> 8 & 0xFF}.{number & 0xFF}"


def make_driver(keys: MoteusSection, bus: can.BusABC, clock: Clock, silent_s: float) -> MoteusMotor:
    """The driver of the drive that [motor] names."""
    settings = keys.to_dataclass(
        MoteusSettings, watchdog_s=keys.watchdog_ms / 1e3, reply_timeout_s=silent_s
    )
    return MoteusMotor(bus, clock, settings)
