"""Twin of an ODrive with firmware 0.6 or 0.5, on the CAN bus, and the faults that can be
injected into it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf, isfinite, tau
from typing import ClassVar

import can
import numpy as np
from numpy.typing import NDArray

from rfca_rig.devices.odrive import codec, messages
from rfca_rig.devices.odrive.memory import OdriveMemory
from rfca_rig.devices.odrive.messages import (
    ESTOP_REQUESTED,
    MISSING_INPUT,
    MODULATION_IS_NAN,
    WATCHDOG_EXPIRED,
    AxisState,
    ControlMode,
    EncoderEstimates,
    Heartbeat,
    Message,
    OdriveCommand,
    OdriveFirmware,
    OdrivePart,
    PartError,
    RebootAction,
    SdoOpcode,
    Version,
)
from rfca_rig.devices.odrive.section import OdriveSection
from rfca_rig.devices.odrive.settings import (
    BAUD_RATE,
    CLOSED_LOOP_AT_START,
    ENABLE_WATCHDOG,
    FEED_FORWARD_SCALE,
    NAMES,
    NODE_ID,
    TORQUE_SCALE,
    VEL_LIMIT,
    VEL_SCALE,
    WATCHDOG_TIMEOUT,
    factory_values,
)
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
    MotorSetPoint,
    MotorThermalModel,
    SpeedLoop,
    ThermalParameters,
    reading_after_power_up,
)
from rfca_rig.twins.wires import SampleGrid, stamp_s
from rfca_rig.twins.world import ShaftDrive, ShaftState, interpolate_motion

Floats = NDArray[np.float64]

# Procedure result of a drive that was disarmed by an error.
DISARMED = 3
# Error bits of firmware 0.6.
MISSING_ESTIMATE = 1 << 3
MOTOR_OVER_TEMP = 1 << 13
# Step of the fault `encoder-jump`, at the motor.
JUMP_TURNS = 1.0
# There is no such board: the endpoint file of the twin must fit no real drive.
FIRMWARE = Version(firmware=(0, 6, 10), hardware=(0, 0, 0))
SERIAL_NUMBER = 0x0000_7771_2E01
SUPPLY_V = 48.0
# Above the limit by this factor the drive gives up; its factory setting.
VEL_LIMIT_TOLERANCE = 1.2
VELOCITY_LIMIT_VIOLATION = 1 << 15
# Bit of the controller's error word; firmware 0.5 alone.
OVERSPEED = 1


@dataclass(frozen=True)
class OdriveTwinSettings:
    """Configuration of the drive. With `watchdog_s` None the watchdog is off, the factory setting.

    `arming_error` is the error word that every attempt to close the loop ends in; 0 for a healthy
    drive. Firmware 0.5 reports the motor's current, with `torque_constant_Nm_per_A`; 0.6 reports
    torque. Only 0.6 reports temperatures; `temperature_period_s` None switches them off.

    With `is_new` the drive has the settings that it leaves its maker with, whatever is stated here.
    A bus in this process has no bit rate, so that a wrong one is not simulated.
    """

    node_id: int = 0
    gear_ratio: float = 1.0
    direction: int = 1
    zero_turns: float = 0.0
    zero_policy: str | None = None
    gains: LoopGains = field(default_factory=LoopGains)
    watchdog_s: float | None = 0.1
    encoder_period_s: float = 1e-3
    heartbeat_period_s: float = 0.1
    arming_error: int = 0
    dialect: OdriveFirmware = OdriveFirmware.V0_6
    torque_constant_Nm_per_A: float = 0.5
    warming: ThermalParameters = field(default_factory=ThermalParameters)
    temperature_period_s: float | None = 0.5
    is_new: bool = False

    def list_values(self) -> dict[str, float]:
        """The settings in the drive's memory, by the names of its firmware."""
        factory = factory_values(self.dialect)
        if self.is_new:
            return factory
        names = NAMES[self.dialect]
        values = {
            BAUD_RATE: 1e6,
            NODE_ID: float(self.node_id),
            names.heartbeat: 1e3 * self.heartbeat_period_s,
            names.encoder: 1e3 * self.encoder_period_s,
            names.iq: 0.0,
            VEL_LIMIT: inf,
            names.torque_max: inf,
            names.current_max: factory[names.current_max],
            names.torque_constant: self.torque_constant_Nm_per_A,
            CLOSED_LOOP_AT_START: 0.0,
            WATCHDOG_TIMEOUT: self.watchdog_s or 0.0,
            ENABLE_WATCHDOG: float(self.watchdog_s is not None),
        }
        if self.dialect == OdriveFirmware.V0_5:
            return values | {names.iq: values[names.encoder]}
        return values | {
            names.torques: values[names.encoder],
            names.temperature: 1e3 * (self.temperature_period_s or 0.0),
            names.torque_min: -inf,
            VEL_SCALE: FEED_FORWARD_SCALE,
            TORQUE_SCALE: FEED_FORWARD_SCALE,
        }


