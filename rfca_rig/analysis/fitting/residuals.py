"""Residuals between recorded and simulated strokes: force and torque over a window of the stroke,
averaged over short bins.

Samples at 1 kHz and more are not independent observations of a leg that swings in tenths of
seconds. Bins of 5 ms lose no information on it.

By default a stroke counts from 200 ms after touchdown to its valley. Before that, the model misses
a leg that was not quite at rest and the chatter of the first contact, by several times the noise. A
fit would then compensate with mass and friction. After the valley the leg is released and small
differences grow: even a model without any omission misses release and rebound. In between, it
agrees with campaigns without omitted physics to the noise, once the scatter from stroke to stroke
is allowed for.

The shaft moves as commanded, on average, or as recorded; one motion serves repeats that are alike.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.analysis.matched_simulation import GRID_S, Shaft, average_speed
from rfca_rig.analysis.phases import PHASES, StrokePhases, Undetermined, valley_and_phases
from rfca_rig.analysis.repeats import Condition
from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.model.motion import ShaftMotion, follow, ramp_to_speed
from rfca_rig.model.stroke import Job, SimulatedStroke, simulate_strokes
from rfca_rig.recording.model import Stroke
from rfca_rig.suggestions import suggestion

Floats = NDArray[np.float64]

# Encoder noise of 1 mrad leaves this much after smoothing; it moves the touchdown of a stroke by
# 0.2 ms.
SAME_TURN_RAD = 5e-4

CHANNELS = ("fz_N", "fy_N", "tx_Nm")
# Bins over which samples are averaged into one residual.
BIN_S = 0.005


@dataclass(frozen=True)
class StrokeMotion:
    """One stroke to simulate: height, and a recorded motion of the shaft, or, where that is None, a
    ramp to `speed_rad_s`.

    `strokes_before` are those before each stroke of the condition, as in `model.setup.Setup`.
    """

    height_m: float
    speed_rad_s: float
    motion: ShaftMotion | None
    end_s: float
    strokes_before: tuple[int, ...] = ()

    def job(self, supposed: ModelPoint) -> Job:
        """The stroke on a grid of half milliseconds from the start."""
        # Two samples beyond the end, so that interpolation at the last measured moment never leaves
        # the grid.
        t_s = GRID_S * np.arange(0, int(np.ceil(self.end_s / GRID_S)) + 2, dtype=np.float64)
        return Job(
            supposed.rig,
            self.height_m + supposed.height_offset_m,
            self._motion(supposed),
            t_s,
            None,
            self.strokes_before,
        )

    def _motion(self, supposed: ModelPoint) -> ShaftMotion:
        if self.motion is None:
            leg = supposed.rig.leg
            drive = supposed.rig.drive
            return ramp_to_speed(leg.start_angle_rad, self.speed_rad_s, drive.ramp_s, self.end_s)
        coefficients = self.motion.coefficients.copy()
        # Only the constant term of each polynomial piece shifts the angle.
        coefficients[:, 0] += supposed.turn_offset_rad
        return replace(self.motion, coefficients=coefficients)


def list_motions(
    condition: Condition, shaft: Shaft, ramp_s: float, end_s: float
) -> tuple[tuple[StrokeMotion, ...], tuple[int, ...]]:
    """Shaft motions of a condition, each to `end_s`, and for each stroke the index of its motion.

    Parameters
    ----------
    condition
        Strokes of one height and speed.
    shaft
        As in `analysis.matched_simulation`. With "recorded", repeats whose smoothed turns differ by
        less than 0.5 mrad share one motion. A stroke without a recorded angle turns at its average
        speed.
    ramp_s
        Duration of the drive's ramp.
    end_s
        End of the simulation.
    """
    before = condition.strokes_before
    if shaft == "recorded":
        turns = [
            replace(_motion_of(stroke, ramp_s, end_s), strokes_before=before)
            for stroke in condition.strokes
        ]
        distinct: list[StrokeMotion] = []
        indices: list[int] = []
        for turn in turns:
            alike = next(
                (i for i, other in enumerate(distinct) if _same(turn, other)), len(distinct)
            )
            if alike == len(distinct):
                distinct.append(turn)
            indices.append(alike)
        return tuple(distinct), tuple(indices)
    speed_rad_s = condition.speed_rad_s
    if shaft == "average":
        speed_rad_s = float(
            np.mean([average_speed(stroke, ramp_s).speed_rad_s for stroke in condition.strokes])
        )
    return (StrokeMotion(condition.height_m, speed_rad_s, None, end_s, before),), (0,) * len(
        condition.strokes
    )


def mean_start_rad(strokes: Sequence[Stroke]) -> float | None:
    """Mean shaft angle before the start over all strokes that recorded it; None where no stroke
    did.
    """
    angles = [stroke.channel("shaft_angle_rad") for stroke in strokes]
    starts = [
        float(trace[1][trace[0] <= 0.0].mean())
        for trace in angles
        if trace is not None and (trace[0] <= 0.0).any()
    ]
    if starts:
        return float(np.mean(starts))
    return None


def _motion_of(stroke: Stroke, ramp_s: float, end_s: float) -> StrokeMotion:
    angle = stroke.channel("shaft_angle_rad")
    if angle is None:
        return StrokeMotion(stroke.height_m, average_speed(stroke, ramp_s).speed_rad_s, None, end_s)
    return StrokeMotion(stroke.height_m, stroke.speed_rad_s, follow(*angle), end_s)


def _same(turn: StrokeMotion, other: StrokeMotion) -> bool:
    if turn.motion is None or other.motion is None:
        return turn == other
    t_s = np.linspace(0.0, turn.end_s, 200)
    return (
        float(np.abs(turn.motion.angle_rad(t_s) - other.motion.angle_rad(t_s)).max())
        < SAME_TURN_RAD
    )


@dataclass(frozen=True)
class StrokeWindow:
    """The part of a stroke that counts: its phases, without the first `after_touchdown_s` of
    contact.
    """

    phases: tuple[str, ...] = ("loading",)
    after_touchdown_s: float = 0.2

    def __post_init__(self) -> None:
        for phase in self.phases:
            if phase not in PHASES:
                raise BadInput(f"{phase!r} is no phase of a stroke; {suggestion(phase, PHASES)}")

    def inside(self, t_s: Floats, found: StrokePhases) -> NDArray[np.bool_]:
        """Whether each moment of a stroke counts, same shape as `t_s`. Rest never counts,
        because there the model is at rest.
        """
        ringing = (t_s >= found.touchdown_s) & (t_s < found.touchdown_s + self.after_touchdown_s)
        wanted = np.isin(found.number(t_s), [PHASES.index(phase) for phase in self.phases])
        return np.asarray(wanted & ~ringing & (t_s > 0.0))

    def in_words(self) -> str:
        """For the reader of a result."""
        if self.after_touchdown_s:
            without = f", without the first {1e3 * self.after_touchdown_s:g} ms of contact"
        else:
            without = ""
        return f"compared: {', '.join(self.phases)}{without}; the rest of a stroke is not fitted"


@dataclass(frozen=True)
class ChannelResiduals:
    """One channel of a stroke within the window: samples (k,), index of the first sample of each
    bin (b,), noise of each bin mean (b,).
    """

    channel: str
    t_s: Floats
    values: Floats
    bins: NDArray[np.intp]
    bin_noise: Floats
    sample_noise: float

    def misses(self, simulated: SimulatedStroke) -> Floats:
        """Simulated minus measured, sample by sample, (k,)."""
        return np.asarray(
            np.interp(self.t_s, simulated.t_s, getattr(simulated, self.channel)) - self.values
        )

    def residuals(self, simulated: SimulatedStroke) -> Floats:
        """The same as bin means over their noise, (b,)."""
        counts = np.diff(np.append(self.bins, len(self.t_s)))
        return np.asarray(
            np.add.reduceat(self.misses(simulated), self.bins) / counts / self.bin_noise
        )


@dataclass(frozen=True)
class MeasuredStroke:
    """A stroke's traces, and the index of its shaft motion among those that are simulated."""

    traces: tuple[ChannelResiduals, ...]
    turn: int

    @property
    def row_count(self) -> int:
        """Number of rows of all traces."""
        return sum(len(trace.bins) for trace in self.traces)


