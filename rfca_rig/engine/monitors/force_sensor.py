"""The force sensor's stream: there, whole, moving, healthy. A rig whose sensor cannot be trusted must not move."""

import numpy as np
from numpy.typing import NDArray

from rfca_rig.codecs.netbox_status import status_text
from rfca_rig.drivers.roles import ForceSamples
from rfca_rig.errors import Tripped
from rfca_rig.protocol.plan import Limits
from rfca_rig.trip_codes import Trip

SENSOR_FAULT = np.uint32(0x80000000)  # NetBox status bit 31: summary error
SATURATED = np.uint32(0x00020000)  # bit 17: transducer saturation or A/D error
ANY_ERROR = np.uint32(0x7FFEFFFF)  # all but the summary and bit 16, a latched monitor condition


class SensorMonitor:
    """Remembers when the last record came, and when its counts last changed."""

    def __init__(self, limits: Limits, now_s: float) -> None:
        self._limits = limits
        self._heard_s = now_s
        self._last: NDArray[np.int32] | None = None
        self._last_s = np.nan
        self._changed_s = np.nan

    def check(self, now_s: float, samples: ForceSamples) -> None:
        """One tick's records, also where there are none."""
        if len(samples.counts):
            self._heard_s = now_s
            self._check_status(samples)
            self._check_time(samples)
            self._check_alive(samples)
        else:
            self._check_silence(now_s - self._heard_s)

    def _check_silence(self, silent_s: float) -> None:
        limit_s = self._limits.sensor_silent_s
        if silent_s > limit_s:
            raise Tripped(
                Trip.SENSOR_SILENT,
                f"force sensor silent for {1e3 * silent_s:.0f} ms, limit {1e3 * limit_s:.0f} ms; check its cable and power",
            )

    def _check_status(self, samples: ForceSamples) -> None:
        worst = np.bitwise_or.reduce(samples.status)
        if worst & SATURATED:
            raise Tripped(
                Trip.SENSOR_SATURATED, f"force sensor saturated (status 0x{int(worst):08x}); its values can no longer guard the rig"
            )
        if worst & SENSOR_FAULT and worst & ANY_ERROR:
            raise Tripped(Trip.SENSOR_ERROR, f"force sensor reports an error: {status_text(int(worst))}; see its status page")

    def _check_time(self, samples: ForceSamples) -> None:
        """Records may come, and yet have left out so much in between that nobody watched the force."""
        times_s = samples.device_s if np.isnan(self._last_s) else np.concatenate([[self._last_s], samples.device_s])
        blind_s = float(np.diff(times_s).max(initial=0.0))
        self._last_s = float(samples.device_s[-1])
        if blind_s > self._limits.sensor_silent_s:
            limit_ms = 1e3 * self._limits.sensor_silent_s
            raise Tripped(
                Trip.SENSOR_BLIND,
                f"records of {1e3 * blind_s:.0f} ms of the force are lost at once, limit {limit_ms:.0f} ms; check the network and the "
                "machine's load",
            )

    def _check_alive(self, samples: ForceSamples) -> None:
        """A quiet sensor has noise; six counts that never change are a cable or a box that hangs."""
        counts = samples.counts
        before = counts[:1] if self._last is None else self._last
        changed = np.flatnonzero((np.concatenate([before, counts[:-1]]) != counts).any(axis=1))
        if len(changed):
            self._changed_s = float(samples.device_s[changed[-1]])
        elif np.isnan(self._changed_s):
            self._changed_s = float(samples.device_s[0])
        self._last = counts[-1:]
        self._check_frozen(float(samples.device_s[-1]) - self._changed_s)

    def _check_frozen(self, frozen_s: float) -> None:
        limit_s = self._limits.sensor_frozen_s
        if frozen_s > limit_s:
            raise Tripped(
                Trip.SENSOR_FROZEN,
                f"force sensor sends the same six counts for {1e3 * frozen_s:.0f} ms, limit {1e3 * limit_s:.0f} ms; "
                "restart its box, check the transducer's cable",
            )
