"""Faults of drives: in the frames on their bus, and inside the drive."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Protocol

import can
import numpy as np

from rfca_rig.codecs import cansimple, moteus, odrive
from rfca_rig.codecs.moteus import FD_LENGTHS, Reply, Subframe
from rfca_rig.codecs.moteus_registers import Register
from rfca_rig.codecs.odrive import EncoderEstimates, OdriveCommand
from rfca_rig.twin_server.faults import DRIVE_FAULTS, Fault, FaultPanel
from rfca_rig.twins.cubemars_mit import CubemarsMitTwin
from rfca_rig.twins.cubemars_servo import CubemarsServoTwin
from rfca_rig.twins.drive_parts import Encoder, MotorThermalModel
from rfca_rig.twins.moteus import MoteusTwin
from rfca_rig.twins.odrive import OdriveTwin

# Heating rate of the fault `drive-hot` in K/s.
HEATING_K_s = 5.0
# Steps of the fault `encoder-jump`: at the shaft of a CubeMars drive, at the motor of the others.
JUMP_RAD = 0.5 * np.pi
JUMP_TURNS = 1.0
# Error codes of a CubeMars drive.
TOO_HOT, ENCODER, STALLED = 1, 5, 7
CUBEMARS_FAULTS = (
    Fault("encoder-jump", "the encoder slips: the drive's position reads a quarter of a turn more from now on", once=True),
    Fault("over-temperature", "the drive stops with error 1, motor too hot", once=True),
    Fault("encoder-lost", "the drive stops with error 5, encoder fault", once=True),
    Fault("stalled", "the drive stops with error 7, motor stalled", once=True),
    Fault("refuses", "every later attempt to enable the drive ends in error 1", once=True),
    *DRIVE_FAULTS,
)

# Fault code of a moteus.
OVER_TEMPERATURE = 38
MOTEUS_FAULTS = (
    Fault("encoder-jump", "the drive's position reads one turn more"),
    Fault("watchdog-trip", "the drive times out, though commands reach it", once=True),
    Fault("over-temperature", "the drive stops with fault 38, over temperature", once=True),
    *DRIVE_FAULTS,
)


class Faultable(Protocol):
    """What every motor twin provides for these faults."""

    encoder: Encoder
    warmth: MotorThermalModel

    def restart(self) -> None: ...


def drive_events(motor: Faultable) -> Mapping[str, Callable[[], None]]:
    """One-time events inside the drive, by the name of the fault."""

    def start_heating() -> None:
        motor.warmth.fever_K_s = HEATING_K_s

    return {
        "drive-restart": motor.restart,
        "drive-hot": start_heating,
        "temperature-stuck": motor.warmth.stick,
        "encoder-frozen": motor.encoder.freeze,
    }


def cubemars_events(motor: CubemarsMitTwin | CubemarsServoTwin) -> Mapping[str, Callable[[], None]]:
    """One-time events inside the drive, by the name of the fault."""
    return {
        "encoder-jump": lambda: motor.leap(JUMP_RAD),
        "over-temperature": lambda: motor.fail(TOO_HOT),
        "encoder-lost": lambda: motor.fail(ENCODER),
        "stalled": lambda: motor.fail(STALLED),
        "refuses": lambda: motor.refuse_with(TOO_HOT),
        **drive_events(motor),
    }


class DriveDialect(Protocol):
    """Knowledge of the drive's frames that bus faults need."""

    def is_heartbeat(self, message: can.Message) -> bool: ...

    def shift_encoder(self, message: can.Message) -> can.Message:
        """The frame with a displaced encoder position; other frames unchanged."""
        ...


class NoDialect:
    """For drives without faults that depend on the content of frames."""

    def is_heartbeat(self, message: can.Message) -> bool:  # noqa: ARG002 (none is)
        return False

    def shift_encoder(self, message: can.Message) -> can.Message:
        return message


