"""Newton-Euler recursion in modified Denavit-Hartenberg frames: section III.C, eqs. (11)-(13), to
be read beside the paper.

Frame {i} sits at joint i, its X along link i, its Z the axis of the joint; X_0 lies along the
ground and Y_0 points down, so that angles count downwards as everywhere in this model. Vectors are
columns of three, given in their own frame: w (omega), dw (its derivative), dv (acceleration of the
frame's origin), dv_c (of the mass centre), f_i and n_i force and moment of link i-1 on link i.

Five misprints of (11)-(12) are corrected:
    (11) line 1 sums hinge angles only; with phi_1 the shaft, as in (9), alpha_i = phi_1 + .. +
    phi_i. (11) line 4 is the angular acceleration: its left side and the first and last phi have
    lost a dot (phi'' in the last term). (11) line 6 is the acceleration of the origin: dv_i; its
    last P_i is P_i in frame {i-1}, [a_{i-1} 0 0]. (12) rotates with R_{i+1} from {i+1} into {i}.
    The force and moment that act on the link's end from outside are added here. (12) last line: the
    joint's moment n.Z is the sum of drive and spring, tau - K (phi - phi_0). So the drive's torque
    is
         n.Z + K (phi - phi_0); with the printed minus every spring would drive its hinge away from
         rest.
Hinge damping is added to the last line.

Eq. (16), forward and inverse dynamics in one system, joint by joint:

At each joint either the acceleration is known and the drive's torque unknown, or the torque is
known and the acceleration unknown. Where the acceleration is known, its column of the mass matrix
moves to the right side, and the column of the unknown torque, -1 in its own row, replaces it. The
paper prints it for one joint k; here any may be exchanged.

`simulate_chain` integrates such a chain with scipy's DOP853: readable and exact, but some hundred
times slower than the compiled chain.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.model.hinge_springs import HingeSprings, springs_of
from rfca_rig.model.parameters import GRAVITY_M_S2, Leg

Floats = NDArray[np.float64]
OverTime = Callable[[float], float]


@dataclass(frozen=True)
class LinkChain:
    """Links on joints, all (n,): `a` lengths [m], `m` masses [kg], `centre` from the joint to the
    mass centre [m] (a / 2 in the paper), `inertia` about the mass centre and Z [kg m2], springs
    with rest angles `phi_0` [rad], `damping` of the joints [N m s/rad].
    """

    a: Floats
    m: Floats
    centre: Floats
    inertia: Floats
    springs: HingeSprings
    phi_0: Floats
    damping: Floats
    gravity_m_s2: float = GRAVITY_M_S2


@dataclass(frozen=True)
class EndLoads:
    """External loads on the ends of links: `force_N` (2, n) along and down, `moment_Nm` (n,)
    about Z.
    """

    force_N: Floats
    moment_Nm: Floats


def link_chain_of(leg: Leg) -> LinkChain:
    """The leg as uniform rods; its driven joint has neither spring nor damping."""
    a = np.array(leg.link_lengths_m)
    m = np.array(leg.link_masses_kg)
    damping = np.full(a.size, leg.hinge_damping_Nm_s_per_rad)
    damping[0] = 0.0
    return LinkChain(a, m, a / 2.0, m * a**2 / 12.0, springs_of(leg), np.zeros(a.size), damping)


def no_loads(links: int) -> EndLoads:
    """Loads of ends in the air: none."""
    return EndLoads(np.zeros((2, links)), np.zeros(links))


def joint_torques_Nm(
    chain: LinkChain, phi: Floats, dphi: Floats, ddphi: Floats, loads: EndLoads
) -> Floats:
    """Inverse dynamics: torque of each joint's drive for a given motion.

    Parameters
    ----------
    chain
        The links.
    phi, dphi, ddphi
        (n,) joint angles relative to the link before [rad], their speeds and accelerations.
    loads
        On the links' ends.

    Returns
    -------
    (n,) [N m]; 0 where a passive hinge makes this motion.

    References
    ----------
    Equations (11) and (12).
    """
    moments = _joint_moments(chain, phi, dphi, ddphi[:, None], chain.gravity_m_s2, loads)[:, 0]
    return np.asarray(moments + chain.springs.torque_Nm(phi - chain.phi_0) + chain.damping * dphi)


def mass_matrix(chain: LinkChain, phi: Floats) -> Floats:
    """Mass matrix A of (13), (n, n) [kg m2], at joint angles `phi` (n,)."""
    # Column j holds the joint torques for a unit acceleration of joint j, at rest and without
    # weight; springs do not enter.
    rest = np.zeros_like(phi)
    return _joint_moments(chain, phi, rest, np.eye(phi.size), 0.0, no_loads(phi.size))


def right_side_Nm(
    chain: LinkChain, phi: Floats, dphi: Floats, tau: Floats, loads: EndLoads
) -> Floats:
    """Right side b of (13), (n,) [N m]: torques `tau` (n,) of the drives less those that the motion
    takes without acceleration.

    `phi`, `dphi` (n,) are joint angles and speeds.
    """
    return np.asarray(tau - joint_torques_Nm(chain, phi, dphi, np.zeros_like(phi), loads))


def joint_accelerations(
    chain: LinkChain, phi: Floats, dphi: Floats, tau: Floats, loads: EndLoads
) -> Floats:
    """Forward dynamics: z of A z = b (13), (n,) [rad/s2], for angles `phi`, speeds `dphi` and
    drive torques `tau`, all (n,).
    """
    return np.asarray(
        np.linalg.solve(mass_matrix(chain, phi), right_side_Nm(chain, phi, dphi, tau, loads))
    )


Z = np.array([0.0, 0.0, 1.0])[:, None]


def _joint_moments(
    chain: LinkChain, phi: Floats, dphi: Floats, ddphi: Floats, gravity_m_s2: float, loads: EndLoads
) -> Floats:
    """n_i . Z for the accelerations in each column of `ddphi` (n, m): (n, m). Vectors are (3,
    m), one column each.
    """
    # Many accelerations at once, because the mass matrix needs n of them at the same pose.
    R = [_rotation(angle) for angle in phi]
    motion = _outward(chain, R, dphi, ddphi, gravity_m_s2)
    return _inward(chain, R, float(np.sum(phi)), motion, loads)


def _rotation(phi: float) -> Floats:
    """R_i, from frame {i} into {i-1}."""
    sin = np.sin(phi)
    cos = np.cos(phi)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def _outward(
    chain: LinkChain, R: list[Floats], dphi: Floats, ddphi: Floats, gravity_m_s2: float
) -> list[tuple[Floats, Floats]]:
    """Eq. (11) and the first two lines of (12): (F_i, N_i), force and moment that accelerate link
    i.

    The weight enters as a base that accelerates upwards, against Y_0.
    """
    w = np.zeros((3, ddphi.shape[1]))
    dw = np.zeros((3, ddphi.shape[1]))
    dv = np.zeros_like(w)
    dv[1] = -gravity_m_s2
    taken = []
    for i, R_i in enumerate(R):
        P_i = _along_link(chain.a[i - 1] if i > 0 else 0.0)
        dv = R_i.T @ (dv + _cross(dw, P_i) + _cross(w, _cross(w, P_i)))
        carried = R_i.T @ w
        spin = dphi[i] * Z
        dw = R_i.T @ dw + _cross(carried, spin) + ddphi[i] * Z
        w = carried + spin
        P_c = _along_link(chain.centre[i])
        dv_c = dv + _cross(dw, P_c) + _cross(w, _cross(w, P_c))
        # All rotation is about Z, so only this entry of the inertia tensor matters.
        I_w = chain.inertia[i] * w
        taken.append((chain.m[i] * dv_c, chain.inertia[i] * dw + _cross(w, I_w)))
    return taken


def _inward(
    chain: LinkChain,
    R: list[Floats],
    alpha: float,
    motion: list[tuple[Floats, Floats]],
    loads: EndLoads,
) -> Floats:
    """Eq. (12) from the tip to the base: n_i . Z of every joint (n, m). `alpha` is the absolute
    angle of the last link.
    """
    f = np.zeros_like(motion[0][0])
    n = np.zeros_like(motion[0][0])
    moments = np.empty((len(R), f.shape[1]))
    from_next = np.eye(3)
    into_link = _rotation(alpha).T
    for i in range(len(R) - 1, -1, -1):
        F_i, N_i = motion[i]
        # The loads are given along and down; `into_link` rotates them into the frame of link i.
        at_end = from_next @ f - into_link @ np.array(
            [[loads.force_N[0, i]], [loads.force_N[1, i]], [0.0]]
        )
        P_c = _along_link(chain.centre[i])
        P_next = _along_link(chain.a[i])
        n = N_i + from_next @ n - loads.moment_Nm[i] * Z + _cross(P_c, F_i) + _cross(P_next, at_end)
        f = at_end + F_i
        moments[i] = n[2]
        from_next = R[i]
        into_link = R[i] @ into_link
    return moments


def _along_link(distance: float) -> Floats:
    return np.array([[distance], [0.0], [0.0]])


def _cross(u: Floats, v: Floats) -> Floats:
    """u x v of columns of three; `np.cross` needs rows and is ten times slower."""
    return np.array(
        [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
    )


@dataclass(frozen=True)
class KnownMotion:
    """A joint whose angle is prescribed: angle [rad], speed [rad/s] and acceleration [rad/s2],
    each of the time [s].
    """

    angle: OverTime
    speed: OverTime
    acceleration: OverTime


@dataclass(frozen=True)
class KnownTorque:
    """A joint under a prescribed torque [N m] of the time [s]; springs and damping of the joint
    act beside it.
    """

    torque: OverTime


PASSIVE = KnownTorque(lambda _t: 0.0)  # a hinge that no drive turns


Drive = KnownMotion | KnownTorque


@dataclass(frozen=True)
class MixedSolution:
    """Solution of (16): accelerations [rad/s2] and drive torques [N m] of all joints (n,), with
    the known ones.
    """

    ddphi: Floats
    tau_Nm: Floats


@dataclass(frozen=True)
class ChainMotion:
    """A motion of the chain at the times `t_s` (m,): joint angles, speeds, accelerations and
    drive torques, each (m, n).
    """

    t_s: Floats
    phi: Floats
    dphi: Floats
    ddphi: Floats
    tau_Nm: Floats


def solve_mixed(
    chain: LinkChain,
    phi: Floats,
    dphi: Floats,
    known: Floats,
    accelerations_known: NDArray[np.bool_],
    loads: EndLoads,
) -> MixedSolution:
    """Accelerations and torques of all joints where one of both is known at each.

    Parameters
    ----------
    chain, loads
        The links, and the loads on their ends.
    phi, dphi
        (n,) joint angles and speeds.
    known
        (n,) an acceleration where `accelerations_known` is true, else the drive's torque.
    accelerations_known
        (n,) bool.

    References
    ----------
    Equation (16).
    """
    exchange = accelerations_known
    b = right_side_Nm(chain, phi, dphi, np.where(exchange, 0.0, known), loads)
    z = solve_exchanged(mass_matrix(chain, phi), b, known, exchange)
    return MixedSolution(np.where(exchange, known, z), np.where(exchange, z, known))


def solve_exchanged(Z: Floats, b: Floats, known: Floats, exchange: NDArray[np.bool_]) -> Floats:
    """Solution z (n,) of (16) for `Z` (n, n) and `b` (n,): for each exchanged k, `known[k]` is
    q''_k and z[k] the drive's torque u_k.

    `known` and `exchange` are (n,).
    """
    return np.asarray(
        np.linalg.solve(exchange_columns(Z, exchange), b - Z @ np.where(exchange, known, 0.0))
    )


def exchange_columns(Z: Floats, exchange: NDArray[np.bool_]) -> Floats:
    """The matrix of (16), `Z` (n, n) with column k replaced by -1 in row k and 0 elsewhere for
    each joint k of `exchange` (n,).
    """
    return np.where(exchange[None, :], -np.eye(len(Z)), Z)


def simulate_chain(
    chain: LinkChain,
    drives: Sequence[Drive],
    phi: Floats,
    dphi: Floats,
    t_s: Floats,
    rtol: float = 1e-9,
    atol: float = 1e-10,
) -> ChainMotion:
    """Integrates the motion of a chain without ground, each joint under its drive.

    Parameters
    ----------
    chain
        The links.
    drives
        One per joint.
    phi, dphi
        (n,) at t = 0; entries of joints with prescribed motion are not used.
    t_s
        (m,) ascending from 0 on.
    rtol, atol
        Tolerances of scipy's DOP853, of eighth order.

    Raises
    ------
    BadInput
        Where drives and joints differ in number.
    SimulationFailed
        Where scipy gives up.
    """
    if len(drives) != phi.size:
        raise BadInput(
            f"{len(drives)} drives for a chain of {phi.size} joints; give one per joint, "
            "PASSIVE for a hinge"
        )
    system = DrivenChain(chain, tuple(drives))
    start = np.concatenate([phi[system.free], dphi[system.free]])
    solution = solve_ivp(
        system.rate, (0.0, float(t_s[-1])), start, "DOP853", t_s, rtol=rtol, atol=atol
    )
    if not solution.success:
        raise SimulationFailed(
            f"the chain of {phi.size} links stopped before {t_s[-1]:.3f} s: {solution.message}"
        )
    states = [system.place(t, x) for t, x in zip(t_s, solution.y.T, strict=True)]
    balances = [system.balance(t, *state) for t, state in zip(t_s, states, strict=True)]
    return ChainMotion(
        t_s=t_s,
        phi=np.array([phi for phi, _ in states]),
        dphi=np.array([dphi for _, dphi in states]),
        ddphi=np.array([balance.ddphi for balance in balances]),
        tau_Nm=np.array([balance.tau_Nm for balance in balances]),
    )


@dataclass(frozen=True)
class DrivenChain:
    """A chain and the drive of each joint, as a first-order system.

    Its state x (2 f,) holds angles, then speeds, of the f free joints; `free` (n,) says which those
    are.
    """

    chain: LinkChain
    drives: tuple[Drive, ...]

    @property
    def free(self) -> NDArray[np.bool_]:
        return np.array([isinstance(drive, KnownTorque) for drive in self.drives])

    def place(self, t: float, x: Floats) -> tuple[Floats, Floats]:
        """(phi, dphi) of all joints, (n,) each; a prescribed joint has exactly its prescribed
        motion, so that nothing drifts.
        """
        phi = np.array([_angle(drive, t) for drive in self.drives])
        dphi = np.array([_speed(drive, t) for drive in self.drives])
        half = x.size // 2
        phi[self.free] = x[:half]
        dphi[self.free] = x[half:]
        return phi, dphi

    def known(self, t: float) -> Floats:
        """The known quantity of each joint (n,), for `solve_mixed`: its acceleration or its
        torque.
        """
        return np.array(
            [
                drive.torque(t) if isinstance(drive, KnownTorque) else drive.acceleration(t)
                for drive in self.drives
            ]
        )

    def balance(self, t: float, phi: Floats, dphi: Floats) -> MixedSolution:
        """Accelerations and torques at this moment, in the air, for angles and speeds (n,)."""
        return solve_mixed(self.chain, phi, dphi, self.known(t), ~self.free, no_loads(phi.size))

    def rate(self, t: float, x: Floats) -> Floats:
        """dx/dt (2 f,) of the state x (2 f,)."""
        phi, dphi = self.place(t, x)
        return np.concatenate([dphi[self.free], self.balance(t, phi, dphi).ddphi[self.free]])


def _angle(drive: Drive, t: float) -> float:
    if isinstance(drive, KnownMotion):
        return drive.angle(t)
    return 0.0


def _speed(drive: Drive, t: float) -> float:
    if isinstance(drive, KnownMotion):
        return drive.speed(t)
    return 0.0
