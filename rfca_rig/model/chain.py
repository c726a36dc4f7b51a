"""The leg as the compiled code wants it, and its rest pose."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import SimulationFailed
from rfca_rig.model.equilibrium import settle
from rfca_rig.model.integrator import DONE, SHORTEST_STEP_S, integrate
from rfca_rig.model.parameters import GRAVITY_M_S2, RigModel
from rfca_rig.model.state import Chain, Samples, Shaft, State

Floats = NDArray[np.float64]

LONGEST_STEP_S = 2e-3


@dataclass(frozen=True)
class Tolerance:
    """Allowed error per step. The default gives force valleys to 1e-4 of those of a run a thousand times tighter."""

    angle_rad: float = 1e-4
    speed_rad_s: float = 0.3


@dataclass(frozen=True)
class Steps:
    """What an integration cost, and the step length to go on with."""

    accepted: int
    rejected: int
    next_s: float


def chain_of(rig: RigModel, height_m: float) -> Chain:
    """The chain of `rig` with its shaft `height_m` above the ground."""
    leg, ground = rig.leg, rig.ground
    length, mass = np.array(leg.link_lengths_m), np.array(leg.link_masses_kg)
    reach = np.tril(np.broadcast_to(length, (length.size, length.size)), -1) + np.diag(length / 2.0)
    return Chain(
        length=length,
        first_moment=mass @ reach,
        k0=np.full(length.size, leg.k0_Nm_per_rad),
        k2=np.full(length.size, leg.k2_per_rad2),
        hinge_damping=np.full(length.size, leg.hinge_damping_Nm_s_per_rad),
        moment=np.einsum("k,ki,kj->ij", mass, reach, reach) + np.diag(mass * length**2 / 12.0),
        radius=leg.link_radius_m,
        gravity=GRAVITY_M_S2,
        total_mass=float(mass.sum()),
        ground_depth=height_m,
        contact_stiffness=ground.stiffness_N_per_m1p5,
        contact_damping=ground.damping_s_per_m,
        mu=ground.friction_coefficient,
        grip=ground.grip_N_per_m,
        drag=ground.drag_N_s_per_m,
    )


def at_rest(chain: Chain, shaft_angle_rad: float) -> State:
    """The chain hanging under its weight with the shaft held; without friction where an end touches the ground."""
    q = np.full(chain.length.size, shaft_angle_rad)
    if not settle(chain._replace(mu=0.0, grip=0.0, drag=0.0), q, 1e-12):
        raise SimulationFailed(
            f"no rest pose found with the shaft at {np.degrees(shaft_angle_rad):.1f} degrees and "
            f"{1e3 * chain.ground_depth:.1f} mm above the ground; is the rack height right?"
        )
    anchor = np.cumsum(chain.length * np.cos(q)) - chain.radius * q
    return State(q, np.zeros_like(q), np.zeros_like(q), anchor)


def room_for(t_s: Floats, links: int) -> Samples:
    """Empty samples at the times `t_s`."""
    m = len(t_s)
    return Samples(t_s, np.empty((m, links)), np.empty((m, links)), np.empty((m, 3)), np.empty((m, 2, links)))


def advance(
    chain: Chain, shaft: Shaft, state: State, span_s: tuple[float, float], step_s: float, tolerance: Tolerance, samples: Samples
) -> Steps:
    """Carries `state` over `span_s` in place and fills `samples`, whose times lie in it, its start excluded.

    Raises SimulationFailed, with the moment, where no step converges.
    """
    bounds = np.array([tolerance.angle_rad, tolerance.speed_rad_s])
    status, next_s, accepted, rejected = integrate(chain, shaft, state, span_s[0], span_s[1], step_s, LONGEST_STEP_S, bounds, samples)
    if status != DONE:
        raise SimulationFailed(
            f"the model stopped after {accepted} steps between {span_s[0]:.3f} s and {span_s[1]:.3f} s, {1e3 * chain.ground_depth:.1f} mm "
            f"above the ground: no step above {SHORTEST_STEP_S:g} s converges; look for a slipped decimal point in the leg or the ground"
        )
    return Steps(accepted, rejected, next_s)
