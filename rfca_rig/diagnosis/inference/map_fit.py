"""The best point of one hypothesis: damped Gauss-Newton, its slopes renewed only as far as they change.

A hypothesis far from the data is fitted under a wide model error, which shrinks as the fit improves: otherwise rows that no value could
explain would drive the nuisances to the ends of their priors.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from rfca_rig.diagnosis.config import (
    ALIKE,
    CONVERGED,
    FARTHEST,
    GOOD_ENOUGH,
    LEVELS,
    NARROWEST,
    POLISHED,
    ROUGH,
    ROUNDS,
    SHORTER,
    SLOPES_ERR,
    STEP,
    WELL_SEEN,
    WIDEST,
)
from rfca_rig.diagnosis.data.dataset import Dataset
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.likelihood.covariance import AtError, Whitening
from rfca_rig.diagnosis.likelihood.laplace import LinearModel, laplace_posterior, laplace_posteriors
from rfca_rig.diagnosis.likelihood.marginal_likelihood import MarginalLikelihood, MarginalPosterior, make_marginal_likelihood

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MapFit:
    """A hypothesis at its best point: x (p,), the model's rows there (m,), its slope (m, p), and about how many deviations long each
    column of that is, `size` (p,). Equal to none but itself.
    """

    coordinates: Parameterization
    x: Floats
    predicted: Floats
    jacobian: Floats
    size: Floats

    @property
    def ids(self) -> tuple[str, ...]:
        """The ids of its effects."""
        return tuple(term.effect.id for term in self.coordinates.choices)

    @property
    def farthest(self) -> float:
        """How many prior deviations off the nuisance stands that is farthest from where it is believed."""
        return float(np.abs(self.x[: self.coordinates.nuisances]).max(initial=0.0))

    @property
    def at_prior_means(self) -> Floats:
        """x with its effects as they stand and its nuisances as believed, (p,)."""
        nuisances = self.coordinates.nuisances
        return np.concatenate([np.zeros(nuisances), self.x[nuisances:]])

    def linear(self, measured: Floats) -> LinearModel:
        """The hypothesis as a linear model."""
        return LinearModel(measured - self.predicted + self.jacobian @ self.x, self.jacobian)


@dataclass(frozen=True)
class GaussNewton:
    """The optimiser of one dataset: damped Gauss-Newton steps, results remembered."""

    dataset: Dataset
    likelihood: MarginalLikelihood
    _free: WeakKeyDictionary[MapFit, float] = field(default_factory=WeakKeyDictionary, init=False, repr=False, compare=False)
    _marginals: WeakKeyDictionary[MapFit, MarginalPosterior] = field(
        default_factory=WeakKeyDictionary, init=False, repr=False, compare=False
    )

    def at(self, coordinates: Parameterization, x: Floats, known_slope: Floats | None = None) -> MapFit | None:
        """The hypothesis at x; None where the model has no answer. The first slopes are taken over from `known_slope`."""
        predicted = self.dataset.predicted(coordinates.supposed(x))
        if predicted is None:
            return None
        left = np.empty((len(predicted), 0)) if known_slope is None else known_slope
        columns = self._columns(coordinates, x, predicted, dict.fromkeys(range(left.shape[1], coordinates.size), STEP))
        return self._fitted(coordinates, x, predicted, np.column_stack([left, *columns]))

    def _fitted(self, coordinates: Parameterization, x: Floats, predicted: Floats, jacobian: Floats) -> MapFit:
        size = np.linalg.norm(self.likelihood.usual(jacobian), axis=0)
        return MapFit(coordinates, x, predicted, self._aligned(coordinates, jacobian), size)

    def without(self, found: MapFit, number: int) -> MapFit | None:
        """The fit less one of its effects, all else where it stands; None where the model has no answer."""
        coordinates = found.coordinates
        kept = [term for i, term in enumerate(coordinates.choices) if i != number]
        drop = np.arange(coordinates.size)[coordinates.part(number)]
        return self.at(coordinates.with_terms(kept), np.delete(found.x, drop), np.delete(found.jacobian, drop, axis=1))

    def refine(self, start: MapFit, levels: int = LEVELS, rounds: int = ROUNDS) -> MapFit:
        """From `start` down until nothing more is gained, at one model error after the other."""
        here, last = start, np.inf
        for _ in range(levels):
            whitening = self.likelihood.level(here.linear(self.dataset.rows.measured))
            if whitening.s == last:
                break
            here, last = self._descend(here, whitening, rounds), whitening.s
        return here

    def converge(self, found: MapFit, rounds: int = POLISHED) -> MapFit:
        """All slopes anew at the point found, and down once more, until that no longer helps."""
        here = found
        for _ in range(rounds):
            before, here = here, self.refine(self._with_new_slopes(here))
            whitening = self.likelihood.level(here.linear(self.dataset.rows.measured))
            if self.misfit(before.x, before.predicted, whitening) - self.misfit(here.x, here.predicted, whitening) < CONVERGED:
                break
        return here

    def _with_new_slopes(self, here: MapFit) -> MapFit:
        columns = self._columns(here.coordinates, here.x, here.predicted, dict(enumerate(_widths(here.size))))
        none = np.empty((len(here.predicted), 0))  # a hypothesis without unknowns has no column
        return self._fitted(here.coordinates, here.x, here.predicted, np.column_stack([none, *columns]))

    def _descend(self, here: MapFit, whitening: AtError, rounds: int) -> MapFit:
        """Steps towards the goal of the linear model, shorter after each that did not help; those teach the slopes, too."""
        share = 1.0
        for _ in range(rounds):
            goal = _goal(here.linear(self.dataset.rows.measured), whitening)
            before = self.misfit(here.x, here.predicted, whitening)
            if before - self.misfit(goal, here.predicted + here.jacobian @ (goal - here.x), whitening) < GOOD_ENOUGH:
                return here
            x = here.x + share * (goal - here.x)
            predicted = self.dataset.predicted(here.coordinates.supposed(x))
            gained = -np.inf if predicted is None else before - self.misfit(x, predicted, whitening)
            if predicted is not None:
                here = self._update_by_secant(here, x, predicted) if gained <= 0.0 else self._refresh_jacobian(here, x, predicted)
            if 0.0 < gained < GOOD_ENOUGH:
                return here
            share = min(1.0, 2.0 * share) if gained > 0.0 else SHORTER * share
        return here

    def evaluate(self, found: MapFit) -> MarginalPosterior:
        """How likely the recordings are with the hypothesis as it stands; what only its slopes promise, and no step found, does not count.

        A slope across a kink, as of a stop that no hinge reaches, promises much.
        """
        if (known := self._marginals.get(found)) is None:
            known = self._marginals[found] = self._integrate(found)
        return known

    def _integrate(self, found: MapFit) -> MarginalPosterior:
        linear = found.linear(self.dataset.rows.measured)
        marginal = self.likelihood.evaluate(linear)
        missing = missing_promise(found, self.dataset.rows.measured, marginal.posterior.mean, marginal.whitening)
        return replace(marginal, log_evidence=marginal.log_evidence - missing)

    def evaluate_unlisted(self, found: MapFit) -> MarginalPosterior:
        """How likely they are with something unlisted beside the hypothesis."""
        return self.likelihood.evaluate_unknown(found.linear(self.dataset.rows.measured))

    def log_evidence(self, found: MapFit) -> float:
        """The log evidence of `evaluate`."""
        return self.evaluate(found).log_evidence

    def free_log_evidence(self, found: MapFit) -> float:
        """Log evidence with the discrepancy scale free over the whole grid, log-uniform; remembered."""
        if (known := self._free.get(found)) is None:
            known = self._free[found] = float(logsumexp(self.log_evidence_by_scale(found)))
        return known

    def log_evidence_by_scale(self, found: MapFit) -> Floats:
        """Log evidence at each discrepancy scale of the grid, (k,)."""
        return log_evidence_by_scale(found, self.dataset.rows.measured, self.likelihood.every_scale)

    def misfit(self, x: Floats, predicted: Floats, whitening: Whitening) -> float:
        """Minus the log posterior density at x, but for a constant."""
        return _misfit(self.dataset.rows.measured - predicted, x, whitening)

    def _update_by_secant(self, here: MapFit, x: Floats, predicted: Floats) -> MapFit:
        """Slopes that agree better with what the model said at x, each changed in proportion to how wrong it may be.

        As a Kalman filter has it, with slopes known to SLOPES_ERR of their size and a model as rough as ROUGH.
        """
        step = x - here.x
        surprise = predicted - here.predicted - here.jacobian @ step
        wrong = step * (SLOPES_ERR * here.size) ** 2
        jacobian = here.jacobian + np.outer(surprise, wrong / (float(step @ wrong) + ROUGH**2))
        return replace(here, jacobian=self._aligned(here.coordinates, jacobian))

    def _refresh_jacobian(self, here: MapFit, x: Floats, predicted: Floats) -> MapFit:
        """At x, all slopes updated, those of the effects' parameters by differences."""
        jacobian = self._update_by_secant(here, x, predicted).jacobian
        of_effects = dict(list(enumerate(_widths(here.size)))[here.coordinates.nuisances :])
        for i, column in zip(of_effects, self._columns(here.coordinates, x, predicted, of_effects), strict=True):
            jacobian[:, i] = column
        return replace(here, x=x, predicted=predicted, jacobian=self._aligned(here.coordinates, jacobian))

    def _aligned(self, coordinates: Parameterization, jacobian: Floats) -> Floats:
        """Nuisances that do the same as an effect, as a rack's height, or all but the same, made to do just that.

        Their slopes are differences over other steps; the data must not seem to tell apart what only the prior does.
        """
        size = jacobian / self.dataset.rows.noise[:, None]
        norm = np.maximum(np.linalg.norm(size, axis=0), 1e-150)  # the product of two does not underflow
        same = coordinates.same_as
        effects = range(coordinates.nuisances, coordinates.size)
        for nuisance, name in enumerate(coordinates.space.names):
            alike = {effect: float(size[:, effect] @ size[:, nuisance]) / (norm[effect] * norm[nuisance]) for effect in effects}
            tied = [effect for effect in effects if same[effect - coordinates.nuisances] == name]
            effect = max(tied or effects, key=lambda one: abs(alike[one]), default=None)
            if effect is not None and (tied or abs(alike[effect]) > ALIKE):
                jacobian[:, nuisance] = jacobian[:, effect] * alike[effect] * norm[nuisance] / norm[effect]
        return jacobian

    def _columns(self, coordinates: Parameterization, x: Floats, predicted: Floats, widths: Mapping[int, float]) -> list[Floats]:
        """The slopes of these unknowns by differences of these widths, towards the middle of the prior; away from it where the model has
        no answer there, and zero where it has none on either side.
        """
        inwards = {i: -width if x[i] > 0.0 else width for i, width in widths.items()}
        found = self._moved(coordinates, x, inwards)
        outwards = {i: -step for i, step in inwards.items() if found[i] is None}
        found, steps = found | self._moved(coordinates, x, outwards), inwards | outwards
        return [np.zeros(len(predicted)) if (rows := found[i]) is None else (rows - predicted) / steps[i] for i in widths]

    def _moved(self, coordinates: Parameterization, x: Floats, steps: Mapping[int, float]) -> dict[int, Floats | None]:
        """The model's rows a step away from x, by the unknown that is moved."""
        places = [coordinates.supposed(np.where(np.arange(len(x)) == i, x + step, x)) for i, step in steps.items()]
        return dict(zip(steps, self.dataset.predicted_all(places), strict=True))


