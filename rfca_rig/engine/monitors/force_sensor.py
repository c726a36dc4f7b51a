"""Checks of the force sensor's stream: present, complete, changing, healthy. A rig without a trusted sensor must not move."""

import numpy as np
from numpy.typing import NDArray

from rfca_rig.codecs.netbox_status import status_text
from rfca_rig.drivers.roles import ForceSamples
from rfca_rig.errors import Tripped
from rfca_rig.protocol.plan import Limits
from rfca_rig.trip_codes import Trip

# Status word of the NetBox, see `codecs.netbox_status`. Drivers of other sensors set the same bits 31 and 17. Bit 31:
# summary of all errors.
SENSOR_FAULT = np.uint32(0x80000000)
# Bit 17: transducer saturation or A/D error.
SATURATED = np.uint32(0x00020000)
# All but the summary bit and bit 16, a latched monitor condition, which leaves the values good.
ANY_ERROR = np.uint32(0x7FFEFFFF)


class SensorMonitor:
    """Remembers when the last record came, and when its counts last changed."""

    def __init__(self, limits: Limits, now_s: float) -> None:
        self._limits = limits
        self._received_s = now_s
        self._last: NDArray[np.int32] | None = None
        self._last_s = np.nan
        self._changed_s = np.nan

    def check(self, now_s: float, samples: ForceSamples) -> None:
        """Checks one tick's records; `samples.counts` (m, 6) may be empty."""
        if len(samples.counts):
            self._received_s = now_s
            self._check_status(samples)
            self._check_time(samples)
            self._check_alive(samples)
        else:
            self._check_silence(now_s - self._received_s)

    def _check_silence(self, silent_s: float) -> None:
        limit_s = self._limits.sensor_silent_s
        if silent_s > limit_s:
            raise Tripped(
                Trip.SENSOR_SILENT,
                f"force sensor silent for {1e3 * silent_s:.0f} ms, limit {1e3 * limit_s:.0f} ms; check its cable and power",
            )

    def _check_status(self, samples: ForceSamples) -> None:
        worst = np.bitwise_or.reduce(samples.status)
        # Before all other errors: the values of a saturated sensor can no longer guard the rig.
        if worst & SATURATED:
            raise Tripped(
                Trip.SENSOR_SATURATED, f"force sensor saturated (status 0x{int(worst):08x}); its values can no longer guard the rig"
            )
        if worst & SENSOR_FAULT and worst & ANY_ERROR:
            raise Tripped(Trip.SENSOR_ERROR, f"force sensor reports an error: {status_text(int(worst))}; see its status page")

    def _check_time(self, samples: ForceSamples) -> None:
        """Checks for gaps: records may come, and yet so many be lost in between that the force was not observed."""
        # By the sensor's own record counter, which shows lost records whenever they were received.
        times_s = samples.device_s
        blind_s = float((times_s[1:] - times_s[:-1]).max(initial=0.0))
        if not np.isnan(self._last_s):
            blind_s = max(blind_s, float(times_s[0]) - self._last_s)
        self._last_s = float(times_s[-1])
        if blind_s > self._limits.sensor_silent_s:
            limit_ms = 1e3 * self._limits.sensor_silent_s
            raise Tripped(
                Trip.SENSOR_BLIND,
                f"records of {1e3 * blind_s:.0f} ms of the force are lost at once, limit {limit_ms:.0f} ms; check the network and the "
                "machine's load",
            )

    def _check_alive(self, samples: ForceSamples) -> None:
        """Checks that the counts change: a sensor at rest has noise, a hanging box or a loose cable has not."""
        counts = samples.counts
        # The first record of all is compared with itself, which counts as no change.
        before = counts[:1] if self._last is None else self._last
        # The newest pair decides alone where it differs, which is the usual case.
        if len(counts) > 1 and (counts[-1] != counts[-2]).any():
            self._changed_s = float(samples.device_s[-1])
        elif len(changed := np.flatnonzero((np.concatenate([before, counts[:-1]]) != counts).any(axis=1))):
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
