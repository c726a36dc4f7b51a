"""The effects that the model of a mechanism may lack, for its joints, actuators and bodies.

MJCF can express most of these laws. `Plant` has the others: friction that depends on speed or load,
and changes of commands and readings. A law that may act in a single joint makes two effects: one in
all joints, each with its own size, and one in one joint.
"""

import copy
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.mechanism.inverse_dynamics import torque_motors
from rfca_rig.mechanism.laws import (
    LARGEST,
    SMALLEST,
    PlaceLaw,
    expand_law,
    group_places,
    join_name,
    joint_units,
    list_own_effects,
    list_sensor_effects,
)
from rfca_rig.mechanism.load import Mechanism
from rfca_rig.mechanism.nuisances import PLACEHOLDER
from rfca_rig.mechanism.plant import (
    Change,
    Plant,
    add_contact_power,
    add_friction,
    add_point_mass,
    add_to,
    scale_contact_damping,
    scale_contact_friction,
    scale_contact_stiffness,
    shift_centre,
)
from rfca_rig.mechanism.usual_motion import UsualMotion
from rfca_rig.model.declarations import ground, joints, rig, sensor
from rfca_rig.model.effect import Declaration, Effect, Parameter, Values

Floats = NDArray[np.float64]

# of a gear, as a share of the usual travel: with more, a controller would hardly be stable
MOST_DEFLECTION = 0.3
# Least inertia, as a share of the usual one, of a rotor that crosses the play of its gear. With
# 0.005 and 0.02 the results for rotors of 0.06, 0.02 and 0.004 kg m2 are equal; with 0.1 the error
# doubles in the joint of the lightest one, for a play of 0.03 rad.
LEAST_ROTOR = 0.02
# Least share of the largest command that is lost at usual speed: less limits hardly any recorded
# command.
FALLS_BY = 0.02
# Of a prescribed joint, in rad, or as a share of the mechanism's size: 3 degrees, or 20 mm of a leg
# that is 0.4 m long.
MOST_OFFSET = 0.05
# Torque constants are usually right to 10 %. A hopper's motion with 27 % more force, the nearest
# point of the usual grid, has lost its likeness to the recorded one within a window, and the search
# missed 15 %.
NEAR_FACTORS = (0.5, 0.9, 1.1, 2.0)
FAR = 1e6  # rad or m: the end of a range that has none


def list_effects(mechanism: Mechanism, usual: UsualMotion) -> list[Effect]:
    """Lists the effects that can act on this mechanism and would be visible in such recordings.

    Parameters
    ----------
    mechanism
        The mechanism.
    usual
        Usual magnitudes in the recordings; they set the plausible sizes.
    """
    effects: list[Effect] = []
    # A body that flies freely has no joint that could rub, yield or stop.
    if mechanism.guided:
        for law in _laws(mechanism, usual):
            effects += expand_law(law)
        effects += [
            *_stribeck(mechanism, usual),
            *_hysteresis(mechanism, usual),
            *_stop(mechanism, usual),
        ]
    return [
        *effects,
        *_of_commands(mechanism, usual),
        *list_sensor_effects(mechanism, usual),
        *_of_contacts(mechanism),
        *_of_rig(mechanism, usual),
        *list_own_effects(mechanism, usual),
    ]


