"""The shaft's own motion as rows: how far it is from where it was told to be."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import Supposed
from rfca_rig.analysis.repeats import Condition
from rfca_rig.diagnosis.rows import Label, Rows
from rfca_rig.model.motion import ramp_to_speed
from rfca_rig.model.stroke import stroke_following

Floats = NDArray[np.float64]

SIGNAL = "shaft_angle_rad"
BIN_S = 0.010
AS_COMMANDED_RAD = 0.003  # rms: what 1 ms of delay at 3 rad/s makes, and no leg notices
SMALLEST_SCALE_RAD = 2e-3


@dataclass(frozen=True)
class ShaftCondition:
    """The mean deviation of the shaft from its command over the repeats of one condition, in bins; `start_rad` where it stood."""

    label: str
    height_m: float
    speed_rad_s: float
    t_s: Floats
    first: NDArray[np.intp]
    angle_rad: Floats
    start_rad: float
    sample_noise_rad: float
    repeats: Floats

    def simulated(self, supposed: Supposed) -> Floats:
        """The model's angle less the command from the believed start, (b,). Raises SimulationFailed."""
        leg, drive = supposed.rig.leg, supposed.rig.drive
        motion = ramp_to_speed(leg.start_angle_rad, self.speed_rad_s, drive.ramp_s, float(self.t_s[-1]))
        stroke = stroke_following(supposed.rig, self.height_m + supposed.height_offset_m, motion, self.t_s)
        return self._binned(stroke.shaft_angle_rad - motion.angle_rad(self.t_s)) + leg.start_angle_rad

    def _binned(self, values: Floats) -> Floats:
        return np.asarray(np.add.reduceat(values, self.first) / self._counts)

    @property
    def _counts(self) -> Floats:
        return np.diff(np.append(self.first, len(self.t_s))).astype(np.float64)

    def rows(self, ramp_s: float = 0.05) -> Rows:
        """The recorded angle less a command that starts at 0, so that its first value is where the shaft stood."""
        motion = ramp_to_speed(0.0, self.speed_rad_s, ramp_s, float(self.t_s[-1]))
        measured = self._binned(self.angle_rad - motion.angle_rad(self.t_s))
        middle = self._binned(self.t_s)
        deviation = measured - self.start_rad
        scale = np.sqrt(deviation**2 + (0.02 * np.gradient(measured, middle)) ** 2 + SMALLEST_SCALE_RAD**2)
        bins = len(measured)
        return Rows(
            measured=measured,
            noise=self.sample_noise_rad / np.sqrt(self._counts * len(self.repeats)),
            scale=scale,
            jolt=np.zeros(bins),
            progress=middle / 0.3,
            t_s=middle,
            phase=np.where(middle <= 0.0, "rest", "turning"),
            label=np.zeros(bins, dtype=np.intp),
            condition=np.zeros(bins, dtype=np.intp),
            labels=(Label("dynamic", self.label, SIGNAL),),
        )


def shaft_condition(condition: Condition, end_s: float) -> ShaftCondition | None:
    """The shaft of a condition until `end_s`; None where no angle was recorded."""
    traces = [trace for stroke in condition.strokes if (trace := stroke.channel(SIGNAL)) is not None]
    if not traces:
        return None
    t_s = min((t for t, _ in traces), key=len)
    t_s = t_s[t_s <= end_s]
    angles = np.array([np.interp(t_s, t, angle) for t, angle in traces])
    mean = angles.mean(axis=0)
    first = np.flatnonzero(np.diff(np.floor(t_s / BIN_S), prepend=-1e9))
    still = t_s <= 0.0
    start = float(mean[still].mean()) if still.any() else float(mean[0])
    noise = float(np.median(np.abs(np.diff(angles, 2, axis=1)))) / 0.6745 / np.sqrt(6.0)
    return ShaftCondition(
        condition.label, condition.height_m, condition.speed_rad_s, t_s, first, mean, start, max(noise, 1e-5), angles
    )


def turns_as_commanded(shaft: ShaftCondition, ramp_s: float) -> bool:
    """Whether the shaft did what it was told, from where it stood."""
    rows = shaft.rows(ramp_s)
    return float(np.sqrt(np.mean((rows.measured - shaft.start_rad) ** 2))) < AS_COMMANDED_RAD
