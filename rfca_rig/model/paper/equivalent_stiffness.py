"""Equivalent hinge stiffness of the strip inside the stiff shells: the paper's (3) to (8).

The shells prescribe the strip's tangent angle at stations s_i: theta(s_i) = beta_i = sum over the
hinges of T_ij phi_j, with the first link at angle zero. Between stations the strip is free. The
paper does not define its "hinge stations"; `Holding` has four readings, of which `by_its_middle` is
the one used elsewhere in this package:

    by_its_middle   each link holds the strip in the middle of what it encases, by direction only
    by_a_length     each link holds it straight but for `free` around each pin: K_i = EI / free,
                    the model of a tight groove
    at_pins         (4) to the letter: at pin i the strip points as the link after it
    at_pins_mean    at pin i it points halfway between the links, as symmetry suggests

Prescribing directions alone is linear in theta, and (7) is quadratic, so U is quadratic in the
hinge angles and K_i is constant: these equations contain no hardening, whatever the reading. With T
the identity's running sum the first three give K_i = EI / (distance of the stations either side)
and no coupling at all; the last couples neighbours, EI / 4p beside EI / 2p on the diagonal, p the
pitch, so that hinges bent to and fro in turn would feel nearly nothing. Hardening needs geometry
that (4) leaves out: see `hinge_curve`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.model.paper.elastica import Bent, Holds, bend, mesh_through, sensitivity

Floats = NDArray[np.float64]

NO_FORCE = np.zeros(2)


@dataclass(frozen=True)
class Lay:
    """Position of a strip of `length_m` in the leg: arc length of each hinge's pin from the
    strip's near end, `pins_m` (h,).
    """

    pins_m: Floats
    length_m: float

    @property
    def encased_m(self) -> tuple[Floats, Floats]:
        """Where each link's part of the strip begins and ends, both (h + 1,)."""
        return np.concatenate(([0.0], self.pins_m)), np.concatenate((self.pins_m, [self.length_m]))


@dataclass(frozen=True)
class Holding:
    """Stations (m,) along the strip and the share (m, h) of every hinge's angle in each
    station's.
    """

    stations_m: Floats
    share: Floats


@dataclass(frozen=True)
class EncasedStrip:
    """A strip of stiffness EI in a lay, held at stations, with about `elements` elements of (7)
    in total.
    """

    EI_Nm2: float
    lay: Lay
    holding: Holding
    elements: int = 400

    def bent(self, phi_rad: Floats) -> Bent:
        """The shape for the hinge angles (h,). Raises SimulationFailed."""
        mesh, nodes = mesh_through(
            self.EI_Nm2, self.lay.length_m, self.holding.stations_m, self.elements
        )
        # Linear interpolation between the stations is close to the solution, which is what Newton
        # needs.
        angles = self.holding.share @ phi_rad
        return bend(
            mesh,
            Holds(nodes, angles),
            NO_FORCE,
            np.interp(mesh.s_m, self.holding.stations_m, angles),
        )

    def energy_J(self, phi_rad: Floats) -> float:
        """U(phi) of (7), for hinge angles (h,)."""
        return self.bent(phi_rad).energy_J

    def torque_Nm(self, phi_rad: Floats) -> Floats:
        """(h,) dU/dphi, from the multipliers of (4)."""
        return -self.holding.share.T @ self.bent(phi_rad).multipliers

    def stiffness_matrix(self, phi_rad: Floats) -> Floats:
        """(h, h) second derivatives of U, exact for the mesh: from the linear system of the last
        Newton step.
        """
        bent = self.bent(phi_rad)
        nodes = np.searchsorted(bent.mesh.s_m, self.holding.stations_m)
        by_station = sensitivity(bent, Holds(nodes, self.holding.share @ phi_rad), NO_FORCE)
        return self.holding.share.T @ by_station @ self.holding.share

    def difference_stiffness(self, phi_rad: Floats, step_rad: float = 1e-2) -> Floats:
        """(h,) K_i by (8), central second differences of U about `phi_rad` (h,), of second order in
        the step.

        The middle term is U(phi), where (8) prints U(0).
        """
        middle = self.energy_J(phi_rad)
        steps = step_rad * np.eye(phi_rad.size)
        return (
            np.array(
                [
                    self.energy_J(phi_rad + d) - 2.0 * middle + self.energy_J(phi_rad - d)
                    for d in steps
                ]
            )
            / step_rad**2
        )

    def difference_stiffness_matrix(self, phi_rad: Floats, step_rad: float = 1e-2) -> Floats:
        """(h, h) by differences of U alone: K_i on the diagonal, and mixed second differences
        beside it.
        """
        matrix = np.diag(self.difference_stiffness(phi_rad, step_rad))
        steps = step_rad * np.eye(phi_rad.size)
        for i in range(phi_rad.size):
            for j in range(i):
                # (U(++) + U(--) - U(+-) - U(-+)) / 4 step^2
                both = steps[i] + steps[j]
                apart = steps[i] - steps[j]
                along = self.energy_J(phi_rad + both) + self.energy_J(phi_rad - both)
                across = self.energy_J(phi_rad + apart) + self.energy_J(phi_rad - apart)
                matrix[i, j] = matrix[j, i] = 0.25 * (along - across) / step_rad**2
        return matrix


