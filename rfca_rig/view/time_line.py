"""Time line of a recording: its stages one after the other, prepared for playback, with a short
pause for what was not recorded.

`Player` gives the samples at one time, and in a window before it.
"""

from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import degrees, isnan

import numpy as np

from rfca_rig.campaign.stored import StoredRecording, StoredStage
from rfca_rig.errors import BadInput
from rfca_rig.protocol.plan import Flap, Hold, Plan
from rfca_rig.protocol.written_plan import parse_plan
from rfca_rig.recording.model import Column, StaticStage, Stream
from rfca_rig.view.expected_force import PlacedStroke
from rfca_rig.view.leg_pose import LegMoment, Legs
from rfca_rig.view.messages import CHANNELS, Message
from rfca_rig.view.pyramid import Extrema, Floats, decimate
from rfca_rig.view.run_facts import (
    STATIC_SWEEP_DEG,
    ExpectedStroke,
    Scene,
    SceneStroke,
    scenes,
)

_PLACES = {channel.name: index for index, channel in enumerate(CHANNELS)}
_SHOWN_AS = {"shaft_angle_rad": "shaft_angle_deg"}
FORCE = ("fx_N", "fy_N", "fz_N")
MOMENT = ("tx_Nm", "ty_Nm", "tz_Nm")

PAUSE_S = 0.25
# A static stage is shown for at least this long.
HOLD_S = 1.0
# Speed between static stages where the recording does not state it.
STATIC_SPEED_RAD_S = 0.5
# Shapes are computed this far beyond the recorded end of a stroke, because a measured shaft may be
# ahead of the command.
MORE_SWEEP_DEG = 3.0

# Limit of the cache of loaded stages.
CACHE_BYTES = 200 << 20
# The interval of one picture of the limits, which are updated five times a second.
RECENT_S = 0.2


def channel_of(column: str) -> str | None:
    """Channel of the page that shows a recorded column; None for a column that is not shown."""
    name = _SHOWN_AS.get(column, column)
    if name in _PLACES:
        return name
    return None


@dataclass(frozen=True)
class Track:
    """Samples of one device: `t_s` (m,) from the stage's first sample, ascending; `values` (m,
    channels) of the channels at `places`.
    """

    t_s: Floats
    values: Floats
    places: Sequence[int]


@dataclass(frozen=True)
class StageSamples:
    """Samples of a whole stage; times in s from its first sample.

    `shaft_rad` (m, 2) holds times and shaft angles as recorded; `sizes` (m, 3) times, force [N] and
    moment [N m] as vector lengths. Either may be empty.
    """

    tracks: Sequence[Track]
    shaft_rad: Floats
    sizes: Floats

    @property
    def nbytes(self) -> int:
        """Memory of all arrays, for the limit of a cache."""
        return (
            sum(track.values.nbytes + track.t_s.nbytes for track in self.tracks)
            + self.shaft_rad.nbytes
            + self.sizes.nbytes
        )

    def extrema(self, begin_s: float, dt_s: float, first: int, count: int) -> Extrema:
        """Extrema (count, channels) in buckets of a time line on which the stage begins at
        `begin_s`.
        """
        extrema = Extrema.none(count, len(CHANNELS))
        for track in self.tracks:
            part = decimate(track.t_s + begin_s, track.values, dt_s, first, count)
            extrema.low[:, track.places] = part.low
            extrema.high[:, track.places] = part.high
        return extrema

    def shaft_at(self, t_s: float) -> float | None:
        """Shaft angle at a time from the stage's first sample, linearly interpolated; None where
        none was recorded.
        """
        if len(self.shaft_rad):
            return float(np.interp(t_s, self.shaft_rad[:, 0], self.shaft_rad[:, 1]))
        return None

    def value_at(self, channel: str, t_s: float) -> float | None:
        """Last value up to a time; None where the channel was not recorded, or began later."""
        index = _PLACES[channel]
        for track in self.tracks:
            if index in track.places and (
                row := int(np.searchsorted(track.t_s, t_s, side="right"))
            ):
                return float(track.values[row - 1, list(track.places).index(index)])
        return None


@dataclass(frozen=True)
class Clip:
    """One stage: its place on the time line, what it was, and `load` to read its samples.

    `rest_s` is the time recorded before the commanded start. `planned_rad` gives the commanded
    shaft angle at a time from the commanded start; None where it is unknown. `hinge_deg` (6,) are
    hinge angles from a photo. `stroke` is that of which the model expects a force.
    """

    label: str
    kind: str
    begin_s: float
    duration_s: float
    rest_s: float
    scene: Scene
    load: Callable[[], StageSamples] = field(repr=False)
    planned_rad: Callable[[float], float] | None = field(default=None, repr=False)
    hinge_deg: Floats | None = None
    stroke: ExpectedStroke | None = None

    @property
    def end_s(self) -> float:
        return self.begin_s + self.duration_s


