"""Draws from the posterior of the hypotheses of a search, with what they predict, for programs of
Bayesian statistics. Entry point: `draw_rivals`.

The posterior is the Laplace approximation of `likelihood.marginal_likelihood`, at the discrepancy
scale that stated values refer to. Draws and predictions are exact where the model is linear over
the width of the posterior; bounds of parameters are kept, because draws are of the coordinates. The
draws of a stated effect are then spread to its stated standard deviation, which includes how far
its law is only approximate (`decision.sizes`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.decision.table import UNKNOWN
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis, ModelSelectionResult
from rfca_rig.diagnosis.inference.map_fit import MapFit
from rfca_rig.diagnosis.inference.parameterization import Parameterization, value_of
from rfca_rig.diagnosis.likelihood.covariance import DiscrepancyWhitening
from rfca_rig.diagnosis.likelihood.marginal_likelihood import (
    LinearModel,
    laplace_posterior,
    loo_posteriors,
)
from rfca_rig.diagnosis.problem import DecidedSearch
from rfca_rig.diagnosis.result import NamedEffect, Rival
from rfca_rig.errors import BadInput

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class RivalDraws:
    """Draws of one hypothesis: d draws, m observed rows, c conditions.

    Parameters
    ----------
    rival
        Its effects, probability, evidence and discrepancy scale.
    posterior, prior
        (d,) of each unknown, in the unit that its name or `units` says.
    units
        Units of the nuisance parameters.
    posterior_predictive, held_out_predictive
        (d, m) the rows of another recording of the same conditions: with all draws of the unknowns,
        and with unknowns that the other conditions determine.
    log_likelihood
        (d, c) log density of each condition given all others, for leave-one-out with rows that are
        not independent (Bürkner, Gabry, Vehtari, Comput. Stat. 36 (2021) 1243).
    """

    rival: Rival
    posterior: Mapping[str, Floats]
    prior: Mapping[str, Floats]
    units: Mapping[str, str]
    posterior_predictive: Floats
    held_out_predictive: Floats
    log_likelihood: Floats


def draw_rivals(
    finding: DecidedSearch, least_probability: float, draws: int, random: np.random.Generator
) -> list[RivalDraws]:
    """Draws of the explanation that an answer rests on, and then of all other rivals that are at
    least so probable, the most probable first.

    Parameters
    ----------
    finding
        The search and its decision.
    least_probability
        Of the rivals that are drawn from.
    draws
        Number of draws d.
    random
        The generator of all draws.

    Raises
    ------
    BadInput
        Where the recordings were too few for a comparison.
    """
    decision = finding.decision
    if not decision.rivals:
        raise BadInput(
            "the recordings were too few to compare sets of effects, so there is nothing to draw "
            "from; record more conditions"
        )
    stated = set(decision.explanation.ids)
    explanation = next(rival for rival in decision.rivals if set(rival.ids) == stated)
    drawn = _draw(finding.search, explanation, draws, random)
    rivals = [replace(drawn, posterior=_spread_to_stated(drawn.posterior, decision.effects))]
    for rival in decision.rivals:
        if rival is not explanation and rival.probability >= least_probability:
            rivals.append(_draw(finding.search, rival, draws, random))
    return rivals


def _find_fit(search: ModelSelectionResult, rival: Rival) -> MapFit:
    """Where a rival fits best."""
    if rival.ids == UNKNOWN:
        return search.nothing.fitted
    hypotheses: Sequence[Hypothesis] = (search.nothing, *search.named)
    # The most probable variant, for instance of the number of a hinge, comes first.
    for hypothesis in hypotheses:
        if set(hypothesis.ids) == set(rival.ids):
            return hypothesis.fitted
    raise ValueError(f"the search has no hypothesis of {rival.ids}")


def _spread_to_stated(
    values: Mapping[str, Floats], effects: Sequence[NamedEffect]
) -> dict[str, Floats]:
    """Draws (d,) by name, those of these effects with their stated mean and standard deviation."""
    spread = dict(values)
    for effect in effects:
        for name, stated in {**effect.parameters, **effect.shape}.items():
            draws = values[f"{effect.id}.{name}"]
            std = float(draws.std())
            if std > 0.0:
                scale = stated.std / std
                spread[f"{effect.id}.{name}"] = stated.value + scale * (draws - draws.mean())
    return spread


def _draw(
    search: ModelSelectionResult, rival: Rival, draws: int, random: np.random.Generator
) -> RivalDraws:
    rows = search.dataset.rows
    fitted = _find_fit(search, rival)
    coordinates = fitted.coordinates
    linear = fitted.linear(rows.measured)
    whitening = search.likelihood.level(linear)
    posterior = laplace_posterior(linear, whitening)
    x = random.multivariate_normal(posterior.mean, posterior.covariance, draws, method="cholesky")
    prior_x = random.normal(size=x.shape)
    # What the linear model predicts: target is y - f + J x0, so f + J (x - x0) is y - target + J x.
    offset = rows.measured - linear.target
    predicted = offset + x @ linear.jacobian.T
    units = {parameter.name: parameter.unit for parameter in coordinates.space.parameters}
    return RivalDraws(
        rival,
        _name_values(coordinates, x),
        _name_values(coordinates, prior_x),
        units,
        predicted + whitening.draw(draws, random),
        offset + _draw_held_out(linear, whitening, rows.condition, draws, random),
        _log_densities(linear, whitening, rows.condition, x),
    )


def _name_values(coordinates: Parameterization, x: Floats) -> dict[str, Floats]:
    """Values (d,) of all unknowns by name, from their coordinates (d, p)."""
    nuisances = coordinates.nuisances
    values = np.array([coordinates.space.values(point) for point in x[:, :nuisances]])
    named = dict(zip(coordinates.space.names, values.reshape(len(x), -1).T, strict=True))
    for number, term in enumerate(coordinates.choices):
        columns = x[:, coordinates.part(number)].T
        for parameter, column in zip(term.free, columns, strict=True):
            name = f"{term.effect.id}.{parameter.name}"
            named[name] = np.array([value_of(parameter, float(z)) for z in column])
        for name, value in term.whole:
            named[f"{term.effect.id}.{name}"] = np.full(len(x), value)
    return named


def _draw_held_out(
    linear: LinearModel,
    whitening: DiscrepancyWhitening,
    condition: NDArray[np.intp],
    draws: int,
    random: np.random.Generator,
) -> Floats:
    """J x and an error (d, m), for the rows of each condition with unknowns from the others."""
    replicated = whitening.draw(draws, random)
    count = int(condition.max()) + 1
    posteriors = loo_posteriors(linear, whitening, condition, range(count))
    for number, (mean, precision) in enumerate(posteriors):
        covariance = np.linalg.inv(precision)
        x = random.multivariate_normal(mean, covariance, draws, method="cholesky")
        of_condition = condition == number
        replicated[:, of_condition] += x @ linear.jacobian[of_condition].T
    return replicated


def _log_densities(
    linear: LinearModel, whitening: DiscrepancyWhitening, condition: NDArray[np.intp], x: Floats
) -> Floats:
    """Log density (d, c) of the rows of each condition given all other rows, at unknowns (d, p).

    With residual r of all rows and precision P, it is normal with the deviation P_oo^-1 (P r)_o and
    the precision P_oo.
    """
    residuals = linear.target[:, None] - linear.jacobian @ x.T
    weighted = whitening.apply_precision(residuals)
    log_2pi = float(np.log(2.0 * np.pi))
    columns = []
    for number in range(int(condition.max()) + 1):
        out = condition == number
        precision = whitening.precision(out)
        solved = np.linalg.solve(precision, weighted[out])
        squares = np.einsum("md,md->d", weighted[out], solved)
        log_det = float(np.linalg.slogdet(precision)[1])
        columns.append(-0.5 * (squares - log_det + int(out.sum()) * log_2pi))
    return np.column_stack(columns)
