"""Writes the model file of a mechanism with the result of a diagnosis, for the user's own tools."""

import os
from pathlib import Path

import numpy as np

from rfca_rig.mechanism.load import read_spec
from rfca_rig.mechanism.plant import Plant
from rfca_rig.recording.atomic import write_atomically


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
    spec, model = read_spec(plant.mechanism.path), plant.model
    # Compiling gives every geom its index.
    spec.compile()
    for place, joint in enumerate(spec.joints):
        # A prescribed joint of the plant has an armature that no load can move; the file gets the original one.
        heavy = place in plant.mechanism.prescribed
        joint.frictionloss = plant.friction[place]
        joint.armature = (plant.mechanism.model if heavy else model).dof_armature[place]
        joint.damping = [model.dof_damping[place], *model.dof_dampingpoly[place]]
        # A stop that was found. MJCF states angles in the unit of its compiler, the compiled model in rad.
        if model.jnt_limited[place] and not plant.mechanism.model.jnt_limited[place]:
            in_degrees = spec.compiler.degree and not plant.mechanism.is_slide[place]
            joint.limited, joint.range = 1, np.degrees(model.jnt_range[place]) if in_degrees else model.jnt_range[place]
        joint.stiffness = [model.jnt_stiffness[place], *model.jnt_stiffnesspoly[place]]
    for place, body in enumerate(spec.bodies):
        if place > 0 and model.body_mass[place] > 0.0:
            # Inertia along principal axes; NaN marks the full tensor as not given.
            body.explicitinertial = True
            body.mass, body.ipos, body.iquat = model.body_mass[place], model.body_ipos[place], model.body_iquat[place]
            body.inertia, body.fullinertia = model.body_inertia[place], np.full(6, np.nan)
    for place, actuator in enumerate(spec.actuators):
        actuator.gear = model.actuator_gear[place] * plant.command_gain[place]
    for geom in spec.geoms:
        geom.solref, geom.friction = model.geom_solref[geom.id], model.geom_friction[geom.id]
    for pair in spec.pairs:
        pair.solref, pair.friction = model.pair_solref[pair.id], model.pair_friction[pair.id]
    spec.option.gravity = model.opt.gravity
    spec.compile()
    # The file may be in another folder than the meshes that it names.
    for kind, has_files in (("meshdir", bool(spec.meshes or spec.hfields or spec.skins)), ("texturedir", bool(spec.textures))):
        if has_files:
            assets = plant.mechanism.path.parent / getattr(spec, kind)
            setattr(spec, kind, Path(os.path.relpath(assets, path.parent)).as_posix())
    write_atomically(path, spec.to_xml().encode("utf-8"))
    return tuple(words for words, is_there in _beyond_mjcf(plant) if is_there)


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
        ("lag of the speed readings", plant.speed_lag_s > 0.0),
        ("scales and zeros of the sensors", any(values.any() for values in scaled)),
        ("crosstalk of the sensors", bool(plant.sensor_crosstalk.any())),
        ("delay or lag of the sensors", plant.sensor_delay_s != 0.0 or plant.sensor_lag_s > 0.0),
    ]
