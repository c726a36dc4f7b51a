"""Forward and inverse dynamics in one system, joint by joint: eq. (16). Symbols as in `newton_euler`.

At each joint either the acceleration is known and the drive's torque unknown, or the torque is known and the acceleration
unknown. Where the acceleration is known, its column of the mass matrix moves to the right side, and the
column of the unknown torque, -1 in its own row, replaces it. The paper prints it for one joint k; here any may be exchanged.

`simulate_chain` integrates such a chain with scipy's DOP853: readable and exact, but some hundred times slower than the compiled chain.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.model.newton_euler import EndLoads, LinkChain, mass_matrix, no_loads, right_side_Nm

Floats = NDArray[np.float64]
OverTime = Callable[[float], float]


@dataclass(frozen=True)
class KnownMotion:
    """A joint whose angle is prescribed: angle [rad], speed [rad/s] and acceleration [rad/s2], each of the time [s]."""

    angle: OverTime
    speed: OverTime
    acceleration: OverTime


@dataclass(frozen=True)
class KnownTorque:
    """A joint under a prescribed torque [N m] of the time [s]; springs and damping of the joint act beside it."""

    torque: OverTime


PASSIVE = KnownTorque(lambda _t: 0.0)  # a hinge that no drive turns

Drive = KnownMotion | KnownTorque


@dataclass(frozen=True)
class MixedSolution:
    """Solution of (16): accelerations [rad/s2] and drive torques [N m] of all joints (n,), with the known ones."""

    ddphi: Floats
    tau_Nm: Floats


@dataclass(frozen=True)
class ChainMotion:
    """A motion of the chain at the times `t_s` (m,): joint angles, speeds, accelerations and drive torques, each (m, n)."""

    t_s: Floats
    phi: Floats
    dphi: Floats
    ddphi: Floats
    tau_Nm: Floats


def solve_mixed(
    chain: LinkChain, phi: Floats, dphi: Floats, known: Floats, accelerations_known: NDArray[np.bool_], loads: EndLoads
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
    """Solution z (n,) of (16) for `Z` (n, n) and `b` (n,): for each exchanged k, `known[k]` is q''_k and z[k] the drive's torque u_k.

    `known` and `exchange` are (n,).
    """
    return np.asarray(np.linalg.solve(exchange_columns(Z, exchange), b - Z @ np.where(exchange, known, 0.0)))


def exchange_columns(Z: Floats, exchange: NDArray[np.bool_]) -> Floats:
    """The matrix of (16), `Z` (n, n) with column k replaced by -1 in row k and 0 elsewhere for each joint k of `exchange` (n,)."""
    return np.where(exchange[None, :], -np.eye(len(Z)), Z)


def simulate_chain(
    chain: LinkChain, drives: Sequence[Drive], phi: Floats, dphi: Floats, t_s: Floats, rtol: float = 1e-9, atol: float = 1e-10
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
        raise BadInput(f"{len(drives)} drives for a chain of {phi.size} joints; give one per joint, PASSIVE for a hinge")
    system = DrivenChain(chain, tuple(drives))
    start = np.concatenate([phi[system.free], dphi[system.free]])
    solution = solve_ivp(system.rate, (0.0, float(t_s[-1])), start, "DOP853", t_s, rtol=rtol, atol=atol)
    if not solution.success:
        raise SimulationFailed(f"the chain of {phi.size} links stopped before {t_s[-1]:.3f} s: {solution.message}")
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

    Its state x (2 f,) holds angles, then speeds, of the f free joints; `free` (n,) says which those are.
    """

    chain: LinkChain
    drives: tuple[Drive, ...]

    @property
    def free(self) -> NDArray[np.bool_]:
        return np.array([isinstance(drive, KnownTorque) for drive in self.drives])

    def place(self, t: float, x: Floats) -> tuple[Floats, Floats]:
        """(phi, dphi) of all joints, (n,) each; a prescribed joint has exactly its prescribed motion, so that nothing drifts."""
        phi, dphi = (np.array([of(drive, t) for drive in self.drives]) for of in (_angle, _speed))
        half = x.size // 2
        phi[self.free], dphi[self.free] = x[:half], x[half:]
        return phi, dphi

    def known(self, t: float) -> Floats:
        """The known quantity of each joint (n,), for `solve_mixed`: its acceleration or its torque."""
        return np.array([drive.torque(t) if isinstance(drive, KnownTorque) else drive.acceleration(t) for drive in self.drives])

    def balance(self, t: float, phi: Floats, dphi: Floats) -> MixedSolution:
        """Accelerations and torques at this moment, in the air, for angles and speeds (n,)."""
        return solve_mixed(self.chain, phi, dphi, self.known(t), ~self.free, no_loads(phi.size))

    def rate(self, t: float, x: Floats) -> Floats:
        """dx/dt (2 f,) of the state x (2 f,)."""
        phi, dphi = self.place(t, x)
        return np.concatenate([dphi[self.free], self.balance(t, phi, dphi).ddphi[self.free]])


def _angle(drive: Drive, t: float) -> float:
    return drive.angle(t) if isinstance(drive, KnownMotion) else 0.0


def _speed(drive: Drive, t: float) -> float:
    return drive.speed(t) if isinstance(drive, KnownMotion) else 0.0
