"""Nuisance parameters of a pendulum: the values of [known_to], of each link."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.analysis.fitting.space import FitParameter, Prior, never_below
from rfca_rig.analysis.swings import Nuisance
from rfca_rig.model.pendulum import Pendulum, rods

NEVER_NEGATIVE = ("joint_damping_Nm_s_per_rad", "joint_friction_Nm", "rotor_inertia_kg_m2")


@dataclass(frozen=True)
class PendulumInput(ModelPoint):
    """Input of one simulation of a pendulum: the effects in `rig`, and the shifts of nominal values, by nuisance parameter."""

    off: tuple[tuple[str, float], ...] = ()


def space_of_pendulum(pendulum: Pendulum, nuisances: Sequence[Nuisance]) -> Prior[PendulumInput]:
    """Space of the nuisance parameters around the nominal pendulum."""
    std = np.array([nuisance.std for nuisance in nuisances])
    parameters = tuple(_parameter(pendulum, nuisance) for nuisance in nuisances)
    return Prior(parameters, PendulumInput(rods(pendulum)), std, np.ones(len(std), dtype=bool))


def _parameter(pendulum: Pendulum, nuisance: Nuisance) -> FitParameter[PendulumInput]:
    link, _, key = nuisance.name.partition(".")
    shift: Callable[[float], float] = float
    if key in NEVER_NEGATIVE:
        shift = never_below(getattr(pendulum.links[int(link.removeprefix("link")) - 1], key), nuisance.std)

    def read(at: PendulumInput) -> float:
        return dict(at.off).get(nuisance.name, 0.0)

    def write(at: PendulumInput, value: float) -> PendulumInput:
        return replace(at, off=(*(pair for pair in at.off if pair[0] != nuisance.name), (nuisance.name, shift(value))))

    unit = "" if nuisance.name.endswith("_relative") else nuisance.name.split("_", 2)[-1]
    return FitParameter(nuisance.name, unit, False, nuisance.std, read, write)


def to_pendulum_input(at: ModelPoint) -> PendulumInput:
    """The input as that of a pendulum; without shifts where it has none."""
    return at if isinstance(at, PendulumInput) else PendulumInput(at.rig)