@dataclass(frozen=True)
class StrokeProblem:
    """All strokes of a fit. `left_out` states in words which strokes could not be used and why.
    Rows are (m,), stroke by stroke.
    """

    turns: tuple[StrokeMotion, ...]
    strokes: tuple[MeasuredStroke, ...]
    left_out: tuple[str, ...]

    @property
    def stroke_of_row(self) -> NDArray[np.intp]:
        """Index of the stroke of each row, (m,)."""
        row_counts = [stroke.row_count for stroke in self.strokes]
        return np.repeat(np.arange(len(self.strokes)), row_counts)

    def residuals(self, supposed: Sequence[ModelPoint]) -> list[Floats | None]:
        """Residuals (m,) at each point, in units of noise; None where the model cannot be
        computed.
        """
        by_point = simulate_points([turn.job for turn in self.turns], supposed)
        return [self._against(simulated) for simulated in by_point]

    def rms(self, supposed: ModelPoint) -> dict[str, float]:
        """Root mean square of simulated minus measured by channel, sample by sample. Raises
        SimulationFailed.
        """
        simulated = _require_all(
            simulate_strokes([turn.job(supposed) for turn in self.turns], only_sensed=True)
        )
        misses: dict[str, list[Floats]] = {}
        for stroke, trace in self._all_traces():
            misses.setdefault(trace.channel, []).append(trace.misses(simulated[stroke.turn]))
        return {
            channel: float(np.sqrt(np.mean(np.concatenate(all_) ** 2)))
            for channel, all_ in misses.items()
        }

    def noise(self) -> dict[str, float]:
        """Root mean square of the noise of one sample, by channel."""
        noises: dict[str, list[float]] = {}
        for _, trace in self._all_traces():
            noises.setdefault(trace.channel, []).append(trace.sample_noise)
        return {
            channel: float(np.sqrt(np.mean(np.square(all_)))) for channel, all_ in noises.items()
        }

    def _all_traces(self) -> Iterator[tuple[MeasuredStroke, ChannelResiduals]]:
        return ((stroke, trace) for stroke in self.strokes for trace in stroke.traces)

    def _against(self, simulated: Sequence[SimulatedStroke | SimulationFailed]) -> Floats | None:
        """None where a motion cannot be simulated; the solver then rejects this point."""
        try:
            strokes = _require_all(simulated)
        except SimulationFailed:
            return None
        return np.concatenate(
            [trace.residuals(strokes[stroke.turn]) for stroke, trace in self._all_traces()]
        )


