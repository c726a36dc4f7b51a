"""The shaft's own motion as rows: how far it is from where it was told to be."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import Supposed
from rfca_rig.analysis.repeats import Condition
from rfca_rig.diagnosis.data.observations import Observations, rms
from rfca_rig.diagnosis.leg.strokes import BOUNDED, dynamic_label
from rfca_rig.model.motion import ramp_to_speed
from rfca_rig.model.setup import set_up
from rfca_rig.model.stroke import stroke_of

Floats = NDArray[np.float64]

SIGNAL = "shaft_angle_rad"
BIN_S = 0.010
AS_COMMANDED_RAD = 0.003  # rms: what 1 ms of delay at 3 rad/s makes, and no leg notices
BUT_LATE_RAD = 0.002  # rms beside what a delay makes
SMALLEST_SCALE_RAD = 0.1  # a model error of 1 % is then a milliradian at least, which no leg notices


@dataclass(frozen=True)
class ShaftCondition:
    """The shaft of one condition, mean over its repeats; `start_rad` where it stood before the motion.

    `first` (b,) is the sample that each bin begins with; `repeats` (r, b) holds by how much each stroke turned further than told, in bins.
    """

    label: str
    height_m: float
    speed_rad_s: float
    t_s: Floats
    first: NDArray[np.intp]
    start_rad: float
    sample_noise_rad: float
    repeats: Floats
    strokes_before: tuple[int, ...] = ()

    def simulated(self, supposed: Supposed) -> Floats:
        """The model's turn less the commanded one, each from where it stands, (b,). Raises SimulationFailed.

        The command starts where the shaft was recorded to stand: by how much a drive sags there is not used. What a late drive does is
        what the same drive would have done so much before.
        """
        motion = ramp_to_speed(self.start_rad, self.speed_rad_s, supposed.rig.drive.ramp_s, float(self.t_s[-1]))
        then_s = self.t_s - supposed.command_delay_s
        setup = set_up(supposed.rig, self.height_m + supposed.height_offset_m, motion, self.strokes_before)
        if setup.drive is None:  # the leg does not act back on this shaft
            angle_rad = setup.motion.angle_rad(np.maximum(then_s, 0.0))
        else:
            angle_rad = stroke_of(setup, then_s, BOUNDED).shaft_angle_rad
        stood_rad = float(angle_rad[self.t_s <= max(0.0, float(self.t_s[0]))].mean())
        return self._binned(angle_rad - stood_rad - motion.angle_rad(self.t_s) + self.start_rad)

    @property
    def away_rad(self) -> Floats:
        """By how much it turned further than told, (b,), mean over the repeats."""
        return np.asarray(self.repeats.mean(axis=0))

    def told_rad_s(self, ramp_s: float) -> Floats:
        """The commanded speed, (b,)."""
        return self._binned(self.speed_rad_s * np.clip(self.t_s / ramp_s, 0.0, 1.0))

    def _binned(self, values: Floats) -> Floats:
        return np.asarray(np.add.reduceat(values, self.first) / self._counts)

    @cached_property
    def _counts(self) -> Floats:
        return np.diff(np.append(self.first, len(self.t_s))).astype(np.float64)

    def rows(self) -> Observations:
        """By how much the shaft has turned further than it was told."""
        measured = self.away_rad
        middle = self._binned(self.t_s)
        scale = np.sqrt(measured**2 + (0.02 * np.gradient(measured, middle)) ** 2 + SMALLEST_SCALE_RAD**2)
        bins = len(measured)
        return Observations(
            measured=measured,
            noise=self.sample_noise_rad / np.sqrt(self._counts * len(self.repeats)),
            scale=scale,
            jolt=np.zeros(bins),
            progress=middle / 0.3,
            t_s=middle,
            phase=np.where(middle <= 0.0, "rest", "turning"),
            label=np.zeros(bins, dtype=np.intp),
            condition=np.zeros(bins, dtype=np.intp),
            labels=(dynamic_label(self.label, SIGNAL),),
        )


def shaft_condition(condition: Condition, end_s: float, ramp_s: float) -> ShaftCondition | None:
    """The shaft of a condition until `end_s`; None where no angle was recorded."""
    traces = [trace for stroke in condition.strokes if (trace := stroke.channel(SIGNAL)) is not None]
    if not traces:
        return None
    t_s = min((t for t, _ in traces), key=len)
    t_s = t_s[t_s <= end_s]
    angles = np.array([np.interp(t_s, t, angle) for t, angle in traces])
    first = np.flatnonzero(np.diff(np.floor(t_s / BIN_S), prepend=-1e9))
    counts = np.diff(np.append(first, len(t_s)))
    away = angles - ramp_to_speed(0.0, condition.speed_rad_s, ramp_s, float(t_s[-1])).angle_rad(t_s)
    still = t_s <= max(0.0, float(t_s[0]))
    away -= angles[:, still].mean(axis=1)[:, None]
    noise = float(np.median(np.abs(np.diff(angles, 2, axis=1)))) / 0.6745 / np.sqrt(6.0)
    return ShaftCondition(
        label=condition.label,
        height_m=condition.height_m,
        speed_rad_s=condition.speed_rad_s,
        t_s=t_s,
        first=first,
        start_rad=float(angles[:, still].mean()),
        sample_noise_rad=max(noise, 1e-5),
        repeats=np.add.reduceat(away, first, axis=1) / counts,
        strokes_before=condition.strokes_before,
    )


def turns_as_commanded(shaft: ShaftCondition) -> bool:
    """Whether the shaft did what it was told, from where it stood."""
    return rms(shaft.away_rad) < AS_COMMANDED_RAD


def tracks_command(shaft: ShaftCondition, ramp_s: float) -> bool:
    """Whether the shaft did what it was told, at once or `late_s` later."""
    return tracking_error(shaft, ramp_s) < 1.0


def tracking_error(shaft: ShaftCondition, ramp_s: float) -> float:
    """How far the shaft is from what it was told, 1 where it neither turns as commanded nor only later."""
    return min(rms(shaft.away_rad) / AS_COMMANDED_RAD, _beside_delay_rad(shaft, ramp_s) / BUT_LATE_RAD)


def _beside_delay_rad(shaft: ShaftCondition, ramp_s: float) -> float:
    return rms(shaft.away_rad + late_s(shaft, ramp_s) * shaft.told_rad_s(ramp_s))


def late_s(shaft: ShaftCondition, ramp_s: float) -> float:
    """How much later than told the shaft turned (least squares)."""
    told_rad_s = shaft.told_rad_s(ramp_s)
    return -float(told_rad_s @ shaft.away_rad) / float(told_rad_s @ told_rad_s)
