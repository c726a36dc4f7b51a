"""The leg of a rig as a MuJoCo model, and one stroke of it, with the nominal ground law or with
MuJoCo's own contact.

The leg of a rig as a MuJoCo model: MuJoCo's own kinematics, inertia, weight and hinge springs, on a
shaft with a prescribed motion.

The plane of motion is x-z, with hinges around +y, so that MuJoCo's hinge angles are positive
downwards as in the model. Needs MuJoCo 3.7, the first version whose joints have polynomial springs
(MJCF reference, joint/stiffness).

Independent second implementation of the ground law, for MuJoCo.

It computes forces on bodies in space from MuJoCo's positions and velocities of the link ends. It
shares no code with the model, which works in link angles. MuJoCo itself transforms the forces to
its joints.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import ceil
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.model.hinge_springs import polynomial_springs
from rfca_rig.model.kernel.compiled import jit
from rfca_rig.model.parameters import GRAVITY_M_S2, RigModel
from rfca_rig.subprocesses import safe_path

Floats = NDArray[np.float64]

# Prescribes the shaft's motion without a constraint: the leg slows it by parts in 1e9 only. At the
# root of the tree, so heavy a pivot costs the other joints no digits.
FLYWHEEL_KG_M2 = 1e9
# Only the contact pairs that are listed explicitly collide.
NEVER_COLLIDES = 'contype="0" conaffinity="0"'

# With RK4, half of this step changes the contact force by less than 1e-5.
STEP_S = 2e-5
# MuJoCo has no static friction: a contact below its friction limit creeps, here by 2 mm/s under 24
# N. A tenth of this viscosity changes the loading by less than 1e-4.
CREEP_N_S_PER_M = 1.2e4
# Damping [1/s] of the friction constraint, in MuJoCo's direct format of solref.
CREEP_DAMPING = 6.0
# MuJoCo reads a pair of numbers as stiffness and damping where both are negative.
NO_SPRING = 1e-9


@dataclass(frozen=True)
class MujocoLeg:
    """The module, its MjModel and its MjData; `data` is changed by every step."""

    mujoco: Any
    model: Any
    data: Any


def load_mujoco() -> Any:
    """Import and return the module. Raises BadInput, naming the extra, where MuJoCo is not
    installed.
    """
    try:
        # To find its window library, MuJoCo's import starts an interpreter.
        with safe_path():
            import mujoco  # noqa: PLC0415  (an extra that most labs do not need)
    except ImportError:
        raise BadInput(
            "the cross-check needs MuJoCo, which is not installed: pip install "
            '"rfca-rig[crosscheck]"'
        ) from None
    return mujoco


def mujoco_leg(rig: RigModel, height_m: float, floor: bool, integrator: str) -> MujocoLeg:
    """The leg with its shaft `height_m` above the ground; `floor` gives MuJoCo's own contact
    under every link end.
    """
    mujoco = load_mujoco()
    model = mujoco.MjModel.from_xml_string(leg_xml(rig, height_m, floor, integrator))
    return MujocoLeg(mujoco, model, mujoco.MjData(model))


def settle_at_rest(leg: MujocoLeg, start_angle_rad: float) -> None:
    """Put the leg at rest under its weight with the shaft held, at MuJoCo's own equilibrium of
    forces.
    """

    def residual_Nm(hinges_rad: Floats) -> Floats:
        leg.data.qpos[0] = start_angle_rad
        leg.data.qpos[1:] = hinges_rad
        leg.mujoco.mj_forward(leg.model, leg.data)
        return np.array(leg.data.qfrc_smooth[1:])

    if leg.model.nq > 1:
        from scipy.optimize import root  # noqa: PLC0415 - every page imports this module, few ask for a rest pose

        solution = root(residual_Nm, np.zeros(leg.model.nq - 1), tol=1e-13)
        # Written with `not`, so that NaN counts as a failure too. The call also leaves the pose in
        # `data`.
        if not np.abs(residual_Nm(solution.x)).max() < 1e-8:
            raise SimulationFailed(
                "MuJoCo finds no rest pose with the shaft at "
                f"{np.degrees(start_angle_rad):.1f} degrees"
            )
    # A leg of a single link has no hinge to solve for, but its pose must still be evaluated.
    else:
        residual_Nm(np.zeros(0))


def leg_xml(rig: RigModel, height_m: float, floor: bool, integrator: str) -> str:
    """The model in MuJoCo's language (MJCF). Sites `end1`, `end2` .. are the link ends; with
    `floor` each carries a sphere.
    """
    links = len(rig.leg.link_lengths_m)
    bodies = ""
    # Bodies are nested, so the innermost one, the tip, is written first.
    for i in reversed(range(links)):
        bodies = _link_xml(rig, i, floor, bodies)
    if floor:
        plane = (
            f'<geom name="floor" type="plane" size="2 2 1" pos="0 0 {-height_m!r}" '
            f"{NEVER_COLLIDES}/>"
        )
        pairs = "".join(_pair_xml(i, rig.ground.friction_coefficient) for i in range(links))
    else:
        plane = ""
        pairs = ""
    # Numbers are written with repr, which keeps all digits. Automatic resets are off: a failed
    # simulation must be seen, not restarted.
    return (
        f'<mujoco><compiler angle="radian"/><option gravity="0 0 {-GRAVITY_M_S2!r}" '
        f'integrator="{integrator}" cone="elliptic">'
        '<flag autoreset="disable"/></option>'
        f"<worldbody>{plane}{bodies}</worldbody><contact>{pairs}</contact></mujoco>"
    )


def _link_xml(rig: RigModel, i: int, ball: bool, further_links: str) -> str:
    """Link i, a thin uniform rod along its own x axis. Its inertia about x is a thousandth,
    which planar motion never uses.
    """
    length = rig.leg.link_lengths_m[i]
    mass = rig.leg.link_masses_kg[i]
    inertia = mass * length**2 / 12.0
    at_m = 0.0
    if i:
        at_m = rig.leg.link_lengths_m[i - 1]
    geom = ""
    if ball:
        geom = (
            f'<geom name="ball{i}" size="{rig.leg.link_radius_m!r}" pos="{length!r} 0 0" '
            f'mass="0" {NEVER_COLLIDES}/>'
        )
    return (
        f'<body pos="{at_m!r} 0 0"><joint '
        f'type="hinge" axis="0 1 0" {_joint_xml(rig, i)}/>'
        f'<inertial pos="{length / 2.0!r} 0 0" mass="{mass!r}" '
        f'diaginertia="{1e-3 * inertia!r} {inertia!r} {inertia!r}"/>'
        f'<site name="end{i + 1}" pos="{length!r} 0 0"/>{geom}{further_links}</body>'
    )


def _joint_xml(rig: RigModel, i: int) -> str:
    """The shaft's flywheel, or a hinge: coefficients of phi, phi |phi| and phi^3."""
    if i == 0:
        return f'armature="{FLYWHEEL_KG_M2!r}"'
    leg = rig.leg
    if leg.rest_angles_rad:
        rest = f' springref="{leg.rest_angles_rad[i - 1]!r}"'
    else:
        rest = ""
    first, second, third = polynomial_springs(leg, "MuJoCo")
    return (
        f'stiffness="{first!r} {second:g} {third!r}" '
        f'damping="{leg.hinge_damping_Nm_s_per_rad!r}"{rest}'
    )


