"""The motion of the shaft as observations: its deviation from the commanded motion."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.analysis.repeats import Condition
from rfca_rig.diagnosis.data import Observations, rms
from rfca_rig.diagnosis.leg.strokes import STROKE_TOLERANCE, dynamic_label
from rfca_rig.model.catalogue import set_up
from rfca_rig.model.motion import ShaftMotion, ramp_to_speed
from rfca_rig.model.stroke import SimulatedStroke, StrokeRequest, simulate_setup

Floats = NDArray[np.float64]

SIGNAL = "shaft_angle_rad"
BIN_S = 0.010
AS_COMMANDED_RAD = 0.003  # rms: what 1 ms of delay at 3 rad/s makes, and no leg notices
DELAYED_RAD = 0.002  # rms beside what a delay makes
# a model error of 1 % is then a milliradian at least, which no leg notices
SMALLEST_SCALE_RAD = 0.1


@dataclass(frozen=True)
class ShaftCondition:
    """The shaft of one condition, mean over its repeats, with n samples in b bins.

    Parameters
    ----------
    label, height_m, speed_rad_s
        The condition.
    t_s
        (n,) times of the samples.
    first
        (b,) the first sample of each bin.
    start_rad
        Angle before the motion.
    sample_noise_rad
        Standard deviation of one sample.
    repeats
        (r, b) by how much the shaft of each stroke is ahead of its command, mean in each bin.
    strokes_before
        Of each stroke, as in `Condition`.
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

    def simulated(self, supposed: ModelPoint) -> Floats:
        """Simulated angle less the commanded one, each from its start, (b,). Raises
        SimulationFailed.

        The command starts from the recorded start angle: the sag of a drive there is not used. A
        drive that is late by a delay moves as the same drive without delay did that much earlier.
        """
        request = self.request(supposed)
        if request.setup.drive is None:
            return self.read_prescribed(supposed, request)
        return self.read(
            supposed,
            simulate_setup(request.setup, request.t_s, request.tolerance, only_sensed=True),
        )

    def request(self, supposed: ModelPoint) -> StrokeRequest:
        """The stroke to simulate. Raises BadInput for effects that do not fit."""
        setup = set_up(
            supposed.rig,
            self.height_m + supposed.height_offset_m,
            self._command(supposed),
            self.strokes_before,
        )
        return StrokeRequest(setup, self.t_s - supposed.command_delay_s, STROKE_TOLERANCE)

    def read_prescribed(self, supposed: ModelPoint, request: StrokeRequest) -> Floats:
        """Rows (b,) of a requested stroke without a compliant drive: the leg does not act back
        on its shaft, so nothing is simulated.
        """
        return self._read_angle(
            supposed, request.setup.motion.angle_rad(np.maximum(request.t_s, 0.0))
        )

    def read(self, supposed: ModelPoint, stroke: SimulatedStroke) -> Floats:
        """Rows (b,) of a stroke that was simulated as requested."""
        return self._read_angle(supposed, stroke.shaft_angle_rad)

    def _read_angle(self, supposed: ModelPoint, angle_rad: Floats) -> Floats:
        stood_rad = float(angle_rad[self.t_s <= max(0.0, float(self.t_s[0]))].mean())
        return self._bin_means(
            angle_rad - stood_rad - self._command(supposed).angle_rad(self.t_s) + self.start_rad
        )

    def _command(self, supposed: ModelPoint) -> ShaftMotion:
        return ramp_to_speed(
            self.start_rad, self.speed_rad_s, supposed.rig.drive.ramp_s, float(self.t_s[-1])
        )

    @property
    def deviation_rad(self) -> Floats:
        """By how much the shaft is ahead of its command, (b,), mean over the repeats."""
        return np.asarray(self.repeats.mean(axis=0))

    def commanded_rad_s(self, ramp_s: float) -> Floats:
        """Commanded speed, (b,)."""
        # A linear ramp, then the constant speed of the stroke.
        return self._bin_means(self.speed_rad_s * np.clip(self.t_s / ramp_s, 0.0, 1.0))

    def _bin_means(self, values: Floats) -> Floats:
        return np.asarray(np.add.reduceat(values, self.first) / self._counts)

    @cached_property
    def _counts(self) -> Floats:
        return np.diff(np.append(self.first, len(self.t_s))).astype(np.float64)

    def rows(self) -> Observations:
        """The rows: by how much the shaft is ahead of its command, in rad."""
        measured = self.deviation_rad
        middle = self._bin_means(self.t_s)
        # The derivative allows an error in time, as for forces.
        scale = np.sqrt(
            measured**2 + (0.02 * np.gradient(measured, middle)) ** 2 + SMALLEST_SCALE_RAD**2
        )
        bins = len(measured)
        return Observations(
            measured=measured,
            noise=self.sample_noise_rad / np.sqrt(self._counts * len(self.repeats)),
            scale=scale,
            transient_scale=np.zeros(bins),
            # Model errors are correlated over about 0.3 s.
            progress=middle / 0.3,
            t_s=middle,
            phase=np.where(middle <= 0.0, "rest", "turning"),
            label=np.zeros(bins, dtype=np.intp),
            condition=np.zeros(bins, dtype=np.intp),
            labels=(dynamic_label(self.label, SIGNAL),),
        )


