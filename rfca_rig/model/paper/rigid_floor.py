"""Contact as a unilateral constraint: section III.D, an independent check of the compliant floor.

While the tip touches, (15) holds it at the floor's level; the contact ends where lambda passes
zero. Touchdown is a plastic impact: one impulse removes the speed into the floor.

Range: the floor is rigid; only the tip touches (the run ends when another link end comes down);
friction, where there is any, is that of a tip that slides one way (the run ends where it stops). In
contrast to the compliant floor there is no rattle after touchdown, and no depth. The two agree from
some 40 ms after touchdown on, the better the stiffer the compliant floor. Angles are integrated by
scipy's LSODA to a relative 1e-7.

y_p is the depth of the tip's circle below the floor, lambda the normal force (positive upwards on
the leg). The row below the mass matrix requires J_y q'' = -(dJ_y/dt) q' (the print of (15) has lost
the dot over J_y). Rounding would add up to a drift, so it is stabilised as by Baumgarte: J_y q'' =
-(dJ_y/dt) q' - 2 alpha y' - alpha^2 y, with alpha = 300 /s.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.model.paper.dynamics import (
    PASSIVE,
    DrivenChain,
    KnownMotion,
    link_chain_of,
    mass_matrix,
    no_loads,
    right_side_Nm,
    solve_exchanged,
)
from rfca_rig.model.paper.statics import equilibrium_under_tip_force, sum_to_tip, tip_chain_of
from rfca_rig.model.parameters import RigModel

Floats = NDArray[np.float64]

# Baumgarte's alpha: an error of the constraint decays with a time constant of 3.3 ms, critically
# damped.
ALPHA_PER_S = 300.0

# Each touchdown and each release is a change; a tip that chatters would otherwise never end.
MOST_CHANGES = 400
RTOL = 1e-7
ATOL = 1e-8


@dataclass(frozen=True)
class RigidFloor:
    """A driven chain above a rigid floor. States x (2 f,) are those of the driven chain: angles and
    speeds of its f free joints.

    `sliding` is the direction of the tip's slip, -1, 0 or 1; `mu` is the friction coefficient.
    """

    system: DrivenChain
    height_m: float
    radius_m: float
    mu: float

    def depths(self, phi: Floats) -> Floats:
        """y_p of every end's circle: how far it is below the floor (n,)."""
        return np.asarray(
            np.cumsum(self.system.chain.a * np.sin(np.cumsum(phi))) + self.radius_m - self.height_m
        )

    def depths_at(self, t: float, x: Floats) -> Floats:
        """The same (n,) for a state."""
        return self.depths(self.system.place(t, x)[0])

    def J_y(self, phi: Floats) -> Floats:
        """Second line of (14): derivative (n,) of the tip's depth by each joint angle [m/rad]."""
        return sum_to_tip(self.system.chain.a * np.cos(np.cumsum(phi)))

    def J_slip(self, phi: Floats) -> Floats:
        """The same along the floor, for the circle's lowest point."""
        return sum_to_tip(-self.system.chain.a * np.sin(np.cumsum(phi))) - self.radius_m

    def slip(self, t: float, x: Floats) -> float:
        """Sliding speed of the tip [m/s]."""
        phi, dphi = self.system.place(t, x)
        return float(self.J_slip(phi) @ dphi)

    def lambda_row(self, phi: Floats, sliding: float) -> Floats:
        """Joint torques (n,) per unit of lambda, with friction: J_y + mu sgn(slip) J_slip."""
        return np.asarray(self.J_y(phi) + self.mu * sliding * self.J_slip(phi))

    def touching(self, t: float, x: Floats, sliding: float) -> tuple[Floats, float]:
        """Solves (15) with the columns of prescribed joints exchanged as in (16): z (n,) and
        lambda.

        z holds the torque of a prescribed joint, and the acceleration of any other.
        """
        phi, dphi = self.system.place(t, x)
        n = phi.size
        J = self.J_y(phi)
        w = np.cumsum(dphi)
        A = np.zeros((n + 1, n + 1))
        A[:n, :n] = mass_matrix(self.system.chain, phi)
        # Column and row differ where there is friction: it acts on the joints, but is not part of
        # the constraint.
        A[:n, n] = self.lambda_row(phi, sliding)
        A[n, :n] = J
        dJ_dphi = -self.system.chain.a * np.sin(np.cumsum(phi)) @ w**2
        held = -dJ_dphi - 2.0 * ALPHA_PER_S * (J @ dphi) - ALPHA_PER_S**2 * self.depths(phi)[-1]
        known = self.system.known(t)
        prescribed = ~self.system.free
        tau = np.where(prescribed, 0.0, known)
        b = np.append(right_side_Nm(self.system.chain, phi, dphi, tau, no_loads(n)), held)
        z = solve_exchanged(A, b, np.append(known, 0.0), np.append(prescribed, False))
        return z[:n], float(z[n])

    def contact_rate(self, t: float, x: Floats, sliding: float) -> Floats:
        """dx/dt (2 f,) while the tip is held."""
        _, dphi = self.system.place(t, x)
        free = self.system.free
        return np.concatenate([dphi[free], self.touching(t, x, sliding)[0][free]])

    def apply_impact(self, t: float, x: Floats, sliding: float) -> Floats:
        """State (2 f,) after a plastic impact: one impulse along lambda on the free joints
        removes the tip's speed into the floor.
        """
        phi, dphi = self.system.place(t, x)
        free = self.system.free
        # Change of the free speeds per unit of impulse; a prescribed joint does not change its
        # speed.
        change = np.linalg.solve(
            mass_matrix(self.system.chain, phi)[np.ix_(free, free)],
            self.lambda_row(phi, sliding)[free],
        )
        J = self.J_y(phi)
        return np.concatenate([phi[free], dphi[free] - change * (J @ dphi) / (J[free] @ change)])