def _laws(mechanism: Mechanism, usual: UsualMotion) -> Iterator[PlaceLaw]:
    moving = mechanism.guided
    sprung = tuple(joint for joint in moving if mechanism.has_spring(joint))

    def per_joint(
        declaration: Declaration,
        quantity: str,
        units: tuple[str, str],
        size: Floats,
        change: Change,
        places: tuple[int, ...] = moving,
    ) -> PlaceLaw:
        names = joint_units(mechanism, *units)
        low = SMALLEST * size
        high = LARGEST * size
        chosen = list(places)
        at = tuple(mechanism.joints[joint] for joint in places)
        return PlaceLaw(
            declaration,
            quantity,
            tuple(names[joint] for joint in places),
            at,
            places,
            low[chosen],
            high[chosen],
            change,
            groups=group_places(mechanism, at),
        )

    torque = usual.torque
    speed = usual.speed
    yield per_joint(
        joints.JOINT_FRICTION,
        "torque",
        ("Nm", "N"),
        torque,
        add_friction,
    )
    yield per_joint(
        joints.JOINT_DAMPING,
        "coefficient",
        ("Nm_s_per_rad", "N_s_per_m"),
        torque / speed,
        add_to("dof_damping"),
    )
    yield per_joint(
        joints.JOINT_DRAG,
        "coefficient",
        ("Nm_s2_per_rad2", "N_s2_per_m2"),
        torque / speed**2,
        add_to("dof_dampingpoly"),
    )
    yield per_joint(
        joints.JOINT_INERTIA,
        "inertia",
        ("kg_m2", "kg"),
        usual.inertia,
        add_to("dof_armature"),
    )
    yield per_joint(
        joints.JOINT_SPRING,
        "stiffness",
        ("Nm_per_rad", "N_per_m"),
        torque / usual.travel,
        add_to("jnt_stiffness"),
    )
    if sprung:
        yield per_joint(
            joints.JOINT_SPRING_PLAY,
            "half_gap",
            ("rad", "m"),
            usual.travel,
            _add_play,
            places=sprung,
        )
    # Without recorded commands there is no torque for a gear to lose, and no command whose scale
    # may be wrong.
    driven = tuple(joint for joint in moving if mechanism.driven[joint])
    if usual.is_driven and driven:
        ones = np.ones(len(driven))
        yield PlaceLaw(
            joints.JOINT_LOAD_FRICTION,
            "loss",
            ("relative",) * len(driven),
            tuple(mechanism.joints[joint] for joint in driven),
            driven,
            0.01 * ones,
            0.6 * ones,
            _add_load_loss,
        )
        yield from _laws_of_gears(mechanism, usual, driven)
        shown = tuple(int(actuator) for actuator in np.flatnonzero(usual.command > 0.0))
        actuators = tuple(mechanism.actuators[actuator] for actuator in shown)
        ones = np.ones(len(shown))
        yield PlaceLaw(
            joints.TORQUE_SCALE,
            "factor",
            ("",) * len(shown),
            actuators,
            shown,
            0.3 * ones,
            3.0 * ones,
            _scale_command,
            starts=NEAR_FACTORS,
        )


def _laws_of_gears(
    mechanism: Mechanism, usual: UsualMotion, driven: tuple[int, ...]
) -> Iterator[PlaceLaw]:
    """Compliance and play between encoders on the motors' side and the joints; sizes are shares
    of the usual travel.
    """
    names = tuple(mechanism.joints[joint] for joint in driven)
    at = list(driven)
    travel = usual.travel[at]
    torque = usual.torque[at]

    def units(of_hinge: str, of_slide: str) -> tuple[str, ...]:
        return tuple(np.array(joint_units(mechanism, of_hinge, of_slide))[at].tolist())

    def add_compliance(plant: Plant, joint: int, value: float) -> None:
        plant.gear_compliance[joint] += value

    def add_play(plant: Plant, joint: int, value: float) -> None:
        plant.gear_play[0, joint] += value
        plant.gear_play[1, joint] = LEAST_ROTOR * usual.inertia[joint]

    yield PlaceLaw(
        joints.GEAR_COMPLIANCE,
        "compliance",
        units("rad_per_Nm", "m_per_N"),
        names,
        driven,
        SMALLEST * travel / torque,
        MOST_DEFLECTION * travel / torque,
        add_compliance,
    )
    yield PlaceLaw(
        joints.GEAR_BACKLASH,
        "play",
        units("rad", "m"),
        names,
        driven,
        SMALLEST * travel,
        MOST_DEFLECTION * travel,
        add_play,
    )


def _add_play(plant: Plant, joint: int, value: float) -> None:
    plant.spring_half_gap[joint] += value


def _add_load_loss(plant: Plant, joint: int, value: float) -> None:
    plant.load_loss[joint] += value


def _scale_command(plant: Plant, actuator: int, value: float) -> None:
    plant.command_gain[actuator] *= value


def _torques(mechanism: Mechanism, usual: UsualMotion) -> list[tuple[Parameter, list[int]]]:
    """A torque of each joint, or of all of one make, and the joints' places."""
    moving = mechanism.guided
    units = joint_units(mechanism, "Nm", "N")
    groups = group_places(mechanism, tuple(mechanism.joints[joint] for joint in moving))
    parameters = []
    for group, members in groups:
        places = [moving[member] for member in members]
        name = join_name(group if len(groups) > 1 else "", "torque", units[places[0]])
        torque = usual.torque[places]
        parameters.append(
            (
                Parameter(
                    name,
                    SMALLEST * float(torque.min()),
                    LARGEST * float(torque.max()),
                    may_be_zero=False,
                ),
                places,
            )
        )
    return parameters


