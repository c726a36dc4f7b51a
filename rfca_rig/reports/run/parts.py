"""Parts of a run: every recorded stroke, static stage and block of cycles, with peak load,
limit, and load predicted by the model.
"""

import json
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rfca_rig.bench.expectation import predict_loads
from rfca_rig.description.model_file import nominal_model
from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.model.parameters import RigModel
from rfca_rig.model.stroke import simulate_stroke_at_speed
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import Cycles, Plan, flap_label
from rfca_rig.protocol.written_plan import parse_plan
from rfca_rig.recording.layout import WRENCH
from rfca_rig.recording.model import RawStage, Recording, StaticStage, Stream, Stroke
from rfca_rig.recording.tables import CYCLES

Floats = NDArray[np.float64]
Kind = Literal["stroke", "static stage", "cycles", "listening", "cut short"]

# Sampling of simulated strokes for their peak loads.
SAMPLE_S = 1e-3
# Prefix of limits among the changes of a rig file.
LIMITS = "limits."


@dataclass(frozen=True)
class ForceTrace:
    """fz in N over the time in s from the commanded start, both (m,)."""

    t_s: Floats
    fz_N: Floats


@dataclass(frozen=True)
class PartBeginning:
    """Beginning of a part: its index among the events, the time on the rig's clock, and the
    limits in force then, by name.
    """

    place: int
    t_s: float
    limits: Mapping[str, float]


@dataclass(frozen=True)
class RunPart:
    """One recorded part. `ended` is the reason why it was cut short, "" for a complete one. `begun`
    is None where no event states it.

    `peak` is over the recorded axes, `expected` the load that the nominal model predicts; both are
    None where unknown. `count` is the number of cycles, else 1.
    """

    kind: Kind
    label: str
    condition: str
    begun: PartBeginning | None
    samples: int
    peak: Load | None
    expected: Load | None
    ended: str = ""
    count: int = 1
    trace: ForceTrace | None = None


@dataclass(frozen=True)
class RunStory:
    """A recording as a run: its plan where it holds one, its events, and its parts in order of
    time.

    `limits` are those at the start, by name, `last_limits` those at the end: a run may be resumed
    with another rig file.
    """

    recording: Recording
    plan: Plan | None
    rig: RigModel | None
    limits: Mapping[str, float]
    last_limits: Mapping[str, float]
    events: tuple[Mapping[str, Any], ...]
    parts: tuple[RunPart, ...]


def story_of(recording: Recording) -> RunStory:
    """The run in a recording. A plan of another version, or a nominal model that cannot be read,
    is left out.
    """
    plan = _plan(recording)
    rig = _rig(recording)
    events = tuple(_events(recording.provenance.get("events", "")))
    limits = _limits(recording.provenance.get("limits", "{}"))
    begun, last_limits = _beginnings(events, limits)
    parts = sorted(
        _parts(recording, _PredictedLoads(plan, rig), begun),
        key=lambda part: part.begun.place if part.begun else -1,
    )
    return RunStory(recording, plan, rig, limits, last_limits, events, tuple(parts))


def _beginnings(
    events: Sequence[Mapping[str, Any]], limits: Mapping[str, float]
) -> tuple[dict[str, list[PartBeginning]], Mapping[str, float]]:
    """Beginnings by label, several where a stage was cut short and repeated; and the limits at
    the end.
    """
    begun: dict[str, list[PartBeginning]] = defaultdict(list)
    for index, event in enumerate(events):
        if event["event"] == "stage begins":
            begun[event["stage"]].append(PartBeginning(index, event["t_s"], limits))
        # A resumed run states what changed in its rig file; from then on the new limits are in
        # force.
        changed = {
            name.removeprefix(LIMITS): value
            for name, value in event.get("rig_changes", {}).items()
            if name.startswith(LIMITS)
        }
        limits = {
            **limits,
            **{name: float(value) for name, value in changed.items() if name in limits},
        }
    return begun, limits


