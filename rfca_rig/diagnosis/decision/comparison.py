"""Comparison of hypotheses with the size of the model discrepancy free, and the support of each
effect by the data.

A hypothesis is a set of effects. Its log evidence is known at every discrepancy scale s of a grid
from 0.5 % to 60 % of the signals. With a log-uniform prior, s is integrated out. So an effect whose
law is only approximate still competes: what its law leaves is discrepancy.

A relative probability alone claims too much here, since a smooth discrepancy hides how similar
wrong laws are. The decision rests on how much better held-out conditions are predicted with an
effect than with the best rival that lacks it; see `calibration`.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from rfca_rig.diagnosis.config import (
    AS_GOOD_LOG_ODDS,
    CONFIRMED_SETS,
    DOMINANT_SHARE,
    FEWEST_CONDITIONS,
    IMPLAUSIBLE,
    LARGE_ERROR,
    LAW_ERROR,
    MAX_COORDINATE,
    MAX_RISE,
    STRAINED,
    USUAL_MISFIT,
    WORTH_ADDING,
)
from rfca_rig.diagnosis.data import unit_of
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis, ModelSelectionResult
from rfca_rig.diagnosis.inference.map_fit import log_evidence_by_scale
from rfca_rig.diagnosis.likelihood.covariance import DiscrepancyWhitening, propagate_smooth_error
from rfca_rig.diagnosis.likelihood.marginal_likelihood import laplace_posterior, loo_residuals
from rfca_rig.model.catalogue import list_related
from rfca_rig.model.effect import Effect

Floats = NDArray[np.float64]

MOST_RISE = (1.0 + MAX_RISE) ** 2  # of a mean square


@dataclass(frozen=True)
class ScaledHypothesis:
    """A hypothesis with the discrepancy scale free.

    Parameters
    ----------
    hypothesis
        The set of effects at its MAP fit.
    log_evidence
        Log evidence at each scale of the grid, (k,).
    scale
        Posterior geometric mean of the discrepancy scale, as a share of the signals.
    whitening
        The covariance at the most probable scale.
    log_joint
        Log of prior times evidence, the scale integrated out.
    result
        The search that it comes from.
    """

    hypothesis: Hypothesis
    log_evidence: Floats
    scale: float
    whitening: DiscrepancyWhitening
    log_joint: float
    result: ModelSelectionResult

    @cached_property
    def held_out_rms(self) -> Floats:
        """Rms (conditions,) of each held-out condition, predicted from the others, in units of
        noise and usual model error.
        """
        return self._rms_of_held_out(self.result.dataset.rows.condition)

    @cached_property
    def held_out_rms_of_recordings(self) -> Floats:
        """The same of whole recordings, (recordings,); (0,) where there are fewer than
        FEWEST_CONDITIONS.

        Stretches of one recording resemble each other, so that a law may predict them and fail in
        another recording.
        """
        recording = self.result.dataset.rows.recording
        if int(recording.max()) + 1 >= FEWEST_CONDITIONS:
            return self._rms_of_held_out(recording)
        return np.empty(0)

    def _rms_of_held_out(self, group: NDArray[np.intp]) -> Floats:
        """Rms (g,) of each group of rows, predicted from all others; `group` (m,) counts from 0."""
        linear = self.hypothesis.fitted.linear(self.result.dataset.rows.measured)
        residuals = loo_residuals(linear, self.whitening, group, range(int(group.max()) + 1))
        # One unit for all hypotheses, whatever discrepancy scale each of them has.
        square = residuals**2 / self.result.likelihood.usual.variance()
        return np.asarray(np.sqrt(np.bincount(group, square) / np.bincount(group)))

    @cached_property
    def squared_residuals(self) -> Floats:
        """Squares (m,) of what held-out conditions leave, at the discrepancy scale at which an
        answer prints them.
        """
        rows = self.result.dataset.rows
        linear = self.hypothesis.fitted.linear(rows.measured)
        conditions = range(int(rows.condition.max()) + 1)
        residuals = self.result.likelihood.compute_held_out_residuals(
            linear, rows.condition, conditions
        )
        return np.asarray(residuals**2)

    def log_joint_at(self, s: float) -> float:
        """Log of prior times evidence where the discrepancy has the scale `s` of the grid."""
        scales = [whitening.s for whitening in self.result.likelihood.every_scale]
        integrated = float(logsumexp(self.log_evidence)) - float(np.log(len(scales)))
        return self.log_joint - integrated + float(self.log_evidence[scales.index(s)])

    @property
    def misfit(self) -> float:
        """Median over conditions of `held_out_rms`: rho in docs/method.md."""
        return float(np.median(self.held_out_rms))

    @property
    def misfit_of_all(self) -> float:
        """Root mean square over conditions of `held_out_rms`, so that a few badly predicted
        conditions count.
        """
        return float(np.sqrt(np.mean(self.held_out_rms**2)))

    @property
    def ids(self) -> tuple[str, ...]:
        """The ids of its effects."""
        return self.hypothesis.ids

    @cached_property
    def signatures(self) -> tuple[Floats, ...]:
        """Signature (m,) of each of its effects: what the effect adds to the rows, all other
        unknowns at their MAP values.
        """
        fitted = self.hypothesis.fitted
        signatures = []
        coordinates = fitted.coordinates
        for number in range(len(coordinates.choices)):
            others = [term for i, term in enumerate(coordinates.choices) if i != number]
            x = np.delete(fitted.x, np.arange(coordinates.size)[coordinates.part(number)])
            rows = self.result.dataset.predicted(coordinates.with_terms(others).supposed(x))
            signatures.append(
                np.zeros_like(fitted.predicted) if rows is None else fitted.predicted - rows
            )
        return tuple(signatures)

    @cached_property
    def nuisance_shifts(self) -> Floats:
        """Distance (n,) of each nuisance parameter from its prior mean, in units of what its prior
        and approximate laws allow.

        The law of each effect errs by LAW_ERROR of its signature, as smoothly as the discrepancy.
        The fit answers such an error by shifts of nuisance parameters, which say nothing against
        the effect. Their standard deviations follow from the linear fit.
        """
        fitted = self.hypothesis.fitted
        rows = self.result.dataset.rows
        x = fitted.x[: fitted.coordinates.nuisances]
        if not self.ids or fitted.max_nuisance_shift <= STRAINED:
            return x
        linear = fitted.linear(rows.measured)
        posterior = laplace_posterior(linear, self.whitening)
        gain = (posterior.covariance @ self.whitening.apply_precision(linear.jacobian).T)[: x.size]
        variance = propagate_smooth_error(
            rows, [LAW_ERROR * signature for signature in self.signatures], gain
        )
        # The optimiser stops at MAX_COORDINATE, the linear fit does not.
        mean = posterior.mean[: x.size]
        goes_on = (np.abs(x) >= MAX_COORDINATE) & (np.abs(mean) > np.abs(x))
        return np.asarray(np.where(goes_on, mean, x) / np.sqrt(1.0 + variance))

    @property
    def max_nuisance_shift(self) -> float:
        """The largest of `nuisance_shifts`."""
        return float(np.abs(self.nuisance_shifts).max(initial=0.0))

    @property
    def sum_of_squared_shifts(self) -> float:
        """Sum of the squares of all nuisance parameters, in prior standard deviations."""
        fitted = self.hypothesis.fitted
        shifts = fitted.x[: fitted.coordinates.nuisances]
        return float(shifts @ shifts)

    def is_less_plausible_than(self, other: "ScaledHypothesis") -> bool:
        """Whether it needs an implausible nuisance parameter, and the other one does not.

        Where both need one, all nuisance parameters together decide: the difference of their sums
        of squares counts like the square of one more value.
        """
        if self.max_nuisance_shift <= IMPLAUSIBLE:
            return False
        more = self.sum_of_squared_shifts - other.sum_of_squared_shifts
        return other.max_nuisance_shift < IMPLAUSIBLE or more > IMPLAUSIBLE**2


@dataclass(frozen=True)
class Support:
    """How well the data support one effect, or one of several that form a family, as part of the
    best explanation.

    Parameters
    ----------
    ids
        The effect, or the members of the family.
    rival
        The best set of effects that has none of them.
    log_bayes_factor
        Log of the posterior odds of the best explanation against the rival, the smaller one of two:
        with the discrepancy scale of both integrated out, and where the model errs by LARGE_ERROR
        of the signals with either of them.
    held_out_ratio
        Median over conditions of log(rms of the rival / rms with the effect), both on held-out
        conditions.
    law_error_without
        Law error of the best explanation without one of these effects, the largest: 1 where nothing
        else explains, little where these only add to what others explain.
    remaining_misfit
        Held-out misfit of the best explanation, in units of noise and usual model error.
    removed_share
        Share of the removable held-out misfit of the rival that the best explanation removes: 1
        down to the noise, 0 as with the rival.
    relief
        How much farther the rival's nuisance parameters are from their priors than those of the
        best explanation: root of the difference of their sums of squares, in prior standard
        deviations; 0 where they are not farther.
    """

    ids: tuple[str, ...]
    rival: tuple[str, ...]
    log_bayes_factor: float
    held_out_ratio: float
    law_error_without: float
    remaining_misfit: float
    removed_share: float
    relief: float


@dataclass(frozen=True)
class Comparison:
    """All hypotheses of a search with the discrepancy scale free, most probable first."""

    result: ModelSelectionResult
    ranked: tuple[ScaledHypothesis, ...]

    @cached_property
    def nothing(self) -> ScaledHypothesis:
        """The hypothesis without effects."""
        return next(hypothesis for hypothesis in self.ranked if not hypothesis.ids)

    @cached_property
    def best(self) -> ScaledHypothesis:
        """The most probable hypothesis, without effects that improve held-out conditions by less
        than WORTH_ADDING.
        """
        best = self.ranked[0]
        while best.ids and (simpler := self._as_good_without_one(best)) is not None:
            best = simpler
        return best

    def scaled(self, hypothesis: Hypothesis) -> ScaledHypothesis:
        """The compared hypothesis of this fit. Raises StopIteration where it is not part of the
        search.
        """
        return next(
            scaled for scaled in self.ranked if scaled.hypothesis.fitted is hypothesis.fitted
        )

    def as_good_as(self, name: str) -> tuple[str, ...]:
        """Effects that could take the place of one effect of the best explanation as well, with
        the other effects unchanged.
        """
        return tuple(sorted(self._list_swapped(name, is_as_good=True)))

    def tells_from(self, name: str) -> frozenset[str]:
        """Effects that were fitted in the place of one effect of the best explanation, with the
        other effects unchanged, and are not as good in any set.
        """
        as_good = self._list_swapped(name, is_as_good=True)
        return frozenset(self._list_swapped(name, is_as_good=False) - as_good)

    def _list_swapped(self, name: str, is_as_good: bool) -> set[str]:
        """Effects that stand in the place of one effect of the best explanation in fitted sets
        that are as good, or are not.
        """
        kept = set(self.best.ids) - {name}
        swapped = [
            rival
            for rival in self.ranked
            if len(rival.ids) == len(self.best.ids)
            and kept < set(rival.ids)
            and name not in rival.ids
        ]
        return {
            other
            for rival in swapped
            if self._is_as_good(rival) is is_as_good
            for other in set(rival.ids) - kept
        }

    def variants_of(self, name: str) -> tuple[str, ...]:
        """Effects with the same law that are not in the best explanation: more general ones, and
        other special cases.
        """
        general = self._effects[name].variant_of or name
        alike = {
            other.id
            for other in self._effects.values()
            if (other.variant_of or other.id) == general
        }
        return tuple(sorted(alike - {name} - set(self.best.ids)))

    def equals_of(self, one: ScaledHypothesis, name: str) -> tuple[str, ...]:
        """Effects that the law of one effect of a hypothesis turns into in a limit, if its
        fitted values lie in that limit.
        """
        coordinates = one.hypothesis.fitted.coordinates
        number = one.ids.index(name)
        term = coordinates.choices[number]
        values = dict(term.present(one.hypothesis.fitted.x[coordinates.part(number)]).values)
        return tuple(
            sorted(
                limit.other
                for limit in term.effect.equal_limits
                if limit.other not in one.ids and limit.holds(values)
            )
        )

    def _is_as_good(self, hypothesis: ScaledHypothesis) -> bool:
        """Whether the data do not distinguish a hypothesis from the best one, or would not at
        the usual model error.
        """
        likelihood = self.result.likelihood
        usual = [whitening.s for whitening in likelihood.every_scale].index(likelihood.usual.s)
        behind = (
            self.best.log_joint - hypothesis.log_joint,
            float(self.best.log_evidence[usual] - hypothesis.log_evidence[usual]),
        )
        return min(behind) < AS_GOOD_LOG_ODDS

    def without(self, ids: Collection[str]) -> ScaledHypothesis:
        """The most probable hypothesis that has none of these effects.

        One that needs an implausible nuisance parameter, which the best explanation does not need,
        explains nothing: the effect took the place of that value. It counts only if there is no
        other.
        """
        rivals = [rival for rival in self.ranked if not set(rival.ids) & set(ids)]
        return next(
            (rival for rival in rivals if not rival.is_less_plausible_than(self.best)), rivals[0]
        )

    def explained_share(self, one: ScaledHypothesis) -> float:
        """Share of the removable held-out misfit that a hypothesis removes: 1 down to the noise, 0
        as without effects.

        It is the smaller one of two: that of the median over conditions, and that of the rms over
        them, so that a few conditions that are predicted far worse count.
        """
        of_median = self._compute_removed_share(self.nothing.misfit, one.misfit)
        return min(
            of_median, self._compute_removed_share(self.nothing.misfit_of_all, one.misfit_of_all)
        )

    def _compute_removed_share(self, before: float, after: float) -> float:
        """Share of the removable part of a held-out misfit that is gone after."""
        # Noise cannot be removed, so it does not count as misfit.
        removable = before**2 - self.noise_floor**2
        # A fit may lie a little below the stated noise.
        if removable > 0.0:
            return min((before**2 - after**2) / removable, 1.0)
        return 0.0

    def predicts_worse(self, one: ScaledHypothesis) -> bool:
        """Whether a hypothesis predicts held-out conditions worse than the one without effects.

        That is so where the rms over all signals rises, each in units of its noise and scatter.
        """
        variance = self.result.floor_std**2
        signals = self.result.dataset.rows.signal
        before = 0.0
        after = 0.0
        for signal in np.unique(signals):
            mask = signals == signal
            before += (self.nothing.squared_residuals[mask] / variance[mask]).mean()
            after += (one.squared_residuals[mask] / variance[mask]).mean()
        return bool(after > MOST_RISE * before)

    def predicts_a_quantity_worse(self, one: ScaledHypothesis) -> bool:
        """Whether a hypothesis predicts a quantity worse than the one without effects, and worse
        than usual.

        A quantity is all signals of one unit, the angles of all hinges, say, so that its rms is
        taken in that unit.
        """
        before = self.nothing.squared_residuals
        after = one.squared_residuals
        in_usual_errors = after / self.result.likelihood.usual.variance()
        units = np.array([unit_of(str(signal)) for signal in self.result.dataset.rows.signal])
        for unit in np.unique(units):
            mask = units == unit
            rises = after[mask].mean() > MOST_RISE * before[mask].mean()
            if rises and in_usual_errors[mask].mean() > USUAL_MISFIT**2:
                return True
        return False

    def law_error(self, one: ScaledHypothesis) -> float:
        """Root of the held-out misfit that a hypothesis leaves, over the misfit that it removes;
        limited to 1.
        """
        left = max(one.misfit**2 - self.noise_floor**2, 0.0)
        removed = self.nothing.misfit**2 - one.misfit**2
        if removed > 0.0:
            return float(min(np.sqrt(left / removed), 1.0))
        return 1.0

    def law_error_without(self, name: str) -> float:
        """Law error of the best explanation without one of its effects; 1 where no effect remains,
        or the rest is no explanation.

        The rest does not count if it needs an implausible nuisance parameter that the best
        explanation does not need.
        """
        others = set(self.best.ids) - {name}
        rest = next(
            (hypothesis for hypothesis in self.ranked if others and set(hypothesis.ids) == others),
            None,
        )
        if rest is None or rest.is_less_plausible_than(self.best):
            return 1.0
        return self.law_error(rest)

    @cached_property
    def noise_floor(self) -> float:
        """Rms of sensor noise alone, in units of noise and usual model error."""
        return float(
            np.sqrt(
                np.mean(self.result.dataset.rows.noise**2 / self.result.likelihood.usual.variance())
            )
        )

    def find_unsure_laws(self) -> frozenset[str]:
        """Effects of the best explanation that share a family, where fewer laws of these families
        explain the recordings nearly as well.

        The laws together may then only describe better what a single approximate law is behind, and
        no more than the family is known.
        """
        best = set(self.best.ids)
        group = {name for name in best if not list_related((name,)).isdisjoint(best - {name})}
        if group and self.explained_share(self.best) < DOMINANT_SHARE:
            # They are stated for the implausible values that they replace, if at all, and several
            # laws of a family replace these in equal measure.
            return frozenset(group)
        laws_of_group = self.laws_of(group)
        for simpler in self.ranked:
            instead = set(simpler.ids) - (best - group)
            is_simpler = (
                best - group <= set(simpler.ids)
                and 0 < len(instead) < len(group)
                and instead <= list_related(group)
            )
            # A subset, or a variant of one, only says that the other laws are not needed.
            is_other = is_simpler and not self.laws_of(instead) <= laws_of_group
            explains = is_other and (
                self.law_error(simpler) <= LAW_ERROR or _loses_little(simpler, self.best)
            )
            if explains and not simpler.is_less_plausible_than(self.best):
                return frozenset(group)
        return frozenset()

    def laws_of(self, ids: Collection[str]) -> set[str]:
        """The most general effects of which these are variants."""
        return {self._effects[name].variant_of or name for name in ids}

    @cached_property
    def _effects(self) -> dict[str, Effect]:
        """All effects of the hypotheses, by id."""
        return {
            term.effect.id: term.effect
            for scaled in self.ranked
            for term in scaled.hypothesis.fitted.coordinates.choices
        }

    def whole_set(self, ids: Collection[str]) -> ScaledHypothesis:
        """The most probable plausible set that has these effects: sizes without its other
        effects would make up for those.
        """
        having = [hypothesis for hypothesis in self.ranked if set(ids) <= set(hypothesis.ids)]
        return next(
            (
                hypothesis
                for hypothesis in having
                if not hypothesis.is_less_plausible_than(self.best)
            ),
            having[0],
        )

    def sets_as_good_as(self, whole: ScaledHypothesis, name: str) -> list[ScaledHypothesis]:
        """Sets with this effect that predict held-out conditions as well, with others of the
        same families in place of its partners.
        """
        others = set(whole.ids) - {name}
        sets = []
        for hypothesis in self.ranked:
            rest = set(hypothesis.ids) - {name}
            is_swapped = (
                name in hypothesis.ids and len(rest) == len(others) and rest <= list_related(others)
            )
            if (
                is_swapped
                and not hypothesis.is_less_plausible_than(whole)
                and _loses_little(hypothesis, whole)
            ):
                sets.append(hypothesis)
        return sets

    def support(self, ids: Sequence[str]) -> Support:
        """The support of these effects, some of which are in the best explanation. Raises
        ValueError where none of them is.
        """
        best = self.best
        rival = self.without(ids)
        numbers = [number for number, name in enumerate(best.ids) if name in ids]
        if not numbers:
            raise ValueError(
                f"none of {', '.join(ids)} is part of the best explanation, "
                f"{', '.join(best.ids) or 'nothing'}"
            )
        return Support(
            ids=tuple(ids),
            rival=rival.ids,
            log_bayes_factor=min(
                best.log_joint - rival.log_joint,
                best.log_joint_at(LARGE_ERROR) - rival.log_joint_at(LARGE_ERROR),
            ),
            held_out_ratio=float(np.median(np.log(rival.held_out_rms / best.held_out_rms))),
            law_error_without=max(self.law_error_without(best.ids[number]) for number in numbers),
            remaining_misfit=best.misfit,
            removed_share=self._compute_removed_share(rival.misfit, best.misfit),
            relief=float(
                np.sqrt(max(rival.sum_of_squared_shifts - best.sum_of_squared_shifts, 0.0))
            ),
        )

    def is_at_bound(self, name: str) -> bool:
        """Whether a size of an effect of the best explanation is where the fit stops; a shape
        parameter may be there.
        """
        coordinates = self.best.hypothesis.fitted.coordinates
        number = self.best.ids.index(name)
        sizes = self.best.hypothesis.fitted.x[coordinates.part(number)][
            : len(coordinates.choices[number].sizes)
        ]
        return bool((np.abs(sizes) >= MAX_COORDINATE).any())

    def _as_good_without_one(self, hypothesis: ScaledHypothesis) -> ScaledHypothesis | None:
        """The most probable hypothesis with one effect fewer that predicts held-out conditions
        about as well.

        A subset does not count if it needs an implausible nuisance parameter that the whole set
        does not need.
        """
        for simpler in self.ranked:
            is_part = len(simpler.ids) == len(hypothesis.ids) - 1 and set(simpler.ids) < set(
                hypothesis.ids
            )
            if (
                is_part
                and not simpler.is_less_plausible_than(hypothesis)
                and _loses_little(simpler, hypothesis)
            ):
                return simpler
        return None


def _loses_little(hypothesis: ScaledHypothesis, other: ScaledHypothesis) -> bool:
    """Whether a hypothesis predicts held-out conditions, or recordings, about as well as another
    one.

    In the median over them it is worse by less than WORTH_ADDING.
    """
    pairs = [(hypothesis.held_out_rms, other.held_out_rms)]
    if len(hypothesis.held_out_rms_of_recordings):
        pairs.append((hypothesis.held_out_rms_of_recordings, other.held_out_rms_of_recordings))
    log_ratios = [float(np.median(np.log(errors / others))) for errors, others in pairs]
    # The threshold is a share of the mean square, and a ratio is that of an rms, hence the half.
    return min(log_ratios) < -0.5 * float(np.log1p(-WORTH_ADDING))


def compare(result: ModelSelectionResult) -> Comparison:
    """All hypotheses of a search with the discrepancy scale free.

    Evidence that an effect brings counts only if held-out conditions confirm it. What one condition
    alone gains by an effect is a part of its discrepancy that resembles the effect.
    """
    hypotheses = [
        _integrate_scale(result, hypothesis) for hypothesis in (result.nothing, *result.named)
    ]
    confirmed: set[int] = set()
    while True:
        hypotheses.sort(key=lambda scaled: -scaled.log_joint)
        index = next(
            (
                number
                for number, scaled in enumerate(hypotheses[:CONFIRMED_SETS])
                if id(scaled) not in confirmed
            ),
            None,
        )
        if index is None:
            return Comparison(result, tuple(hypotheses))
        hypotheses[index] = _without_unconfirmed(hypotheses[index], hypotheses)
        confirmed.add(id(hypotheses[index]))


def _without_unconfirmed(
    scaled: ScaledHypothesis, hypotheses: Sequence[ScaledHypothesis]
) -> ScaledHypothesis:
    """The hypothesis without evidence that held-out conditions do not confirm against a set with
    fewer effects.
    """
    unconfirmed = 0.0
    for simpler in hypotheses:
        if len(simpler.ids) >= len(scaled.ids) or simpler.is_less_plausible_than(scaled):
            continue
        gained = (
            scaled.log_joint
            - scaled.hypothesis.log_prior
            - (simpler.log_joint - simpler.hypothesis.log_prior)
        )
        if gained > unconfirmed and _is_unconfirmed(scaled, simpler):
            unconfirmed = gained
    if unconfirmed == 0.0:
        return scaled
    return replace(
        scaled,
        log_joint=scaled.log_joint - unconfirmed,
        log_evidence=scaled.log_evidence - unconfirmed,
    )


def _is_unconfirmed(hypothesis: ScaledHypothesis, simpler: ScaledHypothesis) -> bool:
    """Whether held-out conditions do not confirm what a hypothesis gains over a set with fewer
    effects.

    A part of it, one effect smaller, then predicts them about as well; any other set predicts them
    better.
    """
    is_part = len(simpler.ids) == len(hypothesis.ids) - 1 and set(simpler.ids) < set(hypothesis.ids)
    if is_part:
        return _loses_little(simpler, hypothesis)
    return _predicts_better(simpler, hypothesis)


def _predicts_better(hypothesis: ScaledHypothesis, other: ScaledHypothesis) -> bool:
    """Whether a hypothesis predicts held-out conditions better than another one, in the median
    over them and in the rms over all.
    """
    return hypothesis.misfit < other.misfit and hypothesis.misfit_of_all < other.misfit_of_all


def _integrate_scale(result: ModelSelectionResult, hypothesis: Hypothesis) -> ScaledHypothesis:
    whitenings = result.likelihood.every_scale
    log_evidence = log_evidence_by_scale(
        hypothesis.fitted, result.dataset.rows.measured, whitenings
    )
    scales = np.array([whitening.s for whitening in whitenings])
    total = float(logsumexp(log_evidence))
    return ScaledHypothesis(
        hypothesis=hypothesis,
        log_evidence=log_evidence,
        # Posterior mean of log s, as the grid is about log-uniform.
        scale=float(np.exp(np.exp(log_evidence - total) @ np.log(scales))),
        whitening=whitenings[int(np.argmax(log_evidence))],
        log_joint=total
        - float(np.log(len(whitenings)))
        + hypothesis.log_prior
        - hypothesis.log_beyond,
        result=result,
    )