def samples_of(streams: Mapping[str, Stream]) -> StageSamples:
    """Samples of the streams of a recorded stage, with times from the earliest sample of all
    streams.
    """
    used = [stream for stream in streams.values() if len(stream.t_s)]
    zero_s = min((float(stream.t_s.min()) for stream in used), default=0.0)
    tracks = [track for stream in used if (track := _track(stream, zero_s)) is not None]
    return StageSamples(tracks, _shaft(used, zero_s), _sizes(used, zero_s))


def _track(stream: Stream, zero_s: float) -> Track | None:
    names = [
        (column, shown) for column in stream.columns if (shown := channel_of(column)) is not None
    ]
    if not names:
        return None
    # Streams are nearly always sorted; a stable sort keeps records of equal time in order of
    # arrival.
    values = np.column_stack([_in_page_units(stream, column) for column, _ in names])
    order = _order(stream)
    return Track(stream.t_s[order] - zero_s, values[order], [_PLACES[shown] for _, shown in names])


def _in_page_units(stream: Stream, column: str) -> Floats:
    values = stream.columns[column].values
    if column == "shaft_angle_rad":
        return np.degrees(values)
    return values


def _order(stream: Stream) -> np.ndarray:
    return np.argsort(stream.t_s, kind="stable")


def _shaft(streams: Iterable[Stream], zero_s: float) -> Floats:
    for stream in streams:
        if "shaft_angle_rad" in stream.columns:
            order = _order(stream)
            both: Floats = np.column_stack(
                [stream.t_s - zero_s, stream.columns["shaft_angle_rad"].values]
            )[order]
            return both
    return np.zeros((0, 2))


def _sizes(streams: Iterable[Stream], zero_s: float) -> Floats:
    for stream in streams:
        if "fz_N" in stream.columns:
            columns = [stream.t_s - zero_s, _norm(stream, FORCE), _norm(stream, MOMENT)]
            sizes: Floats = np.column_stack(columns)[_order(stream)]
            return sizes
    return np.zeros((0, 3))


def _norm(stream: Stream, names: Sequence[str]) -> Floats:
    squares = [stream.columns[name].values ** 2 for name in names if name in stream.columns]
    if not squares:
        return np.zeros(len(stream.t_s))
    norm: Floats = np.sqrt(np.sum(squares, axis=0))
    return norm


def plan_in(stored: StoredRecording) -> Plan | None:
    """Plan of a recorded run; None for an imported campaign, and for plans of other versions."""
    try:
        if "plan" in stored.provenance:
            return parse_plan(stored.title, stored.provenance)
        return None
    except BadInput:
        return None


def time_line(stored: StoredRecording, start_rad: float | None, ramp_s: float) -> tuple[Clip, ...]:
    """All recorded stages in the order of the plan.

    Parameters
    ----------
    stored
        The recording.
    start_rad
        Start angle of strokes in the nominal model; None where unknown.
    ramp_s
        Time in s in which the drive of the nominal model comes to speed.
    """
    placed = []
    at_s = 0.0
    for clip in _in_order(stored, start_rad, ramp_s):
        placed.append(replace(clip, begin_s=at_s))
        at_s += clip.duration_s + PAUSE_S
    return tuple(placed)


def _in_order(stored: StoredRecording, start_rad: float | None, ramp_s: float) -> Iterator[Clip]:
    strokes = iter([_stroke_clip(stroke, start_rad, ramp_s) for stroke in stored.strokes])
    # Raw samples only where the recording kept them for every stage.
    whole = [stage for stage in stored.raw if not stage.cut_short and not stage.is_cycle_table]
    raw_of_holds: list[StoredStage | None] = [None] * len(stored.static)
    if len(whole) == len(stored.static):
        raw_of_holds = list(whole)
    holds = iter(
        [_hold_clip(stage, raw) for stage, raw in zip(stored.static, raw_of_holds, strict=True)]
    )
    plan = plan_in(stored)
    # Without a plan, strokes come before static stages.
    if plan:
        yield from _planned_clips(plan, strokes, holds)
    yield from strokes
    yield from holds
    yield from (
        _cut_short(stage) for stage in stored.raw if stage.cut_short and not stage.is_cycle_table
    )