def _events(text: str) -> Iterator[Mapping[str, Any]]:
    """Events line by line. Lines that are not events, as in files of other programs, are
    ignored.
    """
    for line in text.splitlines():
        try:
            event = json.loads(line)
        except (ValueError, RecursionError):
            continue
        if isinstance(event, dict) and "event" in event:
            yield event


def _limits(text: str) -> Mapping[str, float]:
    """Raises BadInput where the text is no table of numbers."""
    try:
        return {name: float(value) for name, value in dict(json.loads(text)).items()}
    except (ValueError, TypeError, RecursionError):
        raise BadInput("the recording's limits are not numbers by name") from None


def _plan(recording: Recording) -> Plan | None:
    try:
        return parse_plan(recording.title, recording.provenance)
    except BadInput:
        return None


def _rig(recording: Recording) -> RigModel | None:
    try:
        return nominal_model(recording.nominal)
    except BadInput:
        return None


class _PredictedLoads:
    """Loads that the nominal model predicts, by the labels of the plan's stages, otherwise by
    condition.
    """

    def __init__(self, plan: Plan | None, rig: RigModel | None) -> None:
        self._rig = rig
        self._by_label: dict[str, Load] = {}
        self._by_condition: dict[tuple[float, float], Load | None] = {}
        if plan is not None and rig is not None:
            try:
                loads = predict_loads(plan, rig)
            except SimulationFailed:
                return
            self._by_label = {stage.label: load for stage, load in loads.items()}
            self._by_label |= {
                _cycle_condition(stage.label): load
                for stage, load in loads.items()
                if isinstance(stage, Cycles)
            }

    def of(self, label: str) -> Load | None:
        """Load of a stage by its label."""
        # Resumed cycles have other numbers in their label than the plan's, but the same condition.
        return self._by_label.get(label, self._by_label.get(_cycle_condition(label)))

    def of_stroke(self, label: str, stroke: Stroke) -> Load | None:
        """Load of a stroke; one that is not in a plan is simulated over its recorded duration,
        once for each condition.
        """
        if label in self._by_label:
            return self._by_label[label]
        condition = stroke.height_m, stroke.speed_rad_s
        if condition not in self._by_condition:
            self._by_condition[condition] = self._simulate(stroke)
        return self._by_condition[condition]

    def _simulate(self, stroke: Stroke) -> Load | None:
        if self._rig is None:
            return None
        end_s = max(float(stream.t_s[-1]) for stream in stroke.streams.values())
        try:
            simulation = simulate_stroke_at_speed(
                self._rig, stroke.height_m, stroke.speed_rad_s, np.arange(0.0, end_s, SAMPLE_S)
            )
        except SimulationFailed:
            return None
        return Load(
            float(np.hypot(simulation.fy_N, simulation.fz_N).max(initial=0.0)),
            float(np.abs(simulation.tx_Nm).max(initial=0.0)),
        )


def _cycle_condition(label: str) -> str:
    """Condition in the label of cycles: "222.8 mm, 6 rad/s" of "cycles 1 to 10, 222.8 mm, 6
    rad/s".
    """
    return label.partition(", ")[2]


def _parts(
    recording: Recording, expected: _PredictedLoads, begun: Mapping[str, list[PartBeginning]]
) -> Iterator[RunPart]:
    """All parts. Stages that were cut short come first, because each label's beginnings are used
    up in order of time.
    """
    whole = {stage.label: stage for stage in recording.raw if not stage.cut_short}
    for cut in (stage for stage in recording.raw if stage.cut_short):
        yield _cut_short(cut, expected, _next(begun, cut.label))
    for stroke in recording.strokes:
        label = flap_label(stroke.height_m, stroke.speed_rad_s, stroke.repeat)
        yield _stroke(stroke, label, expected, _next(begun, label))
    for stage in (
        stage for stage in recording.raw if CYCLES in stage.streams and not stage.cut_short
    ):
        count = len(stage.streams[CYCLES].t_s)
        loads = _peak(stage.streams), expected.of(stage.label)
        yield RunPart(
            "cycles",
            stage.label,
            _cycle_condition(stage.label),
            _next(begun, stage.label),
            count,
            *loads,
            count=count,
        )
    if recording.is_listening:
        for stage in whole.values():
            begun_here = _next(begun, stage.label)
            loads = _peak(stage.streams), None
            samples = _samples(stage.streams)
            yield RunPart("listening", stage.label, "without motion", begun_here, samples, *loads)
        return
    holds = [stage for stage in whole.values() if CYCLES not in stage.streams]
    for index, static in enumerate(recording.static):
        raw = None
        beginning = None
        # Samples belong to means one for one, or it is not known which belong to which.
        if len(holds) == len(recording.static):
            raw = holds[index]
            beginning = _next(begun, raw.label)
        yield _static(static, raw, expected, beginning)


