"""What every hypothesis about a mechanism may move: the values of [known_to], of each body, joint and actuator."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from rfca_rig.analysis.fitting.space import Parameter, Space, never_below
from rfca_rig.mechanism.load import Mechanism
from rfca_rig.mechanism.nuisances import NUISANCES, OF_COMMANDS, SENSORS, places_of
from rfca_rig.mechanism.plant import Plant
from rfca_rig.model.parameters import PresentEffect


@dataclass(frozen=True)
class MechanismInput:
    """What one simulation supposes: by how much nominal values are off, by key and place, and the effects."""

    off: tuple[tuple[tuple[str, int], float], ...] = ()
    effects: tuple[PresentEffect, ...] = ()

    @property
    def rig(self) -> None:
        """None: no effect of a mechanism counts its size from a value of the leg."""

    def with_effects(self, effects: tuple[PresentEffect, ...]) -> Self:
        """The same with these effects beside those that are there."""
        return replace(self, effects=(*self.effects, *effects))


def space_of_mechanism(
    mechanism: Mechanism, known_to: Mapping[str, float], is_driven: bool, sensors: Collection[str]
) -> Space[MechanismInput]:
    """The space of the nuisance parameters around the nominal mechanism, of those that the recordings can show.

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
    parameters, stds = [], []
    for key, std in known_to.items():
        if key in NUISANCES and (is_driven or key not in OF_COMMANDS):
            objects = NUISANCES[key].objects
            for name, place in places_of(mechanism, objects).items():
                if objects not in SENSORS or name in sensors:
                    parameters.append(_parameter(mechanism, key, name, place, std))
                    stds.append(std)
    return Space(tuple(parameters), MechanismInput(), np.array(stds), np.ones(len(stds), dtype=bool))


def _parameter(mechanism: Mechanism, key: str, name: str, place: int, std: float) -> Parameter[MechanismInput]:
    kind = NUISANCES[key]
    shift = float if kind.nominal is None else never_below(kind.nominal(mechanism, place), std)

    def read(at: MechanismInput) -> float:
        return dict(at.off).get((key, place), 0.0)

    def write(at: MechanismInput, value: float) -> MechanismInput:
        return replace(at, off=(*(pair for pair in at.off if pair[0] != (key, place)), ((key, place), shift(value))))

    return Parameter(f"{name}.{key}" if name else key, kind.unit, False, std, read, write)


def shift_plant(plant: Plant, at: MechanismInput) -> None:
    """Puts the nuisance parameters into a plant."""
    for (key, place), value in at.off:
        NUISANCES[key].shift(plant, place, value)
