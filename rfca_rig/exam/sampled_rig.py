"""The world behind one stroke of a case."""

from dataclasses import dataclass, replace

import numpy as np

from rfca_rig.exam.cases import Case
from rfca_rig.exam.heterogeneity import made_uneven
from rfca_rig.exam.injected_faults import with_effect
from rfca_rig.exam.labels import really
from rfca_rig.exam.laws import shape_laws
from rfca_rig.exam.nominal_world import moved, nominal_world
from rfca_rig.exam.structured import distorted
from rfca_rig.exam.unknown_faults import with_stranger
from rfca_rig.exam.world import World

HEIGHT_M, FRICTION, START_RAD = 1e-4, 5e-3, float(np.radians(0.15))


@dataclass(frozen=True)
class ExamScatter:
    """How one repeat differs from the others."""

    height_m: float = 0.0
    friction: float = 0.0
    start_rad: float = 0.0


def drawn_scatter(random: np.random.Generator) -> ExamScatter:
    """Rack, floor and clamp as they fall out each time: 0.1 mm, 0.005, 0.15 degrees."""
    x = random.normal(size=3)
    return ExamScatter(float(HEIGHT_M * x[0]), float(FRICTION * x[1]), float(START_RAD * x[2]))


def world_of(case: Case, height_m: float, scatter: ExamScatter, repeat: int, stronger: float = 1.0, strokes_before: int = 0) -> World:
    """The real rig of a case in one repeat (from 1), after `strokes_before` in the campaign; effects that vary between conditions are
    `stronger` times as strong here.
    """
    world = replace(moved(nominal_world(height_m), case.off), strokes_before=strokes_before)
    if case.structured is not None:
        world = distorted(world, case.structured)
    world = replace(world, drive=replace(world.drive, late_s=case.late_s))
    world = really(_scattered(world, scatter), case.mislabelled)
    damping = world.hinges.damping_Nm_s_per_rad
    for effect, values in case.effects.items():
        world = with_effect(world, effect, {name: _varied(name, value, stronger) for name, value in values.items()})
    if case.law is not None:
        world = shape_laws(world, case.law, damping)
    if case.uneven is not None:
        world = made_uneven(world, case.uneven, damping)
    for name, values in case.strangers.items():
        world = with_stranger(world, name, values, repeat)
    return world


def _varied(name: str, value: float, stronger: float) -> float:
    """Only sizes vary, not the scales of speed or of angle that go with them."""
    return value if name in ("speed_m_s", "cycles_per_turn") else value * stronger


def _scattered(world: World, scatter: ExamScatter) -> World:
    return replace(
        world,
        floor=replace(world.floor, mu=world.floor.mu + scatter.friction),
        drive=replace(world.drive, start_angle_rad=world.drive.start_angle_rad + scatter.start_rad),
        mount=replace(world.mount, height_m=world.mount.height_m + scatter.height_m),
    )
