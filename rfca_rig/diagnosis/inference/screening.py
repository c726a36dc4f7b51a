"""Screening: the signature of every effect at some sizes, and how much of the misfit it could
remove.

This is a score test with few simulations per effect. It decides only where fits begin, see section
6 of docs/method.md.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from rfca_rig.diagnosis.config import GRID_POINTS, MAX_RESCALING
from rfca_rig.diagnosis.inference.map_fit import GaussNewton, MapFit
from rfca_rig.diagnosis.inference.parameterization import EffectTerm, coordinate_of
from rfca_rig.diagnosis.likelihood.covariance import Whitening
from rfca_rig.diagnosis.simulator import Dataset
from rfca_rig.model.effect import Effect, Parameter

Floats = NDArray[np.float64]
# precision in prior standard deviations: none, and an unknown that no row depends on still has an
# inverse
NO_PRIOR = 1e-6
Point = tuple[EffectTerm, Floats]
"""One effect at the coordinates z of its free parameters, (p,)."""


@dataclass(frozen=True)
class EffectProbe:
    """One effect at one point: coordinates z (p,) of its free parameters, and its signature (m,)
    there in the units of the signals.
    """

    choice: EffectTerm
    z: Floats
    signature: Floats


def terms_of(effect: Effect) -> tuple[EffectTerm, ...]:
    """The effect as terms, one for every value of a parameter that counts something."""
    whole = [parameter for parameter in effect.parameters if parameter.whole]
    values = []
    for parameter in whole:
        counts = range(int(parameter.low), int(parameter.high) + 1)
        values.append([(parameter.name, float(count)) for count in counts])
    return tuple(EffectTerm(effect, combination) for combination in product(*values))


def grid_points(choices: Iterable[EffectTerm]) -> list[Point]:
    """All grid points of all terms."""
    return [(choice, z) for choice in choices for z in grid_of(choice)]


def probe_effects(dataset: Dataset, base: MapFit, points: Sequence[Point]) -> list[EffectProbe]:
    """Signatures (m,) of effects at these points, each added to the model of `base`.

    Points where the model has no answer are omitted.
    """
    coordinates = base.coordinates
    nuisances = coordinates.space.at(base.x[: coordinates.nuisances])
    supposed = []
    for choice, z in points:
        wider = coordinates.with_terms((*coordinates.choices, choice))
        supposed.append(wider.add_effects(nuisances, np.concatenate([base.x, z])))
    changes = dataset.predict_changes(coordinates.supposed(base.x), base.predicted, supposed)
    return [
        EffectProbe(c, z, change)
        for (c, z), change in zip(points, changes, strict=True)
        if change is not None
    ]


def grid_of(choice: EffectTerm) -> list[Floats]:
    """Grid points of a term, (p,) each: those that the effect states, or the middles of equally
    probable parts of its prior.

    Where an effect counts something, each count is a term of its own. The other sizes then begin at
    their middle, or on either side of zero. Shape parameters begin at their stated starts or at
    their neutral value, initial states at rest.
    """
    free = choice.sizes
    at_rest = (0.0,) * len(choice.effect.begins)
    # Points per axis: fewer with each further size, so that the grid does not grow too fast.
    points = max(GRID_POINTS + 1 - len(free), 2)
    if choice.whole:
        if any(parameter.low < 0.0 < parameter.high for parameter in free):
            points = 2
        else:
            points = 1
    middles = tuple(ndtri((np.arange(points) + 0.5) / points).tolist())
    starts = [_starts(parameter) or middles for parameter in free]
    shapes = [
        _starts(parameter) or (coordinate_of(parameter, parameter.neutral),)
        for parameter in choice.effect.shape
    ]
    return [np.array((*point, *at_rest)) for point in product(*starts, *shapes)]


def _starts(parameter: Parameter) -> tuple[float, ...]:
    return tuple(coordinate_of(parameter, value) for value in parameter.starts)


@dataclass(frozen=True)
class Projection:
    """Whitened residual space around a fit, with the nuisance parameters projected out as far as
    their prior allows.

    Parameters
    ----------
    whitening
        The covariance.
    jacobian
        (m, p) whitened Jacobian of the fit.
    inverse
        (p, p) posterior covariance of its unknowns.
    residual
        (m,) whitened residual that they leave.
    """

    whitening: Whitening
    jacobian: Floats
    inverse: Floats
    residual: Floats

    def project(self, whitened: Floats) -> Floats:
        """Part of a whitened vector (m,), or of columns (m, k), that the unknowns of the fit
        cannot take up.
        """
        return whitened - self.jacobian @ (self.inverse @ (self.jacobian.T @ whitened))

    def power(self, signature: Floats) -> float:
        """Squared size of a signature (m,) beyond noise, scatter, model error and nuisance
        parameters.
        """
        white = self.whitening(signature)
        return float(white @ self.project(white))

    def speaks_against(self, signature: Floats, needed: float) -> float:
        """Power of a signature (m,) for its exclusion: as `power`, less where the residual has a
        part along the signature.

        The effect is then there, perhaps, and only much larger sizes are excluded: those from the
        factor f on the signature with f^2 power - 2 f match = needed, in chi-square. The result is
        needed / f^2, which is `power` without a match.
        """
        white = self.whitening(signature)
        power = float(white @ self.project(white))
        match = max(float(white @ self.residual), 0.0)
        if power <= 0.0:
            return 0.0
        factor = (match + np.sqrt(match**2 + power * needed)) / power
        return float(needed / factor**2)

    def gain(self, signature: Floats) -> tuple[float, float]:
        """Chi-square that a signature (m,) could remove, and the factor by which it would have
        to be scaled for that.
        """
        white = self.whitening(signature)
        return self.gain_of_projected(white, self.project(white))

    def gain_of_projected(self, white: Floats, inside: Floats) -> tuple[float, float]:
        """The same of a signature that is whitened already, `white` (m,), with its projection
        `inside` (m,).
        """
        power = float(white @ inside)
        match = float(white @ self.residual)
        if power <= 0.0:
            return 0.0, 1.0
        # Least squares along the signature. An effect cannot change its sign, and far beyond its
        # size the signature is no guide.
        factor = float(np.clip(match / power, 0.0, MAX_RESCALING))
        return 2.0 * factor * match - factor**2 * power, factor


def promising_points(
    projection: Projection, probes: Sequence[EffectProbe], most: int
) -> list[Point]:
    """The points of each effect, at most `most`, that promise most in a projection; signatures
    may be those around another fit.
    """
    of_effect: dict[str, list[EffectProbe]] = {}
    for probe in sorted(probes, key=lambda probe: -projection.gain(probe.signature)[0]):
        of_effect.setdefault(probe.choice.effect.id, []).append(probe)
    return [(probe.choice, probe.z) for best in of_effect.values() for probe in best[:most]]


def make_projection(
    base: MapFit, measured: Floats, whitening: Whitening, free: Sequence[int] = ()
) -> Projection:
    """The projection around a fit.

    Parameters
    ----------
    base
        The fit.
    measured
        (m,) the measured rows.
    whitening
        The covariance.
    free
        Numbers of the unknowns whose prior does not hold.

    Returns
    -------
    Projection
        Its residual is what remains after the best linear correction of all unknowns under their
        prior.
    """
    jacobian = whitening(base.jacobian)
    prior = np.ones(jacobian.shape[1])
    prior[list(free)] = NO_PRIOR
    inverse = np.asarray(np.linalg.inv(jacobian.T @ jacobian + np.diag(prior)), dtype=np.float64)
    linear = base.linear(measured)
    residual = whitening(linear.target)
    return Projection(
        whitening, jacobian, inverse, residual - jacobian @ (inverse @ (jacobian.T @ residual))
    )


def fit_most_promising(
    optimizer: GaussNewton, here: MapFit, points: Sequence[Point], starts: int
) -> MapFit | None:
    """The best fit with one effect more.

    Parameters
    ----------
    optimizer
        Of the data.
    here
        The fit that the effect is added to.
    points
        Effects with their sizes.
    starts
        From so many of them a fit begins: those that promise most. An effect may have more than one
        optimum.

    Returns
    -------
    MapFit or None
        None where the model has no answer at any of these points.
    """
    measured = optimizer.dataset.rows.measured
    projection = make_projection(here, measured, optimizer.likelihood.level(here.linear(measured)))
    ranked = sorted(
        probe_effects(optimizer.dataset, here, points),
        key=lambda probe: -projection.gain(probe.signature)[0],
    )[:starts]
    terms = here.coordinates.choices
    begun = [
        optimizer.at(
            here.coordinates.with_terms((*terms, p.choice)), np.append(here.x, p.z), here.jacobian
        )
        for p in ranked
    ]
    fits = [optimizer.refine(start) for start in begun if start is not None]
    return max(fits, key=optimizer.free_log_evidence, default=None)
