"""Localisation of a residual force: which place explains best what no effect explains, if any
smooth force may act there.

The force of a place is a Gaussian process over the stroke. Its size and smoothness are integrated
out over a grid, and conditions share a part of it, by progress from touchdown to valley. A place
may explain all channels by a small, smooth force that is alike everywhere. It is then more probable
than a place whose force must be bent to each channel (MacKay, Neural Computation 4 (1992) 415).
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular
from scipy.special import logsumexp

from rfca_rig.diagnosis.config import CONDITION_CORRELATION
from rfca_rig.diagnosis.data import Observations
from rfca_rig.diagnosis.inference.map_fit import MapFit
from rfca_rig.diagnosis.leg.simulator import select_strokes
from rfca_rig.diagnosis.likelihood.covariance import DiscrepancyWhitening, Whitening
from rfca_rig.diagnosis.likelihood.marginal_likelihood import (
    MarginalLikelihood,
    make_marginal_likelihood,
    products_without,
)
from rfca_rig.diagnosis.residual_force.force_inputs import (
    ForceInput,
    NominalCondition,
    list_force_inputs,
    nominal_conditions,
)
from rfca_rig.diagnosis.simulator import Dataset

Floats = NDArray[np.float64]

# Of UNKNOWN_ERRORS, as shares of the signal.
LARGER_ERRORS = (0.03, 0.12)
SMOOTH_OVER_S = (0.02, 0.05, 0.15, 0.6)
SIZES = tuple(0.01 * 3.0**k for k in range(7))  # of the place's plausible size
AFTER_VALLEY_S = 0.05  # later, leg and floor add little information
NEGLIGIBLE = 1e-6  # of a process's variance


@dataclass(frozen=True)
class ForceScene:
    """The misfit without effects: rows of strokes up to the valley, as a linear model in the
    nuisance parameters.

    Parameters
    ----------
    rows
        The m rows.
    target, jacobian
        (m,) and (m, p), as in `LinearModel`.
    likelihood
        Covariances at the discrepancy scales.
    conditions
        The nominal conditions, in the order of the rows.
    """

    rows: Observations
    target: Floats
    jacobian: Floats
    likelihood: MarginalLikelihood
    conditions: tuple[NominalCondition, ...]

    @property
    def whitenings(self) -> tuple[DiscrepancyWhitening, ...]:
        """At the usual model error and at larger ones: the response to a large force is not
        linear.
        """
        return (
            self.likelihood.usual,
            *(w for w in self.likelihood.unknown if w.s in LARGER_ERRORS),
        )

    @cached_property
    def without(self) -> float:
        """Log evidence without a force."""
        logs = [
            make_normal_equations(self, whitening, np.empty((len(self.target), 0))).log_evidence(
                np.empty((0, 0))
            )
            for whitening in self.whitenings
        ]
        return float(logsumexp(logs) - np.log(len(logs)))

    @cached_property
    def roots(self) -> list[Floats]:
        """For each smoothness a root (k, r) of the covariance of all forces at size 1."""
        way_s = [
            nominal.flap.phases.valley_s - nominal.flap.phases.touchdown_s
            for nominal in self.conditions
        ]
        # Time is scaled so that touchdown and valley of all conditions coincide, since they share a
        # part of the force.
        at = [
            (h.bumps.centres_s - h.flap.phases.touchdown_s) / way * np.mean(way_s)
            for h, way in zip(self.conditions, way_s, strict=True)
        ]
        t = np.concatenate(at)
        condition = np.repeat(np.arange(len(at)), [len(a) for a in at])
        together = np.where(condition[:, None] == condition, 1.0, CONDITION_CORRELATION)
        return [
            _root(np.exp(-0.5 * ((t[:, None] - t) / over) ** 2) * together)
            for over in SMOOTH_OVER_S
        ]

    @property
    def places(self) -> tuple[ForceInput, ...]:
        """Where a force may enter."""
        return list_force_inputs(self.conditions[0].in_hinge.shape[2])

    def stack_responses(self, blocks: Sequence[Floats]) -> Floats:
        """Columns (m_c, k_c) of the rows of each condition, side by side in all rows, (m, sum
        k_c).
        """
        matrix = np.zeros((len(self.target), sum(block.shape[1] for block in blocks)))
        done = 0
        for number, block in enumerate(blocks):
            matrix[np.flatnonzero(self.rows.condition == number), done : done + block.shape[1]] = (
                block
            )
            done += block.shape[1]
        return matrix


@dataclass(frozen=True)
class LocalizedForce:
    """A place with its most probable free force.

    Parameters
    ----------
    place
        The place.
    log_evidence
        Above that without a force.
    explained
        Share of the misfit of each channel, and of "all", that the force removes.
    misfit
        Remaining mean square of each channel, relative to what is expected.
    """

    place: ForceInput
    log_evidence: float
    explained: dict[str, float]
    misfit: dict[str, float]


def make_scene(dataset: Dataset, nothing: MapFit, scatter: Floats) -> ForceScene:
    """The scene around the fit without effects; `scatter` (m, k) is B in `covariance`. Raises
    SimulationFailed.
    """
    flaps = [
        flap.until(flap.phases.valley_s + AFTER_VALLEY_S) for flap in select_strokes(dataset.parts)
    ]
    ends_s = np.array([flap.t_s[-1] for flap in flaps])
    dynamic = dataset.rows.experiment == "dynamic"
    selected = dynamic & (dataset.rows.t_s < ends_s[np.where(dynamic, dataset.rows.condition, 0)])
    arrays = {
        f.name: getattr(dataset.rows, f.name)[selected]
        for f in fields(dataset.rows)
        if f.name != "labels"
    }
    rows = replace(dataset.rows, **arrays)
    linear = nothing.linear(dataset.rows.measured).kept(selected)
    conditions = nominal_conditions(flaps, nothing.coordinates.supposed(nothing.x))
    return ForceScene(
        rows,
        linear.target,
        linear.jacobian,
        make_marginal_likelihood(rows, scatter[selected]),
        conditions,
    )


def localize_force(
    scene: ForceScene, place: ForceInput, responses: Sequence[Floats]
) -> LocalizedForce:
    """The place with its most probable force.

    Parameters
    ----------
    scene
        The misfit.
    place
        The place.
    responses
        (m_c, count) per condition, from `place.responses`.
    """
    response = scene.stack_responses(responses)
    sizes = [place.size * size for size in SIZES]
    none = np.empty((response.shape[1], 0))
    systems = [make_normal_equations(scene, whitening, response) for whitening in scene.whitenings]
    # Evidence over the grid of model error, smoothness and size of the force.
    logs_by_system = []
    for system in systems:
        logs_by_system.append([system.log_evidences(root, sizes) for root in scene.roots])
    logs = np.array(logs_by_system)
    level, smooth, size = np.unravel_index(int(np.argmax(logs)), logs.shape)
    x, force, _ = systems[level].solve(sizes[size] * scene.roots[smooth])
    left = misfit_by_channel(scene, x, response @ force)
    before = misfit_by_channel(scene, systems[level].solve(none)[0], 0.0 * scene.target)
    return LocalizedForce(
        place=place,
        log_evidence=float(logsumexp(logs) - np.log(logs.size)) - scene.without,
        explained={name: 1.0 - left[name] / before[name] for name in left}
        | {"all": 1.0 - sum(left.values()) / sum(before.values())},
        misfit=left,
    )


def misfit_by_channel(scene: ForceScene, x: Floats, pushed: Floats) -> dict[str, float]:
    """Mean square of the residual relative to what is expected, in each channel.

    Parameters
    ----------
    scene
        The rows.
    x
        (p,) nuisance parameters.
    pushed
        (m,) effect of the force on the rows.
    """
    square = (scene.target - scene.jacobian @ x - pushed) ** 2 / scene.likelihood.usual.variance()
    return {
        str(name): float(square[scene.rows.signal == name].mean())
        for name in np.unique(scene.rows.signal)
    }


@dataclass(frozen=True)
class NormalEquations:
    """Normal equations of p nuisance parameters and k force coefficients, whitened.

    Parameters
    ----------
    gram
        (p + k, p + k) products of the Jacobian and the responses with each other.
    match
        (p + k,) their products with the target.
    constant
        Log density of the target itself.
    nuisances
        The number p.
    """

    gram: Floats
    match: Floats
    constant: float
    nuisances: int

    def _reduce(self, root: Floats) -> tuple[Floats, Floats]:
        """The system for coefficients z of forces `root` z, with a root (k, r): products (p + r,
        p + r) and (p + r,).
        """
        p = self.nuisances
        corner = self.gram[:p, p:] @ root
        gram = np.block(
            [[self.gram[:p, :p], corner], [corner.T, root.T @ self.gram[p:, p:] @ root]]
        )
        return gram, np.concatenate([self.match[:p], root.T @ self.match[p:]])

    def log_evidence(self, root: Floats) -> float:
        """Log evidence with forces `root` z, z standard normal; the root is (k, r)."""
        return self.log_evidences(root, [1.0])[0]

    def log_evidences(self, root: Floats, sizes: Sequence[float]) -> list[float]:
        """The same for roots (k, r) of several sizes."""
        gram, match = self._reduce(root)
        return [
            self._log_evidence_at(
                gram, match, np.append(np.ones(self.nuisances), np.full(root.shape[1], size))
            )
            for size in sizes
        ]

    def _log_evidence_at(self, gram: Floats, match: Floats, scale: Floats) -> float:
        factor = cholesky(
            scale[:, None] * gram * scale + np.eye(len(gram)), lower=True, check_finite=False
        )
        solution = solve_triangular(factor, scale * match, lower=True, check_finite=False)
        return (
            self.constant + 0.5 * float(solution @ solution) - float(np.log(np.diag(factor)).sum())
        )

    def solve(self, root: Floats) -> tuple[Floats, Floats, Floats]:
        """Posterior for a root (k, r): nuisance parameters (p,), forces (k,), and the covariance
        (k, k) of the forces.
        """
        gram, match = self._reduce(root)
        covariance = np.linalg.inv(gram + np.eye(len(gram)))
        mean = covariance @ match
        p = self.nuisances
        return mean[:p], root @ mean[p:], root @ covariance[p:, p:] @ root.T


def make_normal_equations(
    scene: ForceScene, whitening: Whitening, response: Floats
) -> NormalEquations:
    """The system of a response (m, k) under a covariance."""
    both = whitening(np.hstack([scene.jacobian, response]))
    target = whitening(scene.target)
    constant = -0.5 * (float(target @ target) + whitening.log_det)
    return NormalEquations(both.T @ both, both.T @ target, constant, scene.jacobian.shape[1])


def make_held_out_equations(
    scene: ForceScene, whitening: DiscrepancyWhitening, response: Floats
) -> list[NormalEquations]:
    """Systems of the same response (m, k), each without the rows of one condition."""
    both = np.column_stack([scene.jacobian, response, scene.target])
    weighted = whitening.apply_precision(both)
    systems = []
    for number in range(len(scene.conditions)):
        products, log_det = products_without(
            both, weighted, whitening, scene.rows.condition == number
        )
        systems.append(
            NormalEquations(
                products[:-1, :-1],
                products[:-1, -1],
                -0.5 * (float(products[-1, -1]) + log_det),
                scene.jacobian.shape[1],
            )
        )
    return systems


def _root(covariance: Floats) -> Floats:
    values, vectors = np.linalg.eigh(covariance)
    # The covariance of a smooth force has few directions that matter; the others are dropped.
    kept = values > NEGLIGIBLE * values[-1]
    return np.asarray(vectors[:, kept] * np.sqrt(values[kept]))
