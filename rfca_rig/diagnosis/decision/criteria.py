"""What a hypothesis must meet to be stated.

Its misfit on held-out conditions, its nuisance parameters, and its share of what is missing.
"""

from collections.abc import Sequence

from rfca_rig.diagnosis.config import (
    DOMINANT_SHARE,
    IDENTIFIED_PROBABILITY,
    IMPLAUSIBLE,
    MAX_COORDINATE,
    USUAL_MISFIT,
)
from rfca_rig.diagnosis.decision.comparison import Comparison, ScaledHypothesis
from rfca_rig.diagnosis.decision.decision import HELD_OUT, PLAUSIBLE, PROBABLE, Supported
from rfca_rig.diagnosis.result import Criterion


def list_criteria(
    hypothesis: ScaledHypothesis, supported: Sequence[Supported]
) -> tuple[Criterion, ...]:
    """What a hypothesis must meet to be identified; for the one without effects, to lack nothing.

    A law may fail in a few conditions, for example where a stop is reached. Where nothing is
    missing, no condition is predicted badly.
    """
    misfit = hypothesis.misfit if hypothesis.ids else hypothesis.misfit_of_all
    least = min((effect.probability for effect in supported), default=1.0)
    strained = describe_strain(hypothesis)
    needed = f"{IDENTIFIED_PROBABILITY:g} needed"
    at_most = f"{USUAL_MISFIT:g} at most"
    near = f"each within {IMPLAUSIBLE:g} prior standard deviations"
    probable = Criterion(
        PROBABLE,
        least >= IDENTIFIED_PROBABILITY,
        f"{least:.3f} that every effect is there, {needed}",
        needed,
    )
    return (
        *((probable,) if supported else ()),
        Criterion(
            HELD_OUT,
            misfit <= USUAL_MISFIT,
            f"{misfit:.2f} of what noise and a usual model error make, {at_most}",
            at_most,
        ),
        Criterion(
            PLAUSIBLE,
            not strained,
            strained or "all nuisance parameters are near their priors",
            near,
        ),
    )


def describe_strain(one: ScaledHypothesis) -> str:
    """Implausible nuisance parameters in words; empty where there are none."""
    names = one.hypothesis.fitted.coordinates.space.names
    x = one.hypothesis.fitted.x
    nuisances = zip(names, x, one.nuisance_shifts, strict=False)
    off = "prior standard deviations off"
    # At the bound the printed value is the fit's, not the one that the data ask for.
    return "; ".join(
        f"{name} {z:+.1f} {off}{', the bound of the fit' if abs(z) >= MAX_COORDINATE else ''}"
        for name, z, shift in nuisances
        if abs(shift) > IMPLAUSIBLE
    )


def describe_relief(comparison: Comparison, hypothesis: ScaledHypothesis) -> str:
    """Implausible nuisance parameters, in words, that a hypothesis replaces; empty where there are
    none, or it explains DOMINANT_SHARE.

    The model without effects needs them to predict what it does, and the hypothesis, which needs
    none, predicts as usual or as well, in no quantity worse. All nuisance parameters together move
    closer to their priors by as much as a value at the limit is away.
    """
    if comparison.explained_share(hypothesis) >= DOMINANT_SHARE or describe_strain(hypothesis):
        return ""
    # A value that moves from just beyond the limit to just within it is not replaced.
    relieved = comparison.nothing.sum_of_squared_shifts - hypothesis.sum_of_squared_shifts
    if relieved < IMPLAUSIBLE**2:
        return ""
    if hypothesis.misfit_of_all > max(USUAL_MISFIT, comparison.nothing.misfit_of_all):
        return ""
    if comparison.predicts_a_quantity_worse(hypothesis):
        return ""
    return describe_strain(comparison.nothing)


def is_dominant(comparison: Comparison, hypothesis: ScaledHypothesis) -> bool:
    """Whether a hypothesis explains most of what is missing, or replaces an implausible value
    that explains all of it.
    """
    return comparison.explained_share(hypothesis) >= DOMINANT_SHARE or bool(
        describe_relief(comparison, hypothesis)
    )


def is_worse(comparison: Comparison, hypothesis: ScaledHypothesis) -> bool:
    """Whether a hypothesis predicts held-out conditions worse than the model without effects, in
    sum or in a quantity.

    A quantity that is predicted worse shows that the law is wrong, which says nothing against its
    family.
    """
    return comparison.predicts_worse(hypothesis) or comparison.predicts_a_quantity_worse(hypothesis)
