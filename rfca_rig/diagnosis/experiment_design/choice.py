"""Choice of the experiment that best separates the open hypotheses per minute, among all that the
rig and a person can do.

    score = sum over pairs of p_k p_l min(expected log evidence, ENOUGH) / minutes

A kind of rig provides its experiments as designs. Bench tests compete with them. If k is true, the
log evidence that a new recording is expected to give it over l is

    1/2 (f_k - f_l)^T C_l^-1 (f_k - f_l),   C_l = (D + B B^T) / r + s^2 K + J_l P_l J_l^T

- f: the rows that each hypothesis predicts at its fitted point
- D: the noise of one repeat
- B: the scatter from repeat to repeat, and r the number of repeats
- s^2 K: a usual model error
- J_l P_l J_l^T: the change that the parameters of l may still make, given the recordings so far

References
----------
Box and Hill, Technometrics 9 (1967) 57; Hunter and Reiner, Technometrics 7 (1965) 307.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular
from scipy.special import softmax

from rfca_rig.diagnosis.config import (
    AS_GOOD_LOG_ODDS,
    IDENTIFIED_PROBABILITY,
    USUAL_ERROR,
    WIDE_STEP,
)
from rfca_rig.diagnosis.decision.decision import Decision
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis, ModelSelectionResult
from rfca_rig.diagnosis.likelihood.covariance import discrepancy_covariance
from rfca_rig.diagnosis.simulator import ConditionData, Dataset
from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.model.bench_tests import BENCH_TESTS
from rfca_rig.model.catalogue import declarations

PLAUSIBLE = 0.01  # probability: a less probable hypothesis is not worth an experiment
# hypotheses: each costs as many simulations of every experiment as it has parameters
MAX_HYPOTHESES = 5
# probability: the most probable hypothesis was not stated, so the others count at least this much
LEAST_WEIGHT = 0.05


@dataclass(frozen=True)
class OpenHypotheses:
    """The open hypotheses of a search; at least two.

    Parameters
    ----------
    found
        The search.
    open
        The hypotheses, the accepted or most probable one first.
    probability
        (n,) their relative probabilities.
    """

    found: ModelSelectionResult
    open: tuple[Hypothesis, ...]
    probability: NDArray[np.float64]


def list_open_hypotheses(
    found: ModelSelectionResult, decision: Decision, enough: bool
) -> OpenHypotheses | None:
    """Hypotheses that are open after a decision; None where there are fewer than two. Without
    `enough` conditions all are open.
    """
    best: dict[frozenset[str], Hypothesis] = {}  # variant of each set of effects
    for hypothesis in sorted((found.nothing, *found.named), key=lambda h: -h.log_joint):
        best.setdefault(frozenset(hypothesis.ids), hypothesis)
    ranked = list(best.values())
    accepted = decision.explanation
    if not enough:
        is_open = ranked
    elif decision.grade == "identified":
        # After an identified effect, only the effects that explain the data as well are left to be
        # excluded.
        rivals = {name for effect in decision.effects for name in effect.cannot_tell_from}
        is_open = [accepted, *(h for h in ranked if _swaps_one_effect(h, accepted, rivals))]
    elif decision.grade == "nothing missing" and decision.probability >= IDENTIFIED_PROBABILITY:
        is_open = []
    else:
        probability = softmax([h.log_joint for h in ranked])
        closest = (decision.closest or accepted).ids
        likely = [
            h
            for h, p in zip(ranked, probability, strict=True)
            if p >= PLAUSIBLE or h.ids == closest
        ]
        # Nothing was stated, so at least the two most probable hypotheses are compared.
        is_open = likely if len(likely) > 1 else ranked[:2]
    if len(is_open) < 2:
        return None
    weight = np.maximum(softmax([h.log_joint for h in is_open[:MAX_HYPOTHESES]]), LEAST_WEIGHT)
    return OpenHypotheses(found, tuple(is_open[:MAX_HYPOTHESES]), weight / weight.sum())


def _swaps_one_effect(hypothesis: Hypothesis, accepted: Hypothesis, rivals: set[str]) -> bool:
    """Whether the hypothesis has one effect of the accepted one replaced by one of `rivals`,
    which explain the data as well.
    """
    new = set(hypothesis.ids) - set(accepted.ids)
    return len(hypothesis.ids) == len(accepted.ids) and len(new) == 1 and new <= rivals


Floats = NDArray[np.float64]

ENOUGH = 10.0  # log evidence: more decides nothing further, and a bench test decides as surely
# designs, most promising first, whose parameters are freed: each costs a simulation per parameter
LOOKED_INTO = 6
AS_GOOD_AS = 0.9  # share of the best score, within which a gentler experiment is preferred
SET_UP_MIN = 2.0  # minutes of a person before an experiment: start pose, arming, a look at the rig


@dataclass(frozen=True)
class ExpectedInformation:
    """One experiment as the n open hypotheses predict it.

    Parameters
    ----------
    hypotheses
        The open hypotheses.
    dataset
        The experiment as its only condition.
    predicted
        (n, m) the rows of each hypothesis.
    noise
        (m,) standard deviation of one repeat.
    model_error
        (m, m) covariance of a usual model error.
    """

    hypotheses: OpenHypotheses
    dataset: Dataset
    predicted: Floats
    noise: Floats
    model_error: Floats

    def bound(self, repeats: int) -> Floats:
        """Upper bound (n, n) of `expect`: no parameter may change, and repeats do not scatter."""
        return self._compare(
            np.diag(self.noise**2) / repeats, [np.zeros((len(self.noise), 0))] * len(self.predicted)
        )

    def expect(self, repeats: Sequence[int]) -> list[Floats] | None:
        """Expected log evidence, (n, n) per number of repeats: of the row over the column if the
        row is true.

        None where a model has no answer.
        """
        jacobians = self._jacobians()
        if jacobians is None:
            return None
        scatter = self._scatter(jacobians[0])
        of_one = np.diag(self.noise**2) + scatter @ scatter.T
        roots = [
            np.linalg.cholesky(hypothesis.marginal.posterior.covariance)
            for hypothesis in self.hypotheses.open
        ]
        moves = [jacobian @ root for jacobian, root in zip(jacobians, roots, strict=True)]
        return [self._compare(of_one / count, moves) for count in repeats]

    @property
    def load(self) -> float:
        """The largest value that would be recorded, in the unit of its signal."""
        return float(np.abs(self.predicted).max())

    def _compare(self, of_mean: Floats, moves: Sequence[Floats]) -> Floats:
        """`of_mean` (m, m) is the covariance of the mean over repeats, `moves` (m, p) a root of
        what each hypothesis may still change.
        """
        factor = cholesky(of_mean + self.model_error, lower=True)
        predicted, *white = (
            solve_triangular(factor, rows, lower=True) for rows in (self.predicted.T, *moves)
        )
        # Woodbury: C_l is whitened without the parameters, and their part is subtracted as a (p, p)
        # system.
        columns = []
        for k, root in enumerate(white):
            difference = predicted - predicted[:, [k]]
            along = root.T @ difference
            explained = along * np.linalg.solve(np.eye(len(along)) + root.T @ root, along)
            columns.append(0.5 * ((difference**2).sum(axis=0) - explained.sum(axis=0)))
        return np.column_stack(columns)

    def _jacobians(self) -> list[Floats] | None:
        """Jacobian (m, p) of each hypothesis. All share the columns of the nuisance parameters,
        since all fits lie near the first.
        """
        fits = [hypothesis.fitted for hypothesis in self.hypotheses.open]
        shared = fits[0].coordinates.nuisances
        places = [(0, i) for i in range(shared)] + [
            (k, i) for k, fit in enumerate(fits) for i in range(shared, fit.coordinates.size)
        ]
        # Towards the middle of the prior, where the model has an answer.
        steps = [-WIDE_STEP if fits[k].x[i] > 0.0 else WIDE_STEP for k, i in places]
        points = [
            fits[k].x + step * (np.arange(len(fits[k].x)) == i)
            for (k, i), step in zip(places, steps, strict=True)
        ]
        moved = self.dataset.predict_all(
            [fits[k].coordinates.supposed(x) for (k, _), x in zip(places, points, strict=True)]
        )
        columns = {}
        for (k, i), step, rows in zip(places, steps, moved, strict=True):
            if rows is None:
                return None
            columns[k, i] = (rows - self.predicted[k]) / step
        shared_columns = [columns[0, i] for i in range(shared)]
        jacobians = []
        for k, fit in enumerate(fits):
            own_columns = [columns[k, i] for i in range(shared, fit.coordinates.size)]
            jacobian = np.reshape(shared_columns + own_columns, (-1, len(self.noise)))
            jacobians.append(jacobian.T)
        return jacobians

    def _scatter(self, jacobian: Floats) -> Floats:
        """B (m, k), from the columns of the Jacobian of all nuisance parameters.

        A quantity whose recorded value is simulated does not scatter.
        """
        fitted = self.hypotheses.open[0].fitted
        at = fitted.coordinates.supposed(fitted.x)
        directions = self.dataset.simulator.scatter(at, self.dataset.parts)
        corrected = {direction.name for direction in directions if direction.is_corrected}
        std = {
            name: value
            for name, value in self.hypotheses.found.scatter.std.items()
            if name not in corrected
        }
        space = fitted.coordinates.space
        share = np.array([std.get(name, 0.0) for name in space.names]) / space.prior_std
        return jacobian[:, : len(share)] * share


def predict_information(
    hypotheses: OpenHypotheses, condition: ConditionData
) -> ExpectedInformation | None:
    """Predictions of all hypotheses for a condition that is not recorded yet; None where one of
    them has no answer.
    """
    rows = condition.rows()
    dataset = Dataset((condition,), rows, hypotheses.found.dataset.simulator)
    predictions = dataset.predict_all(
        [h.fitted.coordinates.supposed(h.fitted.x) for h in hypotheses.open]
    )
    if any(answer is None for answer in predictions):
        return None
    return ExpectedInformation(
        hypotheses,
        dataset,
        np.array(predictions),
        rows.noise,
        USUAL_ERROR**2 * discrepancy_covariance(rows),
    )


@dataclass(frozen=True)
class ExperimentDesign:
    """Something that can be done next.

    Parameters
    ----------
    settings
        Its "kind" and settings, as the diagnosis states them.
    words
        The same in words.
    set_up_min, each_min
        Usual minutes: once, and for each repeat.
    repeats
        Numbers of repeats to choose from, ascending.
    simulate
        Makes the condition from the simulator's input, as if recorded once without noise. It
        returns None where the rig may not do that, or where the recording could not be used. It may
        raise SimulationFailed and BadInput.
    protocol
        Name of the protocol file that does it; None where a person does it.
    """

    settings: Mapping[str, object]
    words: str
    set_up_min: float
    each_min: float
    repeats: tuple[int, ...] = (1,)
    simulate: Callable[[Any], ConditionData | None] = lambda _: None
    protocol: str | None = None

    def minutes(self, repeats: int) -> float:
        """Usual duration in minutes."""
        return self.set_up_min + repeats * self.each_min

    def try_simulate(self, hypothesis: Hypothesis) -> ConditionData | None:
        """The condition if the hypothesis is true; None where `simulate` returns None or fails."""
        try:
            return self.simulate(hypothesis.fitted.coordinates.supposed(hypothesis.fitted.x))
        except (SimulationFailed, BadInput):
            return None

    def state(
        self, repeats: int, why: str, pairs: Iterable[tuple[str, str, float]] = ()
    ) -> dict[str, object]:
        """The design as a diagnosis proposes it."""
        minutes = round(self.minutes(repeats), 1)
        separates = [list(pair) for pair in pairs]
        return {
            **self.settings,
            "repeats": repeats,
            "minutes": minutes,
            "separates": separates,
            "why": why,
            "protocol": self.protocol,
        }


@dataclass(frozen=True)
class Option:
    """A design with a number of repeats, and its score.

    Parameters
    ----------
    pairs
        (hypothesis, hypothesis, expected log evidence), the pair that matters most first.
    score
        Per minute.
    load
        The largest value that would be recorded; 0 off the rig.
    """

    design: ExperimentDesign
    repeats: int
    pairs: tuple[tuple[str, str, float], ...]
    score: float
    load: float = 0.0


def list_options(
    hypotheses: OpenHypotheses, designs: Iterable[ExperimentDesign], with_bench_tests: bool
) -> Iterator[Option]:
    """All designs and bench tests that would separate at least two of the hypotheses."""
    conditions = [
        (design, condition)
        for design in designs
        if (condition := design.try_simulate(hypotheses.open[0])) is not None
    ]
    views = [
        (design, view)
        for design, condition in conditions
        if (view := predict_information(hypotheses, condition)) is not None
    ]
    # A bound needs one simulation per hypothesis; the exact score needs one per parameter.
    bounds = [
        _worth(hypotheses, view.bound(d.repeats[-1])).sum() / d.minutes(d.repeats[0])
        for d, view in views
    ]
    tenth = (
        0.1 * max(bounds, default=0.0) or 1.0
    )  # of those that promise about as much, the gentle designs come first
    best = 0.0
    for n in sorted(range(len(views)), key=lambda n: (-round(bounds[n] / tenth), views[n][1].load))[
        :LOOKED_INTO
    ]:
        # Designs come in the order of their bounds, so those that follow promise about as little or
        # less.
        if AS_GOOD_AS * bounds[n] <= best:
            break
        for option in _list_repeats(hypotheses, *views[n]):
            best = max(best, option.score)
            yield option
    for kind, minutes, words in BENCH_TESTS if with_bench_tests else ():
        # A bench test separates hypotheses that differ in the effects it shows.
        can_show = {effect.id for effect in declarations() if effect.bench_test == kind}
        shown = [can_show & set(hypothesis.ids) for hypothesis in hypotheses.open]
        # Hypotheses whose tests show the same effects have the same number.
        numbers = [shown.index(effects) for effects in shown]
        expected = ENOUGH * np.not_equal.outer(numbers, numbers)
        if expected.any():
            yield _make_option(
                hypotheses, ExperimentDesign({"kind": kind}, words, 0.0, minutes), 1, expected
            )


def propose(options: Sequence[Option]) -> dict[str, object] | None:
    """The gentlest of the options that are about as good as the best, with its number of
    repeats; None where there is no option.
    """
    good = AS_GOOD_AS * max((option.score for option in options), default=0.0)
    chosen = min(
        (o for o in options if o.score >= good), key=lambda o: (o.load, -o.score), default=None
    )
    if chosen is None:
        return None
    first, other, expected = chosen.pairs[0]
    reason = (
        f"it tells {first} from {other}, log evidence {expected:.0f} expected, and yields most "
        "per minute of all that was considered"
    )
    return chosen.design.state(chosen.repeats, f"{chosen.design.words}: {reason}", chosen.pairs)


def _list_repeats(
    hypotheses: OpenHypotheses, design: ExperimentDesign, view: ExpectedInformation
) -> Iterator[Option]:
    """An option for each number of repeats that separates a pair; none where the rig may not do
    it under one of the hypotheses.
    """
    if any(design.try_simulate(hypothesis) is None for hypothesis in hypotheses.open[1:]):
        return
    for repeats, expected in zip(design.repeats, view.expect(design.repeats) or (), strict=False):
        option = _make_option(hypotheses, design, repeats, expected, view.load)
        if any(log_evidence >= AS_GOOD_LOG_ODDS for _, _, log_evidence in option.pairs):
            yield option


def _make_option(
    hypotheses: OpenHypotheses,
    design: ExperimentDesign,
    repeats: int,
    expected: Floats,
    load: float = 0.0,
) -> Option:
    """The option with its score and the pairs that it separates: a log evidence of 1 or more,
    mean of both directions.
    """
    names = [" with ".join(hypothesis.ids) or "nothing missing" for hypothesis in hypotheses.open]
    mean = 0.5 * (expected + expected.T)
    worth = _worth(hypotheses, expected)
    pairs = sorted(np.argwhere(np.triu(mean >= 1.0, 1)), key=lambda pair: -worth[*pair])
    separated = tuple((names[k], names[j], round(float(mean[k, j]), 1)) for k, j in pairs)
    return Option(design, repeats, separated, float(worth.sum()) / design.minutes(repeats), load)


def _worth(hypotheses: OpenHypotheses, expected: Floats) -> Floats:
    """Contribution of each pair to the score (n, n), upper triangle, per experiment; `expected`
    is (n, n).
    """
    p = hypotheses.probability
    return np.triu(np.outer(p, p) * np.minimum(0.5 * (expected + expected.T), ENOUGH), 1)