def _pair_xml(i: int, mu: float) -> str:
    return (
        f'<pair geom1="floor" geom2="ball{i}" condim="3" friction="{mu!r} {mu!r} 0 0 0" '
        'solimp="1e-4 1e-4 .001 .5 2"/>'
    )


class GroundLaw(NamedTuple):
    """Hertz contact with damping, Coulomb friction with anchors, and viscous drag, for a floor
    `depth` below the shaft. SI units.
    """

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
    """MuJoCo's arrays, by body with the world first: centres of mass, velocities about `origin`,
    wrenches; `place` of the ends (n, 3).
    """

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
    """Write the ground's force into `ends.wrench` (force, torque about the centre of mass) and
    `contact` (2, n) = N, F.

    `ties` (n, 5) holds for each end the anchor, and from the begin of the step the link angle, the
    indentation, the stretch and mu N. At the begin of a step, anchors of sliding ends follow, and
    those of ends in the air move below them. While mu N grows, a tie keeps its force.
    """
    angle = 0.0
    for k in range(ends.hinge_angle.size):
        angle += ends.hinge_angle[k]
        x = ends.place[k, 0]
        z = ends.place[k, 2]
        turning = ends.velocity[k + 1, 1]
        # MuJoCo states velocities at the centre of mass of the whole tree; this moves them to the
        # link end.
        v_x = ends.velocity[k + 1, 3] + turning * (z - ends.origin[2])
        v_z = ends.velocity[k + 1, 5] - turning * (x - ends.origin[0])
        indentation = max(law.radius - z - law.depth, 0.0)
        damping = law.damping if v_z < 0.0 else law.leaving_damping
        # Damping in proportion to the elastic force (Hunt and Crossley); the ground never pulls.
        N = law.stiffness * indentation**1.5 * max(1.0 - damping * v_z, 0.0)
        arm = law.lever - law.lever_rise * indentation
        # The lever shrinks with indentation: this is its mean shrinkage over the step times the
        # turn of the link.
        less = 0.5 * law.lever_rise * (ties[k, 2] + indentation) * (angle - ties[k, 1])
        off = x - law.lever * angle + less - ties[k, 0]
        # Share of the friction limit that the stretch of the presliding spring mobilises, between
        # -1 and 1.
        limit = law.mu * N
        share = 0.0
        if limit > 0.0:
            # Share of the stretch at the begin of the step that remains under the new limit.
            carried_over = min(1.0, ties[k, 4] / limit)
            share = carried_over * ties[k, 3] + 0.5 * (1.0 + carried_over) * (off - ties[k, 3])
            share = min(max(share / law.presliding, -1.0), 1.0)
        if step_begins:
            stretch = law.presliding * share
            ties[k, 0] = ties[k, 0] + off - stretch - less
            ties[k, 1] = angle
            ties[k, 2] = indentation
            ties[k, 3] = stretch
            ties[k, 4] = limit
        F = 0.0
        if indentation > 0.0:
            # Viscous drag acts in full from a normal force of 1 N on.
            F = -limit * share - min(1.0, N) * law.drag * (v_x - arm * turning)
        contact[0, k] = N
        contact[1, k] = F
        wrench = ends.wrench[k + 1]
        centre = ends.mass_centre[k + 1]
        wrench[0] = F
        wrench[2] = N
        # Torque about +y of the contact force at its point of action, a lever below the end, about
        # the centre of mass.
        wrench[4] = (z - arm - centre[2]) * F - (x - centre[0]) * N