class EndReason(Enum):
    """Reason why a run on the rigid floor has ended."""

    TIME = "the last sample was reached"
    OTHER_END = "another link end came down to the floor"
    SLIDING = "the tip stopped sliding"


@dataclass(frozen=True)
class ConstrainedStroke:
    """Samples at `t_s` (m,) up to where the run ended: joint angles (m, n), lambda and the shaft's
    torque (m,), depth of the tip (m,).

    `touchdowns_s` and `releases_s` are the times at which the constraint began and ended.
    """

    t_s: Floats
    phi: Floats
    lambda_N: Floats
    shaft_torque_Nm: Floats
    tip_depth_m: Floats
    touchdowns_s: tuple[float, ...]
    releases_s: tuple[float, ...]
    ended: EndReason


@dataclass(frozen=True)
class _Contact:
    """Whether the tip is down, and which way it slides (-1, 0, 1)."""

    down: bool
    sliding: float = 0.0


@dataclass(frozen=True)
class _Piece:
    """The motion under one contact from `begin_s` on: samples `t_s` (m,), `x` (m, 2 free
    joints), and where and why it ended.
    """

    contact: _Contact
    begin_s: float
    t_s: Floats
    x: Floats
    end_s: float
    x_end: Floats
    ended: EndReason | None


def simulate_on_rigid_floor(
    rig: RigModel,
    height_m: float,
    shaft: KnownMotion,
    t_s: Floats,
    friction_coefficient: float = 0.0,
) -> ConstrainedStroke:
    """Simulates a stroke on a rigid floor, from rest in the air at t = 0.

    Parameters
    ----------
    rig
        Only its leg is used.
    height_m
        Height of the shaft above the floor.
    shaft
        Prescribed motion of the shaft.
    t_s
        (m,) ascending from 0 on.
    friction_coefficient
        Of the floor; 0 for none.

    Raises
    ------
    BadInput
        Where the leg begins in the floor.
    SimulationFailed
        Where the contact chatters.

    References
    ----------
    Equations (14) to (16).
    """
    hanging = equilibrium_under_tip_force(tip_chain_of(rig.leg), shaft.angle(0.0), np.zeros(2)).phi[
        1:
    ]
    system = DrivenChain(link_chain_of(rig.leg), (shaft, *[PASSIVE] * len(hanging)))
    floor = RigidFloor(system, height_m, rig.leg.link_radius_m, friction_coefficient)
    t = 0.0
    x = np.concatenate([hanging, np.zeros_like(hanging)])
    contact = _Contact(False)
    if (deepest := floor.depths_at(t, x).max()) > 0.0:
        raise BadInput(
            f"with the shaft at {np.degrees(shaft.angle(0.0)):.1f} degrees and "
            f"{1e3 * height_m:.1f} mm above the floor the leg begins "
            f"{1e3 * deepest:.1f} mm deep in it; begin further up"
        )
    pieces: list[_Piece] = []
    while len(pieces) < MOST_CHANGES:
        pieces.append(_follow(floor, contact, t, x, t_s))
        if pieces[-1].ended is not None:
            return _join(floor, pieces, pieces[-1].ended)
        t, x, contact = _change_contact(floor, pieces[-1])
    raise SimulationFailed(
        f"the tip left the rigid floor {MOST_CHANGES // 2} times before {t:.4f} s; the "
        "constraint form cannot follow that, "
        f"the compliant floor can"
    )


