"""What the view's process is given of a run before it begins: its facts, the scenes of its stages,
where to serve it, and the token.

A scene is what a picture of the leg needs besides the shaft's angle: rack height and stroke. Who
presents the token may watch the run and stop it.

`Progress` estimates the time that a plan will still take. Planned times are the longest that stages
may take. The stages done so far show which share of that each kind of stage needs.
"""

import secrets
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import degrees
from typing import Any

from rfca_rig.clock import WallClock
from rfca_rig.drivers.roles import SensorScale
from rfca_rig.protocol.plan import (
    Approach,
    Cycles,
    Flap,
    Hold,
    Limits,
    MoveShaft,
    Plan,
    SetHeight,
    Stage,
)

KINDS = {
    "Flap": "flap",
    "Hold": "hold",
    "MoveShaft": "move",
    "Rest": "rest",
    "SetHeight": "height",
    "Approach": "approach",
    "Cycles": "cycles",
    "StiffnessCheck": "check",
}

# Angles over which shapes are computed. Cycles turn on and on, but the leg is in contact for less
# than this part of a turn.
STATIC_SWEEP_DEG = 180.0
CYCLE_SWEEP_DEG = 250.0

MODULE = "rfca_rig.view.process"
READY = "ready"
FAILED = "failed"

# 192 random bits, 32 characters in the address, all of which may stand in a header.
BYTES = 24


def kind_of(stage: Stage) -> str:
    """Kind of a stage in the words of the page."""
    return KINDS[type(stage).__name__]


@dataclass(frozen=True)
class ListedStage:
    """A stage in the page's list; `duration_s` is the planned one."""

    label: str
    kind: str
    duration_s: float


def list_stages(stages: Sequence[Stage]) -> tuple[ListedStage, ...]:
    return tuple(ListedStage(stage.label, kind_of(stage), stage.duration_s) for stage in stages)


@dataclass(frozen=True)
class Position:
    """Progress as shares from 0 to 1, and the remaining seconds `eta_s`, None between stages;
    `stage` is -1 then.
    """

    stage: int
    stage_done: float
    done: float
    eta_s: float | None


class Progress:
    """Follows the plan by wall time: planned durations are times of the rig, and operators take
    their own time.
    """

    def __init__(self, stages: Sequence[ListedStage]) -> None:
        self._stages = stages
        self._took: dict[str, tuple[float, float]] = defaultdict(lambda: (0.0, 0.0))
        # For each place the sum of all durations from there on, (n + 1,); the last is 0.
        sums = [0.0]
        for duration_s in reversed([stage.duration_s for stage in stages]):
            sums.append(sums[-1] + duration_s)
        self._planned_from_s = sums[::-1]
        self._now = -1
        self._began_s = 0.0
        self._over: float | None = None
        self._paused_s: float | None = None

    def pause(self, is_paused: bool, wall_s: float) -> None:
        """The run waits, or goes on: the time between counts to no stage."""
        if is_paused:
            self._paused_s = wall_s
        elif self._paused_s is not None:
            self._began_s += wall_s - self._paused_s
            self._paused_s = None

    def begin(self, number: int, wall_s: float) -> None:
        """A stage begins, which ends the one before; `number` is -1 for one that is not in the
        plan.
        """
        if self._now >= 0:
            stage = self._stages[self._now]
            took_s, planned_s = self._took[stage.kind]
            self._took[stage.kind] = took_s + wall_s - self._began_s, planned_s + stage.duration_s
        self._now = number
        self._began_s = wall_s

    def end(self, wall_s: float, is_whole: bool) -> None:
        """The run is over; `is_whole` where the whole plan was done."""
        self._over = 1.0 if is_whole else self.at(wall_s).done
        self.begin(-1, wall_s)

    def at(self, wall_s: float) -> Position:
        """Progress at a wall time."""
        if self._now < 0:
            return Position(-1, 0.0, self._over or 0.0, None)
        if self._paused_s is not None:
            wall_s = self._paused_s
        needs_s = self._needs_s(self._stages[self._now])
        elapsed_s = wall_s - self._began_s
        if needs_s > 0.0:
            stage_done = min(elapsed_s / needs_s, 1.0)
        else:
            stage_done = 0.0
        # Progress of the whole plan counts planned times, not estimates: it must never run
        # backwards when an estimate changes.
        all_s = self._planned_from_s[0]
        after_s = self._planned_from_s[self._now + 1]
        planned_s = self._stages[self._now].duration_s
        if all_s:
            done = 1.0 - (after_s + (1.0 - stage_done) * planned_s) / all_s
        else:
            done = 0.0
        remaining_s = max(needs_s - elapsed_s, 0.0) + sum(
            self._needs_s(stage) for stage in self._stages[self._now + 1 :]
        )
        return Position(self._now, round(stage_done, 4), round(done, 4), round(remaining_s, 1))

    def _needs_s(self, stage: ListedStage) -> float:
        # Stages of one kind take a similar share of their planned time; without experience the
        # planned time counts.
        took_s, planned_s = self._took[stage.kind]
        if planned_s <= 0.0:
            return stage.duration_s
        return stage.duration_s * (took_s / planned_s)


