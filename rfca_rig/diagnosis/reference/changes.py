"""Changes of nominal values as effects beside a reference.

The reference knows a value far better than [known_to] does. Where it has changed since then, its
prior no longer holds: the change is an effect of its own, with a size.
"""

from collections.abc import Collection
from typing import Any

import numpy as np

from rfca_rig.analysis.fitting.space import FitParameter
from rfca_rig.diagnosis.problem import RecordingPair
from rfca_rig.model.declarations.changes import CHANGES
from rfca_rig.model.effect import Effect, Parameter

# Plausible range of a change in spreads of the value, by which it may be off where nothing is
# known of it. With it, the prior of a shift has a standard deviation of two spreads.
CHANGE_IN_SPREADS = 4.0


def add_changes(pair: RecordingPair, without: Collection[str]) -> tuple[Effect, ...]:
    """The effects of a pair, and the changes of those nominal values that are the same on all days
    and that a change can be told of, but those of the ids `without`.

    An effect that acts exactly as a change of a value does states it where it has both signs;
    otherwise the change takes its place.
    """
    candidates = {parameter.name: parameter for parameter in list_changed_values(pair)}
    kept = []
    for effect in pair.effects:
        if effect.same_as not in candidates:
            kept.append(effect)
        elif effect.parameters[0].low < 0.0:
            kept.append(effect)
            del candidates[effect.same_as]
    changes = (make_change(parameter) for parameter in candidates.values())
    return (*kept, *(change for change in changes if change.id not in without))


def list_changed_values(pair: RecordingPair) -> list[FitParameter[Any]]:
    """The nominal values that are the same on all days, and that a change can be told of."""
    return [
        parameter
        for parameter in pair.space.parameters
        if parameter.name in CHANGES and parameter.name not in pair.free
    ]


def make_change(parameter: FitParameter[Any]) -> Effect:
    """The change of one value: a factor where it is relative, else a difference in its unit."""
    spread = CHANGE_IN_SPREADS * parameter.spread
    if parameter.relative:
        size = Parameter("factor", float(np.exp(-spread)), float(np.exp(spread)), may_be_zero=False)
    else:
        name = "_".join(filter(None, ("change", parameter.unit)))
        size = Parameter(name, -spread, spread)
    return CHANGES[parameter.name].make_effect((size,), _apply_to_setup)


def _apply_to_setup(setup: Any, values: object) -> Any:  # noqa: ARG001
    """Never called: the input of a simulator changes its own values, before there is a setup."""
    raise TypeError("a change of a value is made in the input of the simulator")
