"""Where model and recordings part, before any cause is considered.

The model as believed is held against the rows; what could be expected is noise, what differs from stroke to stroke, a usual model error,
and what the uncertainty of the believed values can do. Each cell of signal, phase and condition is tested by its own chi-square;
the chances are corrected for the number of cells (Holm, Scand. J. Statist. 6 (1979) 65).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.stats import chi2

from rfca_rig.diagnosis.data.observations import Observations
from rfca_rig.diagnosis.inference.map_fit import MapFit
from rfca_rig.diagnosis.likelihood.covariance import factored
from rfca_rig.diagnosis.likelihood.laplace import Linear, laplace_posterior
from rfca_rig.diagnosis.likelihood.marginal_likelihood import MarginalLikelihood
from rfca_rig.diagnosis.result import Cell, Located

Floats = NDArray[np.float64]

CHANCE = 0.01  # family-wise


@dataclass(frozen=True)
class _Tested:
    cell: Cell
    p_value: float


def locate_mismatch(rows: Observations, believed: MapFit, judge: MarginalLikelihood) -> tuple[tuple[Cell, ...], tuple[Located, ...]]:
    """The whole map, and the places where chance and all allowances do not explain the difference, worst first."""
    covariance = judge.usual.covariance() + believed.jacobian @ believed.jacobian.T
    apart = rows.measured - believed.predicted
    tested = [_tested(rows, apart, covariance, cell) for cell in _cells(rows)]
    corrected = _holm(np.array([t.p_value for t in tested]))
    return tuple(t.cell for t in tested), _pooled(tested, corrected)


def lone_channel(rows: Observations, nothing: MapFit, judge: MarginalLikelihood) -> str | None:
    """The one signal without which nothing is missing; None where others part as well, or none does.

    A sensor at fault changes its own channel and leaves the motion alone; a force that acts on the leg shows in all.
    """
    covariance = judge.usual.covariance()
    linear = nothing.linear(rows.measured)
    everything = np.ones(len(rows.measured), dtype=bool)
    if _misfit(linear, covariance, everything) < DEPARTS:
        return None
    signals = [name for name in np.unique(rows.signal) if not str(name).startswith("hinge")]
    alone = [str(name) for name in signals if _misfit(linear, covariance, rows.signal != name) < AGREES]
    return alone[0] if len(alone) == 1 else None


DEPARTS, AGREES = 1.6, 1.2  # mean square over what is expected


def _misfit(linear: Linear, covariance: Floats, kept: NDArray[np.bool_]) -> float:
    found = laplace_posterior(linear.kept(kept), factored(covariance[np.ix_(kept, kept)]))
    return found.chi2 / int(kept.sum())


def _cells(rows: Observations) -> list[NDArray[np.intp]]:
    keys = np.stack([rows.label, np.unique(rows.phase, return_inverse=True)[1]])
    return [np.flatnonzero((keys == key[:, None]).all(axis=0)) for key in np.unique(keys, axis=1).T]


def _tested(rows: Observations, apart: Floats, covariance: Floats, cell: NDArray[np.intp]) -> _Tested:
    block = covariance[np.ix_(cell, cell)]
    statistic = float(apart[cell] @ cho_solve(cho_factor(block), apart[cell]))
    label = rows.labels[rows.label[cell[0]]]
    size = float(np.sqrt(np.mean(apart[cell] ** 2)))
    sigmas = float(np.sqrt(np.mean(apart[cell] ** 2 / np.diag(block))))
    found = Cell(label.signal, label.experiment, str(rows.phase[cell[0]]), label.condition, size, sigmas)
    return _Tested(found, float(chi2.sf(statistic, len(cell))))


def _holm(p_values: Floats) -> Floats:
    order = np.argsort(p_values)
    stepped = np.maximum.accumulate(p_values[order] * (len(p_values) - np.arange(len(p_values))))
    corrected = np.empty(len(p_values))
    corrected[order] = np.minimum(stepped, 1.0)
    return corrected


def _pooled(tested: list[_Tested], corrected: Floats) -> tuple[Located, ...]:
    groups: dict[tuple[str, str, str], list[tuple[Cell, float]]] = {}
    for test, p_value in zip(tested, corrected, strict=True):
        if p_value < CHANCE:
            cell = test.cell
            groups.setdefault((cell.signal, cell.experiment, cell.phase), []).append((cell, float(p_value)))
    found = [_place(group) for group in groups.values()]
    return tuple(sorted(found, key=lambda place: -place.sigmas))


def _place(group: list[tuple[Cell, float]]) -> Located:
    cells = [cell for cell, _ in group]
    first = cells[0]
    return Located(
        signal=first.signal,
        experiment=first.experiment,
        phase=first.phase,
        conditions=tuple(cell.condition for cell in cells),
        size=float(np.sqrt(np.mean([cell.size**2 for cell in cells]))),
        unit=unit_of(first.signal),
        sigmas=float(np.sqrt(np.mean([cell.sigmas**2 for cell in cells]))),
        p_value=min(p for _, p in group),
    )


UNITS = {"_rad_s": "rad/s", "_Nm": "N m", "_N": "N", "_deg": "deg", "_rad": "rad"}


def unit_of(signal: str) -> str:
    """The unit that a signal's name ends with, as people write it; nothing where it ends with none."""
    return next((unit for ending, unit in UNITS.items() if signal.endswith(ending)), "")
