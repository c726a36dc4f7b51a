"""Strokes of one condition as observations, and the simulated stroke binned in the same way."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.analysis.phases import PHASES, StrokePhases, Undetermined, Valley, valley_and_phases
from rfca_rig.analysis.repeats import Condition
from rfca_rig.diagnosis.data import Label, Observations
from rfca_rig.model.catalogue import set_up
from rfca_rig.model.chain import Tolerance
from rfca_rig.model.motion import ShaftMotion, follow, ramp_to_speed
from rfca_rig.model.stroke import SimulatedStroke, StrokeRequest, recall_stroke
from rfca_rig.recording.model import Stroke, collect_strokes_before

Floats = NDArray[np.float64]

FORCES = ("fy_N", "fz_N", "tx_Nm")
REST_BIN_S = 0.025
BIN_S = 0.020
TOUCHDOWN_BIN_S = 0.010
BEFORE_TOUCHDOWN_S = 0.010  # repeats touch down some milliseconds apart
BEFORE_LIFT_OFF_S = 0.020  # the moment of lift-off differs from stroke to stroke
# of a signal's rms over the stroke: a free leg pulls little, but not with infinite precision
SMALLEST_SCALE = 0.02
# of the way from touchdown to valley, some 50 ms: over that a model's errors are alike
CORRELATION_LENGTH = 0.06
TIMING_ERROR_S = 0.1  # a relative error of 1 % goes with a moment that is off by 1 ms
# the ringing after touchdown is that much harder to predict than slow swings
TRANSIENT_FACTOR = 5.0
TRANSIENT_DECAY_S = 0.06
# Means over bins then differ by 4e-5 of a force's range from those of 7000 samples per second (the
# paper's four conditions), a hundredth of the usual model error; at 1 ms by 1.1e-4.
SIMULATED_EVERY_S = 5e-4
# A stroke takes some thousands, up to 20 000 where the tip chatters; a place that takes more is no
# place to go to.
STROKE_TOLERANCE = Tolerance(most_steps=50_000)


@dataclass(frozen=True)
class ShaftTurn:
    """How the shaft moves in the simulation of one condition.

    Parameters
    ----------
    speed_rad_s
        Commanded speed.
    start_rad
        Recorded start angle. None where no shaft angle was recorded; then the leg starts at its
        nominal angle.
    recorded
        Recorded motion to follow; None to follow the command.
    late_s
        Delay behind the command.
    """

    speed_rad_s: float
    start_rad: float | None
    recorded: ShaftMotion | None = None
    late_s: float = 0.0

    def motion(self, supposed: ModelPoint, end_s: float) -> ShaftMotion:
        """The motion until `end_s`, with the encoder zero and the ramp of the drive in
        `supposed`.
        """
        leg = supposed.rig.leg
        drive = supposed.rig.drive
        if self.recorded is not None:
            coefficients = self.recorded.coefficients.copy()
            # The constant term of each cubic piece: the whole motion is shifted.
            coefficients[:, 0] += supposed.turn_offset_rad
            return replace(self.recorded, coefficients=coefficients)
        if self.start_rad is None:
            start_rad = leg.start_angle_rad
        else:
            start_rad = self.start_rad + supposed.turn_offset_rad
        return ramp_to_speed(start_rad, self.speed_rad_s, drive.ramp_s, end_s).later(self.late_s)


@dataclass(frozen=True)
class StrokeBins:
    """Edges (b + 1,) of the bins of a condition, and the moments of its strokes."""

    edges_s: Floats
    phases: StrokePhases

    def within(self, begin_s: float, end_s: float) -> "StrokeBins":
        """The bins that lie between two times."""
        inside = (self.edges_s >= begin_s) & (self.edges_s <= end_s)
        return replace(self, edges_s=self.edges_s[inside])


@dataclass(frozen=True)
class DynamicCondition:
    """One condition of the dynamic experiment: mean over its repeats in b bins, and how to simulate
    the same.

    Parameters
    ----------
    label, height_m
        The condition.
    turn
        How the shaft moves.
    t_s
        (n,) times at which the stroke is simulated, within the bins.
    first
        (b,) the first of these times in each bin.
    samples
        (b,) recorded samples of a stroke in each bin.
    signals
        Names of the k signals.
    repeats
        (r, k b) the binned signals of each stroke, in the order of `signals`.
    phases
        Median times of touchdown, valley and lift-off.
    sample_noise
        Standard deviation of one sample, by signal.
    valley
        Mean force minimum.
    strokes_before
        Of each stroke, as in `Condition`.
    recording
        The run that it is a part of, where that matters; "" where it does not.
    """

    label: str
    height_m: float
    turn: ShaftTurn
    t_s: Floats
    first: NDArray[np.intp]
    samples: NDArray[np.intp]
    signals: tuple[str, ...]
    repeats: Floats
    phases: StrokePhases
    sample_noise: Mapping[str, float]
    valley: Valley | Undetermined
    strokes_before: tuple[int, ...] = ()
    recording: str = ""

    def simulated(self, supposed: ModelPoint) -> Floats:
        """Predicted rows (k b,), signal after signal. Raises SimulationFailed."""
        return self.read(supposed, recall_stroke(self.request(supposed), only_sensed=True))

    def read(self, supposed: ModelPoint, stroke: SimulatedStroke) -> Floats:  # noqa: ARG002  (the shaft's condition needs it)
        """Rows (k b,) of a stroke that was simulated at `t_s`."""
        return np.concatenate([self._bin_means(getattr(stroke, signal)) for signal in self.signals])

    def until(self, end_s: float) -> "DynamicCondition":
        """The same without the bins that end after `end_s`, for what only the beginning shows."""
        bins = max(int(np.searchsorted(self.t_s[self.first], end_s)) - 1, 1)
        repeats = self.repeats.reshape(len(self.repeats), len(self.signals), -1)[:, :, :bins]
        if bins < len(self.first):
            t_s = self.t_s[: self.first[bins]]
        else:
            t_s = self.t_s
        return replace(
            self,
            t_s=t_s,
            first=self.first[:bins],
            samples=self.samples[:bins],
            repeats=repeats.reshape(len(repeats), -1),
        )

    def stroke(self, supposed: ModelPoint) -> SimulatedStroke:
        """The whole stroke, simulated at `t_s`. Raises SimulationFailed."""
        return recall_stroke(self.request(supposed))

    def request(self, supposed: ModelPoint) -> StrokeRequest:
        """The stroke to simulate. Raises BadInput for effects that do not fit."""
        motion = self.turn.motion(supposed, float(self.t_s[-1]))
        setup = set_up(
            supposed.rig, self.height_m + supposed.height_offset_m, motion, self.strokes_before
        )
        return StrokeRequest(setup, self.t_s, STROKE_TOLERANCE)

    def _bin_means(self, values: Floats) -> Floats:
        return np.asarray(np.add.reduceat(values, self.first) / self.counts)

    @cached_property
    def counts(self) -> Floats:
        """Simulated times in each bin, (b,)."""
        return np.diff(np.append(self.first, len(self.t_s))).astype(np.float64)

    def rows(self) -> Observations:
        """The measured rows, (k b,) in each array."""
        bins = len(self.first)
        signals = len(self.signals)
        middle = self._bin_means(self.t_s)
        phase = np.array(PHASES)[self.phases.number(middle)]
        measured = self.repeats.mean(axis=0)
        noise = [
            self.sample_noise[signal] / np.sqrt(self.samples * len(self.repeats))
            for signal in self.signals
        ]
        return Observations(
            measured=measured,
            noise=np.concatenate(noise),
            scale=np.concatenate(
                [_error_scale(middle, part, phase) for part in measured.reshape(signals, bins)]
            ),
            transient_scale=np.concatenate(
                [
                    _transient_scale(middle, part, phase, self.phases)
                    for part in measured.reshape(signals, bins)
                ]
            ),
            progress=np.tile(_progress(middle, self.phases), signals),
            t_s=np.tile(middle, signals),
            phase=np.tile(phase, signals),
            label=np.repeat(np.arange(signals), bins),
            condition=np.zeros(signals * bins, dtype=np.intp),
            labels=tuple(
                replace(dynamic_label(self.label, signal), recording=self.recording)
                for signal in self.signals
            ),
        )


def dynamic_label(condition: str, signal: str) -> Label:
    """Label of a signal of strokes, in which the model error is smooth from touchdown on."""
    return Label("dynamic", condition, signal, CORRELATION_LENGTH, errs_by_phase=False)


def _list_common_signals(strokes: Sequence[Stroke]) -> tuple[str, ...]:
    """The forces that all strokes have."""
    common = []
    for name in FORCES:
        if all(stroke.channel(name) is not None for stroke in strokes):
            common.append(name)
    return tuple(common)


@dataclass(frozen=True)
class DetectedStrokes:
    """The strokes of a condition that show a touchdown and a valley, the medians of their moments,
    and their mean valley.
    """

    condition: Condition
    strokes: tuple[Stroke, ...]
    phases: StrokePhases
    valley: Valley

    @property
    def covered_s(self) -> tuple[float, float]:
        """First and last time that all of them cover."""
        times = [stroke.channel("fz_N")[0] for stroke in self.strokes]  # type: ignore[index]
        return float(max(t_s[0] for t_s in times)), float(min(t_s[-1] for t_s in times))

    def choose_bins(self) -> StrokeBins:
        """Bins that follow their moments, over the time that all of them cover."""
        return StrokeBins(_edges(*self.covered_s, self.phases), self.phases)


def make_dynamic_condition(
    condition: Condition, noise_std: Mapping[str, float | None], turn: ShaftTurn
) -> DynamicCondition | Undetermined:
    """The condition as observations in its own bins; refused where none of its strokes shows a
    touchdown and a valley.
    """
    detected = detect_strokes(condition)
    if isinstance(detected, Undetermined):
        return detected
    return bin_strokes(detected, detected.choose_bins(), noise_std, turn)


def bin_strokes(
    detected: DetectedStrokes,
    bins: StrokeBins,
    noise_std: Mapping[str, float | None],
    turn: ShaftTurn,
) -> DynamicCondition:
    """The condition of these strokes as observations in these bins."""
    condition = detected.condition
    strokes = detected.strokes
    signals = _list_common_signals(strokes)
    time = strokes[0].channel("fz_N")[0]  # type: ignore[index]
    inside = (time >= bins.edges_s[0]) & (time < bins.edges_s[-1])
    first = np.searchsorted(time[inside], bins.edges_s[:-1])
    samples = np.diff(np.append(first, inside.sum()))
    t_s, first = _thin_out(time[inside], first)
    repeats = np.array([_stack_bin_means(stroke, signals, bins.edges_s) for stroke in strokes])
    noise = {s: noise_std.get(s) or _estimate_noise(strokes, s) for s in signals}
    return DynamicCondition(
        condition.label,
        condition.height_m,
        turn,
        t_s,
        first,
        samples,
        signals,
        repeats,
        bins.phases,
        noise,
        detected.valley,
        collect_strokes_before(strokes),
    )


def detect_strokes(condition: Condition) -> DetectedStrokes | Undetermined:
    """The usable strokes of a condition, or why there is none."""
    detections = [(stroke, *_valley_and_phases(stroke)) for stroke in condition.strokes]
    good = [
        (stroke, valley, phases)
        for stroke, valley, phases in detections
        if not isinstance(valley, Undetermined)
    ]
    if not good:
        # The reason of the first stroke: a sampling rate that is too low is the same in all.
        reason = next(
            (
                f": {valley.reason}"
                for _, valley, _ in detections
                if isinstance(valley, Undetermined)
            ),
            "",
        )
        return Undetermined(f"{condition.label}: no stroke shows a touchdown and a valley{reason}")
    moments = np.array([[p.touchdown_s, p.valley_s, p.lift_off_s] for _, _, p in good])
    # The median over repeats: a single badly detected moment does not shift the bins.
    phases = StrokePhases(*(float(m) for m in np.median(moments, axis=0)))
    valley = Valley(
        float(np.mean([v.time_s for _, v, _ in good])), float(np.mean([v.fz_N for _, v, _ in good]))
    )
    return DetectedStrokes(condition, tuple(stroke for stroke, _, _ in good), phases, valley)


def _thin_out(t_s: Floats, first: NDArray[np.intp]) -> tuple[Floats, NDArray[np.intp]]:
    """Times (n,) at which strokes are simulated, and the first one of each bin (b,).

    They are the samples' own times `t_s` (m,). Where these are closer than SIMULATED_EVERY_S, they
    are the middles of equal parts of each bin: a force sensor with 7000 samples per second would
    cost more than the integration.
    """
    step_s = float(np.median(np.diff(t_s)))
    if step_s >= SIMULATED_EVERY_S:
        return t_s, first
    # Each sample stands for the time around it, so that bins end half a step beside their samples.
    edges_s = np.append(t_s[first], t_s[-1] + step_s) - 0.5 * step_s
    parts = np.ceil(np.diff(edges_s) / SIMULATED_EVERY_S).astype(np.intp)
    middles = [
        low + (np.arange(k) + 0.5) / k * (high - low)
        for low, high, k in zip(edges_s, edges_s[1:], parts, strict=False)
    ]
    return np.concatenate(middles), np.append(0, np.cumsum(parts)[:-1])


def make_turn(condition: Condition, follows_recorded: bool, late_s: float = 0.0) -> ShaftTurn:
    """The turn of a condition: along its recorded angles, or as commanded from its mean recorded
    start, `late_s` later.

    A shaft that follows its command is simulated from the command: the noise of an encoder must not
    shake the simulated leg.
    """
    traces = [
        trace
        for stroke in condition.strokes
        if (trace := stroke.channel("shaft_angle_rad")) is not None
    ]
    if not traces:
        return ShaftTurn(condition.speed_rad_s, None)
    # The start angle is the mean before the motion; a recording that begins with the motion has
    # only its first sample.
    starts = [angle[t_s <= 0.0].mean() if (t_s <= 0.0).any() else angle[0] for t_s, angle in traces]
    start = float(np.mean(starts))
    if not follows_recorded:
        return ShaftTurn(condition.speed_rad_s, start, late_s=late_s)
    shortest = min((t_s for t_s, _ in traces), key=len)
    mean = np.mean([np.interp(shortest, t_s, angle) for t_s, angle in traces], axis=0)
    return ShaftTurn(condition.speed_rad_s, start, follow(shortest, mean))


def _valley_and_phases(stroke: Stroke) -> tuple[Valley | Undetermined, StrokePhases]:
    fz = stroke.channel("fz_N")
    if fz is None:
        return (Undetermined("fz was not recorded"), StrokePhases())
    return valley_and_phases(*fz)


def _edges(begin_s: float, end_s: float, phases: StrokePhases) -> Floats:
    """Edges (b + 1,) of the bins from `begin_s` to `end_s`, or to shortly before lift-off."""
    # Bins are fine around the touchdown, where forces change fastest, and wide at rest.
    touch = max(phases.touchdown_s - BEFORE_TOUCHDOWN_S, BIN_S)
    loading = phases.touchdown_s + 0.030
    # At most 0.48 s after the valley, and never before it.
    end = min(
        max(phases.valley_s, min(phases.lift_off_s, phases.valley_s + 0.5) - BEFORE_LIFT_OFF_S),
        end_s,
    )
    pieces = [(begin_s, 0.0, REST_BIN_S), (0.0, touch, BIN_S), (touch, loading, TOUCHDOWN_BIN_S)]
    pieces += [(loading, phases.valley_s, BIN_S), (phases.valley_s, end, BIN_S)]
    # Even edges, about `width` apart, both ends among them.
    edges = [
        np.linspace(a, b, max(round((b - a) / width), 1) + 1)
        for a, b, width in pieces
        if b - a > 0.5 * width
    ]
    return np.unique(np.concatenate(edges))


def _stack_bin_means(stroke: Stroke, signals: Sequence[str], edges: Floats) -> Floats:
    """Means of all signals of a stroke, signal by signal, (k b,)."""
    return np.concatenate([_bin_means(stroke, signal, edges) for signal in signals])


def _bin_means(stroke: Stroke, signal: str, edges: Floats) -> Floats:
    t_s, values = stroke.channel(signal)  # type: ignore[misc]
    bins = np.searchsorted(edges, t_s, side="right") - 1
    inside = (bins >= 0) & (bins < len(edges) - 1)
    counts = np.bincount(bins[inside], minlength=len(edges) - 1)
    sums = np.bincount(bins[inside], values[inside], minlength=len(edges) - 1)
    return np.asarray(sums / np.maximum(counts, 1))


def _error_scale(t_s: Floats, values: Floats, phase: NDArray[np.str_]) -> Floats:
    """Size (b,) of a signal that a relative model error refers to, after "The scale rule" in
    section 3 of docs/method.md.

    It is the value and its change within TIMING_ERROR_S, at least a share of the rms in the phase
    and in the whole stroke.
    """
    least = SMALLEST_SCALE * float(np.sqrt(np.mean(values**2)))
    rms = np.array([np.sqrt(np.mean(values[phase == name] ** 2)) for name in phase])
    return np.sqrt(
        values**2 + (TIMING_ERROR_S * np.gradient(values, t_s)) ** 2 + (0.1 * rms) ** 2 + least**2
    )


def _transient_scale(
    t_s: Floats, values: Floats, phase: NDArray[np.str_], phases: StrokePhases
) -> Floats:
    """Size (b,) of errors that differ from bin to bin, in free flight and after the touchdown.

    Bounces and stick-slip after the touchdown are as large as the peak there and decay. In the air
    after the start, the sensor feels little but the last tenths of a degree of the hinges, which
    are hard to predict.
    """
    peak = float(np.abs(values[phase == "touchdown"]).max(initial=0.0))
    after_s = t_s - phases.touchdown_s
    bounces = np.where(
        after_s > -BEFORE_TOUCHDOWN_S,
        peak * np.exp(-np.maximum(after_s, 0.0) / TRANSIENT_DECAY_S),
        0.0,
    )
    swings = np.where(
        phase == "free",
        0.5 * np.ptp(values[phase == "free"]) if (phase == "free").any() else 0.0,
        0.0,
    )
    return np.asarray(TRANSIENT_FACTOR * np.hypot(bounces, swings))


def _progress(t_s: Floats, phases: StrokePhases) -> Floats:
    """Time (b,) as progress from touchdown (0) to valley (1)."""
    return (t_s - phases.touchdown_s) / (phases.valley_s - phases.touchdown_s)


def _estimate_noise(strokes: Sequence[Stroke], signal: str) -> float:
    """Noise of one sample from second differences, which a smooth force hardly affects; the
    median ignores the jumps of a touchdown.
    """
    # 0.6745 turns a median deviation into a standard deviation; the second difference of noise has
    # 6 times its variance.
    stds = []
    for stroke in strokes:
        samples = stroke.channel(signal)[1]  # type: ignore[index]
        stds.append(np.median(np.abs(np.diff(samples, 2))) / 0.6745 / np.sqrt(6.0))
    return float(np.mean(stds)) or 1.0
