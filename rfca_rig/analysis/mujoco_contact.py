"""Independent second implementation of the ground law, for MuJoCo.

It computes forces on bodies in space from MuJoCo's positions and velocities of the link ends. It shares no code with the model, which works
in link angles. MuJoCo itself transforms the forces to its joints.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rfca_rig.model.compiled import jit
from rfca_rig.model.parameters import RigModel

Floats = NDArray[np.float64]


class GroundLaw(NamedTuple):
    """Hertz contact with damping, Coulomb friction with anchors, and viscous drag, for a floor `depth` below the shaft. SI units."""

    stiffness: float
    damping: float
    leaving_damping: float
    mu: float
    presliding: float
    drag: float
    radius: float
    lever: float
    lever_rise: float
    depth: float


class Ends(NamedTuple):
    """MuJoCo's arrays, by body with the world first: centres of mass, velocities about `origin`, wrenches; `place` of the ends (n, 3)."""

    place: Floats
    mass_centre: Floats
    origin: Floats
    velocity: Floats
    hinge_angle: Floats
    wrench: Floats


def ground_law(rig: RigModel, height_m: float) -> GroundLaw:
    """The nominal ground law of `rig`."""
    g = rig.ground
    return GroundLaw(
        g.stiffness_N_per_m1p5,
        g.damping_s_per_m,
        g.damping_s_per_m * g.leaving_damping_share,
        g.friction_coefficient,
        g.presliding_m,
        g.drag_N_s_per_m,
        rig.leg.link_radius_m,
        rig.friction_lever_m,
        g.friction_rise_share,
        height_m,
    )


@jit
def push(law: GroundLaw, ends: Ends, ties: Floats, step_begins: bool, contact: Floats) -> None:
    """Write the ground's force into `ends.wrench` (force, torque about the centre of mass) and `contact` (2, n) = N, F.

    `ties` (n, 5) holds for each end the anchor, and from the begin of the step the link angle, the indentation, the stretch and mu N. At
    the begin of a step, anchors of sliding ends follow, and those of ends in the air move below them. While mu N grows, a tie keeps its
    force.
    """
    angle = 0.0
    for k in range(ends.hinge_angle.size):
        angle += ends.hinge_angle[k]
        x, z = ends.place[k, 0], ends.place[k, 2]
        turning = ends.velocity[k + 1, 1]
        # MuJoCo states velocities at the centre of mass of the whole tree; this moves them to the link end.
        v_x = ends.velocity[k + 1, 3] + turning * (z - ends.origin[2])
        v_z = ends.velocity[k + 1, 5] - turning * (x - ends.origin[0])
        indentation = max(law.radius - z - law.depth, 0.0)
        damping = law.damping if v_z < 0.0 else law.leaving_damping
        # Damping in proportion to the elastic force (Hunt and Crossley); the ground never pulls.
        N = law.stiffness * indentation**1.5 * max(1.0 - damping * v_z, 0.0)
        arm = law.lever - law.lever_rise * indentation
        # The lever shrinks with indentation: this is its mean shrinkage over the step times the turn of the link.
        less = 0.5 * law.lever_rise * (ties[k, 2] + indentation) * (angle - ties[k, 1])
        off = x - law.lever * angle + less - ties[k, 0]
        # Share of the friction limit that the stretch of the presliding spring mobilises, between -1 and 1.
        limit, share = law.mu * N, 0.0
        if limit > 0.0:
            # Share of the stretch at the begin of the step that remains under the new limit.
            carried_over = min(1.0, ties[k, 4] / limit)
            share = carried_over * ties[k, 3] + 0.5 * (1.0 + carried_over) * (off - ties[k, 3])
            share = min(max(share / law.presliding, -1.0), 1.0)
        if step_begins:
            stretch = law.presliding * share
            ties[k, 0], ties[k, 1], ties[k, 2] = ties[k, 0] + off - stretch - less, angle, indentation
            ties[k, 3], ties[k, 4] = stretch, limit
        F = 0.0
        if indentation > 0.0:
            # Viscous drag acts in full from a normal force of 1 N on.
            F = -limit * share - min(1.0, N) * law.drag * (v_x - arm * turning)
        contact[0, k], contact[1, k] = N, F
        wrench, centre = ends.wrench[k + 1], ends.mass_centre[k + 1]
        wrench[0], wrench[2] = F, N
        # Torque about +y of the contact force at its point of action, a lever below the end, about the centre of mass.
        wrench[4] = (z - arm - centre[2]) * F - (x - centre[0]) * N