def centre_lay(link_lengths_m: tuple[float, ...], strip_length_m: float) -> Lay:
    """Lay of a strip that reaches as far beyond the first hinge as beyond the last.

    The paper does not state the position. Its strip, 226 mm, is shorter than from the middle of the
    first link to the middle of the last (243 mm), and longer than from the first hinge to the last
    (197 mm). Centred, it reaches 14.7 mm into either end link, from 39.3 to 265.3 mm of the leg.
    Raises BadInput where it does not reach beyond the hinges, or sticks out of the leg.
    """
    pins = np.cumsum(link_lengths_m)[:-1]
    beyond = 0.5 * (strip_length_m - (pins[-1] - pins[0]))
    if not 0.0 < beyond <= min(link_lengths_m[0], link_lengths_m[-1]):
        raise BadInput(
            f"strip of {1e3 * strip_length_m:.1f} mm: centred on hinges "
            f"{1e3 * (pins[-1] - pins[0]):.1f} mm apart it reaches "
            f"{1e3 * beyond:.1f} mm into the end links of {1e3 * link_lengths_m[0]:.1f} "
            f"and {1e3 * link_lengths_m[-1]:.1f} mm; "
            "change its length"
        )
    return Lay(pins - pins[0] + beyond, strip_length_m)


def by_its_middle(lay: Lay) -> Holding:
    """One station in every link, in the middle of the encased part."""
    begin, end = lay.encased_m
    return Holding(0.5 * (begin + end), _running_sum(lay))


def by_a_length(lay: Lay, free_m: float) -> Holding:
    """Two stations in every link: the strip is straight from one to the other, and free within
    `free_m` / 2 of each pin.

    Raises BadInput where that leaves nothing to hold in a link.
    """
    begin, end = lay.encased_m
    first = begin + 0.5 * free_m
    last = end - 0.5 * free_m
    # The strip's own ends are no pins, so nothing is free there.
    first[0] = begin[0]
    last[-1] = end[-1]
    if not (free_m > 0.0 and (last > first).all()):
        raise BadInput(
            f"free length of {1e3 * free_m:.1f} mm at every hinge: the shortest encased "
            f"part is {1e3 * (end - begin).min():.1f} mm; "
            "take a free length above zero that leaves some of each part held"
        )
    return Holding(np.stack((first, last), axis=1).ravel(), np.repeat(_running_sum(lay), 2, axis=0))


def at_pins(lay: Lay) -> Holding:
    """The strip's near end along the first link, and at every pin along the link after it."""
    return Holding(np.concatenate(([0.0], lay.pins_m)), _running_sum(lay))


def at_pins_mean(lay: Lay) -> Holding:
    """Both ends along their links, and at every pin halfway between the links it joins."""
    links = _running_sum(lay)
    share = np.concatenate((links[:1], 0.5 * (links[:-1] + links[1:]), links[-1:]))
    return Holding(np.concatenate(([0.0], lay.pins_m, [lay.length_m])), share)


def _running_sum(lay: Lay) -> Floats:
    """(h + 1, h) the angle of each link as a sum of hinge angles."""
    return np.tril(np.ones((lay.pins_m.size + 1, lay.pins_m.size)), -1)
