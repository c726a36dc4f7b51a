"""One version of a mechanism: MuJoCo's model, and parameters that such a model does not have."""

import copy
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rfca_rig.mechanism.contact_law import DAMPING, FRICTION, MORE_POWER, STIFFNESS
from rfca_rig.mechanism.load import Mechanism
from rfca_rig.mechanism.prescribed import ARMATURE

Floats = NDArray[np.float64]

# Margin of a pair that MuJoCo must ignore: the geoms would have to overlap by 1 km.
NEVER_M = -1e3


@dataclass(frozen=True, eq=False)
class JointLaw:
    """A table in the form of a plant.

    Parameters
    ----------
    joint
        Index of the joint.
    by_speed
        Whether the torque depends on the speed, instead of the position.
    knots, values
        (k,) ascending speeds or positions, and the torques [N m or N].
    branches
        (k,) added to the values while the argument rises, and subtracted while it falls.
    turning
        Rate of the argument below which its direction is smoothed, so that there is none at rest.
    """

    joint: int
    by_speed: bool
    knots: Floats
    values: Floats
    branches: Floats
    turning: float = 1.0


@dataclass(eq=False)
class Plant:
    """A copy of a mechanism's model that nuisance parameters and effects may change.

    Parameters
    ----------
    mechanism
        The mechanism as the file has it.
    model
        MuJoCo's model of this version.
    step_s
        Length of the integrator's step.
    friction
        (n,) dry friction of each joint [N m or N]; it stands in for the model's `frictionloss`.
    stribeck
        (3, n) dry friction that falls with speed: its value at high speed, its rise at rest as a
        share, the speed it falls with.
    load_loss
        (n,) share of the actuators' torque that each joint loses by friction.
    hysteresis
        (2, n) Dahl's friction of each joint: its torque, and the angle over which it builds up.
    gear_compliance
        (n,) deflection of each joint's gear per torque that it transmits [rad/(N m) or m/N]; 0 is
        rigid.
    gear_play
        (2, n) play of each gear [rad or m], and the least inertia of the rotor that crosses it.
    torque_offset, zero_offset
        (n,) constant torque in each joint while the actuators are on, and the amount by which each
        position reading is too large.
    command_gain, command_limit, command_dead_band
        (u,) factor on the recorded commands, their largest magnitude, and the magnitude that has no
        effect.
    torque_speed
        (2, u) the largest command at rest, and its relative decrease per rad/s (or m/s) of the
        joint.
    command_delay_s, command_lag_s, command_clock_rate
        Delay of the commands against the recording: dead time, time constant of a low-pass, share
        of the time since the recording began.
    reading_lag_s, speed_lag_s
        Time constant of a low-pass over the readings of positions and speeds, and of a further one
        over those of speed.
    sensor_gain, sensor_offset, sensor_drift_per_s
        (d,) factor on each value of the sensors, its offset at the beginning of the recording, and
        the change of the offset per second.
    sensor_crosstalk
        (d, d) share of another value that each value of the sensors reads, before its factor.
    sensor_lag_s, sensor_delay_s
        Time constant of a low-pass over the sensors, and by how much their clock is late.
    laws
        Torques that are given by tables.
    contact_law
        (c, 7) numbers of the contacts that have a law of their own; see `SphereOnPlane`.
    spring_half_gap
        (n,) play to either side of each joint's rest position, within which its spring does
        nothing.
    start_swing, start_swing_rate_per_s
        Distance of a start at rest from equilibrium, as a share of the way to the pose in which the
        springs are free, and the speed in that direction.
    """

    mechanism: Mechanism
    model: Any
    step_s: float
    friction: Floats
    stribeck: Floats
    load_loss: Floats
    hysteresis: Floats
    gear_compliance: Floats
    gear_play: Floats
    torque_offset: Floats
    zero_offset: Floats
    command_gain: Floats
    command_limit: Floats
    command_dead_band: Floats
    torque_speed: Floats
    sensor_gain: Floats
    sensor_offset: Floats
    sensor_drift_per_s: Floats
    sensor_crosstalk: Floats
    command_delay_s: float = 0.0
    command_lag_s: float = 0.0
    command_clock_rate: float = 0.0
    reading_lag_s: float = 0.0
    speed_lag_s: float = 0.0
    sensor_lag_s: float = 0.0
    sensor_delay_s: float = 0.0
    laws: tuple[JointLaw, ...] = ()
    contact_law: Floats = field(default_factory=lambda: np.empty((0, 7)))
    spring_half_gap: Floats = field(default_factory=lambda: np.empty(0))
    start_swing: float = 0.0
    start_swing_rate_per_s: float = 0.0

    @property
    def has_yielding_gears(self) -> bool:
        """Whether the readings of the motors' encoders differ from the joints' positions."""
        return bool(self.gear_compliance.any() or self.gear_play[0].any())

    @property
    def reads_sensors(self) -> bool:
        """Whether the simulation computes the sensors."""
        import mujoco  # noqa: PLC0415  (optional)

        return not self.model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_SENSOR


