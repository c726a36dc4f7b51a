"""MAP fit of one hypothesis by damped Gauss-Newton steps. The Jacobian is recomputed only as far as
it changes.

A hypothesis far from the data is fitted under a wide discrepancy, which shrinks as the fit
improves. Otherwise rows that no value can explain would drive the nuisance parameters to the ends
of their priors. Section 5 of docs/method.md lists the steps.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from rfca_rig.diagnosis.config import (
    CONVERGED_GAIN,
    CONVERGENCE_ROUNDS,
    DIFFERENCE_SIZE,
    FAILED_STEPS,
    JACOBIAN_ERROR,
    LEAST_GAIN,
    LEVELS,
    MAX_COORDINATE,
    MODEL_ROUGHNESS,
    NARROWEST_STEP,
    ROUNDS,
    SAME_COLUMN_COSINE,
    STEP,
    STEP_REDUCTION,
    WIDEST_STEP,
)
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.likelihood.covariance import DiscrepancyWhitening, Whitening
from rfca_rig.diagnosis.likelihood.marginal_likelihood import (
    LinearModel,
    MarginalLikelihood,
    MarginalPosterior,
    laplace_posterior,
    laplace_posteriors,
    make_marginal_likelihood,
)
from rfca_rig.diagnosis.simulator import Dataset

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MapFit:
    """A hypothesis at its best point, with m rows and p unknowns. Equal only to itself.

    Parameters
    ----------
    coordinates
        The unknowns.
    x
        (p,) their standard normal coordinates.
    predicted
        (m,) the model's rows at x, in the units of the signals.
    jacobian
        (m, p) derivatives of the rows there.
    column_norms
        (p,) length of each column of the Jacobian when all of it was computed last, in standard
        deviations of all rows together.
    """

    coordinates: Parameterization
    x: Floats
    predicted: Floats
    jacobian: Floats
    column_norms: Floats

    @property
    def ids(self) -> tuple[str, ...]:
        """The ids of its effects."""
        return tuple(term.effect.id for term in self.coordinates.choices)

    @property
    def max_nuisance_shift(self) -> float:
        """Largest distance of a nuisance parameter from its prior mean, in prior standard
        deviations.
        """
        return float(np.abs(self.x[: self.coordinates.nuisances]).max(initial=0.0))

    @property
    def at_prior_means(self) -> Floats:
        """x with its effects unchanged and all nuisance parameters at their prior means, (p,)."""
        nuisances = self.coordinates.nuisances
        return np.concatenate([np.zeros(nuisances), self.x[nuisances:]])

    def linear(self, measured: Floats) -> LinearModel:
        """The hypothesis as a linear model around x, for the measured rows (m,)."""
        return LinearModel(measured - self.predicted + self.jacobian @ self.x, self.jacobian)


@dataclass(frozen=True)
class GaussNewton:
    """Optimiser of one dataset: damped Gauss-Newton steps; evidence of fits is cached.

    No coordinate goes farther than `max_coordinate`, in prior standard deviations.
    """

    dataset: Dataset
    likelihood: MarginalLikelihood
    max_coordinate: float = MAX_COORDINATE
    # Evidence is asked for again and again during the search. The weak keys let a fit go with its
    # results once it is dropped.
    _free: WeakKeyDictionary[MapFit, float] = field(
        default_factory=WeakKeyDictionary, init=False, repr=False, compare=False
    )
    _marginals: WeakKeyDictionary[MapFit, MarginalPosterior] = field(
        default_factory=WeakKeyDictionary, init=False, repr=False, compare=False
    )

    def at(
        self, coordinates: Parameterization, x: Floats, known_slope: Floats | None = None
    ) -> MapFit | None:
        """Evaluate a hypothesis at x.

        Parameters
        ----------
        coordinates
            The unknowns.
        x
            (p,) their coordinates.
        known_slope
            (m, k) first k columns of the Jacobian, if they are known; the others are found by
            finite differences of STEP.

        Returns
        -------
        MapFit or None
            None where the model has no answer at x.
        """
        predicted = self.dataset.predicted(coordinates.supposed(x))
        if predicted is None:
            return None
        left = np.empty((len(predicted), 0)) if known_slope is None else known_slope
        columns = self._columns(
            coordinates, x, predicted, dict.fromkeys(range(left.shape[1], coordinates.size), STEP)
        )
        return self._make_fit(coordinates, x, predicted, np.column_stack([left, *columns]))

    def _make_fit(
        self, coordinates: Parameterization, x: Floats, predicted: Floats, jacobian: Floats
    ) -> MapFit:
        norms = np.linalg.norm(self.likelihood.usual(jacobian), axis=0)
        aligned = self._align_nuisances(coordinates, jacobian)
        return MapFit(coordinates, x, predicted, aligned, norms)

    def without(self, found: MapFit, number: int) -> MapFit | None:
        """The fit without one of its effects, everything else unchanged; None where the model
        has no answer.
        """
        coordinates = found.coordinates
        kept = [term for i, term in enumerate(coordinates.choices) if i != number]
        drop = np.arange(coordinates.size)[coordinates.part(number)]
        return self.at(
            coordinates.with_terms(kept),
            np.delete(found.x, drop),
            np.delete(found.jacobian, drop, axis=1),
        )

    def refine(self, start: MapFit, levels: int = LEVELS, rounds: int = ROUNDS) -> MapFit:
        """Steps from `start` until nothing more is gained, at one discrepancy scale after the
        other.
        """
        fit = start
        last = np.inf
        for _ in range(levels):
            whitening = self.likelihood.level(fit.linear(self.dataset.rows.measured))
            # The same scale twice: the fit has settled.
            if whitening.s == last:
                break
            fit = self._descend(fit, whitening, rounds)
            last = whitening.s
        return fit

    def converge(self, found: MapFit, rounds: int = CONVERGENCE_ROUNDS) -> MapFit:
        """Recompute all columns of the Jacobian and refine again, until that gains less than
        CONVERGED_GAIN.
        """
        fit = found
        for _ in range(rounds):
            before = fit
            fit = self.refine(self._recompute_jacobian(fit))
            whitening = self.likelihood.level(fit.linear(self.dataset.rows.measured))
            if (
                self.misfit(before.x, before.predicted, whitening)
                - self.misfit(fit.x, fit.predicted, whitening)
                < CONVERGED_GAIN
            ):
                break
        return fit

    def _recompute_jacobian(self, fit: MapFit) -> MapFit:
        columns = self._columns(
            fit.coordinates, fit.x, fit.predicted, dict(enumerate(_widths(fit.column_norms)))
        )
        no_columns = np.empty(
            (len(fit.predicted), 0)
        )  # a hypothesis without unknowns has no column
        return self._make_fit(
            fit.coordinates, fit.x, fit.predicted, np.column_stack([no_columns, *columns])
        )

    def _descend(self, fit: MapFit, whitening: DiscrepancyWhitening, rounds: int) -> MapFit:
        """Damped steps at one discrepancy scale towards the optimum of the linear model; a
        failed step shortens the next one.
        """
        share = 1.0
        failed = 0
        is_fresh = False
        for _ in range(rounds):
            linear = fit.linear(self.dataset.rows.measured)
            goal = _goal(linear, whitening, self.max_coordinate)
            before = self.misfit(fit.x, fit.predicted, whitening)
            # The linear model itself promises too little for a further step.
            if (
                before - self.misfit(goal, fit.predicted + fit.jacobian @ (goal - fit.x), whitening)
                < LEAST_GAIN
            ):
                return fit
            x = fit.x + share * (goal - fit.x)
            predicted = self.dataset.predicted(fit.coordinates.supposed(x))
            gained = -np.inf if predicted is None else before - self.misfit(x, predicted, whitening)
            if predicted is not None:
                # A failed step is not taken, but it shows where the Jacobian is wrong.
                if gained <= 0.0:
                    fit = self._update_by_secant(fit, x, predicted)
                else:
                    fit = self._refresh_jacobian(fit, x, predicted)
            if 0.0 < gained < LEAST_GAIN:
                return fit
            # Damping by step length: it grows back after a success, up to the full step.
            if gained > 0.0:
                share = min(1.0, 2.0 * share)
            else:
                share = STEP_REDUCTION * share
            failed = 0 if gained > 0.0 else failed + 1
            is_fresh = is_fresh and gained <= 0.0
            if failed == FAILED_STEPS and not is_fresh:
                # The secant updates cannot correct a Jacobian that is wrong in directions the steps
                # did not take.
                fit = self._recompute_jacobian(fit)
                share = 1.0
                failed = 0
                is_fresh = True
        return fit

    def evaluate(self, found: MapFit) -> MarginalPosterior:
        """Marginal likelihood of a fit, with the discrepancy scale integrated out under the strict
        prior.

        Evidence that only the Jacobian promises, and no step found, does not count. A Jacobian
        across a kink promises much, for example at a stop that no hinge reaches.
        """
        if (known := self._marginals.get(found)) is None:
            known = self._marginals[found] = self._integrate(found)
        return known

    def _integrate(self, fit: MapFit) -> MarginalPosterior:
        linear = fit.linear(self.dataset.rows.measured)
        marginal = self.likelihood.evaluate(linear)
        missing = unconfirmed_gain(
            fit, self.dataset.rows.measured, marginal.posterior.mean, marginal.whitening
        )
        return replace(marginal, log_evidence=marginal.log_evidence - missing)

    def evaluate_unlisted(self, found: MapFit) -> MarginalPosterior:
        """Marginal likelihood with something unlisted beside the hypothesis."""
        return self.likelihood.evaluate_unknown(found.linear(self.dataset.rows.measured))

    def log_evidence(self, found: MapFit) -> float:
        """The log evidence of `evaluate`."""
        return self.evaluate(found).log_evidence

    def free_log_evidence(self, found: MapFit) -> float:
        """Log evidence with the discrepancy scale free over the whole grid, log-uniform; cached.
        It ranks sets during the search.
        """
        if (known := self._free.get(found)) is None:
            known = self._free[found] = float(logsumexp(self.log_evidence_by_scale(found)))
        return known

    def log_evidence_by_scale(self, found: MapFit) -> Floats:
        """Log evidence at each discrepancy scale of the grid, (k,)."""
        return log_evidence_by_scale(found, self.dataset.rows.measured, self.likelihood.every_scale)

    def misfit(self, x: Floats, predicted: Floats, whitening: Whitening) -> float:
        """Negative log posterior density at x (p,) with predicted rows (m,), without constants."""
        return _misfit(self.dataset.rows.measured - predicted, x, whitening)

    def _update_by_secant(self, fit: MapFit, x: Floats, predicted: Floats) -> MapFit:
        """Secant update of the whole Jacobian from the model's rows at x, each column in proportion
        to its probable error.

        It is a Kalman update: columns are known to JACOBIAN_ERROR of their size, and the model is
        rough by MODEL_ROUGHNESS. Section 5 of docs/method.md has the formula.
        """
        step = x - fit.x
        deviation = predicted - fit.predicted - fit.jacobian @ step
        gain = step * (JACOBIAN_ERROR * fit.column_norms) ** 2
        jacobian = fit.jacobian + np.outer(
            deviation, gain / (float(step @ gain) + MODEL_ROUGHNESS**2)
        )
        return replace(fit, jacobian=self._align_nuisances(fit.coordinates, jacobian))

    def _refresh_jacobian(self, fit: MapFit, x: Floats, predicted: Floats) -> MapFit:
        """Move to x: all columns get the secant update, those of effects are recomputed by
        finite differences.
        """
        jacobian = self._update_by_secant(fit, x, predicted).jacobian
        of_effects = dict(list(enumerate(_widths(fit.column_norms)))[fit.coordinates.nuisances :])
        for i, column in zip(
            of_effects, self._columns(fit.coordinates, x, predicted, of_effects), strict=True
        ):
            jacobian[:, i] = column
        return replace(
            fit,
            x=x,
            predicted=predicted,
            jacobian=self._align_nuisances(fit.coordinates, jacobian),
        )

    def _align_nuisances(self, coordinates: Parameterization, jacobian: Floats) -> Floats:
        """Replace the column of a nuisance parameter that does the equivalents as an effect by a
        multiple of the effect's column.

        Their columns are differences over other steps, so they would differ slightly. The data
        would then seem to distinguish what only the prior does. It applies to stated equivalents,
        for example the height of the rack, and to columns whose cosine exceeds SAME_COLUMN_COSINE.
        """
        # Parameters with a joint prior share their coordinates, so columns are compared and
        # replaced with respect to the parameters themselves.
        count = coordinates.nuisances
        jacobian[:, :count] = coordinates.space.per_deviation(jacobian[:, :count])
        size = jacobian / self.dataset.rows.noise[:, None]
        # In units of noise, so that channels of different units count alike.
        norm = np.maximum(
            np.linalg.norm(size, axis=0), 1e-150
        )  # the product of two does not underflow
        equivalents = coordinates.same_as
        effects = range(count, coordinates.size)
        for nuisance, name in enumerate(coordinates.space.names):
            cosine = {
                effect: float(size[:, effect] @ size[:, nuisance]) / (norm[effect] * norm[nuisance])
                for effect in effects
            }
            tied = [effect for effect in effects if equivalents[effect - count] == name]
            effect = max(
                tied or effects, key=lambda candidate: abs(cosine[candidate]), default=None
            )
            if effect is not None and (tied or abs(cosine[effect]) > SAME_COLUMN_COSINE):
                jacobian[:, nuisance] = (
                    jacobian[:, effect] * cosine[effect] * norm[nuisance] / norm[effect]
                )
        jacobian[:, :count] = coordinates.space.per_coordinate(jacobian[:, :count])
        return jacobian

    def _columns(
        self,
        coordinates: Parameterization,
        x: Floats,
        predicted: Floats,
        widths: Mapping[int, float],
    ) -> list[Floats]:
        """Columns (m,) of the Jacobian by one-sided finite differences of these widths, by the
        number of the unknown.

        Steps go towards the middle of the prior, or away from it where the model has no answer
        there. The column is zero where it has none on either side.
        """
        inwards = {i: -width if x[i] > 0.0 else width for i, width in widths.items()}
        changes = self._predict_changes(coordinates, x, predicted, inwards)
        outwards = {i: -step for i, step in inwards.items() if changes[i] is None}
        changes = changes | self._predict_changes(coordinates, x, predicted, outwards)
        steps = inwards | outwards
        return [
            np.zeros(len(predicted)) if (change := changes[i]) is None else change / steps[i]
            for i in widths
        ]

    def _predict_changes(
        self,
        coordinates: Parameterization,
        x: Floats,
        predicted: Floats,
        steps: Mapping[int, float],
    ) -> dict[int, Floats | None]:
        """The change of the model's rows over one step from x, by the number of the unknown that
        is shifted.
        """
        places = [
            coordinates.supposed(np.where(np.arange(len(x)) == i, x + step, x))
            for i, step in steps.items()
        ]
        return dict(
            zip(
                steps,
                self.dataset.predict_changes(coordinates.supposed(x), predicted, places),
                strict=True,
            )
        )


def log_evidence_by_scale(
    found: MapFit, measured: Floats, whitenings: Sequence[DiscrepancyWhitening]
) -> Floats:
    """Log evidence of a fit to measured rows (m,) under each of k covariances, (k,)."""
    posteriors = laplace_posteriors(found.linear(measured), whitenings)
    pairs = zip(whitenings, posteriors, strict=True)
    return np.array(
        [
            p.log_evidence - unconfirmed_gain(found, measured, p.mean, whitening)
            for whitening, p in pairs
        ]
    )


def unconfirmed_gain(found: MapFit, measured: Floats, mean: Floats, whitening: Whitening) -> float:
    """Gain in log posterior density at `mean` (p,) that the linear model promises and the fit did
    not find; `measured` is (m,).

    It does not count as evidence. A Jacobian across a kink promises much.
    """
    promised = _misfit(
        measured - found.predicted - found.jacobian @ (mean - found.x), mean, whitening
    )
    return max(_misfit(measured - found.predicted, found.x, whitening) - promised, 0.0)


def _misfit(residual: Floats, x: Floats, whitening: Whitening) -> float:
    white = whitening(residual)
    return 0.5 * float(white @ white + x @ x)


def without_scatter(dataset: Dataset) -> GaussNewton:
    """The optimiser while the scatter from repeat to repeat is unknown: it counts as
    discrepancy.
    """
    return GaussNewton(
        dataset, make_marginal_likelihood(dataset.rows, np.empty((len(dataset.rows.measured), 0)))
    )


def _widths(size: Floats) -> Floats:
    """Widths (p,) of finite differences: a difference should exceed the roughness of the model,
    within NARROWEST_STEP to WIDEST_STEP.
    """
    # Such a step changes the rows by about DIFFERENCE_SIZE standard deviations in all.
    return np.asarray(
        np.clip(DIFFERENCE_SIZE / np.maximum(size, 1e-300), NARROWEST_STEP, WIDEST_STEP)
    )


def _goal(linear: LinearModel, whitening: Whitening, bound: float) -> Floats:
    """Posterior mean (p,) of the linear model within the bounds.

    A coordinate that would leave is fixed at its bound, and the others are solved again.
    """
    x = laplace_posterior(linear, whitening).mean
    free = np.ones(linear.jacobian.shape[1], dtype=bool)
    # Active-set iteration: every pass fixes at least one coordinate more, so it ends.
    while np.any(np.abs(x[free]) > bound):
        free &= np.abs(x) <= bound
        x = np.clip(x, -bound, bound)
        if not free.any():
            break
        rest = LinearModel(
            linear.target - linear.jacobian[:, ~free] @ x[~free], linear.jacobian[:, free]
        )
        x[free] = laplace_posterior(rest, whitening).mean
    return np.clip(x, -bound, bound)
