"""Driver for an ODrive (CANSimple protocol) on a CAN bus: its settings, its messages and its
commands.

Messages are time-stamped, and kept apart from those of other nodes.
"""

from dataclasses import dataclass, replace
from math import inf

import can
import numpy as np

from rfca_rig.clock import Clock
from rfca_rig.devices.odrive import codec, messages
from rfca_rig.devices.odrive.messages import (
    WATCHDOG_EXPIRED,
    AxisState,
    ControlMode,
    EncoderEstimates,
    Heartbeat,
    Iq,
    OdriveCommand,
    OdriveFirmware,
    OdrivePart,
    PartError,
    Temperatures,
    Torques,
    Version,
    error_text,
    part_error_text,
    result_text,
    state_text,
)
from rfca_rig.devices.odrive.section import OdriveSection
from rfca_rig.drivers.device_time import FrameCount
from rfca_rig.drivers.drive_report import (
    WATCHDOG_REMEDY,
    DriveReceiver,
    EncoderJumpMonitor,
    ShaftGear,
    check_command,
    check_positive,
    refuse_late_answers,
)
from rfca_rig.drivers.motor_drive import MotorDrive
from rfca_rig.drivers.reading_check import (
    CURRENT,
    POSITION,
    SPEED,
    TEMPERATURE,
    TORQUE,
    OptionalReading,
    ReadingCheck,
    describe_bad,
)
from rfca_rig.drivers.roles import MotorStatus, ShaftSamples
from rfca_rig.errors import BadInput, DeviceError

# Time given to a drive to answer a request for part errors, in s.
PART_ERROR_S = 0.05
# Time given to a drive to answer a question.
ANSWER_PATIENCE_S = 0.5
# Time without a temperature until it is a fault. Overheating takes longer than this.
MAX_SILENCE_S = 10.0


@dataclass(frozen=True)
class OdriveSettings(ShaftGear):
    """Settings of the drive.

    `gear_ratio` is motor turns per shaft turn, `direction` +1 or -1, `zero_turns` the encoder
    reading in turns with the shaft horizontal. With `torque_constant_Nm_per_A` None the torque
    comes from message 0x1C, else from the measured current 0x14. `encoder_period_s` is the drive's
    cyclic period of message 0x09. `dialect` is that of its firmware; 0.5 reports no torque, so it
    needs the torque constant. Raises BadInput for invalid values.
    """

    node_id: int
    gear_ratio: float = 1.0
    direction: int = 1
    zero_turns: float = 0.0
    torque_constant_Nm_per_A: float | None = None
    encoder_period_s: float = 1e-3
    # Longer than three heartbeat periods of 0.1 s.
    heartbeat_timeout_s: float = 0.35
    enable_timeout_s: float = 1.0
    dialect: OdriveFirmware = OdriveFirmware.V0_6

    def __post_init__(self) -> None:
        # Six bits of the arbitration id hold the node; 63 is the broadcast address of drives
        # without one.
        if not 0 <= self.node_id < 63:
            raise BadInput(f"drive: node_id is {self.node_id}, must be 0..62")
        self.check_gear()
        for name in ("encoder_period_s", "heartbeat_timeout_s", "enable_timeout_s"):
            check_positive(name, getattr(self, name))
        if self.torque_constant_Nm_per_A is not None:
            check_positive("torque_constant_Nm_per_A", self.torque_constant_Nm_per_A)
        # Message 0x1C exists only in firmware 0.6; without it the torque has to come from the
        # current.
        elif self.dialect == OdriveFirmware.V0_5:
            raise BadInput(
                "drive: torque_constant_Nm_per_A is missing; firmware 0.5 tells the "
                "motor's current, not its torque "
                "(8.27 / the motor's KV in rpm/V, as in motor.config.torque_constant)"
            )


