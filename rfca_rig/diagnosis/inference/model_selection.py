"""Search over hypotheses: nothing missing, every effect, pairs of effects, and triples where two do
not suffice.

`map_fit` fits every hypothesis by Gauss-Newton to its MAP point. Starts come from three generators:

- screening of all effects and all pairs, beside the nominal model and beside the fit without
  effects
- a good fit with one effect more
- an exchange in the best explanation: an effect for another of its family, or a strained nuisance
  parameter for the equivalent effect

The search is successive halving (Jamieson and Talwalkar, AISTATS 2016): many fits on a subset of
the conditions, few on all, and the best of them to convergence. Section 6 of docs/method.md
describes it.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.budget import UNLIMITED, TimeBudget
from rfca_rig.diagnosis.config import (
    ALWAYS_FITTED,
    CLOSE_LOG_EVIDENCE,
    DEFAULT_SEARCH,
    GOOD_FIT,
    IMPLAUSIBLE,
    LARGEST_SET,
    MAX_COORDINATE,
    MAX_RESCALING,
    STRAINED,
    SearchConfig,
)
from rfca_rig.diagnosis.inference.hypotheses import (
    EACH_EFFECT,
    PAIRS,
    TRIPLES,
    WEIGHING,
    ModelSelectionResult,
    weigh_models,
)
from rfca_rig.diagnosis.inference.map_fit import GaussNewton, MapFit, without_scatter
from rfca_rig.diagnosis.inference.parameterization import EffectTerm, Parameterization
from rfca_rig.diagnosis.inference.screening import (
    EffectProbe,
    Point,
    Projection,
    grid_points,
    make_projection,
    probe_effects,
    promising_points,
    terms_of,
)
from rfca_rig.diagnosis.likelihood.covariance import RepeatScatter, estimate_scatter
from rfca_rig.diagnosis.likelihood.marginal_likelihood import make_marginal_likelihood
from rfca_rig.diagnosis.simulator import Dataset
from rfca_rig.errors import SimulationFailed
from rfca_rig.executors.parallel import map_in_processes
from rfca_rig.model.catalogue import families_of, list_related, members_of
from rfca_rig.model.effect import Effect
from rfca_rig.model.families import DRY, RISING_WITH_SPEED

Floats = NDArray[np.float64]
Progress = Callable[[str, float], None]
Terms = tuple[EffectTerm, ...]


# losses rising with speed that are fitted beside a dry one: linear and quadratic; or dry ones
# beside those
COMPANIONS = 2


@dataclass(frozen=True)
class FitStart:
    """Start of a fit: effects, coordinates of all unknowns (p,), and the first columns of the
    Jacobian on all conditions, (m, k).
    """

    terms: Terms
    x: Floats
    jacobian: Floats


@dataclass(frozen=True)
class Screen:
    """Every effect at grid points beside a fit: its signatures, and the projection in which they
    are judged.
    """

    base: MapFit
    projection: Projection
    probes: Sequence[EffectProbe]


@dataclass(frozen=True)
class SearchState:
    """State of the search.

    Parameters
    ----------
    optimizer, scatter
        The optimiser on all conditions, and the scatter from repeat to repeat that its covariance
        has.
    coarse, in_coarse
        The optimiser on a subset of the conditions, and which rows these have, (m,).
    nominal, nothing
        The nominal model, and the fit without effects.
    fits
        The best fit of each set of effects.
    converged
        The fits that need no fresh Jacobian.
    exchanged
        The sets whose parts were exchanged already.
    budget
        When it is spent, fits that are not begun yet are left out.
    """

    optimizer: GaussNewton
    scatter: RepeatScatter
    coarse: GaussNewton
    in_coarse: NDArray[np.bool_]
    nominal: MapFit
    nothing: MapFit
    fits: tuple[MapFit, ...] = ()
    converged: frozenset[MapFit] = frozenset()
    exchanged: frozenset[frozenset[EffectTerm]] = frozenset()
    budget: TimeBudget = UNLIMITED

    @property
    def best(self) -> MapFit:
        """The fit with the greatest log evidence, the discrepancy scale free."""
        return max((self.nothing, *self.fits), key=self.optimizer.free_log_evidence)

    def of_size(self, size: int) -> list[MapFit]:
        """The fits with `size` effects, best first."""
        fits = [fit for fit in self.fits if len(fit.coordinates.choices) == size]
        return sorted(fits, key=self.optimizer.free_log_evidence, reverse=True)

    def with_fits(self, fits: Iterable[MapFit]) -> "SearchState":
        """With these fits added; of each set of effects only the best is kept."""
        ranked = sorted((*self.fits, *fits), key=self.optimizer.free_log_evidence)
        # `ranked` ascends, so of equal keys the best fit comes last and stays in the dictionary.
        return replace(
            self, fits=tuple({frozenset(fit.coordinates.choices): fit for fit in ranked}.values())
        )


class SearchStages:
    """The stages of a search as they begin, and the one in which its time was up.

    Parameters
    ----------
    progress
        Called with the stage and the share that is done.
    budget
        The time that the search may take.
    """

    def __init__(self, progress: Progress, budget: TimeBudget) -> None:
        self._progress = progress
        self._budget = budget
        self._current = ""
        self._ended_in = ""

    def begin(self, stage: str, share: float) -> None:
        """The stage before is over; this one begins."""
        self._ended_in = self.find_end()
        self._current = stage
        self._progress(stage, share)

    def find_end(self) -> str:
        """The stage in which the time was up; "" if it was not."""
        if self._ended_in:
            return self._ended_in
        if self._budget.is_spent:
            return self._current
        return ""


def search_models(
    dataset: Dataset,
    coordinates: Parameterization,
    effects: Sequence[Effect],
    progress: Progress,
    config: SearchConfig = DEFAULT_SEARCH,
    begun: Sequence[MapFit] = (),
) -> ModelSelectionResult:
    """The hypotheses that matter, each at its MAP fit.

    Parameters
    ----------
    dataset
        The observations.
    coordinates
        The nuisance parameters.
    effects
        The effects that may be missing.
    progress
        Called with the current step and the share that is done.
    config
        How widely to search.
    begun
        Fits to the same recordings in other windows, with the same unknowns: sets of effects are
        fitted from there, too.

    Returns
    -------
    ModelSelectionResult
        The fitted hypotheses with evidence and prior.

    Raises
    ------
    SimulationFailed
        Where the nominal model cannot be simulated.
    """
    stages = SearchStages(progress, config.budget)
    stages.begin("nothing missing", 0.0)
    state = _fit_nominal(
        dataset.with_parts(dataset.simulator.forget_history(dataset.parts)), coordinates, config
    )
    no_columns = np.empty((len(dataset.rows.measured), 0))
    known_starts = [FitStart(fit.coordinates.choices, fit.x, no_columns) for fit in begun]
    # These few are fitted even where no time is left: an answer needs a fit to these observations.
    fits = _fit_all(replace(state, budget=UNLIMITED), known_starts)
    state = _prefer_nothing(state, [fit for fit in fits if not fit.ids]).with_fits(
        [fit for fit in fits if fit.ids]
    )
    if config.budget.is_spent:
        return _result(state, coordinates, (), effects, stages)
    stages.begin("screening every effect", 0.1)
    points = grid_points(term for effect in effects for term in terms_of(effect))
    beside_nominal = _screen(state, state.nominal, _projection(state, state.nominal), points)
    # Beside the fit without effects the right effect shows best, unless a nuisance parameter has
    # taken its place there.
    beside_nothing = _screen_promising(
        state, state.nothing, beside_nominal.probes, config.worth_a_fit, config
    )
    stages.begin(EACH_EFFECT, 0.25)
    starts = [
        *_first_sets(
            _single_starts(beside_nominal, config.starts_per_effect, config.worth_a_fit),
            config.singles_coarse,
        ),
        *_first_sets(_single_starts(beside_nothing, 1, config.worth_a_fit), config.beside_nothing),
    ]
    if config.singles_only:
        return _result(
            _converge(_fit_best(state, starts, config.singles_full), 1, config),
            coordinates,
            beside_nominal.probes,
            effects,
            stages,
        )
    state = _fit_best(
        state,
        [*starts, *_family_starts(beside_nothing, starts, config.worth_trying_once)],
        config.singles_full,
    )
    # A history is inferred only from a good fit, and before pairs are compared on it.
    state = _infer_history(
        _exchange(_converge(state, 1, config), beside_nominal.probes, config), GOOD_FIT, config
    )
    stages.begin(PAIRS, 0.5)
    if not _is_adequate(state):
        starts = [
            *_pair_starts(beside_nominal, config.pairs_coarse, config.worth_a_fit),
            *_pair_starts(beside_nothing, config.beside_nothing, config.worth_a_fit),
        ]
        state = _fit_best(state, starts, config.pairs_full)
    # Partners are tried even beside an adequate single effect, then with a higher threshold.
    state = _fit_best(state, _partner_starts(state, 1, beside_nothing, config), config.pairs_full)
    state = _converge(state, 2, config)
    if not _is_adequate(state):
        stages.begin(TRIPLES, 0.7)
        state = _fit_best(
            state, _partner_starts(state, 2, beside_nothing, config), config.triples_full
        )
    stages.begin(WEIGHING, 0.85)
    state = _exchange(state, beside_nominal.probes, config)
    # A set must not win because its subsets were fitted badly, so they are fitted again. Another
    # winner needs the same.
    compared_with_subsets = state.best.ids
    state = _converge_all(_infer_history(_fit_nested(state), 2.0 * GOOD_FIT, config), config)
    if state.best.ids != compared_with_subsets:
        state = _converge_all(_fit_nested(state), config)
    return _result(_refit_nothing(state), coordinates, beside_nominal.probes, effects, stages)


def _fit_nominal(
    dataset: Dataset, coordinates: Parameterization, config: SearchConfig
) -> SearchState:
    """State with the nominal model and the fit without effects."""
    # The scatter needs a fit, and a fit needs the scatter: the first fit counts scatter as
    # discrepancy.
    start = without_scatter(dataset)
    nominal = start.at(coordinates, np.zeros(coordinates.size))
    if nominal is None:
        raise SimulationFailed(
            "the model cannot be computed with its nominal values; look for a slipped "
            "decimal point in its parameters"
        )
    nothing = start.refine(nominal)
    scatter = estimate_scatter(dataset, coordinates.supposed(nothing.x))
    optimizer = GaussNewton(dataset, make_marginal_likelihood(dataset.rows, scatter.columns))
    coarse, rows = _coarsen(dataset, scatter, config.coarse_conditions)
    return SearchState(
        optimizer,
        scatter,
        coarse,
        rows,
        nominal,
        optimizer.converge(nothing),
        budget=config.budget,
    )


def _prefer_nothing(state: SearchState, fits: Sequence[MapFit]) -> SearchState:
    """With the best fit without effects, converged, if one of these is better than the present
    one.
    """
    best = max((state.nothing, *fits), key=state.optimizer.free_log_evidence)
    if best is state.nothing:
        return state
    return replace(state, nothing=state.optimizer.converge(best))


def _coarsen(
    dataset: Dataset, scatter: RepeatScatter, conditions: int
) -> tuple[GaussNewton, NDArray[np.bool_]]:
    """The optimiser on a subset of the conditions, and which of all rows these have."""
    subset, rows = dataset.subset(conditions)
    columns = scatter.columns[rows]
    return GaussNewton(
        subset, make_marginal_likelihood(subset.rows, columns[:, np.any(columns, axis=0)])
    ), rows


def _restrict(fit: MapFit, state: SearchState) -> MapFit:
    """The rows of a fit on the subset of the conditions."""
    return replace(
        fit, predicted=fit.predicted[state.in_coarse], jacobian=fit.jacobian[state.in_coarse]
    )


def _projection(state: SearchState, fit: MapFit) -> Projection:
    """The projection around a fit, on the subset of the conditions."""
    coarse_fit = _restrict(fit, state)
    measured = state.coarse.dataset.rows.measured
    return make_projection(
        coarse_fit, measured, state.coarse.likelihood.level(coarse_fit.linear(measured))
    )


def _screen(
    state: SearchState, base: MapFit, projection: Projection, points: Sequence[Point]
) -> Screen:
    """The effects at these points beside a fit, on the subset of the conditions; `projection` is
    that of the fit.
    """
    return Screen(
        base, projection, probe_effects(state.coarse.dataset, _restrict(base, state), points)
    )


def _screen_again(
    state: SearchState,
    base: MapFit,
    projection: Projection,
    probes: Sequence[EffectProbe],
    config: SearchConfig,
) -> Screen:
    """The effects of `probes` beside another fit, each at the points that promise most there."""
    return _screen(
        state, base, projection, promising_points(projection, probes, config.probed_again)
    )


def _screen_promising(
    state: SearchState,
    base: MapFit,
    probes: Sequence[EffectProbe],
    least: float,
    config: SearchConfig,
) -> Screen:
    """As `_screen_again`, but effects that promise too little to reach `least` of chi-square
    keep their known signatures.
    """
    projection = _projection(state, base)
    promising = {
        probe.choice
        for probe in probes
        if projection.gain(probe.signature)[0] > config.worth_a_probe * least
    }
    again = _screen_again(
        state, base, projection, [probe for probe in probes if probe.choice in promising], config
    )
    return replace(
        again, probes=[*again.probes, *(probe for probe in probes if probe.choice not in promising)]
    )


def _first_sets(starts: Sequence[FitStart], count: int) -> list[FitStart]:
    """The starts of the first `count` sets of effects."""
    sets = list(dict.fromkeys(frozenset(start.terms) for start in starts))[:count]
    return [start for start in starts if frozenset(start.terms) in sets]


def _single_starts(screen: Screen, count: int, least: float) -> list[FitStart]:
    """At most `count` grid points of every effect that promises `least` of chi-square, most
    promising first.
    """
    by_term: dict[EffectTerm, list[tuple[float, EffectProbe]]] = {}
    for probe in screen.probes:
        by_term.setdefault(probe.choice, []).append(
            (screen.projection.gain(probe.signature)[0], probe)
        )
    pairs: list[tuple[float, EffectProbe]] = []
    for points in by_term.values():
        points.sort(key=lambda pair: -pair[0])
        if points[0][0] < least:
            continue
        # A second point must promise at least half as much as the first.
        pairs += [pair for pair in points[:count] if pair[0] >= 0.5 * points[0][0]]
    return [_beside(screen.base, (probe,)) for _, probe in sorted(pairs, key=lambda pair: -pair[0])]


def _family_starts(screen: Screen, starts: Sequence[FitStart], least: float) -> list[FitStart]:
    """The most promising effect of every family that has no start yet, if it promises `least` of
    chi-square.
    """
    tried = list_related(start.terms[-1].effect.id for start in starts)
    by_family: dict[str, FitStart] = {}
    for start in _single_starts(screen, 1, least):
        effect_id = start.terms[-1].effect.id
        for family in families_of(effect_id):
            if effect_id not in tried:
                by_family.setdefault(family.id, start)
    return list(by_family.values())


def _pair_starts(screen: Screen, count: int, least: float) -> list[FitStart]:
    """The best grid points of at most `count` pairs of effects that promise `least` of
    chi-square together, most promising first.
    """
    probes = screen.probes
    if len(probes) < 2:
        return []
    gain = _joint_gains(screen.projection, probes)
    best: dict[frozenset[EffectTerm], tuple[float, int, int]] = {}
    for i, j in combinations(range(len(probes)), 2):
        pair = frozenset((probes[i].choice, probes[j].choice))
        if (
            probes[i].choice.effect.id != probes[j].choice.effect.id
            and gain[i, j] > best.get(pair, (least, 0, 0))[0]
        ):
            best[pair] = (float(gain[i, j]), i, j)
    ranked = sorted(best.values(), reverse=True)[:count]
    return [_beside(screen.base, (probes[i], probes[j])) for _, i, j in ranked]


def _joint_gains(projection: Projection, probes: Sequence[EffectProbe]) -> Floats:
    """Chi-square that probes i and j could remove together, (k, k), each signature scaled by a
    factor of 0 to MAX_RESCALING.
    """
    white = projection.whitening(np.column_stack([probe.signature for probe in probes]))
    # Closed solution of the 2 x 2 normal equations for all pairs at once, by Cramer's rule.
    gram = white.T @ projection.project(white)
    match = white.T @ projection.residual
    squares = np.diag(gram)
    product = np.outer(squares, squares)
    # Two almost parallel signatures have no useful determinant; the floor keeps the quotient
    # finite.
    determinant = np.maximum(product - gram**2, 1e-9 * product + 1e-300)
    first = np.clip(
        (np.outer(match, squares) - gram * match[None, :]) / determinant, 0.0, MAX_RESCALING
    )
    # The factors are limited, so the gain is evaluated by its quadratic form, not by the formula
    # for the optimum.
    second = first.T
    quadratic = (
        first**2 * squares[:, None] + 2.0 * first * second * gram + second**2 * squares[None, :]
    )
    return np.asarray(2.0 * (first * match[:, None] + second * match[None, :]) - quadratic)


def _partner_starts(
    state: SearchState, size: int, screen: Screen, config: SearchConfig
) -> list[FitStart]:
    """One effect more beside the best sets of a size, screened beside the fit of that set.

    Effects that promise little there keep their signatures beside the fit without effects.
    """
    starts: list[FitStart] = []
    if state.budget.is_spent:
        return starts
    if _is_adequate(state):
        least = config.worth_beside_a_good_fit
    else:
        least = config.worth_a_fit
    parents = state.of_size(size)[:1]
    if size == 1 and least == config.worth_a_fit:
        parents = state.of_size(size)[: config.parents]
    for parent in parents:
        others = [probe for probe in screen.probes if probe.choice.effect.id not in parent.ids]
        beside_parent = _screen_promising(state, parent, others, least, config)
        starts += _single_starts(beside_parent, 1, least)[: config.partners]
        starts += _companion_starts(beside_parent)
    return starts


def _companion_starts(screen: Screen) -> list[FitStart]:
    """Losses that rise with speed beside a single dry loss, and the other way round: the best
    COMPANIONS, however little they promise.

    A bearing has both, and each of them makes up for most of the other.
    """
    for family, other in ((DRY, RISING_WITH_SPEED), (RISING_WITH_SPEED, DRY)):
        if len(screen.base.ids) == 1 and screen.base.ids[0] in members_of(family):
            probes = [
                probe for probe in screen.probes if probe.choice.effect.id in members_of(other)
            ]
            return _single_starts(replace(screen, probes=probes), 1, 0.0)[:COMPANIONS]
    return []


def _beside(base: MapFit, probes: Sequence[EffectProbe]) -> FitStart:
    terms = (*base.coordinates.choices, *(probe.choice for probe in probes))
    return FitStart(terms, np.concatenate([base.x, *(probe.z for probe in probes)]), base.jacobian)


def _fit_best(state: SearchState, starts: Sequence[FitStart], full: int) -> SearchState:
    """Fit the starts on the subset, keep the best of each set, and fit the best `full` of these
    sets on all conditions.
    """
    fitted = [fit.coordinates.choices for fit in state.fits]
    known = {frozenset(terms) for terms in fitted if len(terms) > 1}
    wanted = [start for start in starts if frozenset(start.terms) not in known]
    without = state.coarse.free_log_evidence(_restrict(state.nothing, state))

    def fit_coarsely(start: FitStart) -> tuple[float, Floats] | None:
        if state.budget.is_spent:
            return None
        fit = _fit_on_subset(state, start, without)
        if fit is None:
            return None
        return (state.coarse.free_log_evidence(fit), fit.x)

    best_of_set: dict[frozenset[EffectTerm], tuple[float, FitStart]] = {}
    for start, end in zip(wanted, map_in_processes(fit_coarsely, wanted), strict=True):
        if end is None:
            continue
        gain, x = end
        terms = frozenset(start.terms)
        if terms not in best_of_set or gain >= best_of_set[terms][0]:
            best_of_set[terms] = (gain, FitStart(start.terms, x, start.jacobian))
    ranked = sorted(best_of_set.values(), key=lambda end: -end[0])[:full]
    # The best ALWAYS_FITTED sets are always fitted: the best one without an effect measures the
    # support of that effect.
    near = []
    for rank, (gain, start) in enumerate(ranked):
        if rank < ALWAYS_FITTED or gain > ranked[0][0] - CLOSE_LOG_EVIDENCE:
            near.append(start)
    return state.with_fits(_fit_all(state, near))


def _fit_on_subset(state: SearchState, start: FitStart, without: float) -> MapFit | None:
    """MAP fit on the subset; None where the model has no answer.

    Effects contain the model without them, which has the log evidence `without`. A fit that is
    worse has not arrived, for example in the valley where larger masses make up for larger torques.
    """
    fit = _fit(state.coarse, state, start, 2)
    if fit is None or state.coarse.free_log_evidence(fit) >= without:
        return fit
    return state.coarse.converge(fit)


def _fit_all(state: SearchState, starts: Sequence[FitStart]) -> list[MapFit]:
    """MAP fits on all conditions, in parallel; without those where the model has no answer, and
    those for which there is no time.
    """

    def fit_in_time(start: FitStart) -> MapFit | None:
        if state.budget.is_spent:
            return None
        return _fit(state.optimizer, state, start, 5)

    fits = map_in_processes(
        fit_in_time,
        starts,
        _list_shared(state, (start.terms for start in starts)),
    )
    return [fit for fit in fits if fit is not None]


def _list_shared(state: SearchState, hypotheses: Iterable[Terms]) -> list[object]:
    """What the fits of these hypotheses refer to, and the state too."""
    return [state.nominal.coordinates.space, *(term for terms in hypotheses for term in terms)]


def _fit(optimizer: GaussNewton, state: SearchState, start: FitStart, levels: int) -> MapFit | None:
    """MAP fit from a start; None where the model has no answer."""
    known = start.jacobian if optimizer is state.optimizer else start.jacobian[state.in_coarse]
    fit = optimizer.at(state.nominal.coordinates.with_terms(start.terms), start.x, known)
    if fit is None:
        return None
    return optimizer.refine(fit, levels=levels)


def _converge(state: SearchState, size: int, config: SearchConfig) -> SearchState:
    """Converge the best fits of a size with fresh Jacobians, unless they are far behind the best
    of all.
    """
    best = state.of_size(size)[: config.converged]
    least = (
        max((state.optimizer.free_log_evidence(fit) for fit in state.fits), default=0.0)
        - CLOSE_LOG_EVIDENCE
    )
    near = [fit for fit in best if fit is best[0] or state.optimizer.free_log_evidence(fit) > least]
    fits = _refine_all(
        state, state.optimizer.converge, [fit for fit in near if fit not in state.converged]
    )
    return replace(state.with_fits(fits), converged=state.converged.union(fits))


def _refine_all(
    state: SearchState, refine: Callable[[MapFit], MapFit], fits: Sequence[MapFit]
) -> list[MapFit]:
    """The fits after `refine`, in parallel; as they are where there is no time."""
    if state.budget.is_spent:
        return list(fits)
    return map_in_processes(
        refine, fits, _list_shared(state, (fit.coordinates.choices for fit in fits))
    )


def _converge_all(state: SearchState, config: SearchConfig) -> SearchState:
    """The same for every size."""
    for size in range(1, LARGEST_SET + 2):
        state = _converge(state, size, config)
    return state


def _is_adequate(state: SearchState) -> bool:
    """Whether the best explanation leaves a normal model error only, with plausible nuisance
    parameters.
    """
    marginal = state.optimizer.evaluate(state.best)
    return (
        marginal.error < GOOD_FIT
        and marginal.max_nuisance_shift(state.nominal.coordinates.nuisances) < IMPLAUSIBLE
    )


def _infer_history(state: SearchState, enough: float, config: SearchConfig) -> SearchState:
    """Infer how conditions were approached from the best explanation, if its error is at most
    `enough`; where that changes the history, the repeat scatter and all fits follow.

    A bad explanation would give a wrong history.
    """
    best = state.best
    if state.budget.is_spent or state.optimizer.evaluate(best).error > enough:
        return state
    old_dataset = state.optimizer.dataset
    dataset = old_dataset.with_parts(
        old_dataset.simulator.infer_history(old_dataset.parts, best.coordinates.supposed, best.x)
    )
    if dataset is old_dataset:
        return state
    scatter = estimate_scatter(dataset, best.coordinates.supposed(best.x))
    optimizer = GaussNewton(dataset, make_marginal_likelihood(dataset.rows, scatter.columns))
    coarse, rows = _coarsen(dataset, scatter, config.coarse_conditions)
    evaluated = [
        fit
        for old in (state.nominal, state.nothing, *state.fits)
        if (fit := optimizer.at(old.coordinates, old.x, old.jacobian))
    ]
    # Where a fit has no answer under the new history, the old state stays complete.
    if len(evaluated) < 2 + len(state.fits):
        return state
    nominal, *fits = evaluated
    least = max(map(optimizer.free_log_evidence, fits)) - CLOSE_LOG_EVIDENCE
    # Fits far behind are not refined, only evaluated where they are.
    near = []
    for number, fit in enumerate(fits):
        if number == 0 or optimizer.free_log_evidence(fit) > least:
            near.append(number)
    refined = _refine_all(state, optimizer.refine, [fits[number] for number in near])
    for number, fit in zip(near, refined, strict=True):
        fits[number] = fit
    nothing, *others = fits
    return replace(
        state,
        optimizer=optimizer,
        scatter=scatter,
        coarse=coarse,
        in_coarse=rows,
        nominal=nominal,
        nothing=nothing,
        fits=tuple(others),
        converged=frozenset(),
    )


def _exchange(
    state: SearchState, probes: Sequence[EffectProbe], config: SearchConfig
) -> SearchState:
    """Exchange a part of the best explanation, or of the fit without effects, for something that
    does much the same.

    An effect is exchanged for another one of its family, or for itself with another size. A
    strained nuisance parameter is exchanged for the equivalent effect. Everything else begins
    unchanged: a rival that began at the prior means may have ended in another mode, and would lose
    by that alone. `probes` are the effects around the nominal model.
    """
    if state.budget.is_spent:
        return state
    terms = tuple(dict.fromkeys(probe.choice for probe in probes))
    parents = [
        fit
        for fit in dict.fromkeys((state.nothing, state.best))
        if frozenset(fit.coordinates.choices) not in state.exchanged
    ]
    starts: list[FitStart] = []
    for parent in parents:
        for base, wanted in _without_each_part(state, parent, terms):
            suitable = [probe for probe in probes if probe.choice.effect.id in wanted]
            screen = _screen_again(state, base, _projection(state, base), suitable, config)
            ranked = _single_starts(screen, 1, 0.0)
            # One variant per effect; `ranked` descends, so in reversed order the best one stays in
            # the dictionary.
            starts += {start.terms[-1].effect.id: start for start in reversed(ranked)}.values()
    # A fit whose nuisance parameters had to leave what is plausible may have ended in another mode
    # than that of their prior means.
    strained = [fit for fit in parents if fit.max_nuisance_shift > IMPLAUSIBLE and fit.ids]
    starts += [
        FitStart(fit.coordinates.choices, fit.at_prior_means, fit.jacobian) for fit in strained
    ]
    fits = _fit_all(state, starts)
    after = state.with_fits(fits)
    least = state.optimizer.free_log_evidence(after.best) - CLOSE_LOG_EVIDENCE
    near = [
        fit for fit in fits if fit in after.fits and state.optimizer.free_log_evidence(fit) > least
    ]
    converged = _refine_all(state, state.optimizer.converge, near)
    exchanged = state.exchanged.union(frozenset(parent.coordinates.choices) for parent in parents)
    return replace(
        after.with_fits(converged), converged=state.converged.union(converged), exchanged=exchanged
    )


def _without_each_part(
    state: SearchState, parent: MapFit, terms: Terms
) -> Iterator[tuple[MapFit, frozenset[str]]]:
    """The parent without one of its effects, or with a strained nuisance parameter at its prior
    mean, and the ids that may take that place.

    The place of an effect is open to its family, and to effects that are equivalent to a strained
    nuisance parameter.
    """
    coordinates = parent.coordinates
    strained = {
        name: index
        for index, name in enumerate(coordinates.space.names)
        if abs(parent.x[index]) > STRAINED
    }
    equivalent = {
        term.effect.id: strained[term.effect.same_as]
        for term in terms
        if term.effect.same_as in strained
    }
    for number, term in enumerate(coordinates.choices):
        relatives = list_related((term.effect.id,)) | {term.effect.id} | equivalent.keys()
        base = state.optimizer.without(parent, number)
        if base is not None:
            yield base, relatives - (set(parent.ids) - {term.effect.id})
    # The effect replaces a value that is not credible, so that it may be one more than a set has
    # otherwise.
    if len(coordinates.choices) <= LARGEST_SET:
        for index in sorted(set(equivalent.values())):
            wanted = frozenset(effect for effect, at in equivalent.items() if at == index) - set(
                parent.ids
            )
            x = np.where(np.arange(coordinates.size) == index, 0.0, parent.x)
            if wanted:
                base = state.optimizer.at(coordinates, x, parent.jacobian)
            else:
                base = None
            if base is not None:
                yield base, wanted


def _fit_nested(state: SearchState) -> SearchState:
    """Fit the subsets of the best set again from its optimum: a set must not win because its
    subsets were fitted badly.

    Each subset also begins with the contribution of the missing effect transferred to the
    equivalent nuisance parameter.
    """
    if state.budget.is_spent:
        return state
    best = state.best
    starts: list[FitStart] = []
    coordinates = best.coordinates
    if len(coordinates.choices) > 1:
        for number, term in enumerate(coordinates.choices):
            terms = tuple(other for i, other in enumerate(coordinates.choices) if i != number)
            x = np.delete(best.x, np.arange(coordinates.size)[coordinates.part(number)])
            of_nuisances = best.jacobian[:, : coordinates.nuisances]
            starts.append(FitStart(terms, x.copy(), of_nuisances))
            if term.effect.same_as not in coordinates.space.names:
                continue
            predicted = state.optimizer.dataset.predicted(coordinates.with_terms(terms).supposed(x))
            if predicted is not None:
                index = coordinates.space.names.index(term.effect.same_as)
                # Least squares in units of noise: the shift of the nuisance parameter that replaces
                # the effect best.
                along = best.jacobian[:, index] / state.optimizer.dataset.rows.noise
                change = (best.predicted - predicted) / state.optimizer.dataset.rows.noise
                share = float(along @ change) / max(float(along @ along), 1e-300)
                x[index] = np.clip(x[index] + share, -MAX_COORDINATE, MAX_COORDINATE)
                starts.append(FitStart(terms, x, of_nuisances))
    return state.with_fits(_fit_all(state, starts))


def _refit_nothing(state: SearchState) -> SearchState:
    """Fit the hypothesis without effects also from the nuisance values of the best explanation;
    the better fit is converged.
    """
    if state.budget.is_spent:
        return state
    nuisances = state.nominal.coordinates.nuisances
    again = _fit(
        state.optimizer,
        state,
        FitStart((), state.best.x[:nuisances], state.best.jacobian[:, :nuisances]),
        5,
    )
    best = max(
        (fit for fit in (state.nothing, again) if fit is not None),
        key=state.optimizer.free_log_evidence,
    )
    return replace(state, nothing=state.optimizer.converge(best))


def _result(
    state: SearchState,
    coordinates: Parameterization,
    probes: Sequence[EffectProbe],
    effects: Sequence[Effect],
    stages: SearchStages,
) -> ModelSelectionResult:
    optimizer = state.optimizer
    nominal = optimizer.at(coordinates, state.nominal.x, state.nominal.jacobian) or state.nominal
    nothing, named = weigh_models(optimizer, state.nothing, state.fits, len(effects))
    unknown = optimizer.evaluate_unlisted(state.nothing)
    return ModelSelectionResult(
        nominal,
        nothing,
        unknown,
        named,
        tuple(probes),
        state.coarse.likelihood,
        state.in_coarse,
        state.scatter,
        optimizer.likelihood,
        optimizer.dataset,
        stages.find_end(),
    )
