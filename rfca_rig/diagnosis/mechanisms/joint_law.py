"""Measures the law in a joint as the recordings show it, in place of the effects of the catalogue
that a diagnosis states there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.inference.hypotheses import Hypothesis, ModelSelectionResult
from rfca_rig.diagnosis.inference.map_fit import GaussNewton
from rfca_rig.diagnosis.inference.parameterization import EffectTerm
from rfca_rig.diagnosis.mechanisms.nuisances import MechanismInput
from rfca_rig.diagnosis.mechanisms.prepared import PreparedMechanism
from rfca_rig.diagnosis.residual_force.law import CatalogueCurve, StatedLaw
from rfca_rig.diagnosis.residual_force.law_arguments import make_joint_argument
from rfca_rig.diagnosis.residual_force.measured_law import LawStart, measure_best_law
from rfca_rig.diagnosis.residual_force.stated_law import CURVE_POINTS
from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.mechanism.laws import QUANTITIES, compute_own_law
from rfca_rig.mechanism.load import Mechanism
from rfca_rig.mechanism.plant import Plant
from rfca_rig.model.effect import Effect
from rfca_rig.suggestions import suggestion

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class JointPlace:
    """Where a law is measured: the joint, and the quantities that are tried as its argument."""

    joint: int
    quantities: tuple[str, ...]


@dataclass(frozen=True)
class MeasuredJointLaw:
    """The law, and the mechanism with it: effects, nuisance parameters and the table at their
    posterior means.
    """

    stated: StatedLaw
    plant: Plant


def parse_place(place: str, mechanism: Mechanism) -> JointPlace:
    """Parse "JOINT", "JOINT.speed" or "JOINT.position". Raises BadInput where there is no such
    joint.
    """
    joint, _, quantity = place.rpartition(".")
    # The name of a joint may itself end with ".speed"; then the whole text is the joint.
    if place not in mechanism.joints and quantity in QUANTITIES and joint in mechanism.joints:
        return JointPlace(mechanism.joints.index(joint), (quantity,))
    if place in mechanism.joints:
        return JointPlace(mechanism.joints.index(place), QUANTITIES)
    known = [
        *mechanism.joints,
        *(f"{joint}.{quantity}" for joint in mechanism.joints for quantity in QUANTITIES),
    ]
    raise BadInput(
        f"--law {place}: no law can be measured there; name a joint, or one as "
        f"joint.speed; {suggestion(place, known)}"
    )


def measure_joint_law(
    problem: PreparedMechanism,
    found: ModelSelectionResult,
    hypothesis: Hypothesis,
    place: JointPlace,
) -> MeasuredJointLaw:
    """Measure the law in a joint beside the rest of a hypothesis. Its effects that are such a law
    there are left out.

    Parameters
    ----------
    problem
        What was diagnosed.
    found
        The result of the search.
    hypothesis
        What is stated; `found.nothing` where nothing is.
    place
        The joint and its arguments.

    Raises
    ------
    SimulationFailed
        Where the model has no answer without those effects, or with any law.
    """
    mechanism = problem.simulator.mechanism
    terms = hypothesis.fitted.coordinates.choices
    others = [_leave_out(term, mechanism, place) for term in terms]
    instead_of = tuple(
        term.effect.id for term, other in zip(terms, others, strict=True) if other is not term
    )
    reduced = {term.effect.id: term.effect for term in others if term is not None}
    simulator = replace(problem.simulator, effects={**problem.simulator.effects, **reduced})
    # The reduced effects replace the whole ones under the same ids.
    found = replace(found, dataset=replace(found.dataset, simulator=simulator))
    if instead_of:
        base = _fit_base(found, hypothesis, others)
    else:
        base = hypothesis
    plants = (
        problem.simulator.plant(_at_mean(hypothesis)),
        simulator.plant(base.fitted.coordinates.supposed(base.fitted.x)),
    )

    def curve(argument: str, u: Floats) -> Floats | None:
        """Law (k,) of the effects that are left out, as far as it is a function of the argument."""
        laws = [
            compute_own_law(plant, place.joint, argument.startswith("speed"), u) for plant in plants
        ]
        having, without = (np.zeros_like(u) if values is None else values for values in laws)
        if instead_of and np.any(having != without):
            return having - without
        return None

    usual = float(problem.usual.torque[place.joint])
    arguments = [
        make_joint_argument(mechanism, place.joint, quantity, usual)
        for quantity in place.quantities
    ]
    law = measure_best_law(
        found,
        arguments,
        base,
        LawStart(base.fitted.x, curve) if instead_of else None,
        renew_range=True,
    )
    u = np.linspace(*law.visited, CURVE_POINTS)
    drawn = curve(law.argument, u)
    stated = StatedLaw(
        law,
        instead_of,
        None if drawn is None else CatalogueCurve(" and ".join(instead_of), u, drawn),
    )
    return MeasuredJointLaw(stated, simulator.plant(_at_mean(law.hypothesis)))


def _at_mean(hypothesis: Hypothesis) -> MechanismInput:
    at: MechanismInput = hypothesis.fitted.coordinates.supposed(hypothesis.marginal.posterior.mean)
    return at


def _fit_base(
    search: ModelSelectionResult, hypothesis: Hypothesis, terms: Sequence[EffectTerm | None]
) -> Hypothesis:
    """The hypothesis with these terms in place of its own, fitted again from its posterior mean."""
    coordinates = hypothesis.fitted.coordinates
    mean = hypothesis.marginal.posterior.mean
    x = [mean[: coordinates.nuisances]]
    for number, (choice, term) in enumerate(zip(coordinates.choices, terms, strict=True)):
        if term is not None:
            # Only the coordinates of the parameters that remain.
            x.append(
                mean[coordinates.part(number)][
                    [parameter in term.free for parameter in choice.free]
                ]
            )
    optimizer = GaussNewton(search.dataset, search.likelihood)
    start = optimizer.at(
        coordinates.with_terms([term for term in terms if term is not None]), np.concatenate(x)
    )
    if start is None:
        raise SimulationFailed(
            "the model has no answer without the effects that a law takes the place of"
        )
    best = optimizer.converge(optimizer.refine(start))
    return Hypothesis(best.ids, best, optimizer.evaluate(best), 0.0)


def _leave_out(term: EffectTerm, mechanism: Mechanism, place: JointPlace) -> EffectTerm | None:
    """The term without its part in the joint.

    It is the term itself if it is no such law there, and None if nothing is left of it.
    """
    effect = term.effect
    if effect.law_of not in place.quantities:
        return term
    counted = dict(term.whole)
    # Such an effect acts in one joint only; joints count from 1 in effects.
    if "joint" in counted:
        if int(counted["joint"]) != place.joint + 1:
            return term
        return None
    name = _own_parameter(effect, mechanism, place.joint)
    if name is None:  # a law of the driven joints, of which this is none; or the only joint
        if len(mechanism.joints) > 1:
            return term
        return None
    rest = tuple(parameter for parameter in effect.parameters if parameter.name != name)
    if not any(
        _own_parameter(replace(effect, parameters=rest), mechanism, joint)
        for joint in range(len(mechanism.joints))
    ):
        return None
    return replace(
        term,
        effect=replace(
            effect,
            parameters=rest,
            apply=lambda plant, values: effect.apply(plant, {**values, name: 0.0}),
        ),
    )


def _own_parameter(effect: Effect, mechanism: Mechanism, joint: int) -> str | None:
    """Name of the size of the effect in this joint. Of several joint names that fit, the longest
    is the right one.
    """
    for parameter in effect.parameters:
        owners = [name for name in mechanism.joints if parameter.name.startswith(f"{name}_")]
        if owners and max(owners, key=len) == mechanism.joints[joint]:
            return parameter.name
    return None
