"""Twin of an ODrive with firmware 0.6 or 0.5, on the CAN bus, and the faults that can be
injected into it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite, tau
from typing import ClassVar

import can
import numpy as np
from numpy.typing import NDArray

from rfca_rig.devices.odrive import codec, messages
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
    Version,
)
from rfca_rig.devices.odrive.section import OdriveSection
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
FIRMWARE = Version(firmware=(0, 6, 10), hardware=(4, 4, 58))


@dataclass(frozen=True)
class OdriveTwinSettings:
    """Configuration of the drive. With `watchdog_s` None the watchdog is off, the factory setting.

    `arming_error` is the error word that every attempt to close the loop ends in; 0 for a healthy
    drive. Firmware 0.5 reports the motor's current, with `torque_constant_Nm_per_A`; 0.6 reports
    torque. Only 0.6 reports temperatures; `temperature_period_s` None switches them off.
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
        self._loop = SpeedLoop(settings.gains)
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
        self._temperature_ticks = SampleGrid(settings.temperature_period_s or 1.0)
        self._encoder_ticks = SampleGrid(settings.encoder_period_s)
        self._heartbeat_ticks = SampleGrid(settings.heartbeat_period_s)
        self._rad_per_turn = settings.direction * tau / settings.gear_ratio
        self._torque_ratio = settings.direction * settings.gear_ratio

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
        return codec.node_of(arbitration_id) in (self._settings.node_id, messages.BROADCAST_NODE)

    def _take(self, message: can.Message) -> None:
        # Firmware 0.5 also answers an empty data frame; adapters without remote frames need that.
        if message.is_remote_frame or (
            message.dlc == 0 and self._settings.dialect == OdriveFirmware.V0_5
        ):
            self._answer(message.arbitration_id & 0x1F)
        if message.is_remote_frame:
            return
        try:
            self._obey(codec.decode(message.arbitration_id, message.data, self._settings.dialect))
        except MalformedFrame:
            # The firmware does not report invalid frames either.
            return

    def _answer(self, command: int) -> None:
        node = self._settings.node_id
        if self._settings.dialect == OdriveFirmware.V0_5:
            # Answers of firmware 0.5: part errors only, neither its version nor a heartbeat on
            # request.
            for part, part_command in codec.PART_COMMANDS.items():
                if command == part_command:
                    self._send(
                        codec.part_error(
                            self._settings.node_id, PartError(part, self._part_errors.get(part, 0))
                        )
                    )
        elif command == OdriveCommand.VERSION:
            self._send(codec.version(node, FIRMWARE))
        elif command == OdriveCommand.HEARTBEAT:
            self._send(codec.heartbeat(node, self._beat()))
        elif command == OdriveCommand.ERRORS:
            self._send(codec.errors(node, messages.ErrorReport(self._error, self._error)))

    def _obey(self, order: Message | None) -> None:
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
        """Power cycle: idle without an error; an encoder of no stated policy counts from zero at
        its present position.
        """
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
        limit_s = self._settings.watchdog_s
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
        self.warmth.advance(elapsed_s, after.torque_Nm)
        due_s = self._encoder_ticks.list_until(now_s)
        motion = interpolate_motion(due_s, elapsed_s, now_s, before, after)
        for at_s, (angle_rad, speed_rad_s) in zip(due_s, motion, strict=True):
            self._report(at_s, angle_rad, speed_rad_s, law.torque_Nm(angle_rad, speed_rad_s))
        for _ in range(self._heartbeat_ticks.count_until(now_s)):
            self._send(
                codec.heartbeat(self._settings.node_id, self._beat(), self._settings.dialect)
            )
        self._report_temperature(now_s)

    def _report_temperature(self, now_s: float) -> None:
        settings = self._settings
        if settings.temperature_period_s is not None and settings.dialect == OdriveFirmware.V0_6:
            for _ in range(self._temperature_ticks.count_until(now_s)):
                self._send(
                    codec.temperatures(
                        settings.node_id, settings.warming.air_degC, self.warmth.reported_degC
                    )
                )

    def _report(self, at_s: float, angle_rad: float, speed_rad_s: float, torque_Nm: float) -> None:
        node = self._settings.node_id
        rad = self._rad_per_turn
        torque_Nm /= self._torque_ratio
        if self._settings.dialect == OdriveFirmware.V0_5:
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
        frame = codec.set_input_pos(self._settings.node_id, -3.0, 5.0)
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
    settings = keys.to_dataclass(
        OdriveTwinSettings,
        gains=gains,
        watchdog_s=watchdog_s,
        encoder_period_s=keys.encoder_period_ms / 1e3,
        dialect=OdriveFirmware(keys.dialect),
        torque_constant_Nm_per_A=keys.torque_constant_Nm_per_A or 1.0,
    )
    return OdriveTwin(bus, settings)