@dataclass(frozen=True)
class MujocoStroke:
    """One simulated stroke. `normal_N`, `tangential_N` (m,) are sums over the link ends; `fz_N`
    (m,) is at the mount, in the sensor's sign.

    `speed_error` is the relative error of the shaft speed at the end.
    """

    t_s: Floats
    normal_N: Floats
    tangential_N: Floats
    fz_N: Floats
    speed_error: float
    steps: int


def stroke_in_mujoco(
    rig: RigModel,
    height_m: float,
    speed_rad_s: float,
    t_s: Floats,
    step_s: float = STEP_S,
    integrator: str = "RK4",
) -> MujocoStroke:
    """MuJoCo's mechanics with the nominal ground law, which is implemented separately from the
    model and applied as external forces.

    `t_s` (m,) is ascending, in s. At times up to 0 the leg is at rest and must hang clear of the
    ground. Raises SimulationFailed, BadInput.
    """
    leg = mujoco_leg(rig, height_m, floor=False, integrator=integrator)
    settle_at_rest(leg, rig.leg.start_angle_rad)
    contact = np.zeros((2, leg.model.nq))
    with _apply_ground_law(rig, height_m, leg, contact) as begin_step:

        def steps(count: int) -> None:
            # Steps are taken one by one, because the friction state may change only between steps,
            # not at the stages of RK4.
            for _ in range(count):
                begin_step()
                leg.mujoco.mj_step(leg.model, leg.data)

        return _follow(rig, leg, speed_rad_s, t_s, step_s, steps, lambda: contact.sum(axis=1))


def stroke_on_springs(
    rig: RigModel,
    height_m: float,
    speed_rad_s: float,
    t_s: Floats,
    stiffness_N_per_m: float,
    step_s: float = STEP_S,
) -> MujocoStroke:
    """The stroke (m samples at `t_s` (m,)) with MuJoCo's own contact: an undamped linear spring
    under each end, and MuJoCo's friction.

    Of the nominal ground only the friction coefficient counts. Raises SimulationFailed, BadInput.
    """
    leg = leg_on_springs(rig, height_m, stiffness_N_per_m)
    settle_at_rest(leg, rig.leg.start_angle_rad)
    force = np.zeros(6)

    def contact() -> Floats:
        total = np.zeros(2)
        for i in range(leg.data.ncon):
            leg.mujoco.mj_contactForce(leg.model, leg.data, i, force)
            total += force[0], np.hypot(force[1], force[2])
        return total

    return _follow(
        rig,
        leg,
        speed_rad_s,
        t_s,
        step_s,
        lambda count: leg.mujoco.mj_step(leg.model, leg.data, count),
        contact,
    )


