"""Torsion springs in place of the bent strip (pseudo-rigid-body model): torque and stiffness of
every joint, eqs. (3), (6).

A spring is k0 phi + k0 k2 phi^3, or a measured torque over angle as a cubic spline. The form is the
interpolating cubic spline with not-a-knot ends. Its second derivative is continuous between the
outermost knots, and beyond them it continues straight, with the end slope. Three reasons:

- The integrator is of third order and its Newton iteration uses dT/dphi. Monotone cubics with a
  continuous first derivative only (PCHIP) have a kink of the stiffness at every knot.
- It is linear in the torques at its knots. So their covariance determines that of the curve, a
  factor scales both, and every law k0 phi + k0 k2 phi^3 is among these splines.
- It is monotone wherever its knots resolve the stiffness. Between two knots the stiffness is a
  parabola, whose least value is known exactly, so a curve that is not monotone is refused. A form
  that is monotone by construction would invent a shape there.

A curve whose angles begin at 0 is odd: the hinge bends alike to either side.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.model.kernel.compiled import jit_inline
from rfca_rig.model.kernel.lanes import count_lanes, lane_of, with_lane
from rfca_rig.model.kernel.state import Chain
from rfca_rig.model.parameters import Leg, TorqueSpline

if TYPE_CHECKING:
    from scipy.interpolate import PPoly


Floats = NDArray[np.float64]

FEWEST_ANGLES = 3  # beside 0; with fewer the spline is a parabola or less
MOST_ANGLES = 200  # a measured curve has some ten
FARTHEST_DEG = 120.0  # a hinge of the paper's leg bends by 30 degrees


class SplineTable(NamedTuple):
    """The springs of all joints as cubics: `origin` (n, p) [rad], where each piece begins and from
    which it counts, and `cubic` (n, p, 5).

    Of `cubic` the first column is the energy at the origin, the others are the coefficients of the
    torque by ascending power, all divided by k0. The first and the last piece of a joint are
    straight. Unused pieces begin at infinity. No spline: p = 0.
    """

    origin: Floats
    cubic: Floats

    def torque(self, x: Floats) -> Floats:
        """Torque over k0 [rad] for angles from rest (..., n)."""
        u, c = self._at(x)
        return np.asarray(c[..., 1] + u * (c[..., 2] + u * (c[..., 3] + u * c[..., 4])))

    def stiffness(self, x: Floats) -> Floats:
        """Its derivative (..., n)."""
        u, c = self._at(x)
        return np.asarray(c[..., 2] + u * (2.0 * c[..., 3] + u * 3.0 * c[..., 4]))

    def energy(self, x: Floats) -> Floats:
        """Its integral from 0 (..., n) [rad2]."""
        u, c = self._at(x)
        return np.asarray(
            c[..., 0]
            + u * (c[..., 1] + u * (c[..., 2] / 2.0 + u * (c[..., 3] / 3.0 + u * c[..., 4] / 4.0)))
        )

    def _at(self, x: Floats) -> tuple[Floats, Floats]:
        # Angles below the first origin use the first piece, which is straight.
        piece = np.maximum((x[..., None] >= self.origin).sum(axis=-1) - 1, 0)
        joint = np.arange(len(self.origin))
        return x - self.origin[joint, piece], self.cubic[joint, piece]


NO_SPLINE = SplineTable(np.empty((0, 0)), np.empty((0, 0, 5)))


@jit_inline
def spring(chain: Chain, i: int, phi: float) -> tuple[float, float]:
    """Torque of joint i at an angle from rest, k0 phi + k0 k2 phi^3 or that of its spline, and
    the torque's derivative over k0.
    """
    k0 = chain.k0[i]
    if chain.spring_origin.shape[1] == 0:
        k2 = chain.k2[i]
        return k0 * phi * (1.0 + k2 * phi * phi), 1.0 + 3.0 * k2 * phi * phi
    u = phi
    c0 = phi
    c1 = phi
    c2 = phi
    c3 = phi
    for lane in range(count_lanes(phi)):
        # Bisection for the last piece that begins at or below phi; unused pieces begin at infinity
        # and are never chosen.
        x = lane_of(phi, lane)
        low = 0
        high = chain.spring_origin.shape[1]
        while high - low > 1:
            middle = (low + high) // 2
            if lane_of(chain.spring_origin[i, middle], lane) <= x:
                low = middle
            else:
                high = middle
        u = with_lane(u, lane, x - lane_of(chain.spring_origin[i, low], lane))
        c0 = with_lane(c0, lane, lane_of(chain.spring_cubic[i, low, 1], lane))
        c1 = with_lane(c1, lane, lane_of(chain.spring_cubic[i, low, 2], lane))
        c2 = with_lane(c2, lane, lane_of(chain.spring_cubic[i, low, 3], lane))
        c3 = with_lane(c3, lane, lane_of(chain.spring_cubic[i, low, 4], lane))
    return k0 * (c0 + u * (c1 + u * (c2 + u * c3))), c1 + u * (2.0 * c2 + u * 3.0 * c3)


def table_of(splines: tuple[TorqueSpline, ...], joints: int) -> SplineTable:
    """Table of a leg's joints, the first of which is the shaft; `splines` holds none, one for
    all hinges, or one for each.
    """
    if splines:
        return _table(splines, joints)
    return NO_SPLINE


@lru_cache(maxsize=64)
def _table(splines: tuple[TorqueSpline, ...], joints: int) -> SplineTable:
    joint_splines = splines * (joints - 1) if len(splines) == 1 else splines
    polynomials = [
        polynomial(spline.angles_rad, np.array(spline.torques_rad)) for spline in joint_splines
    ]
    p = max(len(curve.x) - 1 for curve in polynomials)
    origin = np.full((joints, p), np.inf)
    cubic = np.zeros((joints, p, 5))
    origin[0, 0] = 0.0
    for joint, curve in enumerate(polynomials, start=1):
        pieces = len(curve.x) - 1
        energy = curve.antiderivative()
        origin[joint, :pieces] = curve.x[:-1]
        # The energy counts from rest, where the torque is zero. scipy orders coefficients by
        # descending power.
        cubic[joint, :pieces, 0] = energy(curve.x[:-1]) - energy(0.0)
        cubic[joint, :pieces, 1:] = curve.c[::-1].T
    return SplineTable(origin, cubic)


def polynomial(angles_rad: Sequence[float], torques: Floats) -> "PPoly":
    """The spline through `torques` (m,) or (m, e) at ascending angles (m,), straight beyond them,
    as cubics for any angle.

    Angles that begin at 0 also represent the other side, with the opposite sign of the torques.
    """
    from scipy.interpolate import CubicSpline, PPoly  # noqa: PLC0415  (takes 0.4 s, and legs with a spline only need it)

    x = np.array(angles_rad)
    y = torques
    if x[0] == 0.0:
        x = np.concatenate((-x[:0:-1], x))
        y = np.concatenate((-y[:0:-1], y))
    inner: Any = CubicSpline(x, y, bc_type="not-a-knot")
    c = np.zeros((4, len(x) + 1, *y.shape[1:]))
    c[:, 1:-1] = inner.c
    c[2, 0] = inner(x[0], 1)
    c[2, -1] = inner(x[-1], 1)
    # The first piece counts from one radian before the first knot.
    c[3, 0] = y[0] - c[2, 0]
    c[3, -1] = y[-1]
    return PPoly(c, np.concatenate(([x[0] - 1.0], x, [x[-1] + 1.0])))


def slope_at_rest(spline: TorqueSpline) -> float:
    """dT/dphi over k0 at rest."""
    return float(polynomial(spline.angles_rad, np.array(spline.torques_rad))(0.0, 1))


def knots_from(
    angles_deg: Sequence[float], torques_Nm: Sequence[float], where: str
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Angles [rad] and torques [N m] of a measured curve as knots of its spline; (0, 0) is added
    where it is missing.

    Raises BadInput, which begins with `where`, for points that make no monotone curve through rest.
    """
    _check_points(angles_deg, torques_Nm, where)
    points = sorted(
        {*zip(map(float, np.radians(angles_deg)), map(float, torques_Nm), strict=True), (0.0, 0.0)}
    )
    angles, torques = (tuple(values) for values in zip(*points, strict=True))
    # A curve that was measured on the negative side only is odd as well: it is turned to the
    # positive side.
    if angles[-1] == 0.0:
        angles = tuple(-angle for angle in reversed(angles))
        torques = tuple(-torque for torque in reversed(torques))
    _check_monotone(angles, torques, where)
    return angles, torques