def _stribeck(mechanism: Mechanism, usual: UsualMotion) -> Iterator[Effect]:
    """Friction that falls with speed, in all joints: a torque each, and one shape, with the
    speed as a share of the usual one.
    """
    torques = _torques(mechanism, usual)

    def apply(plant: Plant, values: Values) -> Plant:
        for torque, places in torques:
            plant.stribeck[0, places] += values[torque.name]
        plant.stribeck[1] = values["rise_relative"]
        plant.stribeck[2] = values["speed_relative"] * usual.speed
        return plant

    shape = (
        Parameter("rise_relative", 0.25, 2.5),
        Parameter("speed_relative", 0.03, 1.0, may_be_zero=False),
    )
    yield joints.JOINT_STRIBECK.make_effect(
        (*(torque for torque, _ in torques), *shape),
        apply,
    )


def _hysteresis(mechanism: Mechanism, usual: UsualMotion) -> Iterator[Effect]:
    """Friction that builds up over an angle, in all joints: a torque each, and one angle, as a
    share of the usual travel.
    """
    torques = _torques(mechanism, usual)

    def apply(plant: Plant, values: Values) -> Plant:
        for torque, places in torques:
            plant.hysteresis[0, places] += values[torque.name]
        plant.hysteresis[1] = values["bend_relative"] * usual.travel
        return plant

    bend = Parameter("bend_relative", 0.03, 1.0, may_be_zero=False)
    yield joints.JOINT_HYSTERESIS.make_effect(
        (*(torque for torque, _ in torques), bend),
        apply,
    )


def _stop(mechanism: Mechanism, usual: UsualMotion) -> Iterator[Effect]:
    """A stop within the recorded range of one joint; MuJoCo's limit, with its default stiffness."""
    middle = usual.middle
    half = usual.half_range

    def apply(plant: Plant, values: Values) -> Plant:
        joint = mechanism.guided[int(values["joint"]) - 1]
        share = values["position_relative"]
        at = middle[joint] + share * half[joint]
        plant.model.jnt_limited[joint] = 1
        if share > 0.0:
            plant.model.jnt_range[joint] = (-FAR, at)
        else:
            plant.model.jnt_range[joint] = (at, FAR)
        return plant

    # A model with limits states its stops already.
    if not mechanism.model.jnt_limited.any():
        counted = Parameter(
            "joint", 1.0, float(len(mechanism.guided)), may_be_zero=False, whole=True
        )
        share = Parameter("position_relative", -0.98, 0.98)
        yield joints.JOINT_STOP.make_effect((counted, share), apply)


def _of_commands(mechanism: Mechanism, usual: UsualMotion) -> Iterator[Effect]:
    def delay(plant: Plant, values: Values) -> Plant:
        plant.command_delay_s += values["delay_s"]
        return plant

    def follow(plant: Plant, values: Values) -> Plant:
        plant.command_lag_s = values["time_constant_s"]
        return plant

    def limit(plant: Plant, values: Values) -> Plant:
        plant.command_limit = np.where(
            usual.command > 0.0, values["limit_relative"] * usual.command, np.inf
        )
        return plant

    def ignore_small(plant: Plant, values: Values) -> Plant:
        plant.command_dead_band = values["band_relative"] * usual.command
        return plant

    def drift(plant: Plant, values: Values) -> Plant:
        plant.command_clock_rate += values["rate_relative"]
        return plant

    def read_late(plant: Plant, values: Values) -> Plant:
        plant.reading_lag_s = values["time_constant_s"]
        return plant

    def read_speed_late(plant: Plant, values: Values) -> Plant:
        plant.speed_lag_s = values["time_constant_s"]
        return plant

    late = Parameter("time_constant_s", 0.002, 0.05, may_be_zero=False, below=0.1)
    if usual.is_driven:
        yield joints.TORQUE_DELAY.make_effect(
            (Parameter("delay_s", -0.04, 0.04, below=0.1),),
            delay,
        )
        yield joints.TORQUE_LAG.make_effect(
            (late,),
            follow,
        )
        yield joints.TORQUE_SATURATION.make_effect(
            (Parameter("limit_relative", 0.2, 0.95, may_be_zero=False),),
            limit,
        )
        yield joints.TORQUE_DEAD_BAND.make_effect(
            (Parameter("band_relative", 0.005, 0.3, may_be_zero=False),),
            ignore_small,
        )
        yield from _of_torque_lines(mechanism, usual)
        yield joints.CLOCK_RATE.make_effect(
            (Parameter("rate_relative", -0.004, 0.004),),
            drift,
        )
        # Without commands, a lag of all readings only shifts the time.
        yield sensor.ANGLE_LAG.make_effect(
            (late,),
            read_late,
        )
    if usual.has_speeds:
        yield sensor.SPEED_LAG.make_effect(
            (late,),
            read_speed_late,
        )