def _next(begun: Mapping[str, list[PartBeginning]], label: str) -> PartBeginning | None:
    if begun.get(label):
        return begun[label].pop(0)
    return None


def _condition(height_m: float, speed_rad_s: float) -> str:
    return f"{1e3 * height_m:g} mm, {speed_rad_s:g} rad/s"


def _stroke(
    stroke: Stroke, label: str, expected: _PredictedLoads, begun: PartBeginning | None
) -> RunPart:
    condition = _condition(stroke.height_m, stroke.speed_rad_s)
    fz = stroke.channel("fz_N")
    if fz is not None and len(fz[0]):
        trace = ForceTrace(*fz)
    else:
        trace = None
    loads = _peak(stroke.streams), expected.of_stroke(label, stroke)
    return RunPart("stroke", label, condition, begun, _samples(stroke.streams), *loads, trace=trace)


def _static(
    stage: StaticStage, raw: RawStage | None, expected: _PredictedLoads, begun: PartBeginning | None
) -> RunPart:
    condition = f"{1e3 * stage.height_m:g} mm"
    if raw is None:
        angle = f"{np.degrees(stage.shaft_angle_rad):.1f} deg"
        label = f"hold {stage.stage} at {angle}, {1e3 * stage.height_m:.0f} mm, {stage.direction}"
        return RunPart("static stage", label, condition, None, 0, None, None)
    loads = _peak(raw.streams), expected.of(raw.label)
    return RunPart("static stage", raw.label, condition, begun, _samples(raw.streams), *loads)


def _cut_short(stage: RawStage, expected: _PredictedLoads, begun: PartBeginning | None) -> RunPart:
    trace = next(
        (
            ForceTrace(s.t_s, s.columns["fz_N"].values)
            for s in stage.streams.values()
            if "fz_N" in s.columns and len(s.t_s)
        ),
        None,
    )
    if CYCLES in stage.streams:
        count = len(stage.streams[CYCLES].t_s)
    else:
        count = 1
    condition = f"{1e3 * stage.height_m:g} mm"
    loads = _peak(stage.streams), expected.of(stage.label)
    return RunPart(
        "cut short",
        stage.label,
        condition,
        begun,
        _samples(stage.streams),
        *loads,
        stage.cut_short,
        count,
        trace,
    )


def _samples(streams: Mapping[str, Stream]) -> int:
    return sum(len(stream.t_s) for stream in streams.values())


def _peak(streams: Mapping[str, Stream]) -> Load | None:
    """Peak force and moment over all recorded axes, as the limits use them; for cycles from the
    table of their peaks.
    """
    if CYCLES in streams:
        return Load(
            *(
                float(streams[CYCLES].columns[name].values.max(initial=0.0))
                for name in ("peak_force_N", "peak_moment_Nm")
            )
        )
    columns = {
        name: stream.columns[name].values
        for stream in streams.values()
        for name in WRENCH
        if name in stream.columns
    }
    peaks = []
    for axes in (WRENCH[:3], WRENCH[3:]):
        recorded = [columns[name] for name in axes if name in columns]
        peaks.append(_largest(recorded))
    if any(columns) and np.isfinite(peaks).any():
        return Load(*peaks)
    return None


def _largest(axes: Sequence[Floats]) -> float:
    """Largest vector length over samples of the axes, each (m,); NaN where nothing was recorded."""
    if axes and len(axes[0]):
        return float(np.sqrt(np.sum(np.square(axes), axis=0)).max())
    return float("nan")
