"""Geometrically exact planar beam by finite elements (Simo and Reissner's strains), and the chain
of joints under the same tip force.

Two-node elements with one integration point; nodal unknowns x, y, theta. With dx, dy the element's
chord and theta its mean angle, stretch e = (dx cos + dy sin) / h - 1, shear g = (dy cos - dx sin) /
h, curvature dtheta / h.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve

CHORD = np.array(
    [[-1, 0, 0, 1, 0, 0], [0, -1, 0, 0, 1, 0], [0, 0, 0.5, 0, 0, 0.5], [0, 0, -1, 0, 0, 1.0]]
)


@dataclass(frozen=True)
class Beam:
    """Elements in a row: length h, EI, EA, GA, all (n,)."""

    h: np.ndarray
    EI: np.ndarray
    EA: np.ndarray
    GA: np.ndarray

    def at_rest(self):
        x = np.concatenate(([0.0], np.cumsum(self.h)))
        return np.stack((x, 0 * x, 0 * x), axis=1)

    def forces_and_stiffness(self, nodes):
        """Gradient and Hessian of the strain energy by the nodes' unknowns."""
        h = self.h
        dx, dy, theta, turn = np.einsum(
            "ij,nj->in", CHORD, np.concatenate((nodes[:-1], nodes[1:]), axis=1)
        )
        c = np.cos(theta)
        s = np.sin(theta)
        zero = 0 * h
        one = np.ones_like(h)
        stretch = (dx * c + dy * s) / h - 1
        shear = (dy * c - dx * s) / h
        by_stretch = np.stack((c / h, s / h, shear, zero), axis=1)
        by_shear = np.stack((-s / h, c / h, -(1 + stretch), zero), axis=1)
        by_bend = np.stack((zero, zero, zero, one / h), axis=1)
        force = np.zeros((len(h), 4))
        stiffness = np.zeros((len(h), 4, 4))
        for k, strain, by in (
            (self.EA, stretch, by_stretch),
            (self.GA, shear, by_shear),
            (self.EI, turn / h, by_bend),
        ):
            force += (h * k * strain)[:, None] * by
            stiffness += (h * k)[:, None, None] * by[:, :, None] * by[:, None, :]
        pull = self.EA * stretch
        push = self.GA * shear
        mixed = np.stack((-pull * s - push * c, pull * c - push * s), axis=1)
        stiffness[:, :2, 2] += mixed
        stiffness[:, 2, :2] += mixed
        stiffness[:, 2, 2] -= h * (pull * (1 + stretch) + push * shear)
        return self._gathered(force @ CHORD, np.einsum("ai,nab,bj->nij", CHORD, stiffness, CHORD))

    def _gathered(self, force, stiffness):
        place = 3 * np.arange(len(self.h))[:, None] + np.arange(6)
        size = 3 * len(self.h) + 3
        total = np.bincount(place.ravel(), force.ravel(), size)
        rows = np.repeat(place, 6, axis=1).ravel()
        columns = np.tile(place, (1, 6)).ravel()
        return total, coo_matrix((stiffness.ravel(), (rows, columns)), (size, size)).tocsr()

    def bent(self, force, steps=20):
        """Nodes (n + 1, 3) of the cantilever under a dead tip force (2,), by Newton-Raphson in
        load steps.
        """
        nodes = self.at_rest()
        for share in np.arange(1, steps + 1) / steps:
            for _ in range(60):
                inner, stiffness = self.forces_and_stiffness(nodes)
                inner[-3:-1] -= share * np.asarray(force)
                change = spsolve(stiffness[3:, 3:].tocsc(), -inner[3:])
                nodes[1:] += change.reshape(-1, 3)
                if np.abs(change).max() < 1e-9:
                    break
            else:
                raise AssertionError("the beam does not settle")
        return nodes


def strip_between_shells(strip, link_lengths, free_m, element_m=1e-3, stiffer=1e5):
    """The leg as one beam: the strip's stiffness within free_m / 2 of each pin, a shell's
    elsewhere. No pins: the strip carries all.
    """
    pins = np.cumsum(link_lengths)[:-1]
    borders = np.unique(
        np.round(
            np.concatenate(([0.0, sum(link_lengths)], pins - free_m / 2, pins + free_m / 2)), 9
        )
    )
    counts = np.maximum(1, np.round(np.diff(borders) / element_m)).astype(int)
    s = np.concatenate(
        [
            *(
                np.linspace(a, b, n, endpoint=False)
                for a, b, n in zip(borders[:-1], borders[1:], counts, strict=True)
            ),
            [borders[-1]],
        ]
    )
    middle = 0.5 * (s[1:] + s[:-1])
    h = np.diff(s)
    free = np.abs(middle[:, None] - pins).min(axis=1) < free_m / 2
    area = strip.count * strip.width_m * strip.thickness_m
    G = strip.material.youngs_modulus_Pa / (2 * (1 + strip.material.poisson_ratio))
    EI = np.where(free, 1.0, stiffer) * strip.bending_stiffness_Nm2
    return Beam(
        h,
        EI,
        np.full(h.size, strip.material.youngs_modulus_Pa * area),
        np.full(h.size, 5 / 6 * G * area),
    )


def chain_tip(link_lengths, energy, slope, force, steps=20):
    """(x, y, angle) of the tip of rigid links whose hinges, the first excepted, store
    `energy(phi)`; the root is clamped.
    """
    lengths = np.array(link_lengths)
    force = np.asarray(force)
    phi = np.zeros(len(link_lengths) - 1)

    def value(phi, share):
        angle = np.concatenate(([0.0], np.cumsum(phi)))
        by_angle = lengths * (force[0] * np.sin(angle) - force[1] * np.cos(angle)) * share
        total = energy(phi).sum() - share * (
            force[0] * lengths @ np.cos(angle) + force[1] * lengths @ np.sin(angle)
        )
        return total, slope(phi) + np.cumsum(by_angle[::-1])[::-1][1:]

    for share in np.arange(1, steps + 1) / steps:
        phi = minimize(value, phi, (share,), jac=True, method="BFGS", options={"gtol": 1e-9}).x
    angle = np.concatenate(([0.0], np.cumsum(phi)))
    return np.array([lengths @ np.cos(angle), lengths @ np.sin(angle), angle[-1]]), phi
