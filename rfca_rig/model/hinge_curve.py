"""Torque over angle of one hinge whose shells clamp the strip at some distance from the pin, for large angles.

Between the shells the strip runs free over 2a, a on either side of the pin, at an offset h from it: positive where the hinge bends
towards the strip's side. The shells turn about the pin by phi, so in the frame of the bisecting line the clamped sections point by
-phi/2 and +phi/2, level with each other, a chord X(phi) apart:

    X(phi) = 2 (a cos(phi/2) - h sin(phi/2))

Unlike in (4), the position of the strip is prescribed as well as its direction, which is a geometric nonlinearity. By symmetry the
force in the strip is along the chord, a thrust P. Two limits:

Sliding without friction in its grooves, the strip draws in or lets out length until U no longer depends on it. Then EI theta'^2 / 2 =
P cos(theta) everywhere, also at the mouth of the groove (the thrust M^2 / 2EI of a sliding sleeve; Bigoni et al. 2015,
"Eshelby-like forces acting on elastic structures"), and

    X = sqrt(EI / 2P) I(phi),  I = integral of sqrt(cos t) dt over -phi/2..phi/2,   U = EI I^2 / (2 X)

At h = 0 that is U = EI phi^2 / 4a (1 + phi^2/12 + ...): k0 = EI / 2a, k2 = 1/6.

Fixed in both shells, a strip of length 2a does not stretch. The chord is shorter than the circular arc's, by phi^2 a/6 at h = 0, so the
strip is upset into a deeper curve: theta = A sin(k s) at small angles with tan 2ka = 2ka, and k0 = (ka)^2 cot^2(ka) EI / 2a =
3.246 EI / 2a. Where h phi < 0 it would have to stretch, and there is no such shape.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.model.elastica import Bent, Holds, Mesh, bend, even_mesh

Floats = NDArray[np.float64]

ELEMENTS = 200
FIRST_STEP_RAD = 0.01
LONGEST_STEP_RAD = 0.02
# Gauss-Legendre on -1..1; the integrand sqrt(cos t) is smooth within 45 degrees, the limit of phi / 2.
QUADRATURE, QUADRATURE_WEIGHTS = np.polynomial.legendre.leggauss(40)


@dataclass(frozen=True)
class HeldHinge:
    """`free_m` is 2a, `offset_m` is h, EI that of all strips at this offset."""

    EI_Nm2: float
    free_m: float
    offset_m: float = 0.0

    def chord_m(self, phi_rad: Floats) -> Floats:
        """Distance (m,) of the clamped sections for hinge angles (m,) [m]."""
        return self.free_m * np.cos(0.5 * phi_rad) - 2.0 * self.offset_m * np.sin(0.5 * phi_rad)

    def chord_slope_m(self, phi_rad: Floats) -> Floats:
        """Derivative (m,) of the distance by the hinge angle [m/rad]."""
        return -0.5 * self.free_m * np.sin(0.5 * phi_rad) - self.offset_m * np.cos(0.5 * phi_rad)


class HingeCurve(NamedTuple):
    """All (m,): bending energy, its derivative by the angle, and the greatest curvature in the free length."""

    phi_rad: Floats
    energy_J: Floats
    torque_Nm: Floats
    curvature_per_m: Floats


class HardeningFit(NamedTuple):
    """torque = k0 (phi + k2 phi^3), and the root mean square of its residual, relative to the largest torque."""

    k0_Nm_per_rad: float
    k2_per_rad2: float
    misfit_relative: float


def compute_sliding_curve(hinge: HeldHinge, phi_rad: Floats) -> HingeCurve:
    """Curve of a strip that slides freely in its grooves; closed form but for one integral. `phi_rad` (m,) within +-90 degrees.

    Raises BadInput where the grooves meet.
    """
    chord = hinge.chord_m(phi_rad)
    if (chord <= 0.0).any() or (np.abs(phi_rad) > 0.5 * np.pi).any():
        raise BadInput(
            f"hinge at {np.degrees(np.abs(phi_rad).max()):.1f} degrees with {1e3 * hinge.free_m:.1f} mm free and an offset of "
            f"{1e3 * hinge.offset_m:.1f} mm: the grooves would meet; the limit is 90 degrees and a chord above zero"
        )
    half = 0.5 * phi_rad
    swept = half * (np.sqrt(np.cos(np.multiply.outer(half, QUADRATURE))) @ QUADRATURE_WEIGHTS)
    energy = hinge.EI_Nm2 * swept**2 / (2.0 * chord)
    torque = hinge.EI_Nm2 * swept * np.sqrt(np.cos(half)) / chord - energy * hinge.chord_slope_m(phi_rad) / chord
    return HingeCurve(phi_rad, energy, torque, np.abs(swept / chord))


def compute_fixed_curve(hinge: HeldHinge, phi_rad: Floats) -> HingeCurve:
    """Curve of a strip that is fixed in both shells and keeps its length 2a, by the discrete elastica, continued from small angles.

    `phi_rad` (m,) ascending, above zero. Second order in the length of 200 elements. Raises BadInput where the strip would have to
    stretch, SimulationFailed where no shape is found.
    """
    if phi_rad[0] <= 0.0 or (np.diff(phi_rad) <= 0.0).any() or hinge.offset_m < 0.0:
        raise BadInput(
            f"strip fixed in both shells, offset {1e3 * hinge.offset_m:.1f} mm, angles from {np.degrees(phi_rad[0]):.1f} degrees: "
            "it cannot stretch; give ascending angles above zero, and an offset of zero or towards the inside of the bend"
        )
    mesh = even_mesh(hinge.EI_Nm2, hinge.free_m, ELEMENTS)
    theta, rows, reached = _first_guess(hinge, mesh.s_m, min(FIRST_STEP_RAD, float(phi_rad[0]))), [], 0.0
    for wanted in phi_rad:
        # Each shape is the first guess of the next one, a short step away, which keeps the solution on its branch.
        for angle in _steps(reached, float(wanted)):
            bent = _bend_clamped(hinge, mesh, float(angle), theta)
            theta = bent.theta_rad
        reached = float(wanted)
        rows.append((bent.energy_J, _torque_Nm(hinge, bent, reached), bent.greatest_curvature_per_m))
    return HingeCurve(phi_rad, *np.array(rows).T)


def _bend_clamped(hinge: HeldHinge, mesh: Mesh, phi_rad: float, start_rad: Floats) -> Bent:
    sections = np.array([0, mesh.s_m.size - 1])
    holds = Holds(sections, np.array([-0.5, 0.5]) * phi_rad, (float(hinge.chord_m(np.array(phi_rad))), 0.0))
    return bend(mesh, holds, np.zeros(2), start_rad)


def _torque_Nm(hinge: HeldHinge, bent: Bent, phi_rad: float) -> float:
    """dU/dphi: from the moments of the two sections, each turned by half, and from the thrust times the change of the chord."""
    left, right, along, _ = -bent.multipliers
    return float(0.5 * (right - left) + along * hinge.chord_slope_m(np.array(phi_rad)))


def fit_hardening(phi_rad: Floats, torque_Nm: Floats) -> HardeningFit:
    """Least squares of k0 (phi + k2 phi^3) to a torque curve, both (m,)."""
    columns = np.stack((phi_rad, phi_rad**3), axis=1)
    (first, third), *_ = np.linalg.lstsq(columns, torque_Nm, rcond=None)
    left = torque_Nm - columns @ (first, third)
    return HardeningFit(float(first), float(third / first), float(np.sqrt(np.mean(left**2)) / np.abs(torque_Nm).max()))


def _steps(begin_rad: float, end_rad: float) -> Floats:
    """From where it is, exclusive, to where it shall be; the very first step is short, for the guess is good to small angles only."""
    if begin_rad == 0.0 and end_rad > FIRST_STEP_RAD:
        return np.concatenate(([FIRST_STEP_RAD], _steps(FIRST_STEP_RAD, end_rad)))
    count = int(np.ceil((end_rad - begin_rad) / LONGEST_STEP_RAD))
    return np.linspace(begin_rad, end_rad, count + 1)[1:]


def _first_guess(hinge: HeldHinge, s_m: Floats, phi_rad: float) -> Floats:
    """phi x/2 + C sin(pi x), x from -1 to 1: C takes up the length that the chord falls short by, to second order in the slope.

    The mean square of the slope is twice the shortening: C^2/2 + C phi/pi + phi^2/12 = 2 (1 - X/2a). The root above zero is the deeper
    curve.
    """
    x = 2.0 * s_m / hinge.free_m - 1.0
    short = 1.0 - float(hinge.chord_m(np.array(phi_rad))) / hinge.free_m
    half = phi_rad / np.pi
    C = -half + np.sqrt(half**2 + 4.0 * short - phi_rad**2 / 6.0)
    guess: Floats = 0.5 * phi_rad * x + C * np.sin(np.pi * x)
    return guess
