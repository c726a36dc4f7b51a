"""Scene of each stage of a plan: rack height and stroke, which a picture of the leg needs besides the shaft's angle."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import degrees

from rfca_rig.protocol.cycles import Cycles
from rfca_rig.protocol.plan import Approach, Flap, Hold, MoveShaft, Plan, SetHeight, Stage

# Angles over which shapes are computed. Cycles turn on and on, but the leg is in contact for less than this part of a turn.
STATIC_SWEEP_DEG = 180.0
CYCLE_SWEEP_DEG = 250.0


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