def _check_points(angles_deg: Sequence[float], torques_Nm: Sequence[float], where: str) -> None:
    if len(angles_deg) != len(torques_Nm):
        raise BadInput(
            f"{where}: {len(angles_deg)} angles, but {len(torques_Nm)} torques; give one "
            "torque per angle"
        )
    if not FEWEST_ANGLES <= len(angles_deg) - (0.0 in angles_deg) <= MOST_ANGLES:
        raise BadInput(
            f"{where}: {len(angles_deg)} angles; give {FEWEST_ANGLES} to {MOST_ANGLES} beside 0"
        )
    if max(map(abs, angles_deg)) > FARTHEST_DEG:
        raise BadInput(
            f"{where}: angle {max(angles_deg, key=abs):g} degrees; the limit is {FARTHEST_DEG:g}"
        )
    for i in range(1, len(angles_deg)):
        if angles_deg[i] <= angles_deg[i - 1]:
            raise BadInput(
                f"{where}: angle {i + 1} ({angles_deg[i]:g}) is not above the one before "
                f"({angles_deg[i - 1]:g}); sort them"
            )
        if torques_Nm[i] <= torques_Nm[i - 1]:
            raise BadInput(
                f"{where}: torque {i + 1} ({torques_Nm[i]:g} N m) is not above the one "
                f"before ({torques_Nm[i - 1]:g} N m); "
                "the torque must grow with the angle"
            )
    for angle, torque in zip(angles_deg, torques_Nm, strict=True):
        if angle * torque < 0.0 or (angle == 0.0) != (torque == 0.0):
            raise BadInput(
                f"{where}: {torque:g} N m at {angle:g} degrees; angles count from where "
                "the hinge bears no torque: "
                "put that angle into leg.rest_angles_deg and take it off"
            )


