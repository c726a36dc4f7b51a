"""Model files for the user's own tools: of a mechanism with the result of a diagnosis, and of the
flexible leg in MJCF.

The leg is on a rack that slides to its height, with a prescribed shaft and hinges with springs.
Plane of motion y-z, angles positive downwards from +y. The force sensor stands between world and
rack, `below_shaft` under the shaft, with its z axis down.
"""

import os
from pathlib import Path
from typing import Any

import numpy as np

from rfca_rig.mechanism.free_joints import expand_free_joints
from rfca_rig.mechanism.load import read_spec
from rfca_rig.mechanism.plant import Plant
from rfca_rig.model.hinge_springs import polynomial_springs
from rfca_rig.model.parameters import GRAVITY_M_S2, Leg, RigModel
from rfca_rig.recording.atomic import write_atomically

RACK = "rack"
SHAFT = "shaft"
FLOOR = "floor"
SENSOR = "mount"
RACK_KG = 1e-6  # MuJoCo wants a mass; its weight in the sensor is 1e-5 N


def write_amended_model(plant: Plant, path: Path) -> tuple[str, ...]:
    """Writes MJCF with the plant's joints, bodies, actuators, contacts and gravity.

    Parameters
    ----------
    plant
        The mechanism with nuisance parameters and effects.
    path
        Of the file, which is written atomically.

    Returns
    -------
    tuple of str
        Laws that MJCF cannot express, in words.
    """
    spec, _ = read_spec(plant.mechanism.path, plant.mechanism.mjcf)
    expand_free_joints(spec, plant.mechanism.frames, str(plant.mechanism.path))
    model = plant.model
    # Compiling gives every geom its index.
    spec.compile()
    _amend_joints(spec, plant)
    _amend_bodies(spec, plant)
    _amend_actuators(spec, plant)
    for geom in spec.geoms:
        geom.solref = model.geom_solref[geom.id]
        geom.friction = model.geom_friction[geom.id]
    for pair in spec.pairs:
        pair.solref = model.pair_solref[pair.id]
        pair.friction = model.pair_friction[pair.id]
    spec.option.gravity = model.opt.gravity
    spec.compile()
    # The file may be in another folder than the meshes that it names.
    for kind, has_files in (
        ("meshdir", bool(spec.meshes or spec.hfields or spec.skins)),
        ("texturedir", bool(spec.textures)),
    ):
        if has_files:
            assets = plant.mechanism.path.parent / getattr(spec, kind)
            setattr(spec, kind, Path(os.path.relpath(assets, path.parent)).as_posix())
    write_atomically(path, spec.to_xml().encode("utf-8"))
    return tuple(words for words, is_there in _beyond_mjcf(plant) if is_there)


def _amend_joints(spec: Any, plant: Plant) -> None:
    model = plant.model
    original = plant.mechanism.model
    for index, joint in enumerate(spec.joints):
        # A prescribed joint of the plant has an armature that no load can move; the file gets the
        # original one.
        heavy = index in plant.mechanism.prescribed
        joint.frictionloss = plant.friction[index]
        joint.actfrclimited = model.jnt_actfrclimited[index]
        joint.armature = (original if heavy else model).dof_armature[index]
        joint.damping = [model.dof_damping[index], *model.dof_dampingpoly[index]]
        # A stop that was found. MJCF states angles in the unit of its compiler, the compiled model
        # in rad.
        if model.jnt_limited[index] and not original.jnt_limited[index]:
            in_degrees = spec.compiler.degree and not plant.mechanism.is_slide[index]
            travel = model.jnt_range[index]
            joint.limited = 1
            joint.range = np.degrees(travel) if in_degrees else travel
        joint.stiffness = [model.jnt_stiffness[index], *model.jnt_stiffnesspoly[index]]


def _amend_bodies(spec: Any, plant: Plant) -> None:
    model = plant.model
    for index, body in enumerate(spec.bodies):
        if index > 0 and model.body_mass[index] > 0.0:
            # Inertia along principal axes; NaN marks the full tensor as not given.
            body.explicitinertial = True
            body.mass = model.body_mass[index]
            body.ipos = model.body_ipos[index]
            body.iquat = model.body_iquat[index]
            body.inertia = model.body_inertia[index]
            body.fullinertia = np.full(6, np.nan)


def _amend_actuators(spec: Any, plant: Plant) -> None:
    import mujoco  # noqa: PLC0415  (optional)

    model = plant.model
    for index, actuator in enumerate(spec.actuators):
        gain = plant.command_gain[index]
        # The recordings may have contradicted a limit of the file.
        actuator.ctrllimited = model.actuator_ctrllimited[index]
        actuator.forcelimited = model.actuator_forcelimited[index]
        # Of a muscle other parameters than the gain stand beside it.
        if int(model.actuator_gaintype[index]) in (
            mujoco.mjtGain.mjGAIN_FIXED,
            mujoco.mjtGain.mjGAIN_AFFINE,
        ):
            # A gear would scale what the actuator feeds back, too, and twice: the position, and the
            # force that answers it.
            actuator.gear = model.actuator_gear[index]
            actuator.gainprm = model.actuator_gainprm[index] * gain
        else:
            actuator.gear = model.actuator_gear[index] * gain


