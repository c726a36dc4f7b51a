"""What the model lacks in the reference already, as a part of the model of both recordings.

The model's error cancels where motions match, but only as far as the error of the change is small:
a heavier arm moves otherwise with friction than without, and a fit without friction makes the arm
heavier than it is. Where a motion has no match, nothing cancels. As far as effects explain the
error in the reference, it is no error any more: their sizes become nuisance parameters, which the
reference knows and the recordings share.
"""

from collections.abc import Collection
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.space import FitParameter, Prior
from rfca_rig.diagnosis.config import FEWEST_CONDITIONS
from rfca_rig.diagnosis.decision.decide import decide
from rfca_rig.diagnosis.decision.decision import STATED_GRADES
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis
from rfca_rig.diagnosis.inference.model_selection import Progress, search_models
from rfca_rig.diagnosis.inference.parameterization import (
    EffectTerm,
    Parameterization,
    coordinate_of,
    value_of,
)
from rfca_rig.diagnosis.problem import RecordingPair
from rfca_rig.diagnosis.reference.matching import find_matches
from rfca_rig.model.effect import Parameter

Floats = NDArray[np.float64]


def has_matches(pair: RecordingPair) -> bool:
    """Whether enough conditions for a verdict have a match in the reference."""
    matched = 0
    for part in pair.new.parts:
        if find_matches(part.rows(), pair.reference.rows, pair.name_commands):
            matched += 1
    return matched >= FEWEST_CONDITIONS


def find_omission(
    pair: RecordingPair, without: Collection[str], progress: Progress
) -> Hypothesis | None:
    """What the model lacks in the reference; None where nothing can be stated there.

    Raises SimulationFailed where the nominal model cannot be simulated.
    """
    if len(pair.reference.parts) < FEWEST_CONDITIONS:
        return None
    effects = [effect for effect in pair.effects if effect.id not in without]
    found = search_models(
        pair.reference, Parameterization(pair.space), effects, progress, pair.config
    )
    decision = decide(found)
    if decision.grade in STATED_GRADES:
        return decision.explanation
    return None


def add_omission(pair: RecordingPair, omission: Hypothesis) -> RecordingPair:
    """The pair with the effects of a hypothesis in the model of both recordings, their sizes among
    the nuisance parameters.
    """
    space = pair.space
    coordinates = omission.fitted.coordinates
    for number, term in enumerate(coordinates.choices):
        space = _add_term(space, term, omission.fitted.x[coordinates.part(number)])
    return replace(pair, space=space)


def _add_term(space: Prior[Any], term: EffectTerm, z: Floats) -> Prior[Any]:
    """The space with the coordinates of an effect, which are z (p,) at its centre."""
    parameters = [_make_parameter(term, parameter) for parameter in term.free]
    present = term.present(z)
    return replace(
        space,
        parameters=(*space.parameters, *parameters),
        centre=space.centre.with_effects((present,)),
        std=np.append(space.std, np.ones(len(parameters))),
        has_prior=np.append(space.has_prior, np.zeros(len(parameters), dtype=bool)),
    )


def _make_parameter(term: EffectTerm, parameter: Parameter) -> FitParameter[Any]:
    """One coordinate of an effect that is in the input of every simulation."""
    effect_id = term.effect.id

    def read(at: Any) -> float:
        first = next(effect for effect in at.effects if effect.id == effect_id)
        return coordinate_of(parameter, dict(first.values)[parameter.name])

    def write(at: Any, coordinate: float) -> Any:
        effects = list(at.effects)
        number = next(k for k, effect in enumerate(effects) if effect.id == effect_id)
        values = dict(effects[number].values) | {parameter.name: value_of(parameter, coordinate)}
        effects[number] = replace(effects[number], values=tuple(values.items()))
        return at.replace_effects(tuple(effects))

    return FitParameter(
        name=f"{effect_id}.{parameter.name}",
        unit="prior deviations",
        relative=False,
        spread=1.0,
        read=read,
        write=write,
    )