def _planned_clips(plan: Plan, strokes: Iterator[Clip], holds: Iterator[Clip]) -> Iterator[Clip]:
    """Clips in the order of the plan, which may be longer than what was recorded: `_next` then
    gives nothing.
    """
    for stage, scene in zip(plan.stages, scenes(plan), strict=True):
        if isinstance(stage, Flap):
            yield from _next(strokes)
        elif isinstance(stage, Hold):
            for clip in _next(holds):
                planned = partial(_constant, stage.angle_rad)
                yield replace(
                    clip, label=stage.label, scene=scene, planned_rad=clip.planned_rad or planned
                )


def _next(clips: Iterator[Clip]) -> Iterable[Clip]:
    clip = next(clips, None)
    if clip is None:
        return ()
    return (clip,)


def _constant(value: float, _t_s: float) -> float:
    return value


def _stroke_clip(stroke: StoredStage, start_rad: float | None, ramp_s: float) -> Clip:
    first_s, last_s = stroke.samples.span_s
    sweep_deg = degrees(stroke.speed_rad_s * max(last_s, 0.0)) + MORE_SWEEP_DEG
    planned_rad = None
    if start_rad is not None:
        planned_rad = partial(_command_rad, start_rad, stroke.speed_rad_s, ramp_s)
    return Clip(
        label=stroke.label,
        kind="flap",
        begin_s=0.0,
        duration_s=last_s - first_s,
        rest_s=-first_s,
        scene=Scene(stroke.height_m, SceneStroke(stroke.height_m, stroke.speed_rad_s, sweep_deg)),
        load=partial(_load_samples, stroke),
        planned_rad=planned_rad,
        stroke=ExpectedStroke(stroke.height_m, stroke.speed_rad_s, max(last_s, 0.0)),
    )


def _command_rad(start_rad: float, speed_rad_s: float, ramp_s: float, t_s: float) -> float:
    """Commanded shaft angle in rad: constant acceleration during the ramp, then constant speed."""
    if t_s < ramp_s:
        return start_rad + 0.5 * speed_rad_s * max(t_s, 0.0) ** 2 / ramp_s
    return start_rad + speed_rad_s * (t_s - 0.5 * ramp_s)


def _load_samples(stage: StoredStage) -> StageSamples:
    return samples_of(stage.samples.whole())


def _hold_clip(stage: StaticStage, raw: StoredStage | None) -> Clip:
    shaft_rad = stage.shaft_angle_rad
    hinges = None
    planned_rad = None
    if not any(isnan(angle) for angle in stage.hinge_deg):
        hinges = np.array(stage.hinge_deg)
        planned_rad = partial(_constant, shaft_rad)
    if raw is None:
        first_s = 0.0
        last_s = 0.0
        load = partial(_means, stage)
    else:
        first_s, last_s = raw.samples.span_s
        load = partial(_load_samples, raw)
    return Clip(
        label=(
            f"hold {stage.stage} at {degrees(shaft_rad):.1f} deg, {1e3 * stage.height_m:.0f} "
            f"mm, {stage.direction}"
        ),
        kind="hold",
        begin_s=0.0,
        duration_s=max(HOLD_S, last_s - first_s),
        rest_s=-first_s,
        scene=Scene(
            stage.height_m, SceneStroke(stage.height_m, STATIC_SPEED_RAD_S, STATIC_SWEEP_DEG)
        ),
        load=load,
        planned_rad=planned_rad,
        hinge_deg=hinges,
    )


def _means(stage: StaticStage) -> StageSamples:
    """Samples of a static stage of which only means are known: constant, at 1 kHz, for as long
    as it is shown.
    """
    values: Mapping[str, float] = {
        "shaft_angle_rad": stage.shaft_angle_rad,
        "fy_N": stage.fy_N,
        "fz_N": stage.fz_N,
        "tx_Nm": stage.tx_Nm,
    }
    columns = {
        name: Column(np.full(int(HOLD_S * 1000), value), "")
        for name, value in values.items()
        if not isnan(value)
    }
    return samples_of({"means": Stream(np.linspace(0.0, HOLD_S, int(HOLD_S * 1000)), columns)})


def _cut_short(stage: StoredStage) -> Clip:
    first_s, last_s = stage.samples.span_s
    kind = "move"
    if stage.label.startswith(("flap", "hold")):
        kind = stage.label.partition(" ")[0]
    return Clip(
        label=f"{stage.label}, cut short",
        kind=kind,
        begin_s=0.0,
        duration_s=last_s - first_s,
        rest_s=-first_s,
        scene=Scene(stage.height_m),
        load=partial(_load_samples, stage),
    )