def simulate_points(
    jobs: Sequence[Callable[[ModelPoint], Job]], supposed: Sequence[ModelPoint]
) -> list[list[SimulatedStroke | SimulationFailed]]:
    """For each point its strokes, one for each of `jobs`, which make the job of a motion at a
    point.
    """
    strokes = simulate_strokes([job(point) for job in jobs for point in supposed], only_sensed=True)
    return [strokes[first :: len(supposed)] for first in range(len(supposed))]


def _require_all(simulated: Sequence[SimulatedStroke | SimulationFailed]) -> list[SimulatedStroke]:
    """The strokes. Raises SimulationFailed where one of them is none."""
    for outcome in simulated:
        if isinstance(outcome, SimulationFailed):
            raise outcome
    return [outcome for outcome in simulated if isinstance(outcome, SimulatedStroke)]


def make_stroke_problem(
    conditions: Sequence[Condition],
    ramp_s: float,
    noise_std: Mapping[str, float | None],
    shaft: Shaft = "recorded",
    window: StrokeWindow | None = None,
) -> StrokeProblem:
    """Make the fit problem of all strokes that have a valley.

    Parameters
    ----------
    conditions
        Recorded strokes, by height and speed.
    ramp_s
        Duration of the drive's ramp.
    noise_std
        Standard deviation of the sensor's noise, by channel; where it is not stated, the noise is
        estimated from neighbouring samples.
    shaft
        As in `analysis.matched_simulation`.
    window
        The part of a stroke that counts.

    Raises
    ------
    BadInput
        Where no stroke can be used.
    """
    turns: list[StrokeMotion] = []
    strokes: list[MeasuredStroke] = []
    left_out: list[str] = []
    for condition in conditions:
        pairs = [
            (stroke, _traces(stroke, noise_std, window or StrokeWindow()))
            for stroke in condition.strokes
        ]
        left_out += [
            f"left out: {condition.label}, repeat {s.repeat}: {t.reason}"
            for s, t in pairs
            if isinstance(t, Undetermined)
        ]
        usable = [
            (stroke, traces) for stroke, traces in pairs if not isinstance(traces, Undetermined)
        ]
        if not usable:
            continue
        # Simulations end with the last sample that counts; the time after it costs and is not
        # compared.
        end_s = max(float(trace.t_s[-1]) for _, traces in usable for trace in traces)
        usable_condition = Condition(
            condition.height_m, condition.speed_rad_s, tuple(stroke for stroke, _ in usable)
        )
        own_turns, indices = list_motions(usable_condition, shaft, ramp_s, end_s)
        strokes += [
            MeasuredStroke(traces, len(turns) + index)
            for (_, traces), index in zip(usable, indices, strict=True)
        ]
        turns += own_turns
    if not strokes:
        raise BadInput("; ".join(["no stroke to fit to", *left_out[:1]]))
    return StrokeProblem(tuple(turns), tuple(strokes), tuple(left_out))


