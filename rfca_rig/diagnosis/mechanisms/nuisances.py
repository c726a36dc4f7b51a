"""Nuisance parameters of a mechanism: the values of [known_to], of each body, joint and
actuator.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from rfca_rig.analysis.fitting.space import FitParameter, Prior, never_below
from rfca_rig.mechanism.load import Mechanism
from rfca_rig.mechanism.nuisances import COMMAND_NUISANCES, NUISANCES, SENSORS, find_groups
from rfca_rig.mechanism.plant import Plant
from rfca_rig.model.parameters import PresentEffect


@dataclass(frozen=True)
class MechanismInput:
    """Input of one simulation: shifts of nominal values by key and place, and the effects."""

    off: tuple[tuple[tuple[str, int], float], ...] = ()
    effects: tuple[PresentEffect, ...] = ()

    @property
    def rig(self) -> None:
        """None: no effect of a mechanism counts its size from a nominal value of the leg."""

    @property
    def unchanged(self) -> None:
        """None: changes of a mechanism's values are no effects."""

    def shift_value(self, key: str, place: int, by: float) -> Self:
        """The same with a nominal value shifted by `by` more."""
        now = dict(self.off)
        return replace(
            self, off=tuple({**now, (key, place): now.get((key, place), 0.0) + by}.items())
        )

    def with_effects(self, effects: tuple[PresentEffect, ...]) -> Self:
        """The same with these effects added."""
        return replace(self, effects=(*self.effects, *effects))

    def replace_effects(self, effects: tuple[PresentEffect, ...]) -> Self:
        """The same with these effects instead."""
        return replace(self, effects=effects)


def space_of_mechanism(
    mechanism: Mechanism, known_to: Mapping[str, float], is_driven: bool, sensors: Collection[str]
) -> Prior[MechanismInput]:
    """The space of the nuisance parameters around the nominal mechanism, of those that the
    recordings can show.

    Parameters
    ----------
    mechanism
        The mechanism.
    known_to
        Standard uncertainties by key.
    is_driven
        Whether any recording has commands.
    sensors
        Names of the sensors' values that were recorded.
    """
    parameters = []
    stds = []
    for key, std in known_to.items():
        if key in NUISANCES and (is_driven or key not in COMMAND_NUISANCES):
            objects = NUISANCES[key].objects
            for name, places in find_groups(mechanism, objects).items():
                if objects not in SENSORS or name in sensors:
                    parameters.append(_parameter(mechanism, key, name, places, std))
                    stds.append(std)
    return Prior(
        tuple(parameters), MechanismInput(), np.array(stds), np.ones(len(stds), dtype=bool)
    )


def _parameter(
    mechanism: Mechanism, key: str, name: str, places: tuple[int, ...], std: float
) -> FitParameter[MechanismInput]:
    kind = NUISANCES[key]
    shift = float if kind.nominal is None else never_below(kind.nominal(mechanism, places[0]), std)

    def read(at: MechanismInput) -> float:
        return dict(at.off).get((key, places[0]), 0.0)

    def write(at: MechanismInput, value: float) -> MechanismInput:
        # Places of one group share one parameter, for example links that are stated to be alike.
        group = [(key, place) for place in places]
        others = [pair for pair in at.off if pair[0] not in group]
        return replace(at, off=(*others, *((member, shift(value)) for member in group)))

    return FitParameter(f"{name}.{key}" if name else key, kind.unit, False, std, read, write)


def shift_plant(plant: Plant, at: MechanismInput) -> None:
    """Apply the shifts of nominal values to a plant, in place."""
    for (key, place), value in at.off:
        NUISANCES[key].shift(plant, place, value)