class TemperatureTelemetry:
    """`warmest_C` is the higher of the two temperatures; None before the first message, and
    without any thermistor.
    """

    def __init__(self) -> None:
        self.warmest_C: float | None = None
        self.inverter = OptionalReading(
            "the drive", replace(TEMPERATURE, name="inverter temperature")
        )
        self.motor = OptionalReading("the drive", replace(TEMPERATURE, name="motor temperature"))
        self._reported_s = 0.0

    def update(self, now_s: float, inverter_C: float, motor_C: float) -> None:
        """Takes in one message, received at host time `now_s`."""
        self._reported_s = now_s
        self.inverter.take(inverter_C)
        self.motor.take(motor_C)
        known_C = [
            value for value in (self.inverter.value, self.motor.value) if not np.isnan(value)
        ]
        self.warmest_C = max(known_C, default=None)

    def fault(self, now_s: float) -> str | None:
        """Set if temperatures that were reported have stopped: a limit on them would no longer
        protect the motor.
        """
        if self.warmest_C is None or now_s - self._reported_s <= MAX_SILENCE_S:
            return None
        return (
            f"no temperature for {now_s - self._reported_s:.0f} s, though the drive reported "
            "it before; check its temperature_msg_rate_ms"
        )


class OdriveReports(DriveReceiver):
    """Receives the messages of one node. `beat` is its last heartbeat, received at host time
    `beat_s`; `turns` its encoder position.

    `part_errors` are the error words of its parts, as far as they were requested (firmware 0.5).
    """

    def __init__(self, bus: can.BusABC, clock: Clock, settings: OdriveSettings) -> None:
        super().__init__(bus, clock, WATCHDOG_REMEDY)
        self._settings = settings
        self._rad_per_turn = settings.shaft_rad_per_turn
        self._torque_ratio = settings.shaft_torque_per_drive_torque
        self._count = FrameCount(settings.encoder_period_s)
        # Turns, turns/s and motor torque of frames that have no time stamp yet; None for one that
        # was refused.
        self._arrived: list[tuple[float, float, float, float] | None] = []
        self._encoder_check = ReadingCheck("the drive", POSITION, SPEED)
        torque_field = CURRENT
        if settings.torque_constant_Nm_per_A is None:
            torque_field = TORQUE
        self._torque_check = ReadingCheck("the drive", torque_field)
        self._torque_Nm = np.nan
        self._leap = EncoderJumpMonitor()
        self.temperature = TemperatureTelemetry()
        self.beat: Heartbeat | None = None
        self.beat_s = self._torque_s = self.drained_s
        self.turns = np.nan
        self.firmware = "unknown"
        self.firmware_s = -inf
        self.part_errors: dict[OdrivePart, int] = {}
        self.reset_counters()

    def reset_counters(self) -> None:
        self._foreign_nodes: set[int] = set()
        self._own_frames = self._torque_frames = 0
        self.heard = self.heartbeats = 0

    @property
    def lost_frames(self) -> int:
        return self._count.lost

    @property
    def silent_s(self) -> float:
        return self.drained_s - self.beat_s

    @property
    def zero_lost(self) -> str | None:
        return self._leap.fault

    @property
    def temperature_C(self) -> float | None:
        return self.temperature.warmest_C

    @property
    def doubts(self) -> str | None:
        return (
            self.zero_lost
            or self._count.fault
            or self.temperature.fault(self.drained_s)
            or self.health.fault
        )

    @property
    def torque_age_s(self) -> float:
        return self.drained_s - self._torque_s

    @property
    def bad_reports(self) -> str:
        """How many reports were refused because of impossible numbers, by signal."""
        temperatures = self.temperature.inverter.check.bad, self.temperature.motor.check.bad
        return describe_bad(self._encoder_check.bad, self._torque_check.bad, *temperatures)

    @property
    def torque_source(self) -> str:
        if self._settings.torque_constant_Nm_per_A is None:
            return "torques (0x1C)"
        return "motor currents (0x14)"

    def missing(self) -> str | None:
        node = self._settings.node_id
        if self._own_frames == 0 and self._foreign_nodes:
            others = ", ".join(map(str, sorted(self._foreign_nodes)))
            return f"CAN frames from node {others} but none from node {node}; check node_id"
        # The order of the checks leads the user from the wiring to single messages.
        if self._own_frames == 0:
            return (
                "no frames at all on the CAN bus; check the drive's power, the wiring, the "
                "termination and the bit rate"
            )
        needed = 1
        # A first heartbeat with an error may predate the clearing of the error.
        if self.beat is not None and self.beat.error:
            needed = 2
        if self.heartbeats < needed:
            return (
                f"no heartbeat from node {node}; set the drive's {self._rate('heartbeat')} to 100"
            )
        if self.heard == 0:
            return (
                f"no encoder estimates from node {node}; set its {self._rate('encoder')} to "
                f"{1e3 * self._settings.encoder_period_s:g}"
            )
        if self._torque_frames == 0:
            older = self._settings.dialect == OdriveFirmware.V0_5
            if older:
                or_dialect = " (iq_rate_ms)"
            else:
                or_dialect = ', or dialect = "0.5" if its firmware is 0.5'
            return (
                f"no {self.torque_source} from node {node}; set the cyclic rate of that "
                f"message in the drive{or_dialect}"
            )
        return None

    def _rate(self, message: str) -> str:
        """The drive's setting for the period of a cyclic message; its name changed with firmware
        0.6.
        """
        if self._settings.dialect == OdriveFirmware.V0_5:
            return f"{message}_rate_ms"
        return f"{message}_msg_rate_ms"

    def _take(self, message: can.Message, arrived_s: float) -> None:
        if message.is_extended_id or message.dlc == 0:
            # CANSimple uses standard frames only. An empty frame is a request or command by another
            # master.
            return
        if codec.node_of(message.arbitration_id) != self._settings.node_id:
            self._foreign_nodes.add(codec.node_of(message.arbitration_id))
        else:
            self._own_frames += 1
            self._handle_message(
                codec.decode(message.arbitration_id, message.data, self._settings.dialect),
                arrived_s,
            )

    def _handle_message(self, message: messages.Message | None, arrived_s: float) -> None:
        constant = self._settings.torque_constant_Nm_per_A
        match message:
            case EncoderEstimates():
                self.heard += 1
                if self._encoder_check.accept(message.position_turns, message.speed_turns_s):
                    self.turns = message.position_turns
                    # Torque comes in its own message; each encoder row carries the latest torque.
                    self._arrived.append(
                        (
                            arrived_s,
                            message.position_turns,
                            message.speed_turns_s,
                            self._torque_Nm,
                        )
                    )
                else:
                    # It keeps its place, because the time of the others comes from counting.
                    self._arrived.append(None)
            # Firmware 0.6 reports torque. With a torque constant set, the measured q current is
            # used instead.
            case Torques() if constant is None:
                self._take_torque(message.estimate_Nm, 1.0)
            case Iq() if constant is not None:
                self._take_torque(message.measured_A, constant)
            case Heartbeat():
                self.heartbeats += 1
                self.beat = message
                self.beat_s = self.drained_s
            case Temperatures():
                self.temperature.update(self.drained_s, message.inverter_degC, message.motor_degC)
            case PartError():
                self.part_errors[message.part] = message.word
            case Version():
                self.firmware = ".".join(map(str, message.firmware))
                self.firmware_s = self.drained_s

    def _take_torque(self, reported: float, torque_per_reported_Nm: float) -> None:
        """Takes in a torque in N m, or a current in A with the torque constant."""
        if self._torque_check.accept(reported):
            self._torque_frames += 1
            self._torque_s = self.drained_s
            self._torque_Nm = torque_per_reported_Nm * reported

    def _stamp(self, is_whole: bool) -> None:
        """Time-stamps the new rows. After a long pause frames may be missing anywhere, so no
        jump is looked for.
        """
        arrived = self._arrived
        if not arrived:
            return
        self._arrived = []
        zero_turns = self._settings.zero_turns
        rad = self._rad_per_turn
        ratio = self._torque_ratio
        host_s = self.drained_s
        follow = self._leap.follow
        stamps_s = self._count.list_stamps(len(arrived), host_s)
        for device_s, row in zip(stamps_s, arrived, strict=True):
            # Without a torque, which follows in its own message, a row of the first moments is no
            # sample yet.
            if row is None or row[3] != row[3]:
                continue
            arrived_s, turns, turns_s, torque_Nm = row
            angle_rad = (turns - zero_turns) * rad
            speed_rad_s = turns_s * rad
            follow(host_s, device_s, angle_rad, speed_rad_s, is_whole)
            self._rows.append((arrived_s, device_s, angle_rad, speed_rad_s, torque_Nm * ratio))


