"""Limits of force and moment: an absolute peak limit, and a ceiling from the predicted load that only impacts may pass."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.drivers.roles import ForceSamples, SensorScale
from rfca_rig.errors import Tripped
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import Limits
from rfca_rig.trip_codes import Trip

Floats = NDArray[np.float64]

# Share of the limit below which the ceiling never falls: a small excess over a small prediction is no danger.
MIN_CEILING_SHARE = 0.1


@dataclass
class ExceedanceTimer:
    """How long a value has been above its ceiling, by the device's own time."""

    below_s: float = np.nan

    def seconds(self, device_s: Floats, values: Floats, ceiling: float) -> float:
        """Adds a block of samples and returns for how many seconds the value has been above the ceiling without a break.

        Parameters
        ----------
        device_s : ndarray, shape (m,)
            Times in s by the device's clock, increasing; m is at least 1.
        values : ndarray, shape (m,)
            Force in N or moment in N m.
        ceiling : float
            In the unit of `values`.

        Returns
        -------
        float
            0 where the last value is not above the ceiling.
        """
        # The last value below the ceiling is the usual case.
        if values[-1] <= ceiling:
            self.below_s = float(device_s[-1])
            return 0.0
        below = np.flatnonzero(values <= ceiling)
        if len(below):
            self.below_s = float(device_s[below[-1]])
        # A stage that begins above the ceiling counts from its first sample.
        elif np.isnan(self.below_s):
            self.below_s = float(device_s[0])
        return float(device_s[-1]) - self.below_s


class LoadMonitor:
    """Checks force and moment; `peak` is the largest load since the stage began."""

    def __init__(self, limits: Limits, scale: SensorScale) -> None:
        self._limits = limits
        self._scale = scale
        self.expect(None)

    def expect(self, expected: Load | None) -> None:
        """A stage begins in which the model predicts at most this load; None where there is no prediction."""
        # Without a prediction the ceiling is infinite: only the absolute limits hold then.
        limits, unknown = self._limits, Load(np.inf, np.inf)
        load = expected or unknown
        self._ceiling = Load(
            max(limits.above_expected * load.force_N, MIN_CEILING_SHARE * limits.force_N),
            max(limits.above_expected * load.torque_Nm, MIN_CEILING_SHARE * limits.torque_Nm),
        )
        self._force, self._torque = ExceedanceTimer(), ExceedanceTimer()
        self.peak = Load(0.0, 0.0)

    def check(self, samples: ForceSamples) -> None:
        """Checks one block, with at least one record."""
        counts = samples.counts.astype(np.float64)
        # Magnitudes of the whole vectors: a limit per axis would depend on how the sensor is mounted.
        force_N = np.sqrt((counts[:, :3] ** 2).sum(axis=1)) / self._scale.counts_per_N
        torque_Nm = np.sqrt((counts[:, 3:] ** 2).sum(axis=1)) / self._scale.counts_per_Nm
        here = Load(float(force_N.max()), float(torque_Nm.max()))
        self.peak = self.peak.max_with(here)
        self._check_peak(here)
        self._check_lasting(samples.device_s, force_N, torque_Nm)

    def _check_peak(self, here: Load) -> None:
        if here.force_N > self._limits.force_N:
            raise Tripped(Trip.FORCE, f"force {here.force_N:.1f} N, limit {self._limits.force_N:g} N; raise the rack or go slower")
        if here.torque_Nm > self._limits.torque_Nm:
            limit_Nm = self._limits.torque_Nm
            raise Tripped(Trip.MOMENT, f"moment {here.torque_Nm:.2f} N m, limit {limit_Nm:g} N m; raise the rack or go slower")

    def _check_lasting(self, device_s: Floats, force_N: Floats, torque_Nm: Floats) -> None:
        self._check_one(Trip.FORCE_LASTS, self._force.seconds(device_s, force_N, self._ceiling.force_N), f"force {force_N[-1]:.1f} N", "N")
        lasts_s = self._torque.seconds(device_s, torque_Nm, self._ceiling.torque_Nm)
        self._check_one(Trip.MOMENT_LASTS, lasts_s, f"moment {torque_Nm[-1]:.2f} N m", "N m")

    def _check_one(self, code: Trip, lasts_s: float, value: str, unit: str) -> None:
        if lasts_s > self._limits.above_expected_s:
            ceiling = self._ceiling.force_N if unit == "N" else self._ceiling.torque_Nm
            raise Tripped(
                code,
                f"{value} and more for {1e3 * lasts_s:.0f} ms, {ceiling:.3g} {unit} may be passed for "
                f"{1e3 * self._limits.above_expected_s:.0f} ms; is the rack as high as planned, and the leg whole?",
            )
