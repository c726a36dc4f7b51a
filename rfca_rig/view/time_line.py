"""Time line of a recording: its stages one after the other, with a short pause for what was not recorded in between."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from math import degrees, isnan

import numpy as np

from rfca_rig.campaign.stored import StoredRecording, StoredStage
from rfca_rig.errors import BadInput
from rfca_rig.protocol.plan import Flap, Hold, Plan
from rfca_rig.protocol.written_plan import parse_plan
from rfca_rig.recording.model import Column, StaticStage, Stream
from rfca_rig.view.scenes import STATIC_SWEEP_DEG, Scene, SceneStroke, scenes
from rfca_rig.view.segment import Clip, StageSamples, samples_of

PAUSE_S = 0.25
# A static stage is shown for at least this long.
HOLD_S = 1.0
# Speed between static stages where the recording does not state it.
STATIC_SPEED_RAD_S = 0.5
# Shapes are computed this far beyond the recorded end of a stroke, because a measured shaft may be ahead of the command.
MORE_SWEEP_DEG = 3.0


def plan_in(stored: StoredRecording) -> Plan | None:
    """Plan of a recorded run; None for an imported campaign, and for plans of other versions."""
    try:
        return parse_plan(stored.title, stored.provenance) if "plan" in stored.provenance else None
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
    placed, at_s = [], 0.0
    for clip in _in_order(stored, start_rad, ramp_s):
        placed.append(replace(clip, begin_s=at_s))
        at_s += clip.duration_s + PAUSE_S
    return tuple(placed)


def _in_order(stored: StoredRecording, start_rad: float | None, ramp_s: float) -> Iterator[Clip]:
    strokes = iter([_stroke_clip(stroke, start_rad, ramp_s) for stroke in stored.strokes])
    holds = iter(_hold_clips(stored))
    # A plan may be longer than what was recorded: `_next` then gives nothing. Without a plan, strokes come before static stages.
    plan = plan_in(stored)
    for stage, scene in zip(plan.stages, scenes(plan), strict=True) if plan else ():
        if isinstance(stage, Flap):
            yield from _next(strokes)
        elif isinstance(stage, Hold):
            for clip in _next(holds):
                planned = partial(_constant, stage.angle_rad)
                yield replace(clip, label=stage.label, scene=scene, planned_rad=clip.planned_rad or planned)
    yield from strokes
    yield from holds
    yield from (_cut_short(stage) for stage in stored.raw if stage.cut_short and not stage.is_cycle_table)


def _next(clips: Iterator[Clip]) -> Iterable[Clip]:
    clip = next(clips, None)
    return () if clip is None else (clip,)


def _constant(value: float, _t_s: float) -> float:
    return value


def _stroke_clip(stroke: StoredStage, start_rad: float | None, ramp_s: float) -> Clip:
    first_s, last_s = stroke.samples.span_s
    sweep_deg = degrees(stroke.speed_rad_s * max(last_s, 0.0)) + MORE_SWEEP_DEG
    return Clip(
        label=stroke.label,
        kind="flap",
        begin_s=0.0,
        duration_s=last_s - first_s,
        rest_s=-first_s,
        scene=Scene(stroke.height_m, SceneStroke(stroke.height_m, stroke.speed_rad_s, sweep_deg)),
        load=partial(_load_samples, stroke),
        planned_rad=None if start_rad is None else partial(_command_rad, start_rad, stroke.speed_rad_s, ramp_s),
    )


def _command_rad(start_rad: float, speed_rad_s: float, ramp_s: float, t_s: float) -> float:
    """Commanded shaft angle in rad: constant acceleration during the ramp, then constant speed."""
    if t_s < ramp_s:
        return start_rad + 0.5 * speed_rad_s * max(t_s, 0.0) ** 2 / ramp_s
    return start_rad + speed_rad_s * (t_s - 0.5 * ramp_s)


def _load_samples(stage: StoredStage) -> StageSamples:
    return samples_of(stage.samples.whole())


def _hold_clips(stored: StoredRecording) -> list[Clip]:
    """Clips of static stages, with their raw samples where the recording kept them for every stage."""
    whole = [stage for stage in stored.raw if not stage.cut_short and not stage.is_cycle_table]
    behind = whole if len(whole) == len(stored.static) else [None] * len(stored.static)
    return [_hold_clip(stage, raw) for stage, raw in zip(stored.static, behind, strict=True)]


def _hold_clip(stage: StaticStage, raw: StoredStage | None) -> Clip:
    shaft_rad = stage.shaft_angle_rad
    hinges = None if any(isnan(angle) for angle in stage.hinge_deg) else np.array(stage.hinge_deg)
    first_s, last_s = (0.0, 0.0) if raw is None else raw.samples.span_s
    return Clip(
        label=f"hold {stage.stage} at {degrees(shaft_rad):.1f} deg, {1e3 * stage.height_m:.0f} mm, {stage.direction}",
        kind="hold",
        begin_s=0.0,
        duration_s=max(HOLD_S, last_s - first_s),
        rest_s=-first_s,
        scene=Scene(stage.height_m, SceneStroke(stage.height_m, STATIC_SPEED_RAD_S, STATIC_SWEEP_DEG)),
        load=partial(_means, stage) if raw is None else partial(_load_samples, raw),
        planned_rad=None if hinges is None else partial(_constant, shaft_rad),
        hinge_deg=hinges,
    )


def _means(stage: StaticStage) -> StageSamples:
    """Samples of a static stage of which only means are known: constant, at 1 kHz, for as long as it is shown."""
    values: Mapping[str, float] = {
        "shaft_angle_rad": stage.shaft_angle_rad,
        "fy_N": stage.fy_N,
        "fz_N": stage.fz_N,
        "tx_Nm": stage.tx_Nm,
    }
    columns = {name: Column(np.full(int(HOLD_S * 1000), value), "") for name, value in values.items() if not isnan(value)}
    return samples_of({"means": Stream(np.linspace(0.0, HOLD_S, int(HOLD_S * 1000)), columns)})


def _cut_short(stage: StoredStage) -> Clip:
    first_s, last_s = stage.samples.span_s
    return Clip(
        label=f"{stage.label}, cut short",
        kind=stage.label.split(" ", 1)[0] if stage.label.startswith(("flap", "hold")) else "move",
        begin_s=0.0,
        duration_s=last_s - first_s,
        rest_s=-first_s,
        scene=Scene(stage.height_m),
        load=partial(_load_samples, stage),
    )
