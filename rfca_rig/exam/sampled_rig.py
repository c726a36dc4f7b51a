"""The true world of one stroke of a case: nominal rig, differences, scatter between repeats, effects and their laws."""

from dataclasses import dataclass, replace

import numpy as np

from rfca_rig.exam.cases import Case
from rfca_rig.exam.heterogeneity import deform_law
from rfca_rig.exam.injected_faults import with_effect
from rfca_rig.exam.labels import true_world
from rfca_rig.exam.laws import shape_laws
from rfca_rig.exam.nominal_world import apply_nominal_errors, nominal_world
from rfca_rig.exam.structured import apply_structured_error
from rfca_rig.exam.unknown_faults import with_unknown_fault
from rfca_rig.exam.world import World

# Standard deviations between repeats.
HEIGHT_M, FRICTION, START_RAD = 1e-4, 5e-3, float(np.radians(0.15))


@dataclass(frozen=True)
class ExamScatter:
    """Differences of one repeat from the mean of all."""

    height_m: float = 0.0
    friction: float = 0.0
    start_rad: float = 0.0


def draw_scatter(random: np.random.Generator) -> ExamScatter:
    """Draw the differences of one repeat: rack height 0.1 mm, friction 0.005, start angle 0.15 degrees (standard deviations)."""
    x = random.normal(size=3)
    return ExamScatter(float(HEIGHT_M * x[0]), float(FRICTION * x[1]), float(START_RAD * x[2]))


def build_world(case: Case, height_m: float, scatter: ExamScatter, repeat: int, stronger: float = 1.0, strokes_before: int = 0) -> World:
    """The true rig of a case in one repeat (from 1), after `strokes_before` strokes of the campaign.

    Effects that vary between conditions are multiplied by `stronger`.
    """
    world = replace(apply_nominal_errors(nominal_world(height_m), case.off), strokes_before=strokes_before)
    if case.structured is not None:
        world = apply_structured_error(world, case.structured)
    world = replace(world, drive=replace(world.drive, late_s=case.late_s))
    world = true_world(_scatter(world, scatter), case.mislabelled)
    # Laws scale only the damping that an effect adds, so the damping before the effects is kept.
    damping = world.hinges.damping_Nm_s_per_rad
    for effect, values in case.effects.items():
        world = with_effect(world, effect, {name: _vary(name, value, stronger) for name, value in values.items()})
    if case.law is not None:
        world = shape_laws(world, case.law, damping)
    if case.uneven is not None:
        world = deform_law(world, case.uneven, damping)
    for name, values in case.strangers.items():
        world = with_unknown_fault(world, name, values, repeat)
    return world


def _vary(name: str, value: float, stronger: float) -> float:
    """Sizes vary between conditions; the speed and angle scales of a law do not."""
    return value if name in ("speed_m_s", "cycles_per_turn") else value * stronger


def _scatter(world: World, scatter: ExamScatter) -> World:
    return replace(
        world,
        floor=replace(world.floor, mu=world.floor.mu + scatter.friction),
        drive=replace(world.drive, start_angle_rad=world.drive.start_angle_rad + scatter.start_rad),
        mount=replace(world.mount, height_m=world.mount.height_m + scatter.height_m),
    )