def _of_torque_lines(mechanism: Mechanism, usual: UsualMotion) -> Iterator[Effect]:
    # Only a command that is a torque has a line of torque over speed; position servos are excluded.
    motors = [motor for motor in torque_motors(mechanism) if usual.command[motor] > 0.0]
    driven = mechanism.model.actuator_trnid[motors, 0]

    def fall(plant: Plant, values: Values) -> Plant:
        plant.torque_speed[0, motors] = usual.command[motors]
        plant.torque_speed[1, motors] = values["fall_relative"] / usual.speed[driven]
        return plant

    if motors:
        yield joints.TORQUE_FALLS_WITH_SPEED.make_effect(
            (Parameter("fall_relative", FALLS_BY, LARGEST, may_be_zero=False),),
            fall,
        )


def _of_contacts(mechanism: Mechanism) -> Iterator[Effect]:
    def make_apply(scale: Callable[[Plant, float], None]) -> Callable[[Plant, Values], Plant]:
        def apply(plant: Plant, values: Values) -> Plant:
            scale(plant, values["factor"])
            return plant

        return apply

    if mechanism.has_contacts:
        for declaration, change, low, high in (
            (ground.CONTACT_STIFFNESS, scale_contact_stiffness, 0.05, 20.0),
            (ground.CONTACT_DAMPING, scale_contact_damping, 0.05, 20.0),
            (ground.CONTACT_FRICTION, scale_contact_friction, 0.1, 3.0),
        ):
            factor = Parameter("factor", low, high, may_be_zero=False)
            yield declaration.make_effect((factor,), make_apply(change))

    def harden(plant: Plant, values: Values) -> Plant:
        add_contact_power(plant, values["more_power"])
        return plant

    if mechanism.contacts:
        power = Parameter("more_power", -0.7, 1.5)
        yield ground.CONTACT_POWER.make_effect(
            (power,),
            harden,
        )


def _shift_reading(joint: int, offset: Parameter) -> Callable[[Plant, Values], Plant]:
    def apply(plant: Plant, values: Values) -> Plant:
        plant.zero_offset[joint] += values[offset.name]
        return plant

    return apply


def _of_fluid(mechanism: Mechanism, usual: UsualMotion) -> Iterator[Effect]:
    """Drag of all bodies in the air, which MuJoCo computes from boxes of their inertia."""
    import mujoco  # noqa: PLC0415  (optional)

    model = copy.copy(mechanism.model)
    data = mujoco.MjData(model)
    model.opt.density = 1.0
    data.qpos[:] = usual.middle
    data.qvel[:] = usual.speed
    mujoco.mj_forward(model, data)
    moving = list(mechanism.simulated)
    # The torque of a density of 1 kg/m3 at the usual speed.
    torque = np.abs(data.qfrc_fluid[moving])

    def thicken(plant: Plant, values: Values) -> Plant:
        plant.model.opt.density += values["density_kg_per_m3"]
        return plant

    # In a single joint, drag of the body and of the joint are one law.
    if torque.any() and len(moving) > 1:
        usual_density = float((usual.torque[moving] / np.maximum(torque, 1e-30)).min())
        density = Parameter(
            "density_kg_per_m3",
            SMALLEST * usual_density,
            LARGEST * usual_density,
            may_be_zero=False,
        )
        yield rig.FLUID_DRAG_OF_MECHANISM.make_effect((density,), thicken)


