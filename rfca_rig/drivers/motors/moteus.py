"""Driver for a moteus on a CAN-FD bus."""

from math import isfinite, nan

import can

from rfca_rig.clock import Clock
from rfca_rig.codecs import moteus
from rfca_rig.codecs.moteus import Route, Subframe, Write
from rfca_rig.codecs.moteus_registers import Mode, Register, Width, fault_text, mode_text
from rfca_rig.drivers.can_frames import send, send_stop
from rfca_rig.drivers.motors.moteus_replies import IDENTITY_QUERY, STATE_QUERY, MoteusReplies, MoteusSettings, MoteusState
from rfca_rig.drivers.roles import MotorStatus, ShaftSamples
from rfca_rig.errors import DeviceError

__all__ = ["MoteusMotor", "MoteusSettings"]

POLL_S = 2e-3
# A negative limit switches off the drive's own trajectory planning.
NO_LIMIT = -1.0
# Modes that a drive passes through between the first command and position mode.
STARTING = frozenset({Mode.STOPPED, Mode.ENABLING, Mode.CALIBRATING, Mode.CALIBRATED})
# Fault codes from 96 on (limits 96-103) name what limits the output of a running drive; they are no faults.
MIN_LIMIT_CODE = 96


class MoteusMotor:
    """A `ShaftMotor` over any `can.BusABC` that carries CAN-FD. Waits only through the clock, and only in `enable` and `prove_watchdog`.

    A moteus replies only when asked. Every command requests a reply, and a `read` without a command before it sends its own request,
    so that a reply is there for the next `read`. Only commands feed the drive's watchdog, and they result directly from calls; a
    caller that hangs therefore lets the drive stop the motor. Each command writes the mode first, which resets all other command
    registers, so no old set-point can take effect. The drive's own trajectories (servo.default_velocity_limit, default_accel_limit)
    are switched off in each command, as targets come every few milliseconds. Only `enable` starts the drive: once it has stopped for
    any reason, further commands do not move it.
    """

    def __init__(self, bus: can.BusABC, clock: Clock, settings: MoteusSettings) -> None:
        self._bus = bus
        self._clock = clock
        self._settings = settings
        self._replies = MoteusReplies(bus, clock, settings)
        self._asked = False
        self._armed = False
        # State of the drive when it left position mode on its own; None while it has not.
        self._exit_state: MoteusState | None = None

    def enable(self) -> None:
        """Energises the motor and holds the shaft: the drive starts from the angle that it measures itself at that moment.

        Raises DeviceError, and leaves the motor off, if no answer of this drive arrives, a register is missing, or the drive refuses
        with a fault.
        """
        self.disable()
        if self._replies.zero_lost is not None:
            raise DeviceError(f"drive not enabled: {self._replies.zero_lost}, then start again")
        self._replies.drain()
        self._replies.reset_counters()
        self._send(IDENTITY_QUERY, wants_reply=True)
        self._await_stopped()
        self._await_position_mode()
        self._armed = True

    def _await_stopped(self) -> None:
        """Waits for the stopped mode. Stopping clears old faults; a persistent one remains."""
        deadline_s = self._clock.now_s() + self._settings.enable_timeout_s
        while self._replies.answers == 0 or self._state().mode != Mode.STOPPED:
            if self._clock.now_s() > deadline_s and (missing := self._replies.missing()) is not None:
                raise DeviceError(f"drive not enabled: within {self._settings.enable_timeout_s:g} s {missing}")
            self._refuse_if(self._clock.now_s() > deadline_s, f"does not stop within {self._settings.enable_timeout_s:g} s:")
            self._ask()
            self._wait_and_drain()

    def _await_position_mode(self) -> None:
        deadline_s = self._clock.now_s() + self._settings.enable_timeout_s
        while self._state().mode != Mode.POSITION:
            self._refuse_if(self._state().mode not in STARTING, "refuses position mode with")
            self._refuse_if(self._clock.now_s() > deadline_s, f"not in position mode after {self._settings.enable_timeout_s:g} s:")
            self._command(nan, 0.0)
            self._wait_and_drain()

    def _refuse_if(self, refused: bool, how: str) -> None:
        if refused:
            state = self._state()
            self.disable()
            fault = f"{fault_text(state.fault)}, " if state.fault else ""
            raise DeviceError(f"drive not enabled: drive {self._settings.drive_id} {how} {fault}mode {mode_text(state.mode)}")

    def _state(self) -> MoteusState:
        if self._replies.state is None:
            raise DeviceError(f"no answer from drive {self._settings.drive_id} yet; enable the drive first")
        return self._replies.state

    def command_speed(self, speed_rad_s: float) -> None:
        """Commands a shaft speed. Raises DeviceError if the frame cannot be sent."""
        self._move(nan, self._settings.turns_s(_finite(speed_rad_s, "speed")))

    def command_angle(self, angle_rad: float, speed_rad_s: float = 0.0) -> None:
        """Commands a shaft angle that moves on at the given speed. Raises DeviceError if the frame cannot be sent."""
        turns, turns_s = self._settings.turns(_finite(angle_rad, "angle")), self._settings.turns_s(_finite(speed_rad_s, "speed"))
        self._move(turns, turns_s)

    def _move(self, turns: float, turns_s: float) -> None:
        """Sends a command. Any command would restart a stopped moteus, so one that left position mode is kept stopped and only queried.

        A fault or timeout is latched until a stop, and a stop would erase it.
        """
        if self._armed and self._exit_state is None:
            self._command(turns, turns_s)
        elif self._exit_state is not None and self._exit_state.mode not in {Mode.FAULT, Mode.TIMEOUT}:
            self._ask((Write(Register.MODE, Width.INT8, Mode.STOPPED),))
        else:
            self._ask()

    def _command(self, turns: float, turns_s: float) -> None:
        """Sends position mode with a state query. NaN for `turns` lets the drive continue from its own target."""
        settings = self._settings
        # The limit is set at the shaft; NaN leaves the drive's own limit in force.
        limit_Nm = nan if settings.torque_limit_Nm is None else settings.torque_limit_Nm / settings.gear_ratio
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
        self._send((Write(Register.MODE, Width.INT8, Mode.POSITION), *writes, *STATE_QUERY), wants_reply=True)
        self._note_request()

    def _ask(self, orders: tuple[Write, ...] = ()) -> None:
        self._send((*orders, *STATE_QUERY), wants_reply=True)
        self._note_request()

    def _note_request(self) -> None:
        self._replies.note_query()
        self._asked = True

    def disable(self) -> None:
        """Disables the motor within 20 ms. Raises DeviceError if the frame cannot be sent; its watchdog then stops the motor."""
        self._armed, self._exit_state = False, None
        send_stop(self._bus, self._clock, [self._message((Write(Register.MODE, Width.INT8, Mode.STOPPED),), wants_reply=False)])

    def prove_watchdog(self, limit_s: float) -> float:
        """Sends queries only until the drive reports a timeout; returns the time in s that this took.

        Call it with the shaft enabled and at rest; the motor is off afterwards. Raises DeviceError if nothing happened within
        `limit_s`.
        """
        started_s = self._clock.now_s()
        while self._state().mode != Mode.TIMEOUT:
            # A query does not feed the watchdog, so the mode can be polled while it runs out.
            if self._clock.now_s() - started_s > limit_s:
                self.disable()
                raise DeviceError(
                    f"drive's watchdog let it run through {limit_s:g} s of silence, mode {mode_text(self._state().mode)}; "
                    f"it was set to time out after {self._settings.watchdog_s:g} s (register 0x027), check its firmware"
                )
            self._ask()
            self._wait_and_drain()
        self.disable()
        return self._clock.now_s() - started_s

    def read(self) -> ShaftSamples:
        """Samples (m,) since the last call. Raises DeviceError if the bus fails or a frame cannot be decoded."""
        self._replies.drain()
        state = self._replies.state
        if self._armed and self._exit_state is None and state is not None and state.mode != Mode.POSITION:
            self._exit_state = state
        # A command already requested a reply; only a read without one needs its own query.
        if not self._asked:
            self._ask()
        self._asked = False
        return self._replies.samples()

    def status(self) -> MotorStatus:
        """State of the drive. A motor that left position mode on its own is at fault until it is enabled again, or disabled."""
        state = self._replies.state
        silent_s = self._replies.silent_s
        temperature_C = None if state is None else state.warmest_C
        return MotorStatus("unknown" if state is None else _state_text(state), self._fault(silent_s), silent_s, temperature_C)

    def _fault(self, silent_s: float) -> str | None:
        state, limit_s = self._exit_state or self._replies.state, self._settings.reply_timeout_s
        # The drive's own fault comes first, since it names the cause.
        if state is not None and state.mode == Mode.FAULT:
            return fault_text(state.fault)
        if self._replies.zero_lost is not None:
            return self._replies.zero_lost
        if self._exit_state is not None and self._exit_state.mode == Mode.TIMEOUT:
            return f"mode 11 (timeout: no command reached the drive for {self._settings.watchdog_s:g} s)"
        if self._exit_state is not None:
            return (
                f"left position mode for {mode_text(self._exit_state.mode)} without a fault; was it stopped from elsewhere, or restarted?"
            )
        if silent_s > limit_s:
            return f"no answer for {silent_s:.2f} s, limit {limit_s:g} s; check the drive's power and the CAN wiring"
        return self._replies.health.fault

    def identity(self) -> dict[str, str]:
        """For the recording. Model, firmware and serial number are known after `enable`."""
        settings, facts = self._settings, self._replies.facts
        return {
            "make": "moteus, multiplex protocol on CAN-FD",
            "bus": str(self._bus.channel_info),
            "drive_id": str(settings.drive_id),
            "model": _hexadecimal(facts.get(Register.MODEL_NUMBER), 1),
            "firmware": _version(facts.get(Register.FIRMWARE_VERSION)),
            "serial_number": "".join(_hexadecimal(facts.get(Register.SERIAL_NUMBER_1 + at), 8) for at in (2, 1, 0)),
            "gear_ratio": repr(settings.gear_ratio),
            "direction": str(settings.direction),
            "zero_turns": repr(settings.zero_turns),
            "watchdog_s": repr(settings.watchdog_s),
            "answers_lost": str(self._replies.lost),
            "restarts": str(self._replies.restarts),
            **self._replies.health.facts(),
        }

    def _send(self, subframes: tuple[Subframe, ...], wants_reply: bool) -> None:
        send(self._bus, self._message(subframes, wants_reply))

    def _message(self, subframes: tuple[Subframe, ...], wants_reply: bool) -> can.Message:
        settings = self._settings
        identifier = moteus.arbitration_id(Route(settings.own_id, settings.drive_id, wants_reply, settings.can_prefix))
        return can.Message(
            arbitration_id=identifier,
            is_extended_id=True,
            is_fd=True,
            bitrate_switch=settings.bitrate_switch,
            data=moteus.encode(subframes),
        )

    def _wait_and_drain(self) -> None:
        self._clock.wait_until(self._clock.now_s() + POLL_S)
        self._replies.drain()


def _state_text(state: MoteusState) -> str:
    """Mode as text. Fault codes of a running drive name what limits its output at the moment."""
    limited = state.mode != Mode.FAULT and state.fault >= MIN_LIMIT_CODE
    return f"{mode_text(state.mode)}, {fault_text(state.fault)}" if limited else mode_text(state.mode)


def _hexadecimal(value: float | None, digits: int) -> str:
    return "unknown" if value is None else f"{int(value) & 0xFFFFFFFF:0{digits}x}"


def _version(value: float | None) -> str:
    number = int(value or 0)
    # The register packs major, minor and micro version into one byte each.
    return "unknown" if value is None else f"{number >> 16}.{number >> 8 & 0xFF}.{number & 0xFF}"


def _finite(value: float, name: str) -> float:
    if not isfinite(value):
        raise DeviceError(f"commanded {name} is {value}; nothing was sent to the drive")
    return value
