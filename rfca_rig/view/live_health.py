"""Streams of a run in progress: their data rates, losses and delays, and their sample times on the run's clock."""

from collections import deque
from collections.abc import Mapping
from math import isnan
from typing import Any

import numpy as np

from rfca_rig.drivers.roles import SensorScale
from rfca_rig.protocol.plan import Limits
from rfca_rig.view.messages import Health
from rfca_rig.view.pyramid import Floats
from rfca_rig.view.run_queue import SeenTicks

# Window in s for rates and delays.
RATE_OVER_S = 1.0
# Thresholds of display only; the run is stopped by its limits. Below 90 % of the sensor's nominal rate records are missing.
LEAST_OF_RATE = 0.9
# Share of the delay at which the control loop trips.
GAP_SHARE = 0.5
BACKLOG_MB = 1.0
DELAY_MS = 200.0

# Window in s of the smallest delay. Clocks drift apart, so that an old offset is wrong after a while.
REMEMBERED_S = 10.0
# Records overtake each other by less than this; a larger step back means that the device started its clock again.
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
        """The queue was read at `wall_s`; its oldest tick was put there at `oldest_s`, infinity where it was empty."""
        if oldest_s < wall_s:
            self._delays_s.append((wall_s, wall_s - oldest_s))
        while self._delays_s and self._delays_s[0][0] < wall_s - RATE_OVER_S:
            self._delays_s.popleft()

    def list_lines(self) -> list[Health]:
        """All lines for the page; none before the first tick."""
        ticks = self._last
        return [] if ticks is None else [self._rate(), *self._stream(), *self._loop(ticks), *self._view(ticks.lost)]

    def _rate(self) -> Health:
        elapsed_s = self._counted[-1][0] - self._counted[0][0]
        # The first block's records came before the interval that its time begins, so it does not count.
        rate_Hz = sum(count for _, count in list(self._counted)[1:]) / elapsed_s if elapsed_s > 0.0 else 0.0
        return Health("force records", f"{rate_Hz:.0f}/s", rate_Hz >= LEAST_OF_RATE * self._scale.rate_Hz)

    def _stream(self) -> list[Health]:
        health = self._vitals.get("health", {})
        lost, faulty = health.get("lost", 0), health.get("malformed", 0) + health.get("faulty_status", 0)
        notes = "; ".join(health.get("notes", ()))
        status = notes or ("healthy" if not faulty else f"{faulty} bad records")
        return [Health("records lost", str(lost), lost == 0), Health("sensor", status, not notes and not faulty)]

    def _loop(self, ticks: SeenTicks) -> list[Health]:
        limits, gap_s, warmth_C = self._limits, float(ticks.worst_gap_s[-1]), float(ticks.temperature_C[-1])
        backlog_MB = 1e-6 * self._vitals.get("backlog_bytes", 0)
        warm = [] if isnan(warmth_C) else [warmth_C]
        return [
            Health("worst loop gap", f"{1e3 * gap_s:.1f} ms", gap_s < GAP_SHARE * limits.late_s),
            *(Health("drive", f"{warmth_C:.0f} degC", warmth_C < 0.9 * limits.temperature_C) for warmth_C in warm),
            Health("recorder behind", f"{backlog_MB:.2f} MB", backlog_MB < BACKLOG_MB),
        ]

    def _view(self, lost: int) -> list[Health]:
        delay_ms = 1e3 * max((delay_s for _, delay_s in self._delays_s), default=0.0)
        return [
            Health("lost to the view", f"{lost} records", lost == 0),
            Health("delay of the view", f"{delay_ms:.0f} ms", delay_ms < DELAY_MS),
        ]


class StreamClock:
    """Adds to the device's time the smallest recent difference between arrival and device time.

    A recording does the same with the smallest difference of a whole stage. A restarted stream is recognised by a step of its time.
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
        if device_s[0] < self._last_s - BACK_S or (self._minima and abs(least_s - self._offset_s()) > LEAP_S):
            self._minima.clear()
        self._last_s = float(device_s[-1])
        # Keeps a sliding minimum: offsets ascend in the deque, so that the first is the smallest of the window.
        now_s = float(host_s[-1])
        while self._minima and self._minima[-1][1] >= least_s:
            self._minima.pop()
        self._minima.append((now_s, least_s))
        while self._minima[0][0] < now_s - REMEMBERED_S:
            self._minima.popleft()
        return device_s + self._offset_s()

    def _offset_s(self) -> float:
        return self._minima[0][1]
