"""Hypotheses (sets of effects) that a search leaves, each with its log evidence and prior
probability.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from rfca_rig.diagnosis.config import (
    IMPLAUSIBLE,
    PRIOR_FOUR,
    PRIOR_NOTHING,
    PRIOR_ONE,
    PRIOR_THREE,
    PRIOR_TWO,
)
from rfca_rig.diagnosis.inference.map_fit import GaussNewton, MapFit
from rfca_rig.diagnosis.inference.screening import EffectProbe, terms_of
from rfca_rig.diagnosis.likelihood.covariance import RepeatScatter
from rfca_rig.diagnosis.likelihood.marginal_likelihood import MarginalLikelihood, MarginalPosterior
from rfca_rig.diagnosis.simulator import Dataset

Floats = NDArray[np.float64]

# Stages of a search, as they are shown. Those after the single effects need not be complete for a
# statement.
EACH_EFFECT = "each effect"
PAIRS = "pairs of effects"
TRIPLES = "three effects"
WEIGHING = "weighing"
STAGES_AFTER_SINGLES = (PAIRS, TRIPLES, WEIGHING)


def log_prior_of_set(size: int, candidates: int) -> float:
    """Log prior of one set of `size` effects out of `candidates`: the prior of that size, spread
    evenly over all sets of the size.

    The spread is the correction for multiplicity: the more candidates there are, the less probable
    each is.

    Raises
    ------
    KeyError
        For more than four effects.
    """
    share = {0: PRIOR_NOTHING, 1: PRIOR_ONE, 2: PRIOR_TWO, 3: PRIOR_THREE, 4: PRIOR_FOUR}[size]
    # With fewer candidates than the size there is no such set; the maximum only avoids a division
    # by zero.
    return float(np.log(share / max(comb(candidates, size), 1)))


@dataclass(frozen=True)
class Hypothesis:
    """One set of effects at its best fit, with its evidence.

    Parameters
    ----------
    ids
        The ids of its effects; none for "nothing missing".
    fitted
        Where it fits best.
    marginal
        How well it fits.
    log_prior
        Log prior probability.
    log_beyond
        Log evidence lost where a nuisance parameter had to leave its plausible range. It is
        subtracted from `marginal` already.
    """

    ids: tuple[str, ...]
    fitted: MapFit
    marginal: MarginalPosterior
    log_prior: float
    log_beyond: float = 0.0

    @property
    def log_joint(self) -> float:
        """Log of prior times evidence."""
        return self.marginal.log_evidence + self.log_prior

    @property
    def rows(self) -> Floats:
        """Predicted rows (m,) at the posterior mean, by the linear model around the fit."""
        return self.fitted.predicted + self.fitted.jacobian @ (
            self.marginal.posterior.mean - self.fitted.x
        )


@dataclass(frozen=True)
class ModelSelectionResult:
    """Result of a search.

    Parameters
    ----------
    nominal
        The model at the prior means.
    nothing
        The hypothesis without effects.
    unknown
        Its marginal likelihood with something unlisted beside it.
    named
        The hypotheses with effects, most probable first.
    probes
        The effects on a grid beside the nominal model, on a subset of the conditions.
    coarse, in_coarse
        The likelihood of that subset, and which rows it has, (m,).
    scatter
        Scatter from repeat to repeat.
    likelihood, dataset
        Those of all conditions.
    ended_in
        The stage of the search in which its time was up; "" where it went to its end.
    """

    nominal: MapFit
    nothing: Hypothesis
    unknown: MarginalPosterior
    named: tuple[Hypothesis, ...]
    probes: tuple[EffectProbe, ...]
    coarse: MarginalLikelihood
    in_coarse: NDArray[np.bool_]
    scatter: RepeatScatter
    likelihood: MarginalLikelihood
    dataset: Dataset
    ended_in: str = ""

    @property
    def tried_each_effect(self) -> bool:
        """Whether there was time to fit every single effect that is worth it."""
        return self.ended_in in ("", *STAGES_AFTER_SINGLES)

    @property
    def floor_std(self) -> Floats:
        """Standard deviation (m,) of what noise and scatter leave of each row."""
        return np.asarray(
            np.sqrt(self.dataset.rows.noise**2 + (self.scatter.columns**2).sum(axis=1))
        )


def weigh_models(
    optimizer: GaussNewton, base: MapFit, fits: Sequence[MapFit], effects: int
) -> tuple[Hypothesis, tuple[Hypothesis, ...]]:
    """The hypotheses of a search with their log evidence and prior.

    Parameters
    ----------
    optimizer
        Evaluates the evidence of a fit.
    base
        The fit without effects.
    fits
        The fits with effects.
    effects
        Number of effects that were searched: the prior is spread over their sets.

    Returns
    -------
    Hypothesis, tuple
        The one without effects, and those with effects, most probable first.
    """
    nothing = Hypothesis((), base, optimizer.evaluate(base), float(np.log(PRIOR_NOTHING)))
    named = [
        Hypothesis(fitted.ids, fitted, optimizer.evaluate(fitted), _log_prior(fitted, effects))
        for fitted in fits
    ]
    plausible = [_prefer_plausible(hypothesis, named) for hypothesis in named]
    return _prefer_plausible(nothing, named), tuple(
        sorted(plausible, key=lambda hypothesis: -hypothesis.log_joint)
    )


def _prefer_plausible(hypothesis: Hypothesis, named: Sequence[Hypothesis]) -> Hypothesis:
    """The hypothesis without the evidence that rests on an implausible value of a nuisance
    parameter.

    This applies where one of `named` explains the same by an effect. The prior of a nuisance
    parameter is truncated where it is implausible, and the share of the posterior that lies within
    remains as evidence. Six times the nominal damping is no uncertainty of the hinges, but an
    effect of its own. See "Truncated priors" in section 3 of docs/method.md.
    """
    implausible = max((_log_beyond(hypothesis, wider) for wider in named), default=0.0)
    marginal = hypothesis.marginal
    return replace(
        hypothesis,
        marginal=replace(marginal, log_evidence=marginal.log_evidence - implausible),
        log_beyond=implausible,
    )


def _log_beyond(hypothesis: Hypothesis, wider: Hypothesis) -> float:
    """Minus the log of the plausible share of the posterior of one nuisance parameter.

    It is the one that the additional effect of `wider` is equivalent to.
    """
    equivalent = [
        choice.effect.same_as
        for choice in wider.fitted.coordinates.choices
        if choice.effect.id not in hypothesis.ids
    ]
    names = hypothesis.fitted.coordinates.space.names
    posterior = hypothesis.marginal.posterior
    # Only a set with exactly one effect equivalent counts, and only if that effect does the same as
    # a nuisance parameter.
    is_wider = (
        set(hypothesis.ids) < set(wider.ids) and len(equivalent) == 1 and equivalent[0] in names
    )
    if (
        not is_wider
        or wider.marginal.max_nuisance_shift(wider.fitted.coordinates.nuisances) > IMPLAUSIBLE
    ):
        return 0.0
    index = names.index(equivalent[0])
    std = float(np.sqrt(posterior.covariance[index, index]))
    # -log Phi((IMPLAUSIBLE - |m|) / sigma), m and sigma of the posterior in standard normal
    # coordinates.
    return -float(log_ndtr((IMPLAUSIBLE - abs(posterior.mean[index])) / std))


def _log_prior(fitted: MapFit, effects: int) -> float:
    """Log prior of a set of effects. The variants of an effect, for example one per hinge, share
    its prior evenly.
    """
    choices = fitted.coordinates.choices
    variants = np.prod([len(terms_of(choice.effect)) for choice in choices])
    return log_prior_of_set(len(choices), effects) - float(np.log(variants))