@dataclass(frozen=True)
class SceneStroke:
    """A stroke that the model simulates, so that the leg's shape is known at every angle of the
    shaft.
    """

    height_m: float
    speed_rad_s: float
    sweep_deg: float


@dataclass(frozen=True)
class Scene:
    """Height of the rack, None before it was set, and the stroke in progress, None where the leg
    hangs in the air.
    """

    height_m: float | None = None
    stroke: SceneStroke | None = None


UNKNOWN_SCENE = Scene()


def scenes(plan: Plan) -> tuple[Scene, ...]:
    """The scene of each stage of a plan."""
    return tuple(_scenes(plan.stages))


def _scenes(stages: Sequence[Stage]) -> Iterator[Scene]:
    """Between static stages the leg stays bent, so that moves next to a hold count as strokes;
    other moves go through the air.
    """
    height_m = None
    speed_rad_s = 0.0
    for stage, *neighbours in zip(stages, (None, *stages), (*stages[1:], None), strict=False):
        if isinstance(stage, SetHeight):
            height_m = stage.height_m
        if isinstance(stage, MoveShaft):
            speed_rad_s = stage.speed_rad_s
        match stage:
            case Flap() | Approach():
                yield Scene(
                    height_m,
                    SceneStroke(stage.height_m, stage.speed_rad_s, degrees(stage.sweep_rad)),
                )
            case Cycles():
                yield Scene(
                    height_m, SceneStroke(stage.height_m, stage.speed_rad_s, CYCLE_SWEEP_DEG)
                )
            case _ if height_m is not None and any(
                isinstance(neighbour, Hold) for neighbour in (stage, *neighbours)
            ):
                yield Scene(height_m, SceneStroke(height_m, speed_rad_s, STATIC_SWEEP_DEG))
            case _:
                yield Scene(height_m)


@dataclass(frozen=True)
class ExpectedStroke:
    """A condition of strokes for which the model predicts the force, up to `duration_s` after the
    commanded start.
    """

    height_m: float
    speed_rad_s: float
    duration_s: float

    @property
    def condition(self) -> str:
        """The same text for strokes of one height and speed, whatever their duration."""
        return f"{1e3 * self.height_m:.2f} mm, {self.speed_rad_s:.4f} rad/s"


def expected_strokes(plan: Plan) -> tuple[ExpectedStroke | None, ...]:
    """The stroke of each stage of a plan; None for static stages, cycles and moves."""
    strokes: list[ExpectedStroke | None] = []
    for stage in plan.stages:
        if isinstance(stage, Flap | Approach):
            strokes.append(ExpectedStroke(stage.height_m, stage.speed_rad_s, stage.stroke_s))
        else:
            strokes.append(None)
    return tuple(strokes)


@dataclass(frozen=True)
class RunFacts:
    """Facts of a run. `mark` is SIM or REAL; `nominal` and `known_to` hold the sections of the
    nominal model, and how well it is known, as in recordings. `strokes` has an entry for each
    stage.
    """

    title: str
    mark: str
    stages: tuple[ListedStage, ...]
    scenes: tuple[Scene, ...]
    strokes: tuple[ExpectedStroke | None, ...]
    limits: Limits
    scale: SensorScale
    nominal: Mapping[str, Any]
    known_to: Mapping[str, float]


def run_facts(
    plan: Plan,
    mark: str,
    scale: SensorScale,
    nominal: Mapping[str, Any],
    known_to: Mapping[str, float],
) -> RunFacts:
    """Facts of a run of `plan`.

    Parameters
    ----------
    plan
        The plan to be carried out.
    mark
        SIM for twins, REAL for a rig.
    scale
        Counts of the force sensor per N and N m.
    nominal, known_to
        Sections of the nominal model as in recordings, and one standard deviation of its values.
    """
    return RunFacts(
        plan.title,
        mark,
        list_stages(plan.stages),
        scenes(plan),
        expected_strokes(plan),
        plan.limits,
        scale,
        nominal,
        known_to,
    )


@dataclass(frozen=True)
class ViewAssignment:
    """The run to show, and where to serve it; port 0 is any free port.

    `clock` is that of the run's queue. Both processes read the same monotonic clock of the machine,
    so its times can be compared.
    """

    facts: RunFacts
    queue_name: str
    clock: WallClock
    port: int
    token: str


def new_token() -> str:
    """A new random token, for one run or one replay."""
    return secrets.token_urlsafe(BYTES)


def is_token(given: str, token: str) -> bool:
    """Compares in constant time, so that timing does not reveal how much of a guess is right."""
    return secrets.compare_digest(given.encode(), token.encode())
