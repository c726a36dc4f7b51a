"""The hypotheses that a search leaves, each with its evidence and prior probability."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from rfca_rig.diagnosis.config import IMPLAUSIBLE, PRIOR_NOTHING, PRIOR_ONE, PRIOR_THREE, PRIOR_TWO
from rfca_rig.diagnosis.data.dataset import Dataset
from rfca_rig.diagnosis.inference.map_fit import GaussNewton, MapFit
from rfca_rig.diagnosis.inference.screening import EffectProbe, terms_of
from rfca_rig.diagnosis.likelihood.marginal_likelihood import MarginalLikelihood, MarginalPosterior
from rfca_rig.diagnosis.likelihood.repeat_scatter import Scatter

Floats = NDArray[np.float64]


def log_prior_of_set(size: int, candidates: int) -> float:
    """Log prior of one set of so many effects: each size has its share, spread evenly over the sets of that size.

    Raises
    ------
    KeyError
        For more than three effects.
    """
    share = {0: PRIOR_NOTHING, 1: PRIOR_ONE, 2: PRIOR_TWO, 3: PRIOR_THREE}[size]
    return float(np.log(share / max(comb(candidates, size), 1)))


@dataclass(frozen=True)
class Hypothesis:
    """One answer: the ids of its effects, none for nothing missing; where it fits best, how well, and log prior probability.

    `log_beyond` is what the evidence loses where a nuisance parameter had to leave what is plausible; it is taken off already.
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
        """What it says of every row, at its posterior mean."""
        return self.fitted.predicted + self.fitted.jacobian @ (self.marginal.posterior.mean - self.fitted.x)


@dataclass(frozen=True)
class ModelSelectionResult:
    """What a search leaves.

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
        What differs from repeat to repeat.
    likelihood, dataset
        Those of all conditions.
    """

    nominal: MapFit
    nothing: Hypothesis
    unknown: MarginalPosterior
    named: tuple[Hypothesis, ...]
    probes: tuple[EffectProbe, ...]
    coarse: MarginalLikelihood
    in_coarse: NDArray[np.bool_]
    scatter: Scatter
    likelihood: MarginalLikelihood
    dataset: Dataset


def weigh_models(optimizer: GaussNewton, base: MapFit, fits: Sequence[MapFit], effects: int) -> tuple[Hypothesis, tuple[Hypothesis, ...]]:
    """Nothing missing, and the fits that name something, most plausible first, of a catalogue with so many `effects`."""
    nothing = Hypothesis((), base, optimizer.evaluate(base), float(np.log(PRIOR_NOTHING)))
    named = [Hypothesis(fitted.ids, fitted, optimizer.evaluate(fitted), _log_prior(fitted, effects)) for fitted in fits]
    plausible = [_prefer_plausible(hypothesis, named) for hypothesis in named]
    return _prefer_plausible(nothing, named), tuple(sorted(plausible, key=lambda hypothesis: -hypothesis.log_joint))


def _prefer_plausible(hypothesis: Hypothesis, named: Sequence[Hypothesis]) -> Hypothesis:
    """The hypothesis without what only a value explains that nobody believes, where one of `named` says the very same by an effect.

    The prior of a nominal value ends where it is implausible; what is left of the evidence is the share of the posterior within. Six
    times the nominal damping is not well-known hinges, but more damping than believed.
    """
    implausible = max((_log_beyond(hypothesis, wider) for wider in named), default=0.0)
    marginal = hypothesis.marginal
    return replace(hypothesis, marginal=replace(marginal, log_evidence=marginal.log_evidence - implausible), log_beyond=implausible)


def _log_beyond(hypothesis: Hypothesis, wider: Hypothesis) -> float:
    """Minus the log of the share of the posterior that is plausible, of the nominal value that the wider one's other effect stands for."""
    more = [choice.effect.same_as for choice in wider.fitted.coordinates.choices if choice.effect.id not in hypothesis.ids]
    names, posterior = hypothesis.fitted.coordinates.space.names, hypothesis.marginal.posterior
    is_wider = set(hypothesis.ids) < set(wider.ids) and len(more) == 1 and more[0] in names
    if not is_wider or wider.marginal.farthest(wider.fitted.coordinates.nuisances) > IMPLAUSIBLE:
        return 0.0
    place = names.index(more[0])
    std = float(np.sqrt(posterior.covariance[place, place]))
    return -float(log_ndtr((IMPLAUSIBLE - abs(posterior.mean[place])) / std))


def _log_prior(fitted: MapFit, effects: int) -> float:
    """Each number of effects has its share, spread evenly; so is what an effect counts, as which hinge."""
    choices = fitted.coordinates.choices
    variants = np.prod([len(terms_of(choice.effect)) for choice in choices])
    return log_prior_of_set(len(choices), effects) - float(np.log(variants))