def log_evidence_by_scale(found: MapFit, measured: Floats, whitenings: Sequence[AtError]) -> Floats:
    """Log evidence of a fit under each of these covariances, (k,)."""
    posteriors = laplace_posteriors(found.linear(measured), whitenings)
    pairs = zip(whitenings, posteriors, strict=True)
    return np.array([p.log_evidence - missing_promise(found, measured, p.mean, whitening) for whitening, p in pairs])


def missing_promise(found: MapFit, measured: Floats, mean: Floats, whitening: Whitening) -> float:
    """The log posterior density that only the Jacobian promises at `mean` (p,): a Jacobian across a kink promises much.

    No step of the fit found it, so it does not count as evidence.
    """
    promised = _misfit(measured - found.predicted - found.jacobian @ (mean - found.x), mean, whitening)
    return max(_misfit(measured - found.predicted, found.x, whitening) - promised, 0.0)


def _misfit(residual: Floats, x: Floats, whitening: Whitening) -> float:
    white = whitening(residual)
    return 0.5 * float(white @ white + x @ x)


def without_scatter(dataset: Dataset) -> GaussNewton:
    """The optimiser while nothing is known of what differs from repeat to repeat: that counts as discrepancy."""
    return GaussNewton(dataset, make_marginal_likelihood(dataset.rows, np.empty((len(dataset.rows.measured), 0))))


def _widths(size: Floats) -> Floats:
    """Differences that stand well above the roughness of the model, and are no wider than that takes."""
    return np.asarray(np.clip(WELL_SEEN / np.maximum(size, 1e-300), NARROWEST, WIDEST))


def _goal(linear: LinearModel, whitening: Whitening) -> Floats:
    """The posterior mean within the bounds: what would leave them is held there, and the others found anew."""
    x, free = laplace_posterior(linear, whitening).mean, np.ones(linear.jacobian.shape[1], dtype=bool)
    while np.any(np.abs(x[free]) > FARTHEST):
        free &= np.abs(x) <= FARTHEST
        x = np.clip(x, -FARTHEST, FARTHEST)
        if not free.any():
            break
        rest = LinearModel(linear.target - linear.jacobian[:, ~free] @ x[~free], linear.jacobian[:, free])
        x[free] = laplace_posterior(rest, whitening).mean
    return np.clip(x, -FARTHEST, FARTHEST)