class TamperedBus(can.BusABC):
    """The twin's bus; the faults of the panel act on the frames that pass."""

    def __init__(self, end: can.BusABC, panel: FaultPanel, dialect: DriveDialect) -> None:
        super().__init__(channel=end.channel_info)
        self.channel_info = end.channel_info
        self._end = end
        self._panel = panel
        self._dialect = dialect

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Sends a frame with the active faults. Raises can.CanOperationError once the end is shut down."""
        # Without faults, the usual case, a frame costs no further lookups.
        if self._panel.any_on():
            if self._panel.is_on("can-silent") or self._panel.is_on("bus-off"):
                return
            if self._panel.is_on("heartbeat-silent") and self._dialect.is_heartbeat(msg):
                return
            if self._panel.is_on("encoder-jump"):
                msg = self._dialect.shift_encoder(msg)
            if self._panel.is_on("can-short"):
                msg = _shorten(msg)
            # The frame is sent here a first time.
            if self._panel.is_on("can-twice"):
                self._end.send(msg, timeout)
        self._end.send(msg, timeout)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        message = self._end.recv(timeout)
        # A drive without a bus receives nothing: what arrives meanwhile is lost.
        while message is not None and self._panel.is_on("bus-off"):
            message = self._end.recv(timeout)
        if message is not None and self._panel.is_on("own-frame-echo"):
            self._end.send(message)
        return message, False

    def shutdown(self) -> None:
        super().shutdown()
        self._end.shutdown()


def replace_data(message: can.Message, data: bytes) -> can.Message:
    """The same frame with other data, and the matching length."""
    return can.Message(
        arbitration_id=message.arbitration_id,
        data=data,
        is_extended_id=message.is_extended_id,
        is_fd=message.is_fd,
        bitrate_switch=message.bitrate_switch,
    )


def _shorten(message: can.Message) -> can.Message:
    """Removes the last byte; on CAN-FD as many as lead to the next valid length."""
    length = len(message.data) - 1
    if message.is_fd:
        length = max((one for one in FD_LENGTHS if one <= length), default=0)
    return replace_data(message, bytes(message.data[: max(length, 0)]))


class MoteusDialect:
    """Interprets the frames of a moteus for the bus faults."""

    def is_heartbeat(self, message: can.Message) -> bool:  # noqa: ARG002 (a moteus has none)
        return False

    def shift_encoder(self, message: can.Message) -> can.Message:
        """The frame with the reported position shifted by one turn."""
        return replace_data(message, moteus.encode([_shift_position(item) for item in moteus.decode(message.data)]))


def _shift_position(item: Subframe) -> Subframe:
    if not isinstance(item, Reply) or item.register != Register.POSITION:
        return item
    return replace(item, value=moteus.clip_to_register(item.register, item.width, item.value + JUMP_TURNS))


def moteus_events(motor: MoteusTwin) -> Mapping[str, Callable[[], None]]:
    """One-time events inside the drive, by the name of the fault."""
    return {
        "watchdog-trip": motor.time_out,
        "over-temperature": lambda: motor.fail(OVER_TEMPERATURE),
        **drive_events(motor),
    }


class OdriveDialect:
    """Interprets CANSimple frames for the bus faults."""

    def is_heartbeat(self, message: can.Message) -> bool:
        return message.arbitration_id & 0x1F == OdriveCommand.HEARTBEAT

    def shift_encoder(self, message: can.Message) -> can.Message:
        """The frame with the encoder estimate shifted by one motor turn."""
        estimates = cansimple.decode(message.arbitration_id, message.data)
        if not isinstance(estimates, EncoderEstimates):
            return message
        node = cansimple.node_of(message.arbitration_id)
        _, data = cansimple.encoder_estimates(node, estimates.position_turns + JUMP_TURNS, estimates.speed_turns_s)
        return replace_data(message, data)


def odrive_events(motor: OdriveTwin) -> Mapping[str, Callable[[], None]]:
    """One-time events inside the drive, by the name of the fault."""
    return {
        "watchdog-trip": lambda: motor.fail(odrive.WATCHDOG_EXPIRED[motor.dialect]),
        "over-temperature": lambda: motor.fail(odrive.OVER_TEMPERATURE[motor.dialect]),
        "idle-unasked": lambda: motor.fail(0),
        **drive_events(motor),
    }
