"""What the page shows in numbers: each monitored value beside its limit, and the health of the
streams.

A gauge has the current value, its share of the limit, and the largest share since the stage began.
A stream has its data rate, its losses and delays, and its sample times on the run's clock.
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from math import isnan
from typing import Any

import numpy as np

from rfca_rig.drivers.roles import SensorScale
from rfca_rig.engine.limit_monitor import MIN_CEILING_SHARE
from rfca_rig.errors import Trip
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import Limits
from rfca_rig.view.messages import Health
from rfca_rig.view.pyramid import Floats
from rfca_rig.view.run_queue import SeenTicks


@dataclass
class Gauge:
    """One limit. It reports the value that came nearest to the limit since the last report;
    `limit` may change during a stage.
    """

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
        if limit is None:
            limit = self.limit
        share = 0.0
        if limit > 0.0:
            share = value / limit
        # The page is updated a few times a second: of the values in between, the worst is kept.
        if self.is_reported or share >= self.share:
            self.value = value
            self.share = share
            self.limit = limit
            self.is_reported = False
        self.peak_share = max(self.peak_share, share)

    def read_values(self) -> dict[str, float]:
        """The worst value since the last call, as numbers for the page; the next value starts a
        new report.
        """
        self.is_reported = True
        numbers = {
            "value": self.value,
            "share": self.share,
            "peak_share": max(self.peak_share, self.share),
            "limit": self.limit,
        }
        return {name: round(number, 4) for name, number in numbers.items()}


class Gauges:
    """All limits that the run monitors, evaluated on the ticks that the view receives. For
    display only: it trips nothing.
    """

    def __init__(self, limits: Limits, scale: SensorScale) -> None:
        self._limits = limits
        self._per_unit = np.array([scale.counts_per_N, scale.counts_per_Nm])
        self._heard_s = -np.inf
        # A following error is allowed to grow with speed; the gauge begins with the limit of a
        # shaft at rest.
        still_deg = float(np.degrees(limits.following_error_rad))
        lasting_ms = 1e3 * limits.above_expected_s
        self._force = Gauge("force", "N", Trip.FORCE, limits.force_N)
        self._moment = Gauge("moment", "N m", Trip.MOMENT, limits.torque_Nm)
        self._force_lasts = Gauge("force above expected", "ms", Trip.FORCE_LASTS, lasting_ms)
        self._moment_lasts = Gauge("moment above expected", "ms", Trip.MOMENT_LASTS, lasting_ms)
        self._speed = Gauge("speed", "rad/s", Trip.OVERSPEED, limits.speed_rad_s)
        self._following = Gauge("following error", "deg", Trip.FOLLOWING, still_deg)
        self._sensor = Gauge(
            "sensor silent", "ms", Trip.SENSOR_SILENT, 1e3 * limits.sensor_silent_s
        )
        self._drive = Gauge("drive silent", "ms", Trip.DRIVE_SILENT, 1e3 * limits.drive_silent_s)
        self._warmth = Gauge("drive temperature", "degC", Trip.DRIVE_HOT, limits.temperature_C)
        self._late = Gauge("loop late", "ms", Trip.LATE, 1e3 * limits.late_s)
        load = (self._force, self._moment, self._force_lasts, self._moment_lasts)
        motion = (self._speed, self._following)
        self._all = (*load, *motion, self._sensor, self._drive, self._warmth, self._late)
        self.stage(None)

    def describe(self) -> list[dict[str, object]]:
        """Names, units, limits and trip codes of all gauges, for the first message to a page."""
        return [
            {
                "name": gauge.name,
                "unit": gauge.unit,
                "limit": round(gauge.limit, 4),
                "code": str(gauge.code),
            }
            for gauge in self._all
        ]

    def stage(self, expected: Load | None) -> None:
        """A stage begins with the load that the model expects; None where that is unknown."""
        # The same ceilings as in `engine.limit_monitor`, so that the page shows what the run is
        # stopped by.
        load = expected or Load(np.inf, np.inf)
        factor = self._limits.above_expected
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
        heard_s = np.maximum.accumulate(
            np.where(ticks.force_records > 0, ticks.now_s, self._heard_s)
        )
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
        sizes = (
            np.sqrt(np.column_stack([squares[:, :3].sum(axis=1), squares[:, 3:].sum(axis=1)]))
            / self._per_unit
        )
        for axis, (gauge, lasts) in enumerate(
            ((self._force, self._force_lasts), (self._moment, self._moment_lasts))
        ):
            gauge.show(float(sizes[:, axis].max()))
            lasts.show(1e3 * self._lasting_s(axis, device_s, sizes[:, axis]))

    def _lasting_s(self, axis: int, device_s: Floats, sizes: Floats) -> float:
        """Longest time in s for which a load has stayed above its ceiling, over records at
        `device_s` (n,) of `sizes` (n,).
        """
        # Last time below the ceiling before these records. Where unknown, or after a restart of the
        # device, counting starts here.
        if self._below_s[axis] <= device_s[0]:
            before_s = self._below_s[axis]
        else:
            before_s = float(device_s[0])
        below_s = np.maximum.accumulate(np.where(sizes <= self._ceilings[axis], device_s, before_s))
        self._below_s[axis] = float(below_s[-1])
        return float((device_s - below_s).max())

    def _motion(self, ticks: SeenTicks) -> None:
        """Compares each tick's target with the last angle that the drive reported within that
        tick.
        """
        reported = ticks.shaft_samples > 0
        if not reported.any():
            return
        # Samples of all ticks stand in one row: running sums of their numbers give the column of
        # each tick's last sample.
        last = ticks.shaft[:, np.cumsum(ticks.shaft_samples)[reported] - 1]
        self._speed.show(float(np.abs(last[3]).max()))
        allowed_rad = self._limits.following_error_rad + self._limits.following_error_s * np.abs(
            ticks.target_speed_rad_s[reported]
        )
        behind_rad = np.abs(ticks.target_rad[reported] - last[2])
        worst = int((behind_rad / allowed_rad).argmax())
        self._following.show(
            float(np.degrees(behind_rad[worst])), float(np.degrees(allowed_rad[worst]))
        )

    def read_values(self) -> Mapping[str, Mapping[str, float]]:
        """The worst values since the last call, by name of the gauge."""
        return {gauge.name: gauge.read_values() for gauge in self._all}


# Window in s for rates and delays.
RATE_OVER_S = 1.0
# Thresholds of display only; the run is stopped by its limits. Below 90 % of the sensor's nominal
# rate records are missing.
LEAST_OF_RATE = 0.9
# Share of the delay at which the control loop trips.
GAP_SHARE = 0.5
BACKLOG_MB = 1.0
DELAY_MS = 200.0

# Window in s of the smallest delay. Clocks drift apart, so that an old offset is wrong after a
# while.
REMEMBERED_S = 10.0
# Records overtake each other by less than this; a larger step back means that the device started
# its clock again.
BACK_S = 0.05
# A jump of the offset by more than this means the same.
LEAP_S = 1.0


class LiveHealth:
    """Rates over the last second, and the state of the devices that the run reports."""

    def __init__(self, limits: Limits, scale: SensorScale) -> None:
        self._limits = limits
        self._scale = scale
        self._counted: deque[tuple[float, int]] = deque()
        self._vitals: Mapping[str, Any] = {}
        self._last: SeenTicks | None = None
        self._delays_s: deque[tuple[float, float]] = deque()

    def take(self, ticks: SeenTicks) -> None:
        """Takes in consecutive ticks."""
        self._last = ticks
        self._counted.append((float(ticks.now_s[-1]), len(ticks.counts)))
        while self._counted[0][0] < ticks.now_s[-1] - RATE_OVER_S:
            self._counted.popleft()

    def vitals(self, message: Mapping[str, Any]) -> None:
        """Takes in the state of sensor and recorder."""
        self._vitals = message

    def delay(self, wall_s: float, oldest_s: float) -> None:
        """The queue was read at `wall_s`; its oldest tick was put there at `oldest_s`, infinity
        where it was empty.
        """
        if oldest_s < wall_s:
            self._delays_s.append((wall_s, wall_s - oldest_s))
        while self._delays_s and self._delays_s[0][0] < wall_s - RATE_OVER_S:
            self._delays_s.popleft()

    def list_lines(self) -> list[Health]:
        """All lines for the page; none before the first tick."""
        ticks = self._last
        if ticks is None:
            return []
        return [self._rate(), *self._stream(), *self._loop(ticks), *self._view(ticks.lost)]

    def _rate(self) -> Health:
        elapsed_s = self._counted[-1][0] - self._counted[0][0]
        # The first block's records came before the interval that its time begins, so it does not
        # count.
        if elapsed_s > 0.0:
            rate_Hz = sum(count for _, count in list(self._counted)[1:]) / elapsed_s
        else:
            rate_Hz = 0.0
        return Health(
            "force records", f"{rate_Hz:.0f}/s", rate_Hz >= LEAST_OF_RATE * self._scale.rate_Hz
        )

    def _stream(self) -> list[Health]:
        health = self._vitals.get("health", {})
        lost = health.get("lost", 0)
        faulty = health.get("malformed", 0) + health.get("faulty_status", 0)
        notes = "; ".join(health.get("notes", ()))
        status = notes or ("healthy" if not faulty else f"{faulty} bad records")
        return [
            Health("records lost", str(lost), lost == 0),
            Health("sensor", status, not notes and not faulty),
        ]

    def _loop(self, ticks: SeenTicks) -> list[Health]:
        limits = self._limits
        gap_s = float(ticks.worst_gap_s[-1])
        warmth_C = float(ticks.temperature_C[-1])
        backlog_MB = 1e-6 * self._vitals.get("backlog_bytes", 0)
        lines = [
            Health("worst loop gap", f"{1e3 * gap_s:.1f} ms", gap_s < GAP_SHARE * limits.late_s)
        ]
        if not isnan(warmth_C):
            is_cool = warmth_C < 0.9 * limits.temperature_C
            lines.append(Health("drive", f"{warmth_C:.0f} degC", is_cool))
        lines.append(Health("recorder behind", f"{backlog_MB:.2f} MB", backlog_MB < BACKLOG_MB))
        return lines

    def _view(self, lost: int) -> list[Health]:
        delay_ms = 1e3 * max((delay_s for _, delay_s in self._delays_s), default=0.0)
        return [
            Health("lost to the view", f"{lost} records", lost == 0),
            Health("delay of the view", f"{delay_ms:.0f} ms", delay_ms < DELAY_MS),
        ]


class StreamClock:
    """Adds to the device's time the smallest recent difference between arrival and device time.

    A recording does the same with the smallest difference of a whole stage. A restarted stream is
    recognised by a step of its time.
    """

    def __init__(self) -> None:
        self._minima: deque[tuple[float, float]] = deque()
        self._last_s = -np.inf

    def run_s(self, host_s: Floats, device_s: Floats) -> Floats:
        """Times of samples on the host's clock.

        Parameters
        ----------
        host_s, device_s
            Arrival on the host's clock and time on the device's clock in s, both (m,), m >= 1.

        Returns
        -------
        Floats
            Device times shifted to the host's clock, (m,), in s.
        """
        restarts = np.flatnonzero(np.diff(device_s) < -BACK_S) + 1
        parts = zip(np.split(host_s, restarts), np.split(device_s, restarts), strict=True)
        return np.concatenate([self._of_one_stream(*part) for part in parts])

    def _of_one_stream(self, host_s: Floats, device_s: Floats) -> Floats:
        least_s = float((host_s - device_s).min())
        if device_s[0] < self._last_s - BACK_S or (
            self._minima and abs(least_s - self._offset_s()) > LEAP_S
        ):
            self._minima.clear()
        self._last_s = float(device_s[-1])
        # Keeps a sliding minimum: offsets ascend in the deque, so that the first is the smallest of
        # the window.
        now_s = float(host_s[-1])
        while self._minima and self._minima[-1][1] >= least_s:
            self._minima.pop()
        self._minima.append((now_s, least_s))
        while self._minima[0][0] < now_s - REMEMBERED_S:
            self._minima.popleft()
        return device_s + self._offset_s()

    def _offset_s(self) -> float:
        return self._minima[0][1]
