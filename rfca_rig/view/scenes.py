"""Where the leg is, and what it is doing, in each stage of a plan: what a picture of it needs to know besides the shaft's angle."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import degrees

from rfca_rig.protocol.cycles import Cycles
from rfca_rig.protocol.plan import Approach, Flap, Hold, MoveShaft, Plan, SetHeight, Stage

STATIC_SWEEP_DEG = 180.0
CYCLE_SWEEP_DEG = 250.0  # a turn touches the ground for less


@dataclass(frozen=True)
class Stroked:
    """A motion over the ground of which the model knows the shape at every angle of the shaft."""

    height_m: float
    speed_rad_s: float
    sweep_deg: float


@dataclass(frozen=True)
class Scene:
    """The rack's height, None before it was set, and the stroke under way; None where the leg hangs in the air."""

    height_m: float | None = None
    stroke: Stroked | None = None


NOWHERE = Scene()


def scenes(plan: Plan) -> tuple[Scene, ...]:
    """One for each stage."""
    return tuple(_scenes(plan.stages))


def _scenes(stages: Sequence[Stage]) -> Iterator[Scene]:
    """Between static stages the leg is bent from move to move; other moves go through the air."""
    height_m, speed_rad_s = None, 0.0
    for stage, *neighbours in zip(stages, (None, *stages), (*stages[1:], None), strict=False):
        height_m = stage.height_m if isinstance(stage, SetHeight) else height_m
        speed_rad_s = stage.speed_rad_s if isinstance(stage, MoveShaft) else speed_rad_s
        match stage:
            case Flap() | Approach():
                yield Scene(height_m, Stroked(stage.height_m, stage.speed_rad_s, degrees(stage.sweep_rad)))
            case Cycles():
                yield Scene(height_m, Stroked(stage.height_m, stage.speed_rad_s, CYCLE_SWEEP_DEG))
            case _ if height_m is not None and any(isinstance(one, Hold) for one in (stage, *neighbours)):
                yield Scene(height_m, Stroked(height_m, speed_rad_s, STATIC_SWEEP_DEG))
            case _:
                yield Scene(height_m)