def make_plant(mechanism: Mechanism, step_s: float, reads_sensors: bool = False) -> Plant:
    """The mechanism as its file has it; sensors cost time, so they are computed where
    `reads_sensors` asks for them.
    """
    import mujoco  # noqa: PLC0415  (optional)

    model = copy.copy(mechanism.model)
    model.opt.timestep = step_s
    # Explicit models use RK4, the scheme of `contact_step`; stiff dampers need the implicit
    # integrator that the file chose.
    if not mechanism.is_implicit:
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.dof_armature[list(mechanism.prescribed)] = ARMATURE
    replaced = {frozenset((law.sphere, law.plane)) for law in mechanism.contacts}
    for pair in range(model.npair):
        if (
            frozenset(
                (model.geom(model.pair_geom1[pair]).name, model.geom(model.pair_geom2[pair]).name)
            )
            in replaced
        ):
            model.pair_margin[pair] = NEVER_M
    # Where no contact is left for MuJoCo, it need not detect any. Nor need it divide the joints
    # into islands, which suits mechanisms of many parts: to solve the dry friction of a few joints
    # at once takes a fifth less of a step, and gives the same numbers.
    if len(replaced) == model.npair and not np.any(
        model.geom_contype & model.geom_conaffinity[:, None]
    ):
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
    # A simulation that diverges must not be reset silently; `rollout` raises an error instead.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    if not reads_sensors:
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_SENSOR
    zeros = np.zeros(model.nv)
    # Sets only the usual depth of the contact laws.
    weight_N = float(model.body_mass.sum()) * max(1.0, float(np.linalg.norm(model.opt.gravity)))
    return Plant(
        mechanism=mechanism,
        model=model,
        step_s=step_s,
        friction=model.dof_frictionloss.copy(),
        stribeck=np.vstack([zeros, zeros, zeros + 1.0]),
        load_loss=zeros.copy(),
        hysteresis=np.vstack([zeros, zeros + 1.0]),
        gear_compliance=zeros.copy(),
        gear_play=np.vstack([zeros, zeros + 1.0]),
        torque_offset=zeros.copy(),
        zero_offset=zeros.copy(),
        command_gain=np.ones(model.nu),
        command_limit=np.full(model.nu, np.inf),
        command_dead_band=np.zeros(model.nu),
        torque_speed=np.vstack([np.full(model.nu, np.inf), np.zeros(model.nu)]),
        sensor_gain=np.ones(model.nsensordata),
        sensor_offset=np.zeros(model.nsensordata),
        sensor_drift_per_s=np.zeros(model.nsensordata),
        sensor_crosstalk=np.zeros((model.nsensordata, model.nsensordata)),
        contact_law=np.array(
            [contact.list_numbers(weight_N) for contact in mechanism.contacts]
        ).reshape(-1, 7),
        spring_half_gap=zeros.copy(),
    )


def update_constants(plant: Plant) -> None:
    """Recomputes the constants that MuJoCo derives from masses and joints, after these have
    changed.
    """
    import mujoco  # noqa: PLC0415  (optional)

    with plant.mechanism.borrow_data(plant.model) as data:
        mujoco.mj_setConst(plant.model, data)


Change = Callable[[Plant, int, float], None]
"""Adds a value to a plant, at the place of a joint, a body or an actuator."""