def _traces(
    stroke: Stroke, noise_std: Mapping[str, float | None], window: StrokeWindow
) -> tuple[ChannelResiduals, ...] | Undetermined:
    """The traces of a stroke within the window. Refused where it has no valley, because its
    phases are then unknown.
    """
    fz = stroke.channel("fz_N")
    if fz is None:
        return Undetermined("fz was not recorded, and with it not when the leg touched")
    valley, phases = valley_and_phases(*fz)
    if isinstance(valley, Undetermined):
        return valley
    traces = tuple(
        t
        for c in CHANNELS
        if (t := _trace(stroke, c, window, phases, noise_std.get(c))) is not None
    )
    return traces or Undetermined(
        f"nothing left between touchdown at {phases.touchdown_s:.3f} s and valley at "
        f"{valley.time_s:.3f} s"
    )


def _trace(
    stroke: Stroke, channel: str, window: StrokeWindow, phases: StrokePhases, noise: float | None
) -> ChannelResiduals | None:
    recorded = stroke.channel(channel)
    if recorded is None:
        return None
    t_s, values = recorded
    inside = window.inside(t_s, phases)
    if not inside.any():
        return None
    sample_noise = noise or _noise(values)
    # First sample of each bin, on a common grid of time, also with uneven samples.
    bins = np.flatnonzero(np.diff(np.floor(t_s[inside] / BIN_S), prepend=-1.0))
    counts = np.diff(np.append(bins, inside.sum()))
    return ChannelResiduals(
        channel, t_s[inside], values[inside], bins, sample_noise / np.sqrt(counts), sample_noise
    )


def _noise(values: Floats) -> float:
    """Noise of one sample from second differences, which a smooth force leaves small. The median
    ignores the jumps of a touchdown.

    A difference 1, -2, 1 of white noise has sqrt(6) times its deviation, and the median magnitude
    is 0.6745 deviations.
    """
    # A constant trace has no noise to divide by; 1.0 then keeps the weights finite.
    return float(np.median(np.abs(np.diff(values, 2)))) / 0.6745 / np.sqrt(6.0) or 1.0