def leg_on_springs(rig: RigModel, height_m: float, stiffness_N_per_m: float) -> MujocoLeg:
    """The leg over a floor whose soft constraints are set up to act as springs of a physical
    stiffness.

    Notes
    -----
    MuJoCo: force = (reference - acceleration) / (A + R), R = w (1 - d) / d with impedance d. At d =
    1e-4 R is ten thousand times A, and with reference = k w indentation the force is k indentation
    to 1e-4. Friction: R / impratio and damping alone, hence a viscous slope of impratio * damping /
    w.

    References
    ----------
    MuJoCo documentation, Computation, Constraint model.
    """
    leg = mujoco_leg(rig, height_m, floor=True, integrator="implicitfast")
    w = leg.model.body_invweight0[1:, 0]
    leg.model.pair_solref[:, 0] = -stiffness_N_per_m * w
    leg.model.pair_solref[:, 1] = 0.0
    leg.model.pair_solreffriction[:] = -NO_SPRING, -CREEP_DAMPING
    leg.model.opt.impratio = CREEP_N_S_PER_M * w[-1] / CREEP_DAMPING
    return leg


@contextmanager
def _apply_ground_law(
    rig: RigModel, height_m: float, leg: MujocoLeg, contact: Floats
) -> Iterator[Callable[[], None]]:
    """Within, MuJoCo calls the ground law at every evaluation of its equations. Yields the
    function to call before each step.
    """
    data = leg.data
    # These are views of MuJoCo's own memory: they follow every step without a copy.
    ends = Ends(
        data.site_xpos, data.xipos, data.subtree_com[1], data.cvel, data.qpos, data.xfrc_applied
    )
    law = ground_law(rig, height_m)
    angle = np.cumsum(data.qpos)
    zeros = np.zeros_like(angle)
    # Friction starts without force: each anchor lies below its end.
    ties = np.column_stack([data.site_xpos[:, 0] - law.lever * angle, angle, zeros, zeros, zeros])
    step_begins = True

    def ask(*_: object) -> None:
        nonlocal step_begins
        push(law, ends, ties, step_begins, contact)
        step_begins = False

    def begin() -> None:
        nonlocal step_begins
        step_begins = True

    # The callback is global to the MuJoCo module, so the previous one is restored afterwards.
    previous = leg.mujoco.get_mjcb_passive()
    leg.mujoco.set_mjcb_passive(ask)
    try:
        yield begin
    finally:
        leg.mujoco.set_mjcb_passive(previous)


def _follow(
    rig: RigModel,
    leg: MujocoLeg,
    speed_rad_s: float,
    t_s: Floats,
    step_s: float,
    steps: Callable[[int], None],
    contact: Callable[[], Floats],
) -> MujocoStroke:
    """Steps from sample to sample, none longer than `step_s`. One step ends exactly with the
    ramp, where the shaft torque jumps.
    """
    rows = np.empty((len(t_s), 3))
    now_s = 0.0
    taken = 0
    with _silence_warnings(leg.mujoco):
        for row, sample_s in zip(rows, t_s, strict=True):
            # Splitting at the end of the ramp keeps the order of the integrator, which a jump
            # within a step would spoil.
            for stop_s in (min(rig.drive.ramp_s, sample_s), sample_s):
                if stop_s > now_s:
                    ramping = stop_s <= rig.drive.ramp_s
                    # The flywheel is so heavy that this torque alone gives the commanded
                    # acceleration.
                    if ramping:
                        leg.data.qfrc_applied[0] = FLYWHEEL_KG_M2 * speed_rad_s / rig.drive.ramp_s
                    else:
                        leg.data.qfrc_applied[0] = 0.0
                    count = ceil((stop_s - now_s) / step_s - 1e-6)
                    leg.model.opt.timestep = (stop_s - now_s) / count
                    steps(count)
                    now_s = stop_s
                    taken = taken + count
            leg.mujoco.mj_forward(leg.model, leg.data)
            # Forces between bodies are not computed by a step; this call fills cfrc_int.
            leg.mujoco.mj_rnePostConstraint(leg.model, leg.data)
            row[:2] = contact()
            row[2] = leg.data.cfrc_int[1, 5]
            # MuJoCo only warns where it loses a simulation, and goes on.
            bad = (
                leg.mujoco.mjtWarning.mjWARN_BADQPOS,
                leg.mujoco.mjtWarning.mjWARN_BADQVEL,
                leg.mujoco.mjtWarning.mjWARN_BADQACC,
            )
            if (
                any(leg.data.warning[warning].number for warning in bad)
                or not np.isfinite(leg.data.qacc).all()
            ):
                raise SimulationFailed(
                    f"MuJoCo lost the leg at {sample_s:.3f} s with steps of {1e6 * step_s:g} us; "
                    "look for a slipped decimal point in the leg or ground"
                )
    return MujocoStroke(
        t_s, rows[:, 0], rows[:, 1], rows[:, 2], float(leg.data.qvel[0] / speed_rad_s - 1.0), taken
    )


@contextmanager
def _silence_warnings(mujoco: Any) -> Iterator[None]:
    """Within the context, MuJoCo counts its warnings but neither prints them nor writes a log
    file into the user's folder.
    """
    previous = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda *_: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(previous)