class OdriveTwin(DriveTwin):
    """A `MotorTwin` that sends cyclic reports.

    A world advances it in steps: `take_frames`, `drive`, then, after the plant has moved,
    `advance`.

    Set-points stay as last commanded when the loop closes. Some firmware sets them to the measured
    angle then; a driver that relies on it causes a jerk with the others.
    """

    tells_temperature = True
    tolerances: ClassVar = {"ANGLE_TOLERANCE_RAD": 1e-3}

    def __init__(self, bus: can.BusABC, settings: OdriveTwinSettings) -> None:
        self._bus = bus
        self._settings = settings
        self._memory = OdriveMemory(settings.list_values(), factory_values(settings.dialect))
        self._now_s = 0.0
        self._wanted = MotorSetPoint()
        self._state = AxisState.IDLE
        self._error = 0
        self._part_errors: dict[OdrivePart, int] = {}
        self._result = 0
        self._fed_s = 0.0
        self._restarts = False
        # Shaft angle at which the encoder last started to count from zero.
        self._counted_from_rad = 0.0
        self.encoder = Encoder()
        self.warmth = MotorThermalModel(settings.warming)
        self._rad_per_turn = settings.direction * tau / settings.gear_ratio
        self._torque_ratio = settings.direction * settings.gear_ratio
        self._limit_Nm = settings.gains.torque_limit_Nm
        self._loop = SpeedLoop(settings.gains)
        self._use_memory()

    def _use_memory(self) -> None:
        """Behaves as the settings in the memory say, from now on."""
        values = self._memory.values
        names = NAMES[self._settings.dialect]
        self._node = round(values[NODE_ID])
        self._watchdog_s: float | None = None
        if values[ENABLE_WATCHDOG]:
            self._watchdog_s = values[WATCHDOG_TIMEOUT]
        self._vel_limit_rad_s = VEL_LIMIT_TOLERANCE * values[VEL_LIMIT] * abs(self._rad_per_turn)
        self._heartbeat_ticks = self._make_ticks(values[names.heartbeat])
        self._encoder_ticks = self._make_ticks(values[names.encoder])
        torque_ms = max(values[names.iq], values.get(names.torques, 0.0))
        self._torque_ticks = self._make_ticks(torque_ms)
        # The usual case costs no second grid.
        self._torque_with_angle = torque_ms == values[names.encoder]
        self._temperature_ticks = self._make_ticks(values.get(names.temperature, 0.0))
        limit_Nm = min(
            self._settings.gains.torque_limit_Nm, values[names.torque_max] * abs(self._torque_ratio)
        )
        # A loop that runs keeps its integrator where another setting was written.
        if limit_Nm != self._limit_Nm:
            self._limit_Nm = limit_Nm
            self._loop = SpeedLoop(replace(self._settings.gains, torque_limit_Nm=limit_Nm))

    def _make_ticks(self, period_ms: float) -> SampleGrid | None:
        """The times of a cyclic message; None for one that is off."""
        if period_ms <= 0.0:
            return None
        ticks = SampleGrid(1e-3 * period_ms)
        ticks.skip_to(self._now_s)
        return ticks

    def type_line(self, line: str) -> str:
        """A line of odrivetool, over USB; returns what it prints."""
        match line.strip():
            case "odrv0.save_configuration()":
                self._reboot(RebootAction.SAVE_CONFIGURATION)
            case "odrv0.erase_configuration()":
                self._reboot(RebootAction.ERASE_CONFIGURATION)
            case "odrv0.reboot()":
                self._reboot(RebootAction.REBOOT)
            case _:
                printed = self._memory.type_line(line)
                self._use_memory()
                return printed
        return "the drive starts again"

    def _reboot(self, action: int) -> None:
        # A drive that runs saves nothing, and goes on.
        if action != RebootAction.REBOOT and self._state != AxisState.IDLE:
            return
        if action == RebootAction.SAVE_CONFIGURATION:
            self._memory.save()
        elif action == RebootAction.ERASE_CONFIGURATION:
            self._memory.erase()
        self.restart()

    def take_frames(self, now_s: float) -> None:
        """Executes received frames; invalid ones are ignored. Any frame for this node feeds the
        watchdog.
        """
        while (message := self._bus.recv(timeout=0)) is not None:
            if (
                not message.is_extended_id
                and not message.is_error_frame
                and self._is_mine(message.arbitration_id)
            ):
                self._fed_s = now_s
                self._take(message)
        self._check_watchdog(now_s)

    def _is_mine(self, arbitration_id: int) -> bool:
        return codec.node_of(arbitration_id) in (self._node, messages.BROADCAST_NODE)

    def _take(self, message: can.Message) -> None:
        # An empty data frame is a question too; adapters without remote frames need that.
        if message.is_remote_frame or message.dlc == 0:
            self._answer(message.arbitration_id & 0x1F)
        if message.is_remote_frame:
            return
        try:
            self._obey(codec.decode(message.arbitration_id, message.data, self._settings.dialect))
        except MalformedFrame:
            # The firmware does not report invalid frames either.
            return

    def _answer(self, command: int) -> None:
        node = self._node
        if command == OdriveCommand.BUS_VOLTAGE_CURRENT:
            self._send(codec.bus_voltage_current(node, SUPPLY_V, 0.0))
        elif self._settings.dialect == OdriveFirmware.V0_5:
            # Answers of firmware 0.5: part errors only, neither its version nor a heartbeat on
            # request.
            for part, part_command in codec.PART_COMMANDS.items():
                if command == part_command:
                    self._send(
                        codec.part_error(node, PartError(part, self._part_errors.get(part, 0)))
                    )
        elif command == OdriveCommand.VERSION:
            self._send(codec.version(node, FIRMWARE))
        elif command == OdriveCommand.HEARTBEAT:
            self._send(codec.heartbeat(node, self._beat()))
        elif command == OdriveCommand.ERRORS:
            self._send(codec.errors(node, messages.ErrorReport(self._error, self._error)))
        elif command == OdriveCommand.ADDRESS:
            self._send(codec.address(node, messages.Address(node, SERIAL_NUMBER)))

    def _obey(self, order: Message | None) -> None:
        match order:
            case messages.Reboot():
                self._reboot(order.action)
            case messages.RxSdo():
                self._access_endpoint(order)
            case messages.Address():
                self._take_address(order)
            case _:
                self._command(order)

    def _command(self, order: Message | None) -> None:
        wanted = self._wanted
        rad = self._rad_per_turn
        match order:
            case messages.SetAxisState():
                self._request(order.state)
            case messages.SetControllerMode():
                wanted.mode = order.control_mode
            case messages.SetInputPos():
                wanted.angle_rad = (
                    order.position_turns - self._settings.zero_turns
                ) * rad + self._counted_from_rad
                wanted.speed_rad_s = order.speed_turns_s * rad
                wanted.torque_Nm = order.torque_Nm * self._torque_ratio
            case messages.SetInputVel():
                wanted.speed_rad_s = order.speed_turns_s * rad
                wanted.torque_Nm = order.torque_Nm * self._torque_ratio
            case messages.SetInputTorque():
                wanted.torque_Nm = order.torque_Nm * self._torque_ratio
            case messages.ClearErrors():
                self._error = 0
                self._part_errors.clear()
            case messages.Estop():
                self.set_error(ESTOP_REQUESTED[self._settings.dialect])
        # A set-point that is not finite disarms the drive, with an error that depends on the
        # firmware.
        if not (
            isfinite(wanted.angle_rad)
            and isfinite(wanted.speed_rad_s)
            and isfinite(wanted.torque_Nm)
        ):
            self._wanted = MotorSetPoint(wanted.mode)
            if self._settings.dialect == OdriveFirmware.V0_5:
                self.fail_part(OdrivePart.MOTOR, MODULATION_IS_NAN)
            else:
                self.set_error(MISSING_INPUT)

    def _access_endpoint(self, order: messages.RxSdo) -> None:
        """Reads or writes a value. A drive says nothing of endpoints that it does not have."""
        found = self._memory.find_endpoint(order.endpoint_id)
        if found is None:
            return
        name, endpoint = found
        if order.opcode == SdoOpcode.READ:
            value = endpoint.encode(self._memory.values[name])
            self._send(codec.endpoint_value(self._node, order.endpoint_id, value))
        elif order.opcode == SdoOpcode.WRITE:
            written = endpoint.decode(order.value)
            if written is not None:
                self._memory.values[name] = written
                self._use_memory()

    def _take_address(self, order: messages.Address) -> None:
        if order.serial_number == SERIAL_NUMBER:
            self._memory.values[NODE_ID] = float(order.node_id)
        elif order.node_id == self._node:
            # Another drive has that address now.
            self._memory.values[NODE_ID] = float(messages.BROADCAST_NODE)
        self._node = round(self._memory.values[NODE_ID])

    def _request(self, state: int) -> None:
        if state == AxisState.IDLE:
            self._state = AxisState.IDLE
            self._result = 0
        elif state == AxisState.CLOSED_LOOP and self._settings.arming_error:
            self.set_error(self._settings.arming_error)
        elif (
            state == AxisState.CLOSED_LOOP
            and not self._error
            and not self._part_errors
            and self._state != AxisState.CLOSED_LOOP
        ):
            self._state = AxisState.CLOSED_LOOP
            self._result = 0
            self._loop.reset()

    def set_error(self, error: int) -> None:
        """Adds bits to the error word; the motor goes idle."""
        self._error |= error
        self._state = AxisState.IDLE
        self._result = DISARMED

    def restart(self) -> None:
        """Power cycle: idle without an error, with the settings that were saved; an encoder of no
        stated policy counts from zero at its present position.
        """
        self._memory.restart()
        self._use_memory()
        self._state = AxisState.IDLE
        self._error = 0
        self._result = 0
        self._part_errors.clear()
        self._wanted = MotorSetPoint()
        self._restarts = True

    def fail_part(self, part: OdrivePart, error: int) -> None:
        """Sets an error of one part, as in firmware 0.5: the error word of the axis may stay
        zero.
        """
        self._part_errors[part] = self._part_errors.get(part, 0) | error
        self.set_error(0)

    def _check_watchdog(self, now_s: float) -> None:
        limit_s = self._watchdog_s
        if (
            limit_s is not None
            and self._state == AxisState.CLOSED_LOOP
            and now_s - self._fed_s > limit_s
        ):
            self.set_error(WATCHDOG_EXPIRED[self._settings.dialect])

    def drive(self, shaft: ShaftState) -> ShaftDrive:
        """Torque law on the shaft until the next step."""
        if self._restarts:
            self._restarts = False
            self._counted_from_rad = self._count_after_power_up(shaft.angle_rad)
        if self._state == AxisState.CLOSED_LOOP:
            return self._loop.law(self._wanted, shaft)
        return ShaftDrive()

    def _count_after_power_up(self, angle_rad: float) -> float:
        """The shaft angle that counts as zero when the drive starts at `angle_rad`."""
        zero_turns = self._settings.zero_turns
        turns = zero_turns + (angle_rad - self._counted_from_rad) / self._rad_per_turn
        turns = reading_after_power_up(turns, 1.0, self._settings.zero_policy or "incremental")
        return angle_rad - (turns - zero_turns) * self._rad_per_turn

    def advance(
        self, elapsed_s: float, now_s: float, before: ShaftState, after: ShaftState, law: ShaftDrive
    ) -> None:
        """Takes in a step of the plant under `law` that ended at `now_s`, and sends the reports
        that became due in it.
        """
        if self._state == AxisState.CLOSED_LOOP:
            self._loop.advance(self._wanted, elapsed_s, before, after)
            self._check_speed(after.speed_rad_s)
        self.warmth.advance(elapsed_s, after.torque_Nm)
        due_s: list[float] = []
        if self._encoder_ticks is not None:
            due_s = self._encoder_ticks.list_until(now_s)
        motion = interpolate_motion(due_s, elapsed_s, now_s, before, after)
        for at_s, (angle_rad, speed_rad_s) in zip(due_s, motion, strict=True):
            self._report(at_s, angle_rad, speed_rad_s, law.torque_Nm(angle_rad, speed_rad_s))
        if self._heartbeat_ticks is not None:
            for _ in range(self._heartbeat_ticks.count_until(now_s)):
                self._send(codec.heartbeat(self._node, self._beat(), self._settings.dialect))
        self._report_temperature(now_s)
        self._now_s = now_s

    def _check_speed(self, speed_rad_s: float) -> None:
        if abs(speed_rad_s) <= self._vel_limit_rad_s:
            return
        if self._settings.dialect == OdriveFirmware.V0_5:
            self.fail_part(OdrivePart.CONTROLLER, OVERSPEED)
        else:
            self.set_error(VELOCITY_LIMIT_VIOLATION)

    def _report_temperature(self, now_s: float) -> None:
        if self._temperature_ticks is None:
            return
        for _ in range(self._temperature_ticks.count_until(now_s)):
            self._send(
                codec.temperatures(
                    self._node, self._settings.warming.air_degC, self.warmth.reported_degC
                )
            )

    def _report(self, at_s: float, angle_rad: float, speed_rad_s: float, torque_Nm: float) -> None:
        node = self._node
        rad = self._rad_per_turn
        torque_Nm /= self._torque_ratio
        if not self._is_torque_due(at_s):
            pass
        elif self._settings.dialect == OdriveFirmware.V0_5:
            # Sent before the encoder estimates, so that the driver pairs both of the same time.
            current_A = torque_Nm / self._settings.torque_constant_Nm_per_A
            self._send(codec.iq(node, current_A, current_A))
        else:
            self._send(codec.torques(node, torque_Nm, torque_Nm))
        reported_rad, reported_rad_s = self.encoder.report(
            angle_rad - self._counted_from_rad, speed_rad_s
        )
        self._send(
            codec.encoder_estimates(
                node, self._settings.zero_turns + reported_rad / rad, reported_rad_s / rad
            ),
            stamp_s(at_s),
        )

    def _is_torque_due(self, at_s: float) -> bool:
        if self._torque_with_angle:
            return True
        return self._torque_ticks is not None and self._torque_ticks.count_until(at_s) > 0

    def _beat(self) -> Heartbeat:
        return Heartbeat(
            self._error,
            self._state,
            self._result,
            self._wanted.mode != ControlMode.POSITION,
            tuple(self._part_errors),
        )

    def _send(self, frame: codec.Frame, timestamp: float = 0.0) -> None:
        self._bus.send(
            can.Message(
                arbitration_id=frame[0],
                data=frame[1],
                is_extended_id=False,
                timestamp=timestamp,
            )
        )

    def stale_set_point(self) -> Sequence[can.Message]:
        """A position at a high speed."""
        frame = codec.set_input_pos(self._node, -3.0, 5.0)
        return (can.Message(arbitration_id=frame[0], data=frame[1], is_extended_id=False),)

    def fail(self) -> str:
        self.set_error(MOTOR_OVER_TEMP)
        return r"error 0x00002000 \(MOTOR_OVER_TEMP: motor too hot\)"

    def refuse(self) -> str:
        self._settings = replace(self._settings, arming_error=MISSING_ESTIMATE)
        return r"refuses closed loop with error 0x00000008 \(MISSING_ESTIMATE"

    @property
    def dialect(self) -> OdriveFirmware:
        return self._settings.dialect