def add_to(field: str, least: float = -np.inf) -> Change:
    """Makes a change that adds to an array of MuJoCo's model, to the first column of one with
    several; the sum is not below `least`.
    """

    def change(plant: Plant, place: int, by: float) -> None:
        array = getattr(plant.model, field)
        at = (place, 0) if array.ndim > 1 else place
        array[at] = max(least, array[at] + by)

    return change


def add_friction(plant: Plant, joint: int, by: float) -> None:
    """Adds dry friction; the sum is not below zero."""
    plant.friction[joint] = max(0.0, plant.friction[joint] + by)


def shift_centre(plant: Plant, body: int, by_m: float) -> None:
    """Moves a body's centre of mass away from its frame, along its present direction; the inertia
    about the centre of mass stays.

    `body` counts as MuJoCo does, with 0 for the world.
    """
    at = plant.model.body_ipos[body]
    distance = float(np.linalg.norm(at))
    if distance > 0.0:
        at *= 1.0 + by_m / distance


def add_point_mass(plant: Plant, body: int, at_m: Floats, mass_kg: float) -> None:
    """Adds a point mass to a body, at `at_m` (3,) in the body's frame; `body` counts as MuJoCo
    does.
    """
    model = plant.model
    mass = model.body_mass[body]
    centre_m = (mass * model.body_ipos[body] + mass_kg * at_m) / (mass + mass_kg)
    w, x, y, z = model.body_iquat[body]
    axes = Rotation.from_quat([x, y, z, w]).as_matrix()
    tensor = axes @ np.diag(model.body_inertia[body]) @ axes.T
    # Steiner's theorem, for the body and for the point, about the common centre of mass.
    for part_kg, place_m in ((mass, model.body_ipos[body]), (mass_kg, at_m)):
        arm = place_m - centre_m
        tensor = tensor + part_kg * (float(arm @ arm) * np.eye(3) - np.outer(arm, arm))
    inertia, axes = np.linalg.eigh(tensor)
    # Eigenvectors may form a left-handed frame, which no quaternion describes.
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    x, y, z, w = Rotation.from_matrix(axes).as_quat()
    model.body_mass[body] = mass + mass_kg
    model.body_ipos[body] = centre_m
    model.body_iquat[body] = (w, x, y, z)
    model.body_inertia[body] = inertia


def scale_contact_stiffness(plant: Plant, factor: float) -> None:
    """Makes all contacts stiffer by a factor, with as much damping.

    References
    ----------
    MuJoCo documentation, Modeling, solver parameters: the damping is 2 / (d t) and the stiffness 1
    / (d t r)^2 of a contact with time constant t, damping ratio r and impedance d; of negative
    values, stiffness and damping themselves.
    """
    for solref in (plant.model.geom_solref, plant.model.pair_solref):
        is_direct = solref[:, 0] < 0.0
        # Stiffness ~ 1 / (t r)^2 at constant damping ~ 1 / t: only the ratio r changes.
        solref[is_direct, 0] *= factor
        solref[~is_direct, 1] /= np.sqrt(factor)
    plant.contact_law[:, STIFFNESS] *= factor


def scale_contact_damping(plant: Plant, factor: float) -> None:
    """Makes all contacts damp more by a factor, with the same stiffness; see
    `scale_contact_stiffness`.
    """
    for solref in (plant.model.geom_solref, plant.model.pair_solref):
        is_direct = solref[:, 0] < 0.0
        solref[is_direct, 1] *= factor
        # Damping ~ 1 / t grows by the factor, and the product t r, which sets the stiffness, stays.
        solref[~is_direct, 0] /= factor
        solref[~is_direct, 1] *= factor
    plant.contact_law[:, DAMPING] *= factor


def scale_contact_friction(plant: Plant, factor: float) -> None:
    """Multiplies the sliding friction of all contacts."""
    plant.model.geom_friction[:, 0] *= factor
    plant.model.pair_friction[:, :2] *= factor
    plant.contact_law[:, FRICTION] *= factor


def add_contact_power(plant: Plant, by: float) -> None:
    """Adds to the power of the depth in all contacts that have a law of their own; the force at
    the usual depth stays.
    """
    plant.contact_law[:, MORE_POWER] += by