def _check_monotone(
    angles_rad: tuple[float, ...], torques_Nm: tuple[float, ...], where: str
) -> None:
    """The stiffness of every piece is a parabola, least at an end or at its turning point."""
    stiffness = polynomial(angles_rad, np.array(torques_Nm)).derivative()
    turns = stiffness.derivative().roots(extrapolate=False)
    # The outermost breaks belong to the straight continuations and are no knots. A straight piece
    # has no turning point: NaN.
    x = np.concatenate((stiffness.x[1:-1], turns[np.isfinite(turns)]))
    least = int(np.argmin(stiffness(x)))
    if stiffness(x)[least] <= 0.0:
        raise BadInput(
            f"{where}: the spline through these torques falls at "
            f"{np.degrees(x[least]):.1f} degrees, so the curve is not monotone; "
            "give smoother torques, or more angles there"
        )


@dataclass(frozen=True)
class HingeSprings:
    """k0 x + k0 k2 x^3 per joint, or k0 times the joint's spline; x = phi - `rest_rad`, all
    (n,). Joint 1 is the shaft and has k0 = 0.
    """

    k0_Nm_per_rad: Floats
    k2_per_rad2: Floats
    rest_rad: Floats
    splines: SplineTable = NO_SPLINE

    def torque_Nm(self, phi: Floats) -> Floats:
        """Torque (..., n) that bends the springs to `phi` (..., n) [rad]."""
        # A leg has either splines for all hinges or none.
        x = phi - self.rest_rad
        if self.splines.origin.size:
            return np.asarray(self.k0_Nm_per_rad * self.splines.torque(x))
        return np.asarray(self.k0_Nm_per_rad * x * (1.0 + self.k2_per_rad2 * x**2))

    def stiffness_Nm_per_rad(self, phi: Floats) -> Floats:
        """Its derivative K_i (..., n)."""
        x = phi - self.rest_rad
        if self.splines.origin.size:
            return np.asarray(self.k0_Nm_per_rad * self.splines.stiffness(x))
        return np.asarray(self.k0_Nm_per_rad * (1.0 + 3.0 * self.k2_per_rad2 * x**2))

    def energy_J(self, phi: Floats) -> Floats:
        """Energy (..., n) of each bent spring, the integral of its torque from rest."""
        x = phi - self.rest_rad
        if self.splines.origin.size:
            return np.asarray(self.k0_Nm_per_rad * self.splines.energy(x))
        return np.asarray(self.k0_Nm_per_rad * x**2 * (0.5 + 0.25 * self.k2_per_rad2 * x**2))


def springs_of(leg: Leg) -> HingeSprings:
    """The springs of a leg."""
    n = len(leg.link_lengths_m)
    k0 = np.full(n, leg.k0_Nm_per_rad)
    k0[0] = 0.0
    if leg.rest_angles_rad:
        rest = np.array([0.0, *leg.rest_angles_rad])
    else:
        rest = np.zeros(n)
    return HingeSprings(k0, np.full(n, leg.k2_per_rad2), rest, table_of(leg.torque_splines, n))


def polynomial_springs(leg: Leg, where: str) -> tuple[float, float, float]:
    """Coefficients of phi, phi |phi| and phi^3, for programs without other springs; BadInput,
    which names them, for a measured curve.
    """
    if leg.torque_splines:
        raise BadInput(
            f"leg.torque_rotation: {where} takes springs k0 phi + k0 k2 phi^3 only, not a "
            "measured curve; "
            "give a model with k0 and k2, as static report writes it"
        )
    return leg.k0_Nm_per_rad, 0.0, leg.k0_Nm_per_rad * leg.k2_per_rad2


def bending_torque_Nm(leg: Leg, x_rad: Floats) -> Floats:
    """Torque of a hinge, (m,) or any other shape, at `x_rad` from rest; the mean of all hinges
    where each has its own curve.
    """
    springs = springs_of(leg)
    return _of_hinges(leg, springs.torque_Nm(springs.rest_rad + x_rad[..., None]))


def bending_stiffness_Nm_per_rad(leg: Leg, x_rad: Floats) -> Floats:
    """Derivative of `bending_torque_Nm`, of the same shape (m,) as `x_rad` [N m/rad]."""
    springs = springs_of(leg)
    return _of_hinges(leg, springs.stiffness_Nm_per_rad(springs.rest_rad + x_rad[..., None]))


def _of_hinges(leg: Leg, values: Floats) -> Floats:
    return np.asarray(
        values[..., 1:].mean(axis=-1) if len(leg.torque_splines) > 1 else values[..., 1]
    )
