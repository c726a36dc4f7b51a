"""Residual force at a place as a function of one argument, with an uncertainty band and without a
formula.

The law is piecewise linear between values at knots. It acts in the simulator itself, beside the
base hypothesis, so that the motion responds to it. The response of the observations to each value
is found by finite differences there, and recomputed where the fit moves to.

The values have the smooth Gaussian prior of `law`, with the size and roughness of the greatest
evidence over a grid. All nuisance parameters stay free, and the covariance of the data includes the
discrepancy.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.config import CLOSE_LOG_EVIDENCE
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis, ModelSelectionResult
from rfca_rig.diagnosis.inference.map_fit import GaussNewton, MapFit
from rfca_rig.diagnosis.inference.parameterization import EffectTerm
from rfca_rig.diagnosis.likelihood.marginal_likelihood import (
    LinearModel,
    loo_log_densities,
    loo_residuals,
    products_without,
)
from rfca_rig.diagnosis.residual_force.law import (
    ROUGHNESS,
    SIZES,
    LawArgument,
    MeasuredLaw,
    prior_root,
)
from rfca_rig.diagnosis.residual_force.law_arguments import (
    add_own_law,
    arguments_at,
    compute_nominal_law,
    courses,
    find_visited_range,
    make_argument,
    place_knots,
)
from rfca_rig.diagnosis.residual_force.law_memory import detect_memory
from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.model.effect import Parameter
from rfca_rig.model.parameters import LawTable, PresentEffect
from rfca_rig.model.tabulated_law import TABULATED_LAW

Floats = NDArray[np.float64]

# Of the first prior. A fit from no law begins nearly straight: with a free law, its first steps go
# so far that it may end in a wrong optimum. Of 9 starts 1e-3 prior deviations apart, a friction law
# fell 250 or more short of the best log evidence in 3 with 0.3, in 2 with 0.1; of 21 with 0.03,
# none by more than 75. A law that is given is not pulled straight. The likeliest roughness follows.
FIRST_SIZE = 1.0
STRAIGHT = 0.03
FREE = 0.3
CONVERGE = 1  # recomputations of the whole Jacobian at the end
# steps of each of the two fits; a friction law changes the motion that it depends on
LEVELS = 2
ROUNDS = 4
# of a prior deviation: the base law of the model is a smooth function of the nuisance parameters
STEP = 1e-4


@dataclass(frozen=True)
class LawStart:
    """Start of a fit: the unknowns of the base (p,), and the values (k,) of the law for an
    argument at its knots; None for no law of it.
    """

    x: Floats
    values: Callable[[str, Floats], Floats | None]


@dataclass(frozen=True)
class _Fits:
    """The most probable law and those about as probable, and the range of its argument."""

    laws: list[Hypothesis]
    visited: tuple[float, float]


@dataclass(frozen=True)
class TableTerm(EffectTerm):
    """A tabulated law as part of a hypothesis: `root` (k rows of k) times its standard normal
    coordinates (k,) are the values.
    """

    argument: LawArgument = field(kw_only=True)
    knots: tuple[float, ...] = ()
    root: tuple[tuple[float, ...], ...] = ()

    @property
    def free(self) -> tuple[Parameter, ...]:
        """One coordinate per knot; a normal parameter from -2 to 2 equals its own coordinate."""
        return tuple(
            Parameter(f"coordinate{number}", -2.0, 2.0) for number in range(1, len(self.knots) + 1)
        )

    def values(self, z: Floats) -> Floats:
        """Values at the knots (k,) for coordinates z (k,)."""
        return np.asarray(np.array(self.root) @ z)

    def present(self, z: Floats) -> PresentEffect:
        """The law at coordinates z (k,)."""
        table = LawTable(
            self.argument.place,
            self.argument.name,
            self.knots,
            tuple(float(value) for value in self.values(z)),
        )
        return PresentEffect(TABULATED_LAW, table=table)


def measure_law(
    found: ModelSelectionResult,
    place: str,
    base: Hypothesis,
    arguments: Sequence[str] = (),
    start: LawStart | None = None,
) -> MeasuredLaw:
    """The law at a place for the argument that predicts held-out conditions best.

    Parameters
    ----------
    found
        What a search left: its data, covariance and hypotheses.
    place
        As in `rfca_rig.model.tabulated_law`.
    base
        The hypothesis that the law is put beside, usually `found.nothing`.
    arguments
        Those to choose from; without any, all that make sense at the place.
    start
        Where a fit begins beside the base itself, for example at a law of the catalogue.

    Raises
    ------
    BadInput
        For a place or an argument that is not known, and where no recording moves.
    SimulationFailed
        Where the model has no answer with any law there.
    """
    supposed = base.fitted.coordinates.supposed(base.fitted.x)
    names = arguments or arguments_at(place, supposed)
    return measure_best_law(
        found, [make_argument(place, argument) for argument in names], base, start
    )


def measure_best_law(
    found: ModelSelectionResult,
    arguments: Sequence[LawArgument],
    base: Hypothesis,
    start: LawStart | None = None,
    renew_range: bool = False,
) -> MeasuredLaw:
    """The law for the argument that predicts held-out conditions best, for any kind of rig; all
    arguments are at one place.

    With `renew_range` each law is fitted again over the range of the motion with the law. If the
    base brakes too little, windows that begin at a measured state reach speeds that were never
    recorded.
    """
    fitted = [fit_law(found, argument, base, start, renew_range) for argument in arguments]
    laws = [law for law in fitted if law is not None]
    if not laws:
        raise SimulationFailed(
            f"the model cannot be computed with a tabulated law at {arguments[0].place}; "
            "look at the base hypothesis first"
        )
    best = max(laws, key=lambda law: law.log_density_gain)
    return with_memory_test(found, best)


def with_memory_test(found: ModelSelectionResult, law: MeasuredLaw) -> MeasuredLaw:
    """The law with the result of the memory test. Raises SimulationFailed where the model has no
    answer.
    """
    fitted = law.hypothesis.fitted
    table = law.present.table
    assert table is not None
    linear = fitted.linear(found.dataset.rows.measured)
    supposed = fitted.coordinates.supposed(fitted.x)
    term, part = _term_of(fitted)
    # The Jacobian is by coordinates; the inverse root turns it into one by values of the law.
    slopes = fitted.jacobian[:, part] @ np.linalg.inv(np.array(term.root))
    memory = detect_memory(found, linear, supposed, table, term.argument.plausible, slopes)
    if not memory.has_memory:
        return replace(law, memory=memory)
    half = 0.5 * (
        memory.rising - memory.falling
    )  # no single curve is right: the band holds both branches
    whole_std = law.whole_std
    if law.whole is not None and whole_std is not None:
        # A law of floor friction is a share of the coefficient, so its band is converted to the
        # coefficient.
        whole_std = np.hypot(
            whole_std,
            half * (law.whole / (1.0 + law.values) if law.place == "floor_friction" else 1.0),
        )
    return replace(law, memory=memory, std=np.hypot(law.std, half), whole_std=whole_std)


def base_without(found: ModelSelectionResult, hypothesis: Hypothesis, effect: str) -> Hypothesis:
    """The hypothesis without one of its effects, fitted again: the base of a law that takes the
    place of the effect.

    Raises BadInput where it has no such effect, SimulationFailed where the model has no answer.
    """
    if effect not in hypothesis.ids:
        raise BadInput(
            f"effect {effect}: is not in the hypothesis, which has "
            f"{', '.join(hypothesis.ids) or 'none'}"
        )
    optimizer = GaussNewton(found.dataset, found.likelihood)
    remaining = optimizer.without(hypothesis.fitted, hypothesis.ids.index(effect))
    if remaining is None:
        raise SimulationFailed(f"the model has no answer without {effect}")
    return _hypothesis(optimizer, optimizer.converge(optimizer.refine(remaining)))


def fit_law(
    found: ModelSelectionResult,
    argument: LawArgument,
    base: Hypothesis,
    start: LawStart | None = None,
    renew_range: bool = False,
) -> MeasuredLaw | None:
    """The law of one argument over its range in the motion of the base; with `renew_range` fitted
    again over that with the law.

    None where the argument hardly changes, or where the model has no answer.
    """
    # The missing law may have drawn the nuisance parameters away, so a fit also begins at their
    # prior means.
    starts = [
        (STRAIGHT, LawStart(x, lambda _, knots: np.zeros(len(knots))))
        for x in (base.fitted.x, base.fitted.at_prior_means)
    ]
    if start is not None:
        starts.append((FREE, start))
    fits = _fit(found, argument, base, starts, base)
    if fits is not None and renew_range:
        # The motion with the law may have another range. If it cannot be fitted there, the first
        # fit is used.
        fits = (
            _fit(found, argument, base, [(FREE, _start_at(law)) for law in fits.laws], fits.laws[0])
            or fits
        )
    if fits is None:
        return None
    return _make_measured_law(found, base, fits)


def _fit(
    search: ModelSelectionResult,
    argument: LawArgument,
    base: Hypothesis,
    starts: Sequence[tuple[float, LawStart]],
    moving: Hypothesis,
) -> _Fits | None:
    """The law over its range in the motion of `moving`, from starts with the roughness of their
    first prior.
    """
    optimizer = GaussNewton(search.dataset, search.likelihood)
    supposed = moving.fitted.coordinates.supposed(moving.fitted.x)
    visited = find_visited_range(courses(search.dataset, supposed, argument.place, argument.name))
    if visited[1] - visited[0] < 1e-9:
        return None
    knots = place_knots(visited, argument.is_signed)
    laws = []
    for roughness, begin in starts:
        values = begin.values(argument.name, knots)
        first = _term(argument, knots, FIRST_SIZE, roughness)
        if values is None:
            continue
        coordinates = base.fitted.coordinates.with_terms((*base.fitted.coordinates.choices, first))
        # The values are the root times the coordinates, so the coordinates follow by solving.
        start = optimizer.at(
            coordinates, np.append(begin.x, np.linalg.solve(np.array(first.root), values))
        )
        if start is not None:
            # Twice: the prior is chosen by the Jacobian of the first fit, and the second fit uses
            # it.
            fit = _with_likeliest_prior(optimizer, optimizer.refine(start, LEVELS, ROUNDS))
            laws.append(
                _hypothesis(
                    optimizer, optimizer.converge(optimizer.refine(fit, LEVELS, ROUNDS), CONVERGE)
                )
            )
    # Fits that are about as probable as the best are kept: their differences widen the band.
    laws.sort(key=lambda law: -law.marginal.log_evidence)
    if laws:
        return _Fits(
            [
                law
                for law in laws
                if law.marginal.log_evidence > laws[0].marginal.log_evidence - CLOSE_LOG_EVIDENCE
            ],
            visited,
        )
    return None


def _start_at(law: Hypothesis) -> LawStart:
    """Start of a fit over other knots, from a law that was fitted."""
    term, part = _term_of(law.fitted)
    values = term.values(law.fitted.x[part])
    return LawStart(
        law.fitted.x[: part.start], lambda _, knots: np.interp(knots, term.knots, values)
    )


def _term(argument: LawArgument, knots: Floats, size: float, roughness: float) -> TableTerm:
    """The term with a prior of this roughness and size; the size is a multiple of the plausible
    one.
    """
    table = LawTable(argument.place, argument.name, tuple(map(float, knots)), (0.0,) * len(knots))
    rows = tuple(tuple(map(float, row)) for row in _root(argument, knots, size, roughness))
    return TableTerm(argument.effect_of(table), argument=argument, knots=table.knots, root=rows)


def _root(argument: LawArgument, knots: Floats, size: float, roughness: float) -> Floats:
    return prior_root(knots, size * argument.plausible, roughness, argument.zero_at_zero)


def _with_likeliest_prior(optimizer: GaussNewton, fit: MapFit) -> MapFit:
    """The fit at the same values with the prior size and roughness of the greatest evidence, by
    its present Jacobian.
    """
    term, part = _term_of(fit)
    root = np.array(term.root)
    knots = np.array(term.knots)
    law = root @ fit.x[part]
    slopes = fit.jacobian[:, part] @ np.linalg.inv(root)
    target = fit.linear(optimizer.dataset.rows.measured).target
    best = fit
    most = -np.inf
    for size, roughness in product(SIZES, ROUGHNESS):
        other = _term(term.argument, knots, size, roughness)
        jacobian = np.column_stack([fit.jacobian[:, : part.start], slopes @ np.array(other.root)])
        log_evidence = optimizer.likelihood.evaluate(LinearModel(target, jacobian)).log_evidence
        if log_evidence > most:
            coordinates = fit.coordinates.with_terms((*fit.coordinates.choices[:-1], other))
            x = np.append(fit.x[: part.start], np.linalg.solve(np.array(other.root), law))
            size_of = np.linalg.norm(optimizer.likelihood.usual(jacobian), axis=0)
            best = replace(
                fit, coordinates=coordinates, x=x, jacobian=jacobian, column_norms=size_of
            )
            most = log_evidence
    return best


def _term_of(fitted: MapFit) -> tuple[TableTerm, slice]:
    """The tabulated law of a fit, its last term, and the slice of its coordinates."""
    term = fitted.coordinates.choices[-1]
    assert isinstance(term, TableTerm)
    return term, fitted.coordinates.part(len(fitted.coordinates.choices) - 1)


def _hypothesis(optimizer: GaussNewton, fitted: MapFit) -> Hypothesis:
    return Hypothesis(fitted.ids, fitted, optimizer.evaluate(fitted), 0.0)


def _make_measured_law(search: ModelSelectionResult, base: Hypothesis, fits: _Fits) -> MeasuredLaw:
    """The most probable fit as plain values, with standard deviations that include the spread
    between equally good fits.
    """
    # Covariance (p, p) between fits that are about as probable, as of a mixture of all; zero for a
    # single one. Contact makes the misfit rough, so fits from different starts stop at different
    # places.
    estimates = np.array([_estimate(law) for law in fits.laws])
    apart = estimates - estimates.mean(axis=0)
    law = fits.laws[0]
    spread = np.asarray(apart.T @ apart / len(fits.laws))
    term, part = _term_of(law.fitted)
    argument = term.argument
    values = _estimate(law)[part]
    knots = np.array(term.knots)
    covariances = [
        covariance + spread
        for covariance in (_covariance(search, law), _jackknife_covariance(search, law))
    ]
    whole = _whole(search, law, covariances)
    before, after = (_compute_held_out_misfit(search, hypothesis) for hypothesis in (base, law))
    densities = [_compute_held_out_log_density(search, hypothesis) for hypothesis in (base, law)]
    return MeasuredLaw(
        place=argument.place,
        argument=argument.name,
        argument_unit=argument.unit,
        unit=argument.value_unit,
        knots=knots,
        values=values,
        std=_widest([covariance[part, part] for covariance in covariances]),
        whole=None if whole is None else whole[0],
        whole_std=None if whole is None else whole[1],
        visited=fits.visited,
        explained=1.0 - after / before,
        log_density_gain=densities[1] - densities[0],
        log_evidence_gain=law.marginal.log_evidence - base.marginal.log_evidence,
        base=base.ids,
        hypothesis=law,
    )


def _estimate(law: Hypothesis) -> Floats:
    """Nuisance parameters and values of the law, (p,)."""
    term, part = _term_of(law.fitted)
    mean = law.marginal.posterior.mean
    return np.asarray(_to_values(len(mean), part, np.array(term.root)) @ mean)


def _widest(covariances: Sequence[Floats]) -> Floats:
    """Larger standard deviation (k,) at each knot: where conditions disagree, the posterior
    alone is too narrow.
    """
    return np.asarray(np.sqrt(np.max([np.diag(covariance) for covariance in covariances], axis=0)))


def _to_values(size: int, part: slice, root: Floats) -> Floats:
    """Matrix (p, p) that turns the coordinates of a law into its values and leaves the other
    unknowns unchanged.
    """
    turn = np.eye(size)
    turn[part, part] = root
    return turn


def _covariance(search: ModelSelectionResult, law: Hypothesis) -> Floats:
    """Covariance (p, p) of nuisance parameters and values, averaged over sizes and roughness of
    the prior by their evidence.
    """
    term, part = _term_of(law.fitted)
    linear = law.fitted.linear(search.dataset.rows.measured)
    root = np.array(term.root)
    knots = np.array(term.knots)
    slopes = linear.jacobian[:, part] @ np.linalg.inv(root)
    estimate = _estimate(law)
    logs = []
    moments = []
    for size, roughness in product(SIZES, ROUGHNESS):
        other = _root(term.argument, knots, size, roughness)
        judged = search.likelihood.evaluate(
            LinearModel(
                linear.target, np.column_stack([linear.jacobian[:, : part.start], slopes @ other])
            )
        )
        turn = _to_values(len(estimate), part, other)
        off = turn @ judged.posterior.mean - estimate
        logs.append(judged.log_evidence)
        # Second moment about the estimate, not about the mean of each prior: the differences
        # between priors count, too.
        moments.append(turn @ judged.posterior.covariance @ turn.T + np.outer(off, off))
    # The maximum is subtracted to avoid an underflow.
    weights = np.exp(np.array(logs) - max(logs))
    return np.asarray(np.einsum("h,hij->ij", weights / weights.sum(), np.array(moments)))


def _jackknife_covariance(search: ModelSelectionResult, law: Hypothesis) -> Floats:
    """Covariance (p, p) from the change of the estimate when each condition in turn is left out
    (Efron, SIAM 1982).
    """
    rows = search.dataset.rows
    whitening = law.marginal.whitening
    linear = law.fitted.linear(rows.measured)
    out = _list_held_out(search)
    both = np.column_stack([linear.jacobian, linear.target])
    weighed = whitening.apply_precision(both)
    unit = np.eye(linear.jacobian.shape[1])
    estimates = []
    for number in out:
        products, _ = products_without(both, weighed, whitening, rows.condition == number)
        estimates.append(np.linalg.solve(products[:-1, :-1] + unit, products[:-1, -1]))
    term, part = _term_of(law.fitted)
    turned = np.array(estimates) @ _to_values(linear.jacobian.shape[1], part, np.array(term.root)).T
    apart = turned - np.mean(turned, axis=0)
    return np.asarray((len(out) - 1.0) / len(out) * apart.T @ apart)


def _whole(
    search: ModelSelectionResult, law: Hypothesis, covariances: Sequence[Floats]
) -> tuple[Floats, Floats] | None:
    """The law plus that of the model at the place, and its standard deviations, (k,) each; None
    where the model has none.

    Both parts move with the nuisance parameters, so the uncertainty of the sum is propagated from
    all unknowns.
    """
    coordinates = law.fitted.coordinates
    term, part = _term_of(law.fitted)

    def at(x: Floats) -> Floats | None:
        nominal = compute_nominal_law(
            search.dataset,
            coordinates.supposed(x),
            term.argument.place,
            term.argument.name,
            np.array(term.knots),
        )
        if nominal is None:
            return None
        return add_own_law(term.argument.place, nominal, x[part])

    estimate = _estimate(law)
    whole = at(estimate)
    if whole is None:
        return None
    moved = [at(estimate + STEP * unit) for unit in np.eye(coordinates.size)]
    jacobian = np.column_stack(
        [(neighbour - whole) / STEP for neighbour in moved if neighbour is not None]
    )
    return whole, _widest([jacobian @ covariance @ jacobian.T for covariance in covariances])


def _list_held_out(search: ModelSelectionResult) -> list[int]:
    """Conditions that move; a static table is always among the others."""
    rows = search.dataset.rows
    return sorted({int(number) for number in rows.condition[rows.experiment != "static"]})


def _compute_held_out_misfit(search: ModelSelectionResult, hypothesis: Hypothesis) -> float:
    """Sum of squares relative to noise and the usual model error, each condition predicted from
    the others.
    """
    rows = search.dataset.rows
    out = _list_held_out(search)
    residual = loo_residuals(
        hypothesis.fitted.linear(rows.measured), search.likelihood.usual, rows.condition, out
    )
    return float((residual**2 / search.likelihood.usual.variance()).sum())


def _compute_held_out_log_density(search: ModelSelectionResult, hypothesis: Hypothesis) -> float:
    """Log predictive density of all conditions, each predicted from the others, at the
    discrepancy scale of this hypothesis.
    """
    rows = search.dataset.rows
    linear = hypothesis.fitted.linear(search.dataset.rows.measured)
    return float(
        loo_log_densities(
            linear, search.likelihood.level(linear), rows.condition, _list_held_out(search)
        ).sum()
    )
