"""What the view's process is given of a run before it begins: its facts, the scenes of its stages, where to serve it, and the token.

A scene is what a picture of the leg needs besides the shaft's angle: rack height and stroke. Who presents the token may watch the run and
stop it.
"""

import secrets
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import degrees
from typing import Any

from rfca_rig.clock import WallClock
from rfca_rig.drivers.roles import SensorScale
from rfca_rig.protocol.cycles import Cycles
from rfca_rig.protocol.plan import Approach, Flap, Hold, Limits, MoveShaft, Plan, SetHeight, Stage
from rfca_rig.view.progress import ListedStage, list_stages

# Angles over which shapes are computed. Cycles turn on and on, but the leg is in contact for less than this part of a turn.
STATIC_SWEEP_DEG = 180.0
CYCLE_SWEEP_DEG = 250.0

MODULE = "rfca_rig.view.process"
READY, FAILED = "ready", "failed"

# 192 random bits, 32 characters in the address, all of which may stand in a header.
BYTES = 24


@dataclass(frozen=True)
class SceneStroke:
    """A stroke that the model simulates, so that the leg's shape is known at every angle of the shaft."""

    height_m: float
    speed_rad_s: float
    sweep_deg: float


@dataclass(frozen=True)
class Scene:
    """Height of the rack, None before it was set, and the stroke in progress, None where the leg hangs in the air."""

    height_m: float | None = None
    stroke: SceneStroke | None = None


UNKNOWN_SCENE = Scene()


def scenes(plan: Plan) -> tuple[Scene, ...]:
    """The scene of each stage of a plan."""
    return tuple(_scenes(plan.stages))


def _scenes(stages: Sequence[Stage]) -> Iterator[Scene]:
    """Between static stages the leg stays bent, so that moves next to a hold count as strokes; other moves go through the air."""
    height_m, speed_rad_s = None, 0.0
    for stage, *neighbours in zip(stages, (None, *stages), (*stages[1:], None), strict=False):
        height_m = stage.height_m if isinstance(stage, SetHeight) else height_m
        speed_rad_s = stage.speed_rad_s if isinstance(stage, MoveShaft) else speed_rad_s
        match stage:
            case Flap() | Approach():
                yield Scene(height_m, SceneStroke(stage.height_m, stage.speed_rad_s, degrees(stage.sweep_rad)))
            case Cycles():
                yield Scene(height_m, SceneStroke(stage.height_m, stage.speed_rad_s, CYCLE_SWEEP_DEG))
            case _ if height_m is not None and any(isinstance(one, Hold) for one in (stage, *neighbours)):
                yield Scene(height_m, SceneStroke(height_m, speed_rad_s, STATIC_SWEEP_DEG))
            case _:
                yield Scene(height_m)


@dataclass(frozen=True)
class RunFacts:
    """Facts of a run. `mark` is SIM or REAL; `nominal` holds the sections of the nominal model as in recordings."""

    title: str
    mark: str
    stages: tuple[ListedStage, ...]
    scenes: tuple[Scene, ...]
    limits: Limits
    scale: SensorScale
    nominal: Mapping[str, Any]


def run_facts(plan: Plan, mark: str, scale: SensorScale, nominal: Mapping[str, Any]) -> RunFacts:
    """Facts of a run of `plan`.

    Parameters
    ----------
    plan
        The plan to be carried out.
    mark
        SIM for twins, REAL for a rig.
    scale
        Counts of the force sensor per N and N m.
    nominal
        Sections of the nominal model as in recordings.
    """
    return RunFacts(plan.title, mark, list_stages(plan.stages), scenes(plan), plan.limits, scale, nominal)


@dataclass(frozen=True)
class ViewAssignment:
    """The run to show, and where to serve it; port 0 is any free port.

    `clock` is that of the run's queue. Both processes read the same monotonic clock of the machine, so its times can be compared.
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
