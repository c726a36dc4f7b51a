"""The formula that was found for the hinges, put back into the simulator as a law of its own and fitted again there.

The formula was found as if the leg answered in proportion. Here the leg moves under it, the believed values move beside it, and every
condition must be foretold from the others.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.config import STEP
from rfca_rig.diagnosis.data.dataset import THREADS
from rfca_rig.diagnosis.inference.map_fit import MapFit
from rfca_rig.diagnosis.likelihood.covariance import factored
from rfca_rig.diagnosis.likelihood.cross_validation import loo_residuals
from rfca_rig.diagnosis.likelihood.laplace import Linear, laplace_posterior
from rfca_rig.diagnosis.residual_force.force_inputs import ForceInput
from rfca_rig.diagnosis.residual_force.force_localization import LocalizedForce, Scene
from rfca_rig.diagnosis.residual_force.hinge_series import SERIES, series_in
from rfca_rig.diagnosis.residual_force.sparse_law import FoundTerm
from rfca_rig.diagnosis.residual_force.spline_force import forced_stroke
from rfca_rig.errors import SimulationFailed

Floats = NDArray[np.float64]

ROUNDS = 3


@dataclass(frozen=True)
class ClosedLoopRefit:
    """The law in the simulator: its `terms` fitted again, the mean square `misfit` left in each channel over what is expected, and the
    share of conditions that it foretells better from the others than nothing missing does.
    """

    terms: tuple[FoundTerm, ...]
    misfit: dict[str, float]
    foretold: float


def put_back(scene: Scene, nothing: MapFit, found: LocalizedForce, terms: Sequence[FoundTerm]) -> ClosedLoopRefit | None:
    """The law fitted anew in the simulator; None for a place that is no hinge, a term it has no law for, or no answer of the model."""
    if not found.place.id.startswith("hinge") or not terms or any(term.term not in SERIES for term in terms):
        return None
    fit = _Fit(scene, nothing, found.place, terms)
    point = np.concatenate([nothing.x, np.ones(len(terms))])
    linear = fit.linear(point)
    for _ in range(ROUNDS):
        if linear is None:
            return None
        point = laplace_posterior(linear, found.whitening).mean * fit.scale
        linear = fit.linear(point)
    return None if linear is None else _told(scene, found, terms, fit.scale, linear)


def _told(scene: Scene, found: LocalizedForce, terms: Sequence[FoundTerm], scale: Floats, linear: Linear) -> ClosedLoopRefit:
    posterior = laplace_posterior(linear, found.whitening)
    share = (posterior.mean * scale)[-len(terms) :]
    std = (np.sqrt(np.diag(posterior.covariance)) * scale)[-len(terms) :]
    each = zip(terms, share, std, strict=True)
    again = [replace(t, coefficient=t.coefficient * float(k), std=abs(t.coefficient) * float(s)) for t, k, s in each]
    square = (linear.target - linear.jacobian @ posterior.mean) ** 2 / scene.judge.usual.variance()
    misfit = {str(name): float(square[scene.rows.signal == name].mean()) for name in np.unique(scene.rows.signal)}
    return ClosedLoopRefit(tuple(again), misfit, _foretold(scene, linear, found))


@dataclass(frozen=True)
class _Fit:
    """Point: the nuisances in prior deviations, then each coefficient as a share of what the formula says, known to `scale`."""

    scene: Scene
    nothing: MapFit
    place: ForceInput
    terms: Sequence[FoundTerm]

    @property
    def scale(self) -> Floats:
        """Prior deviations of the point: a coefficient may be some times larger."""
        return np.concatenate([np.ones(len(self.nothing.x)), np.full(len(self.terms), 3.0)])

    def linear(self, point: Floats) -> Linear | None:
        """The rows around the point as a linear model in what is standard normal before; None where the model has no answer."""
        moves = [point, *(point + STEP * one for one in np.eye(len(point)))]
        with ThreadPoolExecutor(THREADS) as pool:
            rows = list(pool.map(self._rows, moves))
        if any(one is None for one in rows):
            return None
        here, *there = (one for one in rows if one is not None)
        jacobian = np.column_stack([(one - here) / STEP for one in there])
        return Linear(self.scene.rows.measured - here + jacobian @ point, jacobian * self.scale)

    def _rows(self, point: Floats) -> Floats | None:
        count = len(self.nothing.x)
        coefficients = point[count:] * np.array([term.coefficient for term in self.terms])
        change = series_in(self.place, [term.term for term in self.terms], coefficients)
        supposed = self.nothing.coordinates.supposed(point[:count])
        found = np.empty(len(self.scene.target))
        try:
            for number, here in enumerate(self.scene.conditions):
                found[self.scene.rows.condition == number] = here.rows(forced_stroke(here.flap, supposed, (change,)))
        except SimulationFailed:
            return None
        return found


def _foretold(scene: Scene, linear: Linear, found: LocalizedForce) -> float:
    """Share of conditions whose own rows the law, fitted to the others, meets better than nothing missing, fitted likewise."""
    numbers, covariance = range(len(scene.conditions)), found.whitening.covariance()
    law, none = (
        loo_residuals(model, found.whitening, scene.rows.condition, numbers) for model in (linear, Linear(scene.target, scene.jacobian))
    )
    better = []
    for number in numbers:
        out = np.flatnonzero(scene.rows.condition == number)
        own = factored(covariance[np.ix_(out, out)])
        better.append(np.linalg.norm(own(law[out])) < np.linalg.norm(own(none[out])))
    return float(np.mean(better))
