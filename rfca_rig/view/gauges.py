"""Distance of each monitored value from its limit: current value, share of the limit, and largest share since the stage began."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rfca_rig.drivers.roles import SensorScale
from rfca_rig.engine.limit_monitor import MIN_CEILING_SHARE
from rfca_rig.errors import Trip
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import Limits
from rfca_rig.view.pyramid import Floats
from rfca_rig.view.run_queue import SeenTicks


@dataclass
class Gauge:
    """One limit. It reports the value that came nearest to the limit since the last report; `limit` may change during a stage."""

    name: str
    unit: str
    code: Trip
    limit: float
    value: float = 0.0
    share: float = 0.0
    peak_share: float = 0.0
    is_reported: bool = True

    def show(self, value: float, limit: float | None = None) -> None:
        """Takes in a value, and the limit in force for it where that has changed."""
        limit = self.limit if limit is None else limit
        share = value / limit if limit > 0.0 else 0.0
        # The page is updated a few times a second: of the values in between, the worst is kept.
        if self.is_reported or share >= self.share:
            self.value, self.share, self.limit, self.is_reported = value, share, limit, False
        self.peak_share = max(self.peak_share, share)

    def read_values(self) -> dict[str, float]:
        """The worst value since the last call, as numbers for the page; the next value starts a new report."""
        self.is_reported = True
        numbers = {"value": self.value, "share": self.share, "peak_share": max(self.peak_share, self.share), "limit": self.limit}
        return {name: round(number, 4) for name, number in numbers.items()}


class Gauges:
    """All limits that the run monitors, evaluated on the ticks that the view receives. For display only: it trips nothing."""

    def __init__(self, limits: Limits, scale: SensorScale) -> None:
        self._limits = limits
        self._per_unit = np.array([scale.counts_per_N, scale.counts_per_Nm])
        self._heard_s = -np.inf
        # A following error is allowed to grow with speed; the gauge begins with the limit of a shaft at rest.
        still_deg = float(np.degrees(limits.following_error_rad))
        lasting_ms = 1e3 * limits.above_expected_s
        self._force = Gauge("force", "N", Trip.FORCE, limits.force_N)
        self._moment = Gauge("moment", "N m", Trip.MOMENT, limits.torque_Nm)
        self._force_lasts = Gauge("force above expected", "ms", Trip.FORCE_LASTS, lasting_ms)
        self._moment_lasts = Gauge("moment above expected", "ms", Trip.MOMENT_LASTS, lasting_ms)
        self._speed = Gauge("speed", "rad/s", Trip.OVERSPEED, limits.speed_rad_s)
        self._following = Gauge("following error", "deg", Trip.FOLLOWING, still_deg)
        self._sensor = Gauge("sensor silent", "ms", Trip.SENSOR_SILENT, 1e3 * limits.sensor_silent_s)
        self._drive = Gauge("drive silent", "ms", Trip.DRIVE_SILENT, 1e3 * limits.drive_silent_s)
        self._warmth = Gauge("drive temperature", "degC", Trip.DRIVE_HOT, limits.temperature_C)
        self._late = Gauge("loop late", "ms", Trip.LATE, 1e3 * limits.late_s)
        load, motion = (self._force, self._moment, self._force_lasts, self._moment_lasts), (self._speed, self._following)
        self._all = (*load, *motion, self._sensor, self._drive, self._warmth, self._late)
        self.stage(None)

    def describe(self) -> list[dict[str, object]]:
        """Names, units, limits and trip codes of all gauges, for the first message to a page."""
        return [{"name": gauge.name, "unit": gauge.unit, "limit": round(gauge.limit, 4), "code": str(gauge.code)} for gauge in self._all]

    def stage(self, expected: Load | None) -> None:
        """A stage begins with the load that the model expects; None where that is unknown."""
        # The same ceilings as in `engine.limit_monitor`, so that the page shows what the run is stopped by.
        load, factor = expected or Load(np.inf, np.inf), self._limits.above_expected
        self._ceilings = (
            max(factor * load.force_N, MIN_CEILING_SHARE * self._limits.force_N),
            max(factor * load.torque_Nm, MIN_CEILING_SHARE * self._limits.torque_Nm),
        )
        self._below_s = [np.inf, np.inf]
        for gauge in self._all:
            gauge.peak_share = 0.0

    def take(self, ticks: SeenTicks) -> None:
        """Takes in consecutive ticks."""
        if len(ticks.counts):
            self._loads(ticks.force_device_s, ticks.counts)
        self._motion(ticks)
        # Age of the newest force record at each tick; none before the first record arrived.
        heard_s = np.maximum.accumulate(np.where(ticks.force_records > 0, ticks.now_s, self._heard_s))
        self._heard_s = float(heard_s[-1])
        if np.isfinite(heard_s).any():
            self._sensor.show(1e3 * float((ticks.now_s - heard_s)[np.isfinite(heard_s)].max()))
        self._drive.show(1e3 * float(ticks.drive_silent_s.max()))
        self._late.show(1e3 * max(float(ticks.late_s.max()), 0.0))
        if not np.isnan(ticks.temperature_C[-1]):
            self._warmth.show(float(ticks.temperature_C[-1]))

    def _loads(self, device_s: Floats, counts: np.ndarray) -> None:
        # In floats: squares of raw counts may exceed 32 bits.
        squares = np.square(counts, dtype=np.float64)
        sizes = np.sqrt(np.column_stack([squares[:, :3].sum(axis=1), squares[:, 3:].sum(axis=1)])) / self._per_unit
        for axis, (gauge, lasts) in enumerate(((self._force, self._force_lasts), (self._moment, self._moment_lasts))):
            gauge.show(float(sizes[:, axis].max()))
            lasts.show(1e3 * self._lasting_s(axis, device_s, sizes[:, axis]))

    def _lasting_s(self, axis: int, device_s: Floats, sizes: Floats) -> float:
        """Longest time in s for which a load has stayed above its ceiling, over records at `device_s` (n,) of `sizes` (n,)."""
        # Last time below the ceiling before these records. Where unknown, or after a restart of the device, counting starts here.
        before_s = self._below_s[axis] if self._below_s[axis] <= device_s[0] else float(device_s[0])
        below_s = np.maximum.accumulate(np.where(sizes <= self._ceilings[axis], device_s, before_s))
        self._below_s[axis] = float(below_s[-1])
        return float((device_s - below_s).max())

    def _motion(self, ticks: SeenTicks) -> None:
        """Compares each tick's target with the last angle that the drive reported within that tick."""
        reported = ticks.shaft_samples > 0
        if not reported.any():
            return
        # Samples of all ticks stand in one row: running sums of their numbers give the column of each tick's last sample.
        last = ticks.shaft[:, np.cumsum(ticks.shaft_samples)[reported] - 1]
        self._speed.show(float(np.abs(last[3]).max()))
        allowed_rad = self._limits.following_error_rad + self._limits.following_error_s * np.abs(ticks.target_speed_rad_s[reported])
        behind_rad = np.abs(ticks.target_rad[reported] - last[2])
        worst = int((behind_rad / allowed_rad).argmax())
        self._following.show(float(np.degrees(behind_rad[worst])), float(np.degrees(allowed_rad[worst])))

    def read_values(self) -> Mapping[str, Mapping[str, float]]:
        """The worst values since the last call, by name of the gauge."""
        return {gauge.name: gauge.read_values() for gauge in self._all}