def make_shaft_condition(
    condition: Condition, end_s: float, ramp_s: float
) -> ShaftCondition | None:
    """The shaft of a condition until `end_s`; None where no angle was recorded."""
    traces = [
        trace for stroke in condition.strokes if (trace := stroke.channel(SIGNAL)) is not None
    ]
    if not traces:
        return None
    t_s = min((t for t, _ in traces), key=len)
    t_s = t_s[t_s <= end_s]
    angles = np.array([np.interp(t_s, t, angle) for t, angle in traces])
    # A bin begins where the number of the time interval changes; the large negative value starts
    # the first one.
    first = np.flatnonzero(np.diff(np.floor(t_s / BIN_S), prepend=-1e9))
    counts = np.diff(np.append(first, len(t_s)))
    deviation = angles - ramp_to_speed(
        0.0, condition.speed_rad_s, ramp_s, float(t_s[-1])
    ).angle_rad(t_s)
    still = t_s <= max(0.0, float(t_s[0]))
    deviation -= angles[:, still].mean(axis=1)[:, None]
    # Robust noise: 0.6745 turns a median deviation into a standard deviation, and a second
    # difference of noise has the variance 6.
    noise = float(np.median(np.abs(np.diff(angles, 2, axis=1)))) / 0.6745 / np.sqrt(6.0)
    return ShaftCondition(
        label=condition.label,
        height_m=condition.height_m,
        speed_rad_s=condition.speed_rad_s,
        t_s=t_s,
        first=first,
        start_rad=float(angles[:, still].mean()),
        sample_noise_rad=max(noise, 1e-5),
        repeats=np.add.reduceat(deviation, first, axis=1) / counts,
        strokes_before=condition.strokes_before,
    )


def turns_as_commanded(shaft: ShaftCondition) -> bool:
    """Whether the shaft followed its command without delay, from its start."""
    return rms(shaft.deviation_rad) < AS_COMMANDED_RAD


def tracks_command(shaft: ShaftCondition, ramp_s: float) -> bool:
    """Whether the shaft followed its command, at once or with the constant delay
    `estimate_delay_s`.
    """
    return tracking_error(shaft, ramp_s) < 1.0


def tracking_error(shaft: ShaftCondition, ramp_s: float) -> float:
    """Deviation of the shaft from its command; below 1 where it follows the command, at once or
    with a delay.
    """
    beside_delay_rad = rms(
        shaft.deviation_rad + estimate_delay_s(shaft, ramp_s) * shaft.commanded_rad_s(ramp_s)
    )
    return min(rms(shaft.deviation_rad) / AS_COMMANDED_RAD, beside_delay_rad / DELAYED_RAD)


def estimate_delay_s(shaft: ShaftCondition, ramp_s: float) -> float:
    """Delay of the shaft behind its command in s, by least squares."""
    command_rad_s = shaft.commanded_rad_s(ramp_s)
    return -float(command_rad_s @ shaft.deviation_rad) / float(command_rad_s @ command_rad_s)


def measure_other_turn(shaft: ShaftCondition, other: ShaftCondition, ramp_s: float) -> float:
    """Rms difference of two recorded turns of one condition beside a difference of their delays,
    rad.
    """
    t_s = shaft.rows().t_s
    other_t_s = other.rows().t_s
    common = t_s <= other_t_s[-1]
    of_other_rad = np.interp(t_s[common], other_t_s, other.deviation_rad)
    difference_rad = shaft.deviation_rad[common] - of_other_rad
    command_rad_s = shaft.commanded_rad_s(ramp_s)[common]
    delay_s = float(command_rad_s @ difference_rad) / float(command_rad_s @ command_rad_s)
    return rms(difference_rad - delay_s * command_rad_s)