class OdriveMotor(MotorDrive):
    """Commands an ODrive, which closes the position loop itself.

    Any frame to the drive feeds its watchdog, so this class sends nothing on its own. Firmware 0.5
    keeps separate errors for motor, encoder and controller; `read` requests such an error once a
    heartbeat announces it (the motor is off then).
    """

    report_name = "heartbeat"
    remedy = WATCHDOG_REMEDY

    _reports: OdriveReports

    def __init__(self, bus: can.BusABC, clock: Clock, settings: OdriveSettings) -> None:
        super().__init__(bus, clock, settings.heartbeat_timeout_s)
        self._settings = settings
        self._reports = OdriveReports(bus, clock, settings)
        self._mode: ControlMode | None = None
        self._asked_parts: set[OdrivePart] = set()
        self._can_be_asked = True

    def enable(self) -> None:
        """Energises the motor and holds the shaft: the set-point is the measured angle before the
        loop closes.

        Raises DeviceError, and leaves the motor idle, if

        - no frame, no frame of this node, or none of its heartbeat, encoder or torque messages
          arrives;
        - the encoder messages come at another rate than configured;
        - it answers late, so that its readings are old from the start;
        - the drive refuses with an error.
        """
        self._begin_enabling()
        self._reports.part_errors.clear()
        self._asked_parts.clear()
        self._send_frame(codec.clear_errors(self._settings.node_id, self._settings.dialect))
        asked_s = self._ask_version()
        self._await_reports()
        # Firmware 0.6 answers a version request, 0.5 does not. A heartbeat decoded in the wrong
        # dialect would be wrong.
        if self._settings.dialect == OdriveFirmware.V0_5 and self._reports.firmware != "unknown":
            raise DeviceError(
                f'drive not enabled: its firmware is {self._reports.firmware}; set dialect = "0.6"'
            )
        if self._settings.dialect == OdriveFirmware.V0_6 and self._can_be_asked:
            refuse_late_answers(asked_s, self._ask_version, self._await_version)
        self._refuse_if(_is_faulty(self._beat()), "still reports")
        # Set-point first, then mode, then closed loop: an old set-point in the drive would make the
        # shaft jump.
        hold = codec.set_input_pos(self._settings.node_id, self._reports.turns)
        self._send_frame(hold)
        self._set_mode(ControlMode.POSITION)
        self._send_frame(codec.set_axis_state(self._settings.node_id, AxisState.CLOSED_LOOP))
        self._await_closed_loop(hold)
        self._armed = True

    def _ask_version(self) -> float:
        """Asks for the firmware; returns when."""
        self._send_frame(codec.request(self._settings.node_id, OdriveCommand.VERSION), remote=True)
        return self._clock.now_s()

    def _await_version(self, asked_s: float) -> float | None:
        """When the answer came; None where it does not come in time, as not every adapter
        carries questions (remote frames).
        """
        while self._reports.firmware_s <= asked_s:
            if self._clock.now_s() - asked_s > ANSWER_PATIENCE_S:
                # Not waited for again at every later start.
                self._can_be_asked = False
                return None
            self._wait_and_drain()
            # The watchdog may run in idle too; a set-point does nothing there.
            self._send_frame(codec.set_input_pos(self._settings.node_id, self._reports.turns))
        return self._reports.firmware_s

    def _await_reports(self) -> None:
        configured_s = self._settings.encoder_period_s
        measured_s = self._await_cyclic_reports(configured_s, self._settings.enable_timeout_s)
        if measured_s is not None:
            raise DeviceError(
                f"drive not enabled: encoder estimates come every {1e3 * measured_s:.2g} "
                "ms, the settings say "
                f"{1e3 * configured_s:g} ms; set the drive's encoder_msg_rate_ms, or "
                f"encoder_period_ms in the rig file: {self._setup_command}"
            )

    def _ask_for_part_errors(self) -> None:
        beat = self._reports.beat
        if beat is None:
            return
        for part in sorted(set(beat.failed) - self._asked_parts):
            self._send_frame(codec.request(self._settings.node_id, codec.PART_COMMANDS[part]))
            self._asked_parts.add(part)

    def _await_closed_loop(self, hold: codec.Frame) -> None:
        self._reports.reset_counters()
        deadline_s = self._clock.now_s() + self._settings.enable_timeout_s
        # A new heartbeat is required, as the last one was sent before the request.
        while self._reports.heartbeats == 0 or self._beat().state != AxisState.CLOSED_LOOP:
            self._refuse_if(
                self._reports.heartbeats > 0 and _is_faulty(self._beat()),
                "refuses closed loop with",
            )
            self._refuse_if(
                self._clock.now_s() > deadline_s,
                f"not in closed loop after {self._settings.enable_timeout_s:g} s:",
            )
            self._wait_and_drain()
            # The watchdog may already run in closed loop, so the same set-point is repeated.
            self._send_frame(hold)
        self._refuse_if(_is_faulty(self._beat()), "refuses closed loop with")

    def _refuse_if(self, refused: bool, how: str) -> None:
        if refused:
            beat = self._beat()
            self.disable()
            # Waits briefly for the drive to report the error of each part.
            self._ask_for_part_errors()
            deadline_s = self._clock.now_s() + PART_ERROR_S
            while (
                self._asked_parts - self._reports.part_errors.keys()
                and self._clock.now_s() < deadline_s
            ):
                self._wait_and_drain()
            if self._settings.dialect == OdriveFirmware.V0_6:
                result = f", procedure result {result_text(beat.procedure_result)}"
            else:
                result = ""
            raise DeviceError(
                f"drive not enabled: node {self._settings.node_id} {how} "
                f"{self._errors(beat)}, state {state_text(beat.state)}{result}"
            )

    def _errors(self, beat: Heartbeat) -> str:
        """Text of the drive's error word and of its parts' error words, as far as they are
        known.
        """
        errors = self._reports.part_errors
        texts = [error_text(beat.error, self._settings.dialect)]
        for part in beat.failed:
            if part in errors:
                texts.append(part_error_text(part, errors[part]))
            else:
                texts.append(f"{part} error, which one is not reported")
        return "; ".join(texts)

    def _beat(self) -> Heartbeat:
        if self._reports.beat is None:
            raise DeviceError(
                f"no heartbeat from node {self._settings.node_id} yet; enable the drive first"
            )
        return self._reports.beat

    def command_speed(self, speed_rad_s: float) -> None:
        """Commands a shaft speed. Raises DeviceError if the frame cannot be sent."""
        self._send_frame(
            codec.set_input_vel(
                self._settings.node_id, self._settings.turns_s(check_command(speed_rad_s, "speed"))
            )
        )
        self._set_mode(ControlMode.VELOCITY)

    def command_angle(self, angle_rad: float, speed_rad_s: float = 0.0) -> None:
        """Commands a shaft angle. Raises DeviceError if the frame cannot be sent, or above
        32.767 motor turns/s of feed-forward.
        """
        turns = self._settings.turns(check_command(angle_rad, "angle"))
        turns_s = self._settings.turns_s(check_command(speed_rad_s, "speed"))
        self._send_frame(codec.set_input_pos(self._settings.node_id, turns, turns_s))
        self._set_mode(ControlMode.POSITION)

    def _set_mode(self, mode: ControlMode) -> None:
        """Switches the controller mode. Call it after the set-point is sent, so a new mode never
        acts on an old set-point.
        """
        if mode != self._mode:
            self._send_frame(codec.set_controller_mode(self._settings.node_id, mode))
            self._mode = mode

    def disable(self) -> None:
        """Disables the motor within 20 ms. Raises DeviceError if the frame cannot be sent; its
        watchdog then stops the motor.
        """
        self._mode = None
        self._stop([_message(codec.set_axis_state(self._settings.node_id, AxisState.IDLE))])

    def _await_torque_off(self, limit_s: float) -> float:
        """Sends nothing until the heartbeat shows an expired watchdog and an idle motor; the
        heartbeat alone takes up to 0.1 s to show it.
        """
        took_s = self._await_watchdog(limit_s, self._watchdog_has_expired, self._wait_and_drain)
        if took_s is None:
            raise DeviceError(
                f"drive's watchdog let it run through {limit_s:g} s of silence; set "
                f"enable_watchdog and watchdog_timeout: {self._setup_command}"
            )
        return took_s

    @property
    def _setup_command(self) -> str:
        """The command that helps with a wrong setting; firmware 0.5 saves nothing over CAN."""
        if self._settings.dialect == OdriveFirmware.V0_5:
            return "rfca-rig setup motor --rig RIG --print has the lines for odrivetool"
        return "rfca-rig setup motor --rig RIG --endpoints FILE --write"

    def _watchdog_has_expired(self) -> bool:
        beat = self._beat()
        expired = beat.error & WATCHDOG_EXPIRED[self._settings.dialect]
        return expired != 0 and beat.state == AxisState.IDLE

    def read(self) -> ShaftSamples:
        """Samples (m,) since the last call. Raises DeviceError if the bus fails or a frame
        cannot be decoded.
        """
        self._reports.drain()
        self._ask_for_part_errors()
        return self._reports.samples()

    def status(self) -> MotorStatus:
        """State of the drive. A motor that left closed loop on its own is at fault, even if the
        error word is zero.
        """
        beat = self._reports.beat
        if beat is None:
            return self._make_status("unknown")
        state = state_text(beat.state)
        error = exit_text = None
        if _is_faulty(beat):
            error = self._errors(beat)
        # Firmware 0.5 can fall back to idle with an error word of zero, so the state is checked,
        # not only the word.
        if beat.state != AxisState.CLOSED_LOOP:
            exit_text = (
                f"left closed loop for {state} without an error; was it stopped from elsewhere, "
                "or restarted?"
            )
        return self._make_status(state, error, exit_text)

    def identity(self) -> dict[str, str]:
        """For the recording. The firmware version is known after `enable`."""
        return {
            "make": "ODrive, CANSimple",
            "bus": str(self._bus.channel_info),
            "node_id": str(self._settings.node_id),
            "dialect": self._settings.dialect.value,
            "firmware": self._reports.firmware,
            "gear_ratio": repr(self._settings.gear_ratio),
            "direction": str(self._settings.direction),
            "zero_turns": repr(self._settings.zero_turns),
            "encoder_period_s": repr(self._settings.encoder_period_s),
            "torque_from": self._reports.torque_source,
            "encoder_frames_lost": str(self._reports.lost_frames),
            "bad_reports": self._reports.bad_reports,
            **self._reports.health.facts(),
        }

    def _send_frame(self, frame: codec.Frame, remote: bool = False) -> None:
        self._send(_message(frame, remote))


def _message(frame: codec.Frame, remote: bool = False) -> can.Message:
    return can.Message(
        arbitration_id=frame[0], data=frame[1], is_extended_id=False, is_remote_frame=remote
    )


def _is_faulty(beat: Heartbeat) -> bool:
    return beat.error != 0 or len(beat.failed) > 0


def make_driver(keys: OdriveSection, bus: can.BusABC, clock: Clock, silent_s: float) -> OdriveMotor:
    """The driver of the drive that [motor] names."""
    settings = keys.to_dataclass(
        OdriveSettings,
        encoder_period_s=keys.encoder_period_ms / 1e3,
        heartbeat_timeout_s=silent_s,
        dialect=OdriveFirmware(keys.dialect),
    )
    return OdriveMotor(bus, clock, settings)