class OdriveDialect(DriveDialect):
    """Interprets CANSimple frames for the bus faults."""

    def is_heartbeat(self, message: can.Message) -> bool:
        return message.arbitration_id & 0x1F == OdriveCommand.HEARTBEAT

    def shift_encoder(self, message: can.Message) -> can.Message:
        """The frame with the encoder estimate shifted by one motor turn."""
        estimates = codec.decode(message.arbitration_id, message.data)
        if not isinstance(estimates, EncoderEstimates):
            return message
        node = codec.node_of(message.arbitration_id)
        _, data = codec.encoder_estimates(
            node, estimates.position_turns + JUMP_TURNS, estimates.speed_turns_s
        )
        return replace_data(message, data)


def odrive_events(motor: OdriveTwin) -> Mapping[str, Callable[[], None]]:
    """One-time events inside the drive, by the name of the fault."""
    return {
        "watchdog-trip": lambda: motor.set_error(messages.WATCHDOG_EXPIRED[motor.dialect]),
        "over-temperature": lambda: motor.set_error(messages.OVER_TEMPERATURE[motor.dialect]),
        "idle-unasked": lambda: motor.set_error(0),
        **drive_events(motor),
    }


FAULTS = DriveFaults(
    (
        Fault("heartbeat-silent", "encoder reports go on without heartbeats"),
        Fault("encoder-jump", "the encoder reads one motor turn more"),
        Fault("watchdog-trip", "the drive says its watchdog expired, and goes idle", once=True),
        Fault("over-temperature", "the drive says its motor is too hot, and goes idle", once=True),
        Fault("idle-unasked", "the drive goes idle without any error", once=True),
        *DRIVE_FAULTS,
    ),
    odrive_events,
    OdriveDialect(),
)


def make_twin(
    bus: can.BusABC, keys: OdriveSection, gains: LoopGains, watchdog_s: float | None
) -> OdriveTwin:
    """The twin of the drive that [motor] names."""
    return OdriveTwin(bus, _twin_settings(keys, gains, watchdog_s))


def make_new_twin(bus: can.BusABC, keys: OdriveSection, gains: LoopGains) -> OdriveTwin:
    """The same drive as it leaves its maker."""
    return OdriveTwin(bus, replace(_twin_settings(keys, gains, None), is_new=True))


def _twin_settings(
    keys: OdriveSection, gains: LoopGains, watchdog_s: float | None
) -> OdriveTwinSettings:
    return keys.to_dataclass(
        OdriveTwinSettings,
        gains=gains,
        watchdog_s=watchdog_s,
        encoder_period_s=keys.encoder_period_ms / 1e3,
        dialect=OdriveFirmware(keys.dialect),
        torque_constant_Nm_per_A=keys.torque_constant_Nm_per_A or 1.0,
    )
