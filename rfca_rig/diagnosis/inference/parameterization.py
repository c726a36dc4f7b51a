"""Every unknown as a coordinate that is standard normal a priori: nuisance parameters, and the
parameters of effects.

The coordinate of a nuisance parameter counts the prior standard deviations by which it is off. A
parameter of an effect that is positive over more than an octave is log-uniform between its
plausible bounds. Any other one is normal about their middle, with a standard deviation of a quarter
of their distance. So one step length, one prior and one test for "at a bound" suit all.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from rfca_rig.analysis.fitting.space import Prior
from rfca_rig.diagnosis.config import MAX_COORDINATE, OCTAVE
from rfca_rig.diagnosis.simulator import SimulatorInput
from rfca_rig.model.effect import Effect, Parameter
from rfca_rig.model.parameters import PresentEffect

Floats = NDArray[np.float64]


def value_of(parameter: Parameter, z: float) -> float:
    """The parameter's value at the standard normal coordinate z."""
    low = parameter.low
    high = parameter.high
    # Log-uniform: Phi(z) is uniform between 0 and 1.
    if _is_scale(parameter):
        return float(low * (high / low) ** ndtr(z))
    return 0.5 * (low + high) + 0.25 * (high - low) * z


def coordinate_of(parameter: Parameter, value: float) -> float:
    """Standard normal coordinate of a value; beyond the bounds of a log-uniform parameter it is
    limited to MAX_COORDINATE deviations.
    """
    low = parameter.low
    high = parameter.high
    if _is_scale(parameter):
        share = np.log(max(value, 1e-300) / low) / np.log(high / low)
        # The inner limit keeps the inverse of Phi finite at and beyond the bounds.
        return float(
            np.clip(ndtri(np.clip(share, 1e-12, 1.0 - 1e-12)), -MAX_COORDINATE, MAX_COORDINATE)
        )
    return (value - 0.5 * (low + high)) / (0.25 * (high - low))


def std_of(parameter: Parameter, z: float, std_z: float) -> float:
    """Standard deviation of z in the unit of the parameter: half the distance between the values
    one deviation up and down.
    """
    return 0.5 * abs(value_of(parameter, z + std_z) - value_of(parameter, z - std_z))


def _is_scale(parameter: Parameter) -> bool:
    return parameter.low > 0.0 and parameter.high / parameter.low > OCTAVE


@dataclass(frozen=True)
class EffectTerm:
    """One effect as part of a hypothesis.

    Parameters
    ----------
    effect
        The effect of the catalogue.
    whole
        Values of its parameters that count something, for example the number of a hinge. All other
        parameters are fitted, and so are the shape of its law and its initial state.
    """

    effect: Effect
    whole: tuple[tuple[str, float], ...] = ()

    @property
    def free(self) -> tuple[Parameter, ...]:
        """The parameters that are fitted."""
        return (*self.sizes, *self.effect.shape, *self.effect.begins)

    @property
    def sizes(self) -> tuple[Parameter, ...]:
        """The free parameters that a diagnosis reports as the effect's own."""
        return tuple(parameter for parameter in self.effect.parameters if not parameter.whole)

    def present(self, z: Floats) -> PresentEffect:
        """The effect with the values at the coordinates z (p,) of its free parameters."""
        values = dict(self.whole) | {
            p.name: value_of(p, float(x)) for p, x in zip(self.free, z, strict=True)
        }
        parameters = (*self.effect.parameters, *self.effect.shape, *self.effect.begins)
        return PresentEffect(self.effect.id, tuple((p.name, values[p.name]) for p in parameters))


@dataclass(frozen=True)
class Parameterization:
    """The unknowns of one hypothesis: first the nuisance parameters of `space`, then the free
    parameters of each term in `choices`.
    """

    space: Prior[Any]
    choices: tuple[EffectTerm, ...] = ()

    @property
    def nuisances(self) -> int:
        return len(self.space.std)

    @property
    def size(self) -> int:
        return self.nuisances + sum(len(choice.free) for choice in self.choices)

    @property
    def same_as(self) -> list[str]:
        """For each effect parameter the equivalent nuisance parameter, empty where there is
        none.
        """
        return [
            choice.effect.same_as if parameter in choice.sizes else ""
            for choice in self.choices
            for parameter in choice.free
        ]

    def part(self, number: int) -> slice:
        """Which coordinates belong to one term."""
        begin = self.nuisances + sum(len(choice.free) for choice in self.choices[:number])
        return slice(begin, begin + len(self.choices[number].free))

    def supposed(self, x: Floats) -> Any:
        """Input of the simulator at the coordinates x (p,), of the simulator's own type (a
        `SimulatorInput`).
        """
        return self.add_effects(self.space.at(x[: self.nuisances]), x)

    def add_effects(self, at: SimulatorInput, x: Floats) -> Any:
        """The input of `supposed`, where that of the nuisance parameters in x (p,) is `at`: for
        many points that have these in common.
        """
        return at.with_effects(
            tuple(choice.present(x[self.part(i)]) for i, choice in enumerate(self.choices))
        )

    def with_terms(self, choices: Sequence[EffectTerm]) -> "Parameterization":
        """The same nuisance parameters with other effects."""
        return replace(self, choices=tuple(choices))