def _beyond_mjcf(plant: Plant) -> list[tuple[str, bool]]:
    late = (plant.command_delay_s, plant.command_lag_s, plant.command_clock_rate)
    scaled = (plant.sensor_gain - 1.0, plant.sensor_offset, plant.sensor_drift_per_s)
    return [
        ("friction that falls with speed", bool(plant.stribeck[0].any())),
        ("friction that grows with load", bool(plant.load_loss.any())),
        ("hysteresis of the joints", bool(plant.hysteresis[0].any())),
        ("elasticity or play of the gears", plant.has_yielding_gears),
        ("play of the springs", bool(plant.spring_half_gap.any())),
        ("contact laws of spheres on planes", bool(plant.contact_law.size)),
        ("a swing at the start", plant.start_swing != 0.0 or plant.start_swing_rate_per_s != 0.0),
        ("steady torques in the joints", bool(plant.torque_offset.any())),
        ("measured laws", bool(plant.laws)),
        ("zero offsets of the readings", bool(plant.zero_offset.any())),
        ("saturation of the commands", bool(np.isfinite(plant.command_limit).any())),
        ("dead band of the commands", bool(plant.command_dead_band.any())),
        ("largest commands that fall with speed", bool(plant.torque_speed[1].any())),
        ("delay, lag or clock of the commands", any(late)),
        ("lag of the readings of the joints", plant.reading_lag_s > 0.0),
        ("lag of the speed readings", plant.speed_lag_s > 0.0),
        ("scales and zeros of the sensors", any(values.any() for values in scaled)),
        ("crosstalk of the sensors", bool(plant.sensor_crosstalk.any())),
        ("delay or lag of the sensors", plant.sensor_delay_s != 0.0 or plant.sensor_lag_s > 0.0),
    ]


def hinge_names(leg: Leg) -> tuple[str, ...]:
    """The hinges behind the shaft."""
    return tuple(f"hinge{i + 1}" for i in range(1, len(leg.link_lengths_m)))


def link_names(leg: Leg) -> tuple[str, ...]:
    """The links' bodies."""
    return tuple(f"link{i + 1}" for i in range(len(leg.link_lengths_m)))


def end_names(leg: Leg) -> tuple[str, ...]:
    """The spheres at the links' ends."""
    return tuple(f"end{i + 1}" for i in range(len(leg.link_lengths_m)))


def write_leg_mjcf(rig: RigModel) -> str:
    """The model in MJCF. The rack's joint is the height of the shaft above the floor, 0 on it."""
    links = ""
    # From the last link inwards, as each body contains the text of those beyond it.
    for i in reversed(range(len(rig.leg.link_lengths_m))):
        links = _link(rig, i, links)
    pairs = "".join(_pair(rig, name) for name in end_names(rig.leg))
    return f"""<mujoco model="flexible leg">
 <compiler angle="radian"/>
 <option gravity="0 0 {-GRAVITY_M_S2!r}" integrator="implicitfast" timestep="0.0001" cone="elliptic"/>
 <worldbody>
  <geom name="{FLOOR}" type="plane" size="2 2 1" contype="0" conaffinity="0"/>
  <body name="{RACK}"><joint name="{RACK}" type="slide" axis="0 0 1"/>
   <inertial pos="0 0 0" mass="{RACK_KG}" diaginertia="1e-9 1e-9 1e-9"/>
   <site name="{SENSOR}" pos="0 0 {-rig.sensor.below_shaft_m!r}" quat="0 1 0 0"/>
{links}  </body>
 </worldbody>
 <contact>{pairs}
 </contact>
 <sensor><force name="{SENSOR}_force" site="{SENSOR}"/><torque name="{SENSOR}_torque" site="{SENSOR}"/></sensor>
</mujoco>
"""


def _link(rig: RigModel, i: int, further: str) -> str:
    """Link i, a thin uniform rod along its own y. Its inertia about y, which planar motion does
    not involve, is a thousandth.
    """
    leg = rig.leg
    length = rig.leg.link_lengths_m[i]
    mass = rig.leg.link_masses_kg[i]
    inertia = mass * length**2 / 12.0
    name = SHAFT if i == 0 else hinge_names(leg)[i - 1]
    spring = ""
    at = leg.link_lengths_m[i - 1] if i else 0.0
    if i:
        first, second, third = polynomial_springs(leg, "a mechanism of MuJoCo")
        stiffness = f"{first!r} {second:g} {third!r}"
        spring = f' stiffness="{stiffness}" damping="{leg.hinge_damping_Nm_s_per_rad!r}"'
        if leg.rest_angles_rad:
            spring += f' springref="{leg.rest_angles_rad[i - 1]!r}"'
    return f"""   <body name="{link_names(leg)[i]}" pos="0 {at!r} 0"><joint name="{name}" axis="-1 0 0"{spring}/>
    <inertial pos="0 {length / 2.0!r} 0" mass="{mass!r}" diaginertia="{inertia!r} {1e-3 * inertia!r} {inertia!r}"/>
    <geom name="{end_names(leg)[i]}" size="{leg.link_radius_m!r}" pos="0 {length!r} 0" mass="0" contype="0" conaffinity="0"/>
{further}   </body>
"""


def _pair(rig: RigModel, name: str) -> str:
    """MuJoCo's own contact, for viewers: about as stiff under the leg's weight; a diagnosis
    replaces it by the floor's law.
    """
    mu = rig.ground.friction_coefficient
    return f"""
  <pair geom1="{FLOOR}" geom2="{name}" condim="3" friction="{mu!r} {mu!r} 0 0 0"/>"""
