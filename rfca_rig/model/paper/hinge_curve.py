"""Torque over angle of one hinge whose shells clamp the strip at some distance from the pin, for
large angles.

Between the shells the strip runs free over 2a, a on either side of the pin, at an offset h from it:
positive where the hinge bends towards the strip's side. The shells turn about the pin by phi, so in
the frame of the bisecting line the clamped sections point by -phi/2 and +phi/2, level with each
other, a chord X(phi) apart:

    X(phi) = 2 (a cos(phi/2) - h sin(phi/2))

Unlike in (4), the position of the strip is prescribed as well as its direction, which is a
geometric nonlinearity. By symmetry the force in the strip is along the chord, a thrust P. Two
limits:

Sliding without friction in its grooves, the strip draws in or lets out length until U no longer
depends on it. Then EI theta'^2 / 2 = P cos(theta) everywhere, also at the mouth of the groove (the
thrust M^2 / 2EI of a sliding sleeve; Bigoni et al. 2015, "Eshelby-like forces acting on elastic
structures"), and

    X = sqrt(EI / 2P) I(phi),  I = integral of sqrt(cos t) dt over -phi/2..phi/2,
    U = EI I^2 / (2 X)

At h = 0 that is U = EI phi^2 / 4a (1 + phi^2/12 + ...): k0 = EI / 2a, k2 = 1/6.

Fixed in both shells, a strip of length 2a does not stretch. The chord is shorter than the circular
arc's, by phi^2 a/6 at h = 0, so the strip is upset into a deeper curve: theta = A sin(k s) at small
angles with tan 2ka = 2ka, and k0 = (ka)^2 cot^2(ka) EI / 2a = 3.246 EI / 2a. Where h phi < 0 it
would have to stretch, and there is no such shape.

Torque over angle of a hinge whose strip has play in the shells' grooves: the only way in which the
strip alone hardens much.

All hinges are bent alike, so half a pitch p repeats: from the middle of a link (slope 0, by
symmetry) to the pin (slope phi/2). The groove ends at the mouth, m before the pin, and lets the
strip move by the play d in all. With x from the link's middle, b the distance from where the strip
lies flat to the mouth, and slopes small within a link (phi/2 is half of what a hinge turns):

    free      the strip bends evenly over the pitch: M = EI phi / p
    touching  from phi = 2 p d / (p/2 - m)^2 on: middle and mouth press on opposite walls,
              M grows linearly between them
    flat      the middle lies along its wall; 3 d = M b^2 / 2EI and phi/2 = M (b/2 + m) / EI,
              hence M = EI phi / (2m + b)

so that the secant stiffness goes from EI / p to EI / 2m. With the paper's strips, m = 3.0 mm and d
= 0.32 mm this follows the fitted 10.98 (phi + 4.56 phi^3) to 2.5 % of its end over 0 to 23.5
degrees, as far as the hinges turn in the paper's stroke. But the curvature at the pin is M / EI:
there the strips would be at twice the strength of Table I. The shape can be the groove's doing, the
size not alone.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.model.paper.elastica import Bent, Holds, Mesh, bend, even_mesh

Floats = NDArray[np.float64]

ELEMENTS = 200
FIRST_STEP_RAD = 0.01
LONGEST_STEP_RAD = 0.02
# Gauss-Legendre on -1..1; the integrand sqrt(cos t) is smooth within 45 degrees, the limit of phi /
# 2.
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
    """All (m,): bending energy, its derivative by the angle, and the greatest curvature in the
    free length.
    """

    phi_rad: Floats
    energy_J: Floats
    torque_Nm: Floats
    curvature_per_m: Floats


class HardeningFit(NamedTuple):
    """torque = k0 (phi + k2 phi^3), and the root mean square of its residual, relative to the
    largest torque.
    """

    k0_Nm_per_rad: float
    k2_per_rad2: float
    misfit_relative: float


def compute_sliding_curve(hinge: HeldHinge, phi_rad: Floats) -> HingeCurve:
    """Curve of a strip that slides freely in its grooves; closed form but for one integral.
    `phi_rad` (m,) within +-90 degrees.

    Raises BadInput where the grooves meet.
    """
    chord = hinge.chord_m(phi_rad)
    if (chord <= 0.0).any() or (np.abs(phi_rad) > 0.5 * np.pi).any():
        raise BadInput(
            f"hinge at {np.degrees(np.abs(phi_rad).max()):.1f} degrees with "
            f"{1e3 * hinge.free_m:.1f} mm free and an offset of "
            f"{1e3 * hinge.offset_m:.1f} mm: the grooves would meet; the limit is 90 "
            "degrees and a chord above zero"
        )
    half = 0.5 * phi_rad
    swept = half * (np.sqrt(np.cos(np.multiply.outer(half, QUADRATURE))) @ QUADRATURE_WEIGHTS)
    energy = hinge.EI_Nm2 * swept**2 / (2.0 * chord)
    torque = (
        hinge.EI_Nm2 * swept * np.sqrt(np.cos(half)) / chord
        - energy * hinge.chord_slope_m(phi_rad) / chord
    )
    return HingeCurve(phi_rad, energy, torque, np.abs(swept / chord))


def compute_fixed_curve(hinge: HeldHinge, phi_rad: Floats) -> HingeCurve:
    """Curve of a strip that is fixed in both shells and keeps its length 2a, by the discrete
    elastica, continued from small angles.

    `phi_rad` (m,) ascending, above zero. Second order in the length of 200 elements. Raises
    BadInput where the strip would have to stretch, SimulationFailed where no shape is found.
    """
    if phi_rad[0] <= 0.0 or (np.diff(phi_rad) <= 0.0).any() or hinge.offset_m < 0.0:
        raise BadInput(
            f"strip fixed in both shells, offset {1e3 * hinge.offset_m:.1f} mm, angles "
            f"from {np.degrees(phi_rad[0]):.1f} degrees: "
            "it cannot stretch; give ascending angles above zero, and an offset of zero "
            "or towards the inside of the bend"
        )
    mesh = even_mesh(hinge.EI_Nm2, hinge.free_m, ELEMENTS)
    theta = _first_guess(hinge, mesh.s_m, min(FIRST_STEP_RAD, float(phi_rad[0])))
    rows = []
    reached = 0.0
    for wanted in phi_rad:
        # Each shape is the first guess of the next one, a short step away, which keeps the solution
        # on its branch.
        for angle in _steps(reached, float(wanted)):
            bent = _bend_clamped(hinge, mesh, float(angle), theta)
            theta = bent.theta_rad
        reached = float(wanted)
        rows.append(
            (bent.energy_J, _torque_Nm(hinge, bent, reached), bent.greatest_curvature_per_m)
        )
    return HingeCurve(phi_rad, *np.array(rows).T)


def _bend_clamped(hinge: HeldHinge, mesh: Mesh, phi_rad: float, start_rad: Floats) -> Bent:
    sections = np.array([0, mesh.s_m.size - 1])
    holds = Holds(
        sections, np.array([-0.5, 0.5]) * phi_rad, (float(hinge.chord_m(np.array(phi_rad))), 0.0)
    )
    return bend(mesh, holds, np.zeros(2), start_rad)


def _torque_Nm(hinge: HeldHinge, bent: Bent, phi_rad: float) -> float:
    """dU/dphi: from the moments of the two sections, each turned by half, and from the thrust
    times the change of the chord.
    """
    left, right, along, _ = -bent.multipliers
    return float(0.5 * (right - left) + along * hinge.chord_slope_m(np.array(phi_rad)))


def fit_hardening(phi_rad: Floats, torque_Nm: Floats) -> HardeningFit:
    """Least squares of k0 (phi + k2 phi^3) to a torque curve, both (m,)."""
    columns = np.stack((phi_rad, phi_rad**3), axis=1)
    (first, third), *_ = np.linalg.lstsq(columns, torque_Nm, rcond=None)
    left = torque_Nm - columns @ (first, third)
    return HardeningFit(
        float(first),
        float(third / first),
        float(np.sqrt(np.mean(left**2)) / np.abs(torque_Nm).max()),
    )


def _steps(begin_rad: float, end_rad: float) -> Floats:
    """From where it is, exclusive, to where it shall be; the very first step is short, for the
    guess is good to small angles only.
    """
    if begin_rad == 0.0 and end_rad > FIRST_STEP_RAD:
        return np.concatenate(([FIRST_STEP_RAD], _steps(FIRST_STEP_RAD, end_rad)))
    count = int(np.ceil((end_rad - begin_rad) / LONGEST_STEP_RAD))
    return np.linspace(begin_rad, end_rad, count + 1)[1:]


def _first_guess(hinge: HeldHinge, s_m: Floats, phi_rad: float) -> Floats:
    """phi x/2 + C sin(pi x), x from -1 to 1: C takes up the length that the chord falls short by,
    to second order in the slope.

    The mean square of the slope is twice the shortening: C^2/2 + C phi/pi + phi^2/12 = 2 (1 -
    X/2a). The root above zero is the deeper curve.
    """
    x = 2.0 * s_m / hinge.free_m - 1.0
    short = 1.0 - float(hinge.chord_m(np.array(phi_rad))) / hinge.free_m
    half = phi_rad / np.pi
    C = -half + np.sqrt(half**2 + 4.0 * short - phi_rad**2 / 6.0)
    guess: Floats = 0.5 * phi_rad * x + C * np.sin(np.pi * x)
    return guess


@dataclass(frozen=True)
class LooseGroove:
    """`pitch_m` is p, `mouth_m` is m, `play_m` is d: how much wider the groove is than the strip
    is thick. Raises BadInput.
    """

    EI_Nm2: float
    pitch_m: float
    mouth_m: float
    play_m: float

    def __post_init__(self) -> None:
        if not (0.0 < self.mouth_m < 0.5 * self.pitch_m and self.play_m > 0.0):
            raise BadInput(
                f"groove with {1e3 * self.play_m:.2f} mm of play ending "
                f"{1e3 * self.mouth_m:.1f} mm before the pin: the play must be above "
                f"zero and the end between zero and half the pitch, {500.0 * self.pitch_m:.1f} mm"
            )

    @property
    def reach_m(self) -> float:
        """From the link's middle to the groove's mouth."""
        return 0.5 * self.pitch_m - self.mouth_m

    @property
    def touches_rad(self) -> float:
        """Hinge angle from which on the strip touches both walls."""
        return 2.0 * self.play_m * self.pitch_m / self.reach_m**2

    @property
    def flat_rad(self) -> float:
        """Hinge angle from which on it lies along one wall."""
        return (
            6.0 * self.play_m / self.reach_m + 12.0 * self.play_m * self.mouth_m / self.reach_m**2
        )

    def torque_Nm(self, phi_rad: Floats) -> Floats:
        """(m,) for hinge angles (m,) from zero up."""
        free = self.EI_Nm2 * phi_rad / self.pitch_m
        # All three branches are computed for all angles; at the borders they agree, so the curve is
        # continuous.
        torque = np.where(phi_rad < self.flat_rad, self._touching(phi_rad), self._flat(phi_rad))
        return np.where(phi_rad < self.touches_rad, free, torque)

    def _touching(self, phi_rad: Floats) -> Floats:
        """M from M0 in the middle to M at the mouth over r: rise M0 r^2/3 + M r^2/6 = d EI,
        slope (M0 + M) r/2 + M m = EI phi/2.
        """
        r = self.reach_m
        from_rise = 3.0 * self.play_m * self.EI_Nm2 / r**2
        torque: Floats = (0.5 * self.EI_Nm2 * phi_rad - 0.5 * r * from_rise) / (
            0.25 * r + self.mouth_m
        )
        return torque

    def _flat(self, phi_rad: Floats) -> Floats:
        """phi/2 = 3 d / b + 6 d m / b^2, solved for b. (Rise of a strip flat at the far end: M
        b^2 / 6 EI = d.)
        """
        # Smaller angles belong to other branches; the bound keeps the division finite at zero.
        phi = np.maximum(phi_rad, self.flat_rad)
        b = (
            3.0 * self.play_m
            + np.sqrt(9.0 * self.play_m**2 + 12.0 * phi * self.play_m * self.mouth_m)
        ) / phi
        torque: Floats = self.EI_Nm2 * phi / (2.0 * self.mouth_m + b)
        return torque