def _of_rig(mechanism: Mechanism, usual: UsualMotion) -> Iterator[Effect]:
    import mujoco  # noqa: PLC0415  (optional)

    model = mechanism.model

    def tilt(plant: Plant, values: Values) -> Plant:
        x, y, z = plant.model.opt.gravity
        about_x = values["about_x_rad"]
        about_y = values["about_y_rad"]
        # Rotation about the world's x axis, then about its y axis.
        y, z = y * np.cos(about_x) - z * np.sin(about_x), y * np.sin(about_x) + z * np.cos(about_x)
        x, z = x * np.cos(about_y) + z * np.sin(about_y), z * np.cos(about_y) - x * np.sin(about_y)
        plant.model.opt.gravity[:] = x, y, z
        return plant

    if np.any(model.opt.gravity != 0.0):
        angles = (Parameter("about_x_rad", -0.2, 0.2), Parameter("about_y_rad", -0.2, 0.2))
        yield rig.GRAVITY_TILT_OF_MECHANISM.make_effect(
            angles,
            tilt,
        )
    # Bodies that have a mass only because MuJoCo requires one, or that are fixed to the world, are
    # no candidates.
    least_kg = PLACEHOLDER * float(model.body_mass.sum())
    heavy = [
        index
        for index in range(1, model.nbody)
        if model.body_mass[index] > least_kg and model.body_weldid[index] != 0
    ]

    sensed = {
        int(site) for site in model.sensor_objid[model.sensor_objtype == mujoco.mjtObj.mjOBJ_SITE]
    }
    # A load may hang at a site; those of sensors are on parts of the mechanism itself.
    sites = [
        index
        for index in range(model.nsite)
        if int(model.site_bodyid[index]) in heavy and index not in sensed
    ]

    def load(plant: Plant, values: Values) -> Plant:
        number = int(values["body"]) - 1
        if number >= len(heavy):
            site = sites[number - len(heavy)]
            at_m = model.site_pos[site]
            add_point_mass(plant, int(model.site_bodyid[site]), at_m, values["mass_kg"])
            return plant
        body = heavy[number]
        # The mass is added where the body's mass is already, so the inertia grows in proportion.
        plant.model.body_inertia[body] *= 1.0 + values["mass_kg"] / plant.model.body_mass[body]
        plant.model.body_mass[body] += values["mass_kg"]
        return plant

    def move(plant: Plant, values: Values) -> Plant:
        shift_centre(plant, off_centre[int(values["body"]) - 1], values["shift_m"])
        return plant

    off_centre = [index for index in heavy if np.linalg.norm(model.body_ipos[index]) > 0.0]
    if off_centre:
        most = max(float(np.linalg.norm(model.body_ipos[index])) for index in off_centre)
        body = Parameter("body", 1.0, float(len(off_centre)), may_be_zero=False, whole=True)
        shift = Parameter("shift_m", -0.5 * most, 0.5 * most, starts=(-0.1 * most, 0.1 * most))
        yield rig.CENTRE_OF_MASS.make_effect(
            (body, shift),
            move,
        )
    for slides, declaration, unit, most in (
        (True, rig.PRESCRIBED_OFFSET, "m", MOST_OFFSET * float(model.stat.extent)),
        (False, rig.PRESCRIBED_ANGLE_OFFSET, "rad", MOST_OFFSET),
    ):
        of_kind = [joint for joint in mechanism.prescribed if mechanism.is_slide[joint] == slides]
        # The effect has one offset, so it exists only where exactly one joint of this kind is
        # prescribed.
        if len(of_kind) == 1:
            joint = of_kind[0]
            offset = Parameter(f"offset_{unit}", -most, most)
            of_joint = replace(declaration, same_as=f"{mechanism.joints[joint]}.zero_offset_{unit}")
            yield of_joint.make_effect((offset,), _shift_reading(joint, offset))
    yield from _of_fluid(mechanism, usual)
    total = float(sum(model.body_mass[index] for index in heavy))
    places = float(len(heavy) + len(sites))
    body = Parameter("body", 1.0, places, may_be_zero=False, whole=True)
    mass = Parameter("mass_kg", SMALLEST * total, 3.0 * LARGEST * total, may_be_zero=False)
    yield rig.ADDED_MASS.make_effect(
        (body, mass),
        load,
    )
