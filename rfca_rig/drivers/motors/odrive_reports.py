"""Settings of an ODrive; receives and time-stamps its messages, and keeps those of other nodes apart."""

from dataclasses import dataclass
from math import isfinite

import can
import numpy as np

from rfca_rig.clock import Clock
from rfca_rig.codecs import cansimple, odrive
from rfca_rig.codecs.odrive import (
    EncoderEstimates,
    Heartbeat,
    Iq,
    OdriveFirmware,
    OdrivePart,
    PartError,
    Temperatures,
    Torques,
    Version,
)
from rfca_rig.drivers.can_frames import MAX_READ_PAUSE_S, BusHealth, receive_frames
from rfca_rig.drivers.device_time import FrameCount
from rfca_rig.drivers.motors.drive_report import EncoderJumpMonitor, ShaftGear, check_positive
from rfca_rig.drivers.roles import ShaftSamples, concatenate_blocks
from rfca_rig.errors import BadInput

# Time without a temperature until it is a fault. Overheating takes longer than this.
MAX_SILENCE_S = 10.0

WATCHDOG_REMEDY = "the drive's watchdog stops the motor"


@dataclass(frozen=True)
class OdriveSettings(ShaftGear):
    """Settings of the drive.

    `gear_ratio` is motor turns per shaft turn, `direction` +1 or -1, `zero_turns` the encoder reading in turns with the shaft
    horizontal. With `torque_constant_Nm_per_A` None the torque comes from message 0x1C, else from the measured current 0x14.
    `encoder_period_s` is the drive's cyclic period of message 0x09. `dialect` is that of its firmware; 0.5 reports no torque, so it
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
        # Six bits of the arbitration id hold the node; 63 is the broadcast address of drives without one.
        if not 0 <= self.node_id < 63:
            raise BadInput(f"drive: node_id is {self.node_id}, must be 0..62")
        self.check_gear()
        for name in ("encoder_period_s", "heartbeat_timeout_s", "enable_timeout_s"):
            check_positive(name, getattr(self, name))
        if self.torque_constant_Nm_per_A is not None:
            check_positive("torque_constant_Nm_per_A", self.torque_constant_Nm_per_A)
        # Message 0x1C exists only in firmware 0.6; without it the torque has to come from the current.
        elif self.dialect == OdriveFirmware.V0_5:
            raise BadInput(
                "drive: torque_constant_Nm_per_A is missing; firmware 0.5 tells the motor's current, not its torque "
                "(8.27 / the motor's KV in rpm/V, as in motor.config.torque_constant)"
            )


class TemperatureTelemetry:
    """`warmest_C` is the highest temperature of the last message.

    It is None before the first message, and if no value is finite, as without a thermistor.
    """

    def __init__(self) -> None:
        self.warmest_C: float | None = None
        self._reported_s = 0.0

    def hear(self, now_s: float, *values_C: float) -> None:
        """Takes in one message, received at host time `now_s`."""
        self.warmest_C = max((value for value in values_C if isfinite(value)), default=None)
        self._reported_s = now_s

    def fault(self, now_s: float) -> str | None:
        """Set if temperatures that were reported have stopped: a limit on them would no longer protect the motor."""
        if self.warmest_C is None or now_s - self._reported_s <= MAX_SILENCE_S:
            return None
        return (
            f"no temperature for {now_s - self._reported_s:.0f} s, though the drive reported it before; check its temperature_msg_rate_ms"
        )


class OdriveReports:
    """Receives the messages of one node. `beat` is its last heartbeat, received at host time `beat_s`; `turns` its encoder position.

    `part_errors` are the error words of its parts, as far as they were requested (firmware 0.5).
    """

    def __init__(self, bus: can.BusABC, clock: Clock, settings: OdriveSettings) -> None:
        self._bus = bus
        self._clock = clock
        self._settings = settings
        self._rad_per_turn, self._torque_ratio = settings.shaft_rad_per_turn, settings.shaft_torque_per_drive_torque
        self._count = FrameCount(settings.encoder_period_s)
        # Turns, turns/s and motor torque of frames that have no time stamp yet.
        self._rows: list[tuple[float, float, float]] = []
        self._samples: list[ShaftSamples] = []
        self._torque_Nm = np.nan
        self._leap = EncoderJumpMonitor()
        self.health = BusHealth()
        self.temperature = TemperatureTelemetry()
        self.beat: Heartbeat | None = None
        self.drained_s = self.beat_s = clock.now_s()
        self.turns = np.nan
        self.firmware = "unknown"
        self.part_errors: dict[OdrivePart, int] = {}
        self.reset_counters()

    def reset_counters(self) -> None:
        """Restarts the counters behind `missing`."""
        self._foreign_nodes: set[int] = set()
        self._own_frames = self._torque_frames = 0
        self.encoder_frames = self.heartbeats = 0

    def drain(self) -> None:
        """Receives everything the bus holds; never waits. Raises DeviceError if the bus fails or a frame cannot be decoded."""
        # The time is read before the first frame, so that no frame gets a time later than its arrival.
        before_s, self.drained_s = self.drained_s, self._clock.now_s()
        try:
            for message in receive_frames(self._bus, self.health, WATCHDOG_REMEDY):
                self._take(message)
        # Rows received before a failure are still stamped and handed out.
        finally:
            self._stamp_rows(is_whole=self.drained_s - before_s < MAX_READ_PAUSE_S)

    def samples(self) -> ShaftSamples:
        """Samples (m,) drained since the last call."""
        blocks, self._samples = self._samples, []
        return concatenate_blocks(blocks or [NO_SAMPLES])

    @property
    def lost_frames(self) -> int:
        return self._count.lost

    @property
    def zero_lost(self) -> str | None:
        """Why the angle can no longer be trusted, or None. Never reset."""
        return self._leap.fault

    @property
    def doubts(self) -> str | None:
        """An error of the reports themselves that the drive does not report, or None."""
        return self.zero_lost or self._count.fault or self.temperature.fault(self.drained_s) or self.health.fault

    @property
    def torque_source(self) -> str:
        return "torques (0x1C)" if self._settings.torque_constant_Nm_per_A is None else "motor currents (0x14)"

    def missing(self) -> str | None:
        """The first required message that has not arrived since `reset_counters`, with the remedy; None if all have."""
        node = self._settings.node_id
        if self._own_frames == 0 and self._foreign_nodes:
            others = ", ".join(map(str, sorted(self._foreign_nodes)))
            return f"CAN frames from node {others} but none from node {node}; check node_id"
        # The order of the checks leads the user from the wiring to single messages.
        if self._own_frames == 0:
            return "no frames at all on the CAN bus; check the drive's power, the wiring, the termination and the bit rate"
        # A first heartbeat with an error may predate the clearing of the error.
        needed = 2 if self.beat is not None and self.beat.error else 1
        if self.heartbeats < needed:
            return f"no heartbeat from node {node}; set the drive's {self._rate('heartbeat')} to 100"
        if self.encoder_frames == 0:
            return f"no encoder estimates from node {node}; set its {self._rate('encoder')} to {1e3 * self._settings.encoder_period_s:g}"
        if self._torque_frames == 0:
            older = self._settings.dialect == OdriveFirmware.V0_5
            or_dialect = " (iq_rate_ms)" if older else ', or dialect = "0.5" if its firmware is 0.5'
            return f"no {self.torque_source} from node {node}; set the cyclic rate of that message in the drive{or_dialect}"
        return None

    def _rate(self, message: str) -> str:
        """The drive's setting for the period of a cyclic message; its name changed with firmware 0.6."""
        return f"{message}_rate_ms" if self._settings.dialect == OdriveFirmware.V0_5 else f"{message}_msg_rate_ms"

    def _take(self, message: can.Message) -> None:
        if message.is_extended_id or message.dlc == 0:
            # CANSimple uses standard frames only. An empty frame is a request or command by another master.
            return
        if cansimple.node_of(message.arbitration_id) != self._settings.node_id:
            self._foreign_nodes.add(cansimple.node_of(message.arbitration_id))
        else:
            self._own_frames += 1
            self._hear(cansimple.decode(message.arbitration_id, message.data, self._settings.dialect))

    def _hear(self, message: odrive.Message | None) -> None:
        constant = self._settings.torque_constant_Nm_per_A
        match message:
            case EncoderEstimates():
                self.encoder_frames += 1
                self.turns = message.position_turns
                # Torque comes in its own message; each encoder row carries the latest torque.
                self._rows.append((message.position_turns, message.speed_turns_s, self._torque_Nm))
            # Firmware 0.6 reports torque. With a torque constant set, the measured q current is used instead.
            case Torques() if constant is None:
                self._hear_torque(message.estimate_Nm)
            case Iq() if constant is not None:
                self._hear_torque(constant * message.measured_A)
            case Heartbeat():
                self.heartbeats += 1
                self.beat, self.beat_s = message, self.drained_s
            case Temperatures():
                self.temperature.hear(self.drained_s, message.inverter_degC, message.motor_degC)
            case PartError():
                self.part_errors[message.part] = message.word
            case Version():
                self.firmware = ".".join(map(str, message.firmware))

    def _hear_torque(self, torque_Nm: float) -> None:
        self._torque_frames += 1
        self._torque_Nm = torque_Nm

    def _stamp_rows(self, is_whole: bool) -> None:
        """Time-stamps the new rows. After a long pause frames may be missing anywhere, so no jump is looked for."""
        if not self._rows:
            return
        rows, self._rows = self._rows, []
        zero_turns, rad, ratio = self._settings.zero_turns, self._rad_per_turn, self._torque_ratio
        # Plain numbers: a tick brings two reports, for which numpy takes longer.
        angle_rad = [(turns - zero_turns) * rad for turns, _, _ in rows]
        speed_rad_s = [turns_s * rad for _, turns_s, _ in rows]
        device_s = self._count.stamp(len(rows), self.drained_s)
        for report in zip(device_s.tolist(), angle_rad, speed_rad_s, strict=True):
            self._leap.follow(self.drained_s, *report, judged=is_whole)
        self._samples.append(
            ShaftSamples(
                host_s=np.array([self.drained_s] * len(rows)),
                device_s=device_s,
                angle_rad=np.array(angle_rad),
                speed_rad_s=np.array(speed_rad_s),
                torque_Nm=np.array([torque_Nm * ratio for _, _, torque_Nm in rows]),
            )
        )


NO_SAMPLES = ShaftSamples(*(np.empty(0) for _ in range(5)))
