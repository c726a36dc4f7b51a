"""Receives and time-stamps the cyclic status of one AK drive in servo mode, and keeps other frames apart."""

import can
import numpy as np

from rfca_rig.clock import Clock
from rfca_rig.codecs import cubemars_servo
from rfca_rig.codecs.cubemars_servo import MAX_ERPM, STATUS_DEG, Packet, Status
from rfca_rig.drivers.bus_health import BusHealth
from rfca_rig.drivers.can_frames import MAX_READ_PAUSE_S, receive_frames
from rfca_rig.drivers.cubemars_settings import ServoSettings
from rfca_rig.drivers.frame_count import FrameCount
from rfca_rig.drivers.roles import ShaftSamples
from rfca_rig.drivers.speed_check import SpeedCheck
from rfca_rig.drivers.wrapped_position import WrappedPosition

# Ends of the 16 bit field, and of the range to which the manual says the position is limited.
RANGE_ENDS = frozenset({-32768, -32000, 32000, 32767})
# Margin in rad at the shaft, on top of the fastest possible motion, before a step counts as a jump.
JUMP_MARGIN_RAD = 0.3


class ServoReports:
    """Receives the status of one drive.

    `status` is its last frame, received at host time `heard_s`. Angle (continuous over turns), speed and torque are those of the shaft.
    """

    def __init__(self, bus: can.BusABC, clock: Clock, settings: ServoSettings) -> None:
        self._bus = bus
        self._clock = clock
        self._settings = settings
        # The status frame carries no time and no number, so device time comes from counting frames.
        self._count = FrameCount(settings.status_period_s)
        rad_per_count = abs(settings.angle_rad(1) - settings.angle_rad(0))
        fastest_rad_s = MAX_ERPM / abs(settings.erpm_s_per_rad)
        self._position = WrappedPosition(RANGE_ENDS, fastest_rad_s / rad_per_count, JUMP_MARGIN_RAD / rad_per_count)
        self._speed = SpeedCheck("gear_ratio and pole_pairs")
        self._rows: list[tuple[float, ...]] = []
        self.health = BusHealth()
        self.status: Status | None = None
        self.drained_s = self.heard_s = clock.now_s()
        self.position_deg = self.angle_rad = self.speed_rad_s = self.torque_Nm = np.nan
        self.reset_counters()

    def reset_counters(self) -> None:
        """Restarts the counters behind `missing`, and clears motion faults."""
        self._position.forgive()
        self._speed.forgive()
        self._foreign: set[int] = set()
        self._standard = False
        self.heard = 0

    def drain(self) -> None:
        """Receives everything the bus holds; never waits. Raises DeviceError if the bus fails or a frame cannot be decoded."""
        before_s, self.drained_s = self.drained_s, self._clock.now_s()
        reports: list[Status] = []
        try:
            for message in receive_frames(self._bus, self.health):
                self._take(message, reports)
        # Frames decoded before a failure are still stamped and handed out.
        finally:
            for report, device_s in zip(reports, self._count.stamp(len(reports), self.drained_s).tolist(), strict=True):
                self._follow(report, device_s, is_whole=self.drained_s - before_s < MAX_READ_PAUSE_S)

    def _take(self, message: can.Message, reports: list[Status]) -> None:
        if not message.is_extended_id:
            # MIT mode uses standard frames, servo mode extended ones.
            self._standard = True
        elif message.arbitration_id >> 8 == Packet.STATUS:
            drive = cubemars_servo.drive_of(message.arbitration_id)
            report = cubemars_servo.decode(message.arbitration_id, message.data) if drive == self._settings.drive_id else None
            if isinstance(report, Status):
                reports.append(report)
            else:
                self._foreign.add(drive)

    def _follow(self, report: Status, device_s: float, is_whole: bool) -> None:
        """Takes in one status. After a long pause (`is_whole` False) frames may be missing anywhere, so no jump is looked for."""
        settings = self._settings
        self.status, self.heard_s = report, self.drained_s
        self.heard += 1
        self.speed_rad_s = report.speed_erpm / settings.erpm_s_per_rad
        count = self._position.follow(report.position_count, device_s, self.speed_rad_s, judged=is_whole)
        self.position_deg = STATUS_DEG * count
        self.angle_rad = settings.angle_rad(count)
        self.torque_Nm = report.current_A * settings.shaft_torque_per_A
        self._speed.follow(device_s, self.angle_rad, self.speed_rad_s)
        self._rows.append((self.drained_s, device_s, self.angle_rad, self.speed_rad_s, self.torque_Nm))

    def samples(self) -> ShaftSamples:
        """Samples (m,) drained since the last call."""
        rows, self._rows = np.array(self._rows, np.float64).reshape(-1, 5), []
        return ShaftSamples(*rows.T.copy())

    @property
    def lost_frames(self) -> int:
        return self._count.lost

    @property
    def silent_s(self) -> float:
        """Time in s since the last status frame, at the last `drain`."""
        return self.drained_s - self.heard_s

    @property
    def motion_fault(self) -> str | None:
        """An error of the reported motion since `reset_counters`, or None."""
        return self._position.fault or self._speed.fault or self._count.fault

    @property
    def zero_lost(self) -> str | None:
        """Why the angle can no longer be trusted, or None. Never reset."""
        return self._position.leap

    def missing(self) -> str | None:
        """Why there is no status since `reset_counters`, and the remedy; None if there is one."""
        drive = self._settings.drive_id
        if self.heard:
            return None
        if self._foreign:
            others = ", ".join(map(str, sorted(self._foreign)))
            return f"status frames of drive {others} but none of drive {drive}; check drive_id"
        if self._standard:
            return (
                f"no status frame of drive {drive}, but frames of MIT mode or of others; check that it is set to servo mode (CubeMarsTool)"
            )
        return (
            "no frames at all on the CAN bus; check the drive's power, the wiring, the bit rate (1 Mbit/s), "
            "and that it uploads its status over CAN (CubeMarsTool)"
        )