@dataclass
class _Crossing:
    """An event that ends a piece: `value` of (t, x) passes zero in `direction`. `solve_ivp`
    reads the names of the attributes.
    """

    value: Callable[[float, Floats], float]
    direction: float
    terminal: bool = True

    def __call__(self, t: float, x: Floats) -> float:
        return self.value(t, x)


def _follow(floor: RigidFloor, contact: _Contact, t: float, x: Floats, t_s: Floats) -> _Piece:
    # Depth of the deepest other end; a leg of one link has none.
    others = _Crossing(lambda t, x: floor.depths_at(t, x)[:-1].max(initial=-1.0), 1.0)
    slides = _Crossing(
        lambda t, x: floor.slip(t, x) * contact.sliding if floor.mu > 0.0 and contact.down else 1.0,
        -1.0,
    )
    if contact.down:
        change = _Crossing(lambda t, x: floor.touching(t, x, contact.sliding)[1], -1.0)
    else:
        change = _Crossing(lambda t, x: float(floor.depths_at(t, x)[-1]), 1.0)

    def rate(t: float, x: Floats) -> Floats:
        if contact.down:
            return floor.contact_rate(t, x, contact.sliding)
        return floor.system.rate(t, x)

    ahead = t_s[t_s >= t]
    motion = solve_ivp(
        rate,
        (t, float(t_s[-1])),
        x,
        "LSODA",
        ahead,
        events=[change, others, slides],
        rtol=RTOL,
        atol=ATOL,
    )
    if not motion.success:
        raise SimulationFailed(
            f"the leg on the rigid floor stopped after {t:.4f} s: {motion.message}"
        )
    for event, why in zip((0, 1, 2), (None, EndReason.OTHER_END, EndReason.SLIDING), strict=True):
        if motion.t_events[event].size:
            return _Piece(
                contact,
                t,
                motion.t,
                motion.y.T,
                float(motion.t_events[event][0]),
                motion.y_events[event][0],
                why,
            )
    return _Piece(contact, t, motion.t, motion.y.T, float(t_s[-1]), motion.y[:, -1], EndReason.TIME)


def _change_contact(floor: RigidFloor, piece: _Piece) -> tuple[float, Floats, _Contact]:
    t = piece.end_s
    x = piece.x_end
    if piece.contact.down:
        return t, x, _Contact(False)
    # Where lambda is not positive right after the impact, the tip leaves at once: the next piece
    # begins in the air.
    sliding = float(np.sign(floor.slip(t, x)))
    x = floor.apply_impact(t, x, sliding)
    return t, x, _Contact(floor.touching(t, x, sliding)[1] > 0.0, sliding)


def _join(floor: RigidFloor, pieces: list[_Piece], ended: EndReason) -> ConstrainedStroke:
    samples = [
        (t, x, piece.contact)
        for piece in pieces
        for t, x in zip(piece.t_s, piece.x.reshape(len(piece.t_s), -1), strict=True)
    ]
    forces = [_lambda_and_torque(floor, t, x, contact) for t, x, contact in samples]
    return ConstrainedStroke(
        t_s=np.array([t for t, _, _ in samples]),
        phi=np.array([floor.system.place(t, x)[0] for t, x, _ in samples]),
        lambda_N=np.array([normal for normal, _ in forces]),
        shaft_torque_Nm=np.array([torque for _, torque in forces]),
        tip_depth_m=np.array([floor.depths_at(t, x)[-1] for t, x, _ in samples]),
        touchdowns_s=tuple(piece.begin_s for piece in pieces if piece.contact.down),
        releases_s=tuple(
            piece.end_s for piece in pieces if piece.contact.down and piece.ended is None
        ),
        ended=ended,
    )


def _lambda_and_torque(
    floor: RigidFloor, t: float, x: Floats, contact: _Contact
) -> tuple[float, float]:
    if contact.down:
        z, normal = floor.touching(t, x, contact.sliding)
        return normal, float(z[0])
    return 0.0, float(floor.system.balance(t, *floor.system.place(t, x)).tau_Nm[0])
