"""Where model and recordings differ, before any cause is considered.

The residual of the nominal model is compared with noise, scatter between strokes, a usual model
error, and what the prior standard deviations of the nuisance parameters allow. The tests are
hierarchical (Meinshausen, Biometrika 95 (2008) 265). First, each signal in each phase is tested by
a chi-square over all conditions. Then the conditions of each one that is significant are tested.
Both levels are corrected for the number of tests (Holm, Scand. J. Statist. 6 (1979) 65).
"""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.special import chdtrc

from rfca_rig.diagnosis.data import Observations, unit_of
from rfca_rig.diagnosis.inference.map_fit import MapFit
from rfca_rig.diagnosis.likelihood.covariance import make_whitening
from rfca_rig.diagnosis.likelihood.marginal_likelihood import (
    LinearModel,
    MarginalLikelihood,
    laplace_posterior,
)
from rfca_rig.diagnosis.result import Located, MapCell

Floats = NDArray[np.float64]

CHANCE = 0.01  # family-wise


def locate_mismatch(
    rows: Observations, fit: MapFit, likelihood: MarginalLikelihood
) -> tuple[tuple[MapCell, ...], tuple[Located, ...]]:
    """The whole map, and the places where the difference is significant, worst first.

    Parameters
    ----------
    rows
        The m observations.
    fit
        The model that is compared with them.
    likelihood
        Gives the usual covariance (m, m).
    """
    # The prior uncertainty of the unknowns is an allowance, too: C(0.01) + J J^T.
    covariance = likelihood.usual.covariance() + fit.jacobian @ fit.jacobian.T
    residual = rows.measured - fit.predicted
    places: dict[tuple[str, str, str], list[NDArray[np.intp]]] = {}
    cells = [(_describe_cell(rows, residual, covariance, of), of) for of in _cells(rows)]
    for cell, of in cells:
        places.setdefault((cell.signal, cell.experiment, cell.phase), []).append(of)
    chances = _holm(
        np.array(
            [_chance(residual, covariance, np.concatenate(parts)) for parts in places.values()]
        )
    )
    located = [
        _locate(rows, residual, covariance, parts, float(p_value))
        for parts, p_value in zip(places.values(), chances, strict=True)
        if p_value < CHANCE
    ]
    return tuple(cell for cell, _ in cells), tuple(sorted(located, key=lambda place: -place.sigmas))


def lone_channel(rows: Observations, nothing: MapFit, likelihood: MarginalLikelihood) -> str | None:
    """The only signal without which nothing is missing; None where other signals differ as well, or
    none does.

    A faulty sensor changes only its own channel and leaves the motion unchanged. A force on the leg
    shows in all channels.
    """
    covariance = likelihood.usual.covariance()
    linear = nothing.linear(rows.measured)
    everything = np.ones(len(rows.measured), dtype=bool)
    if _misfit(linear, covariance, everything) < DEPARTS:
        return None
    signals = [name for name in np.unique(rows.signal) if not str(name).startswith("hinge")]
    alone = [
        str(name) for name in signals if _misfit(linear, covariance, rows.signal != name) < AGREES
    ]
    if len(alone) == 1:
        return alone[0]
    return None


# mean square over what is expected
DEPARTS = 1.6
AGREES = 1.2


def _misfit(linear: LinearModel, covariance: Floats, kept: NDArray[np.bool_]) -> float:
    posterior = laplace_posterior(linear.kept(kept), make_whitening(covariance[np.ix_(kept, kept)]))
    return posterior.chi2 / int(kept.sum())


def _cells(rows: Observations) -> list[NDArray[np.intp]]:
    keys = np.stack([rows.label, np.unique(rows.phase, return_inverse=True)[1]])
    return [np.flatnonzero((keys == key[:, None]).all(axis=0)) for key in np.unique(keys, axis=1).T]


def _describe_cell(
    rows: Observations, apart: Floats, covariance: Floats, of: NDArray[np.intp]
) -> MapCell:
    label = rows.labels[rows.label[of[0]]]
    part = apart[of]
    sigmas = float(np.sqrt(np.mean(part**2 / np.diag(covariance)[of])))
    return MapCell(
        label.signal,
        label.experiment,
        str(rows.phase[of[0]]),
        label.condition,
        float(np.sqrt(np.mean(part**2))),
        sigmas,
    )


def _chance(apart: Floats, covariance: Floats, of: NDArray[np.intp]) -> float:
    """Probability of a chi-square as large as that of these rows if nothing is missing."""
    return float(
        chdtrc(len(of), apart[of] @ cho_solve(cho_factor(covariance[np.ix_(of, of)]), apart[of]))
    )


def _holm(p_values: Floats) -> Floats:
    """P-values (n,) corrected for the number of tests by Holm's method."""
    order = np.argsort(p_values)
    # The smallest is multiplied by n, the next by n - 1, and so on; they must not decrease.
    stepped = np.maximum.accumulate(p_values[order] * (len(p_values) - np.arange(len(p_values))))
    corrected = np.empty(len(p_values))
    corrected[order] = np.minimum(stepped, 1.0)
    return corrected


def _locate(
    rows: Observations,
    apart: Floats,
    covariance: Floats,
    parts: list[NDArray[np.intp]],
    combined_p_value: float,
) -> Located:
    """The statement about one signal in one phase: the conditions that are significant alone, or
    all of them where none is.
    """
    p_values = _holm(np.array([_chance(apart, covariance, of) for of in parts]))
    shown = [of for of, p_value in zip(parts, p_values, strict=True) if p_value < CHANCE] or parts
    cells = [_describe_cell(rows, apart, covariance, of) for of in shown]
    first = cells[0]
    return Located(
        signal=first.signal,
        experiment=first.experiment,
        phase=first.phase,
        conditions=tuple(cell.condition for cell in cells),
        size=float(np.sqrt(np.mean([cell.size**2 for cell in cells]))),
        unit=unit_of(first.signal),
        sigmas=float(np.sqrt(np.mean([cell.sigmas**2 for cell in cells]))),
        p_value=combined_p_value,
    )
