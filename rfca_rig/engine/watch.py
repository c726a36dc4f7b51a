"""The limits, checked at every tick by the very loop that feeds the drive's watchdog."""

from dataclasses import dataclass

import numpy as np

from rfca_rig.drivers.roles import ForceSamples, MotorStatus, SensorScale
from rfca_rig.errors import Tripped
from rfca_rig.protocol.plan import Limits

SENSOR_FAULT = np.uint32(0x80000000)  # NetBox status bit 31: summary error
SATURATED = np.uint32(0x00020000)  # bit 17: transducer saturation or A/D error


@dataclass(frozen=True)
class Tracking:
    """Where the shaft should be and is."""

    target_rad: float
    angle_rad: float
    target_speed_rad_s: float
    speed_rad_s: float


class Watch:
    """Raises Tripped, with the value and the limit, as soon as one is passed."""

    def __init__(self, limits: Limits, scale: SensorScale) -> None:
        self._limits = limits
        self._scale = scale
        self._last_force_s: float | None = None

    def force(self, now_s: float, samples: ForceSamples) -> None:
        """Force, moment, health and age of the sensor's stream."""
        if len(samples.counts):
            self._last_force_s = now_s
            self._wrench(samples)
            self._sensor_status(samples)
            return
        if self._last_force_s is None:
            self._last_force_s = now_s
        silent_s = now_s - self._last_force_s
        if silent_s > self._limits.sensor_silent_s:
            limit_ms = 1e3 * self._limits.sensor_silent_s
            raise Tripped(f"force sensor silent for {1e3 * silent_s:.0f} ms, limit {limit_ms:.0f} ms; check its cable and power")

    def _wrench(self, samples: ForceSamples) -> None:
        counts = samples.counts.astype(np.float64)
        force_N = float(np.sqrt((counts[:, :3] ** 2).sum(axis=1)).max()) / self._scale.counts_per_N
        if force_N > self._limits.force_N:
            raise Tripped(f"force {force_N:.1f} N, limit {self._limits.force_N:g} N; raise the rack or go slower")
        torque_Nm = float(np.sqrt((counts[:, 3:] ** 2).sum(axis=1)).max()) / self._scale.counts_per_Nm
        if torque_Nm > self._limits.torque_Nm:
            raise Tripped(f"moment {torque_Nm:.2f} N m, limit {self._limits.torque_Nm:g} N m; raise the rack or go slower")

    def _sensor_status(self, samples: ForceSamples) -> None:
        worst = np.bitwise_or.reduce(samples.status)
        if worst & SATURATED:
            raise Tripped(f"force sensor saturated (status 0x{int(worst):08x}); its values can no longer guard the rig")
        if worst & SENSOR_FAULT and worst & np.uint32(0x7FFEFFFF):
            raise Tripped(f"force sensor reports an error (status 0x{int(worst):08x}); see its status page")

    def drive(self, status: MotorStatus) -> None:
        """The drive's error, its state, and the age of its last heartbeat."""
        if status.fault is not None:
            raise Tripped(f"drive: {status.fault}")
        if status.silent_s > self._limits.drive_silent_s:
            raise Tripped(
                f"drive silent for {1e3 * status.silent_s:.0f} ms, limit {1e3 * self._limits.drive_silent_s:.0f} ms; check bus and power"
            )

    def tracking(self, now: Tracking) -> None:
        """Speed, and how far the shaft is from where it should be; the limit grows with the speed."""
        if abs(now.speed_rad_s) > self._limits.speed_rad_s:
            raise Tripped(f"shaft at {now.speed_rad_s:.2f} rad/s, limit {self._limits.speed_rad_s:g} rad/s")
        behind_rad = abs(now.target_rad - now.angle_rad)
        limit_rad = self._limits.following_error_rad + self._limits.following_error_s * abs(now.target_speed_rad_s)
        if behind_rad > limit_rad:
            raise Tripped(
                f"shaft {np.degrees(behind_rad):.1f} deg from where it should be, limit {np.degrees(limit_rad):.1f} deg "
                f"at {now.target_speed_rad_s:.2f} rad/s; look for a jam, or a drive too weak for this load"
            )