class Player:
    """Loads the samples of stages on demand, and caches those used last."""

    def __init__(self, clips: Sequence[Clip], legs: Legs) -> None:
        self.clips = clips
        self.duration_s = 0.0
        if clips:
            self.duration_s = clips[-1].end_s
        self._legs = legs
        self._begins_s = [clip.begin_s for clip in clips]
        self._loaded: OrderedDict[int, StageSamples] = OrderedDict()

    def _samples(self, index: int) -> StageSamples:
        if index in self._loaded:
            self._loaded.move_to_end(index)
            return self._loaded[index]
        samples = self._loaded[index] = self.clips[index].load()
        # The oldest come first in the dictionary. The stage just loaded is never dropped, however
        # large it is.
        while (
            len(self._loaded) > 1
            and sum(stage.nbytes for stage in self._loaded.values()) > CACHE_BYTES
        ):
            self._loaded.popitem(last=False)
        return samples

    def strokes(self) -> tuple[PlacedStroke, ...]:
        """Where the strokes are, from their commanded start to the end of what was recorded."""
        placed = []
        for clip in self.clips:
            if clip.stroke is not None:
                from_s = clip.begin_s + clip.rest_s
                placed.append(PlacedStroke(from_s, clip.end_s, clip.stroke.condition))
        return tuple(placed)

    def place_at(self, at_s: float) -> int:
        """Index of the clip that is played at a time, or was played last."""
        return max(bisect_right(self._begins_s, at_s) - 1, 0)

    def extrema(self, dt_s: float, first: int, count: int) -> Extrema:
        """Extrema (count, channels) in buckets of `dt_s` s, the first of which begins at first *
        dt_s.
        """
        extrema = Extrema.none(count, len(CHANNELS))
        begin_s = first * dt_s
        end_s = (first + count) * dt_s
        for index in range(self.place_at(begin_s), self.place_at(end_s) + 1):
            clip = self.clips[index]
            if clip.begin_s < end_s and clip.end_s >= begin_s:
                part = self._samples(index).extrema(clip.begin_s, dt_s, first, count)
                extrema = Extrema(np.fmin(extrema.low, part.low), np.fmax(extrema.high, part.high))
        return extrema

    def leg(self, at_s: float) -> Message | None:
        """Pose of the leg at a time; None where no angle of the shaft was recorded."""
        clip, samples, t_s = self._at(at_s)
        shaft_rad = samples.shaft_at(t_s)
        if shaft_rad is None:
            return None
        planned_rad = None
        if clip.planned_rad is not None:
            planned_rad = clip.planned_rad(t_s - clip.rest_s)
        fy_N = samples.value_at("fy_N", t_s)
        fz_N = samples.value_at("fz_N", t_s)
        force_N = None
        if fy_N is not None and fz_N is not None:
            force_N = (fy_N, fz_N)
        return self._legs.message(
            LegMoment(clip.scene, shaft_rad, planned_rad, clip.hinge_deg, force_N)
        )

    def _at(self, at_s: float) -> tuple[Clip, StageSamples, float]:
        """The clip at a time, its samples, and the time in s since its first sample, within the
        clip.
        """
        index = self.place_at(at_s)
        clip = self.clips[index]
        return clip, self._samples(index), min(at_s - clip.begin_s, clip.duration_s)

    def loads(self, at_s: float) -> tuple[Floats, Floats]:
        """Largest force [N] and moment [N m], each pair (2,): over the last RECENT_S, and since
        the stage began.
        """
        _, samples, t_s = self._at(at_s)
        before = samples.sizes[: int(np.searchsorted(samples.sizes[:, 0], t_s, side="right"))]
        # At least the last sample: a slow stream may have none within the interval.
        lately = before[
            min(int(np.searchsorted(before[:, 0], t_s - RECENT_S)), max(len(before) - 1, 0)) :
        ]
        return lately[:, 1:].max(axis=0, initial=0.0), before[:, 1:].max(axis=0, initial=0.0)

    def channels(self) -> Mapping[str, bool]:
        """Which channels were recorded, judged by the first clip of each kind: loading all
        stages would take long.
        """
        places = {
            self.clips[index].kind: index for index in reversed(range(len(self.clips)))
        }.values()
        recorded = {
            index
            for clip in places
            for track in self._samples(clip).tracks
            for index in track.places
        }
        return {channel.name: index in recorded for index, channel in enumerate(CHANNELS)}
