"""The leg of a rig as a MuJoCo model: MuJoCo's own kinematics, inertia, weight and hinge springs, on a shaft with a prescribed motion.

The plane of motion is x-z, with hinges around +y, so that MuJoCo's hinge angles are positive downwards as in the model. Needs MuJoCo 3.7,
the first version whose joints have polynomial springs (MJCF reference, joint/stiffness).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root

from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.model.hinge_springs import polynomial_springs
from rfca_rig.model.parameters import GRAVITY_M_S2, RigModel

Floats = NDArray[np.float64]

# Prescribes the shaft's motion without a constraint: the leg slows it by parts in 1e9 only. At the root of the tree, so heavy a pivot costs
# the other joints no digits.
FLYWHEEL_KG_M2 = 1e9
# Only the contact pairs that are listed explicitly collide.
NEVER_COLLIDES = 'contype="0" conaffinity="0"'


@dataclass(frozen=True)
class MujocoLeg:
    """The module, its MjModel and its MjData; `data` is changed by every step."""

    mujoco: Any
    model: Any
    data: Any


def load_mujoco() -> Any:
    """Import and return the module. Raises BadInput, naming the extra, where MuJoCo is not installed."""
    try:
        import mujoco  # noqa: PLC0415  (an extra that most labs do not need)
    except ImportError:
        raise BadInput('the cross-check needs MuJoCo, which is not installed: pip install "rfca-rig[crosscheck]"') from None
    return mujoco


def mujoco_leg(rig: RigModel, height_m: float, floor: bool, integrator: str) -> MujocoLeg:
    """The leg with its shaft `height_m` above the ground; `floor` gives MuJoCo's own contact under every link end."""
    mujoco = load_mujoco()
    model = mujoco.MjModel.from_xml_string(leg_xml(rig, height_m, floor, integrator))
    return MujocoLeg(mujoco, model, mujoco.MjData(model))


def settle_at_rest(leg: MujocoLeg, start_angle_rad: float) -> None:
    """Put the leg at rest under its weight with the shaft held, at MuJoCo's own equilibrium of forces."""

    def residual_Nm(hinges_rad: Floats) -> Floats:
        leg.data.qpos[0], leg.data.qpos[1:] = start_angle_rad, hinges_rad
        leg.mujoco.mj_forward(leg.model, leg.data)
        return np.array(leg.data.qfrc_smooth[1:])

    if leg.model.nq > 1:
        solution = root(residual_Nm, np.zeros(leg.model.nq - 1), tol=1e-13)
        # Written with `not`, so that NaN counts as a failure too. The call also leaves the pose in `data`.
        if not np.abs(residual_Nm(solution.x)).max() < 1e-8:
            raise SimulationFailed(f"MuJoCo finds no rest pose with the shaft at {np.degrees(start_angle_rad):.1f} degrees")
    # A leg of a single link has no hinge to solve for, but its pose must still be evaluated.
    else:
        residual_Nm(np.zeros(0))


def leg_xml(rig: RigModel, height_m: float, floor: bool, integrator: str) -> str:
    """The model in MuJoCo's language (MJCF). Sites `end1`, `end2` .. are the link ends; with `floor` each carries a sphere."""
    links = len(rig.leg.link_lengths_m)
    bodies = ""
    # Bodies are nested, so the innermost one, the tip, is written first.
    for i in reversed(range(links)):
        bodies = _link_xml(rig, i, floor, bodies)
    plane = f'<geom name="floor" type="plane" size="2 2 1" pos="0 0 {-height_m!r}" {NEVER_COLLIDES}/>' if floor else ""
    pairs = "".join(_pair_xml(i, rig.ground.friction_coefficient) for i in range(links)) if floor else ""
    # Numbers are written with repr, which keeps all digits. Automatic resets are off: a failed simulation must be seen, not restarted.
    return (
        f'<mujoco><compiler angle="radian"/><option gravity="0 0 {-GRAVITY_M_S2!r}" integrator="{integrator}" cone="elliptic">'
        f'<flag autoreset="disable"/></option><worldbody>{plane}{bodies}</worldbody><contact>{pairs}</contact></mujoco>'
    )


def _link_xml(rig: RigModel, i: int, ball: bool, further_links: str) -> str:
    """Link i, a thin uniform rod along its own x axis. Its inertia about x is a thousandth, which planar motion never uses."""
    length, mass = rig.leg.link_lengths_m[i], rig.leg.link_masses_kg[i]
    inertia = mass * length**2 / 12.0
    geom = f'<geom name="ball{i}" size="{rig.leg.link_radius_m!r}" pos="{length!r} 0 0" mass="0" {NEVER_COLLIDES}/>' if ball else ""
    return (
        f'<body pos="{rig.leg.link_lengths_m[i - 1] if i else 0.0!r} 0 0"><joint type="hinge" axis="0 1 0" {_joint_xml(rig, i)}/>'
        f'<inertial pos="{length / 2.0!r} 0 0" mass="{mass!r}" diaginertia="{1e-3 * inertia!r} {inertia!r} {inertia!r}"/>'
        f'<site name="end{i + 1}" pos="{length!r} 0 0"/>{geom}{further_links}</body>'
    )


def _joint_xml(rig: RigModel, i: int) -> str:
    """The shaft's flywheel, or a hinge: coefficients of phi, phi |phi| and phi^3."""
    if i == 0:
        return f'armature="{FLYWHEEL_KG_M2!r}"'
    leg = rig.leg
    rest = f' springref="{leg.rest_angles_rad[i - 1]!r}"' if leg.rest_angles_rad else ""
    first, second, third = polynomial_springs(leg, "MuJoCo")
    return f'stiffness="{first!r} {second:g} {third!r}" damping="{leg.hinge_damping_Nm_s_per_rad!r}"{rest}'


def _pair_xml(i: int, mu: float) -> str:
    return f'<pair geom1="floor" geom2="ball{i}" condim="3" friction="{mu!r} {mu!r} 0 0 0" solimp="1e-4 1e-4 .001 .5 2"/>'
