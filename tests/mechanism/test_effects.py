"""Effects and nuisance parameters of a mechanism: each acts, none at its neutral value, and the
amended model moves alike.
"""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.diagnosis.inference.screening import grid_of, terms_of
from rfca_rig.mechanism.contact_law import SphereOnPlane
from rfca_rig.mechanism.effects import list_effects
from rfca_rig.mechanism.load import Sensor, load_mechanism
from rfca_rig.mechanism.model_files import write_amended_model
from rfca_rig.mechanism.nuisances import NUISANCES, find_places
from rfca_rig.mechanism.plant import (
    make_plant,
    scale_contact_damping,
    scale_contact_stiffness,
    update_constants,
)
from rfca_rig.mechanism.rollout import CommandTrace, simulate_plant
from rfca_rig.mechanism.usual_motion import UsualMotion
from rfca_rig.model.declarations import MECHANISM
from tests.mechanism import hopper
from tests.mechanism.arm import Arm, mjcf

START_RAD = np.array([0.9, -0.4, 0.7])
START_RAD_S = np.array([0.5, -1.0, 2.0])
T_S = np.linspace(0.005, 0.5, 50)
WAVE_S = np.arange(-0.1, 0.7, 0.002)
TRACE = CommandTrace(WAVE_S, np.column_stack([np.sin(20.0 * WAVE_S)] * 3) * (4.0, 2.0, 1.0))
USUAL = UsualMotion(
    torque=np.array([5.0, 2.0, 0.7]),
    speed=np.array([1.0, 1.0, 1.0]),
    travel=np.array([0.3, 0.3, 0.3]),
    inertia=np.array([0.6, 0.1, 0.01]),
    lowest=np.array([0.0, -1.0, 0.0]),
    highest=np.array([1.2, 0.5, 1.0]),
    command=np.array([4.0, 2.0, 1.0]),
    has_speeds=True,
    sensors={},
)
CART = (
    '<mujoco><worldbody><body name="cart"><joint name="x" type="slide" axis="1 0 '
    '0"/><geom type="box" size="0.1 0.1 0.1" mass="1"/>'
    '<body name="pole"><joint name="pivot" axis="0 1 0"/><geom type="capsule" fromto="0 '
    '0 0 0 0 -0.5" size="0.01" mass="0.2"/></body>'
    '</body></worldbody><actuator><motor name="push" joint="x" gear="2"/></actuator></mujoco>'
)
SPRINGS = (
    '<mujoco><worldbody><body name="upper"><joint name="hip" stiffness="3" axis="0 1 0"/>'
    '<geom type="capsule" fromto="0 0 0 0 0 -0.5" size="0.01" mass="0.2"/>'
    '<body name="lower" pos="0 0 -0.5"><joint name="knee" stiffness="2" axis="0 1 0"/>'
    '<geom type="capsule" fromto="0 0 0 0 0 -0.5" size="0.01" mass="0.2"/></body></body>'
    "</worldbody></mujoco>"
)


@pytest.fixture(scope="module")
def mechanism(tmp_path_factory):
    path = tmp_path_factory.mktemp("arm") / "model.xml"
    path.write_text(mjcf(Arm()), encoding="utf-8")
    return load_mechanism(path)


def moved(plant):
    update_constants(plant)
    motion = simulate_plant(plant, TRACE, START_RAD, START_RAD_S, T_S)
    return np.concatenate([motion.position, motion.speed], axis=1)


def middle(parameter):
    value = 0.5 * (parameter.low + parameter.high) or parameter.high
    if parameter.whole:
        return float(round(value))
    return value


@pytest.fixture(scope="module")
def plain(mechanism):
    return moved(make_plant(mechanism, 1e-3))


def effects_of(mechanism):
    return {effect.id: effect for effect in list_effects(mechanism, USUAL)}


def test_ids_are_unique_and_every_variant_has_its_general_law(mechanism):
    effects = list_effects(mechanism, USUAL)
    found = [effect.id for effect in effects]
    assert len(set(found)) == len(found)
    assert {effect.variant_of for effect in effects} <= {"", *found}
    assert {effect.id for effect in effects if effect.variant_of == "joint_stribeck"} == {
        *("joint_friction", "joint_friction_of_one", "joint_hysteresis")
    }


@pytest.mark.parametrize(
    "effect_id",
    [
        *(
            "joint_friction",
            "joint_damping",
            "joint_drag",
            "joint_inertia",
            "joint_spring",
            "joint_load_friction",
            "torque_scale",
        ),
        *(
            "joint_stribeck",
            "torque_delay",
            "torque_lag",
            "torque_saturation",
            "speed_lag",
            "gravity_tilt",
            "added_mass",
        ),
        *(
            "joint_friction_of_one",
            "joint_damping_of_one",
            "torque_scale_of_one",
            "joint_hysteresis",
            "joint_stop",
            "torque_dead_band",
        ),
    ],
)
def test_every_effect_changes_the_motion_and_leaves_the_mechanism_alone(
    mechanism, plain, effect_id
):
    effect = effects_of(mechanism)[effect_id]
    plant = effect.apply(
        make_plant(mechanism, 1e-3), {p.name: middle(p) for p in effect.parameters}
    )
    assert np.abs(moved(plant) - plain).max() > 1e-3
    assert np.array_equal(moved(make_plant(mechanism, 1e-3)), plain)


@pytest.mark.parametrize(
    "effect_id", ["joint_friction", "joint_damping", "joint_drag", "joint_inertia", "joint_spring"]
)
def test_an_effect_of_one_joint_is_the_general_one_with_nothing_elsewhere(mechanism, effect_id):
    effects = effects_of(mechanism)
    general = effects[effect_id]
    single = effects[f"{effect_id}_of_one"]
    size = middle(general.parameters[1])
    alone = single.apply(
        make_plant(mechanism, 1e-3), {"joint": 2.0, single.parameters[1].name: size}
    )
    values = dict.fromkeys((p.name for p in general.parameters), 0.0) | {
        general.parameters[1].name: size
    }
    assert np.array_equal(moved(alone), moved(general.apply(make_plant(mechanism, 1e-3), values)))


def test_drag_resists_with_the_speed_squared(mechanism):
    import mujoco

    plant = effects_of(mechanism)["joint_drag_of_one"].apply(
        make_plant(mechanism, 1e-3), {"joint": 1.0, "coefficient_Nm_s2_per_rad2": 0.1}
    )
    data = mujoco.MjData(plant.model)
    data.qvel[:] = (-3.0, 0.0, 0.0)
    mujoco.mj_forward(plant.model, data)
    assert data.qfrc_passive[0] == pytest.approx(0.9)


def test_effects_of_what_was_not_recorded_are_not_looked_for(mechanism):
    still = replace(USUAL, command=np.zeros(3), has_speeds=False)
    found = {effect.id for effect in list_effects(mechanism, still)}
    assert not found & {
        "torque_scale",
        "torque_delay",
        "torque_lag",
        "torque_saturation",
        "joint_load_friction",
        "speed_lag",
        "clock_rate",
    }
    assert "joint_friction" in found


def test_a_slide_has_its_own_units(tmp_path):
    (tmp_path / "cart.xml").write_text(CART, encoding="utf-8")
    cart = load_mechanism(tmp_path / "cart.xml")
    usual = UsualMotion(*(np.ones(2) for _ in range(6)), np.ones(1), True, {})
    effects = {effect.id: effect for effect in list_effects(cart, usual)}
    assert [p.name for p in effects["joint_friction"].parameters] == [
        "x_torque_N",
        "pivot_torque_Nm",
    ]
    assert [p.name for p in effects["joint_load_friction"].parameters] == ["loss_relative"]
    assert find_places(cart, "slides") == {"x": 0}
    assert find_places(cart, "hinges") == {"pivot": 1}
    assert find_places(cart, "hinge motors") == {}
    assert find_places(cart, "actuators") == {"push": 0}


OF_HOPPER = ("slide", "contacts", "sensors")
ELSEWHERE = ("springs", "starts", "contact laws")  # in test_prescribed and test_contact_law


def nuisances_of(words):
    """Nuisance parameters of objects that one of these words names."""
    keys = []
    for key, kind in NUISANCES.items():
        if any(word in kind.objects for word in words):
            keys.append(key)
    return keys


@pytest.mark.parametrize(
    "key", [key for key in NUISANCES if key not in nuisances_of((*OF_HOPPER, *ELSEWHERE))]
)
def test_every_nuisance_parameter_changes_the_motion(mechanism, plain, key):
    plant = make_plant(mechanism, 1e-3)
    place = next(iter(find_places(mechanism, NUISANCES[key].objects).values()))
    NUISANCES[key].shift(plant, place, 0.02)
    assert np.abs(moved(plant) - plain).max() > 1e-4


@pytest.fixture(scope="module")
def on_floor(tmp_path_factory):
    path = tmp_path_factory.mktemp("hopper") / "model.xml"
    path.write_text(hopper.mjcf(hopper.Hopper()), encoding="utf-8")
    return load_mechanism(path)


def hopped(plant):
    """What a fall onto the floor and a push read: height, leg, force on the sole."""
    update_constants(plant)
    trace = CommandTrace(np.array([-0.1, 0.0, 0.3]), np.array([[14.0], [14.0], [40.0]]))
    motion = simulate_plant(
        plant, trace, np.array([0.275, 0.25]), np.array([-0.3, 0.0]), np.linspace(0.002, 0.25, 125)
    )
    return np.concatenate([motion.position, motion.sensors], axis=1)


@pytest.fixture(scope="module")
def plainly_hopped(on_floor):
    return hopped(make_plant(on_floor, 1e-3, reads_sensors=True))


@pytest.mark.parametrize("key", nuisances_of(OF_HOPPER))
def test_nuisance_parameters_of_slides_contacts_and_sensors_act_where_they_are(
    on_floor, plainly_hopped, key
):
    places = find_places(on_floor, NUISANCES[key].objects)
    if key in ("sensor_offset_Nm", "contact_friction_relative"):
        assert places == (
            {} if key == "sensor_offset_Nm" else {"": 0}
        )  # no torque sensor; nothing slides on the floor
        return
    plant = make_plant(on_floor, 1e-3, reads_sensors=True)
    NUISANCES[key].shift(plant, list(places.values())[-1], 0.05)
    changed = np.abs(hopped(plant) - plainly_hopped).max(axis=0)
    assert changed[2] > 1e-2
    assert (changed[1] > 1e-5) == (key != "sensor_offset_N")


USUAL_HOP = UsualMotion(*(np.ones(2) for _ in range(6)), np.ones(1), False, {"plate_force": 20.0})


@pytest.mark.parametrize(
    "effect_id",
    [
        "sensor_gain",
        "sensor_lag",
        "clock_offset",
        "sensor_drift",
        "contact_stiffness",
        "contact_damping",
    ],
)
def test_effects_of_sensors_change_readings_alone_and_those_of_contacts_the_motion(
    on_floor, plainly_hopped, effect_id
):
    effect = {one.id: one for one in list_effects(on_floor, USUAL_HOP)}[effect_id]
    plant = effect.apply(
        make_plant(on_floor, 1e-3, reads_sensors=True),
        {p.name: 0.9 * p.high for p in effect.parameters},
    )
    changed = np.abs(hopped(plant) - plainly_hopped).max(axis=0)
    assert changed[2] > 1.0
    assert (changed[1] > 1e-3) == effect_id.startswith("contact")


def test_every_declared_effect_is_one_of_some_mechanism(mechanism, on_floor, tmp_path):
    two_sensors = replace(USUAL_HOP, sensors={"plate_force": 20.0, "other": 1.0})
    sensors = replace(on_floor, sensors=on_floor.sensors | {"other": Sensor(0, 1, "N")})
    sole = SphereOnPlane("sole", "floor", 2e5, 0.4, 0.5, 1e-4, 0.0)
    of_hopper = {
        effect.id for effect in list_effects(replace(sensors, contacts=(sole,)), two_sensors)
    }
    held = {
        effect.id
        for joint in (0, 1)
        for effect in list_effects(replace(on_floor, prescribed=(joint,)), USUAL_HOP)
    }
    turned = {effect.id for effect in list_effects(replace(mechanism, prescribed=(0,)), USUAL)}
    (tmp_path / "springs.xml").write_text(SPRINGS, encoding="utf-8")
    usual = UsualMotion(*(np.ones(2) for _ in range(6)), np.zeros(0), True, {})
    sprung = {effect.id for effect in list_effects(load_mechanism(tmp_path / "springs.xml"), usual)}
    declared = [declaration.id for declaration in MECHANISM]
    assert len(set(declared)) == len(declared)
    assert set(declared) == {*effects_of(mechanism), *of_hopper, *held, *turned, *sprung}


def test_effects_of_sensors_and_contacts_need_them(mechanism, on_floor):
    of_arm = set(effects_of(mechanism))
    assert not of_arm & {
        "sensor_gain",
        "sensor_lag",
        "clock_offset",
        "sensor_drift",
        "contact_stiffness",
        "contact_damping",
        "contact_friction",
    }
    found = {effect.id for effect in list_effects(on_floor, replace(USUAL_HOP, sensors={}))}
    assert "contact_stiffness" in found
    assert not found & {"sensor_gain", "sensor_lag", "clock_offset", "sensor_drift"}


def test_the_amended_contacts_are_as_stiff_and_lose_as_much(on_floor, plainly_hopped, tmp_path):
    plant = make_plant(on_floor, 1e-3, reads_sensors=True)
    for name, factor in (
        ("contact_stiffness", 0.3),
        ("contact_damping", 4.0),
        ("contact_friction", 0.5),
    ):
        plant = {one.id: one for one in list_effects(on_floor, USUAL_HOP)}[name].apply(
            plant, {"factor": factor}
        )
    expected = hopped(plant)
    plant.sensor_gain[0] = 1.1
    assert write_amended_model(plant, tmp_path / "model.xml") == (
        "scales and zeros of the sensors",
    )
    amended = make_plant(load_mechanism(tmp_path / "model.xml"), 1e-3, reads_sensors=True)
    assert np.abs(expected - plainly_hopped)[:, 2].max() > 1.0
    assert np.allclose(hopped(amended), expected, rtol=1e-4, atol=1e-4)
    assert np.allclose(amended.model.geom_friction[:, 0], 0.5)


def test_an_amended_stop_stops_where_the_effect_does(mechanism, plain, tmp_path):
    plant = effects_of(mechanism)["joint_stop"].apply(
        make_plant(mechanism, 1e-3), {"joint": 1.0, "position_relative": -0.7}
    )
    expected = moved(plant)
    assert expected[:, 0].min() > plain[:, 0].min() + 0.02
    write_amended_model(plant, tmp_path / "model.xml")
    assert (
        np.abs(moved(make_plant(load_mechanism(tmp_path / "model.xml"), 1e-3)) - expected).max()
        < 1e-3
    )


def test_a_limit_of_the_model_leaves_no_room_for_another_stop(tmp_path):
    path = tmp_path / "model.xml"
    path.write_text(
        mjcf(Arm()).replace('name="joint1"', 'name="joint1" limited="true" range="-90 90"'),
        encoding="utf-8",
    )
    assert "joint_stop" not in effects_of(load_mechanism(path))


@pytest.mark.parametrize("solref", [(0.02, 0.7), (-3000.0, -40.0)])
def test_stiffness_and_damping_of_a_contact_are_scaled_apart(on_floor, solref):
    """Stiffness and damping as MuJoCo derives them from both kinds of numbers, for an impedance
    of 1.
    """
    plant = make_plant(on_floor, 1e-3)
    plant.model.geom_solref[:] = solref

    def both():
        first, second = plant.model.geom_solref[0]
        if first < 0.0:
            return (-first, -second)
        return (1.0 / (first * second) ** 2, 2.0 / first)

    stiffness, damping = both()
    scale_contact_stiffness(plant, 3.0)
    assert both() == pytest.approx((3.0 * stiffness, damping))
    scale_contact_damping(plant, 5.0)
    assert both() == pytest.approx((3.0 * stiffness, 5.0 * damping))


def test_what_is_never_negative_ends_at_zero(mechanism, plain):
    plant = make_plant(mechanism, 1e-3)
    for key in ("joint_damping_Nm_s_per_rad", "joint_friction_Nm", "rotor_inertia_kg_m2"):
        NUISANCES[key].shift(plant, 1, -0.5)
    assert np.array_equal(moved(plant), plain)


def test_the_amended_model_moves_as_the_plant_does(mechanism, plain, tmp_path):
    effects = effects_of(mechanism)
    plant = make_plant(mechanism, 1e-3)
    for name in (
        "joint_friction",
        "joint_damping",
        "joint_drag",
        "joint_inertia",
        "torque_scale",
        "gravity_tilt",
        "added_mass",
    ):
        effect = effects[name]
        plant = effect.apply(
            plant,
            {
                p.name: p.low + 0.05 * (p.high - p.low) if not p.whole else 2.0
                for p in effect.parameters
            },
        )
    NUISANCES["centre_of_mass_m"].shift(plant, 0, 0.01)
    expected = moved(plant)
    assert write_amended_model(plant, tmp_path / "model.xml") == ()
    amended = moved(make_plant(load_mechanism(tmp_path / "model.xml"), 1e-3))
    assert np.abs(expected - plain).max() > 0.1
    assert np.abs(amended - expected).max() < 1e-3


def test_what_mjcf_does_not_hold_is_named(mechanism, tmp_path):
    effects = effects_of(mechanism)
    plant = effects["torque_delay"].apply(make_plant(mechanism, 1e-3), {"delay_s": 0.01})
    plant = effects["joint_load_friction"].apply(
        plant, {p.name: 0.1 for p in effects["joint_load_friction"].parameters}
    )
    beyond = write_amended_model(plant, tmp_path / "model.xml")
    assert beyond == ("friction that grows with load", "delay, lag or clock of the commands")


def test_the_amended_model_finds_its_meshes_from_another_folder(tmp_path):
    (tmp_path / "rig" / "shapes").mkdir(parents=True)
    corners = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\n"
    (tmp_path / "rig" / "shapes" / "a.obj").write_text(
        corners + "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n", encoding="utf-8"
    )
    (tmp_path / "rig" / "model.xml").write_text(
        '<mujoco><compiler meshdir="shapes"/><asset><mesh name="a" '
        'file="a.obj"/></asset><worldbody><body><joint name="j"/>'
        '<geom type="mesh" mesh="a" density="1000"/></body></worldbody></mujoco>',
        encoding="utf-8",
    )
    plain = load_mechanism(tmp_path / "rig" / "model.xml")
    (tmp_path / "out").mkdir()
    write_amended_model(make_plant(plain, 1e-3), tmp_path / "out" / "model.xml")
    amended = load_mechanism(tmp_path / "out" / "model.xml", beside=(tmp_path / "rig",))
    assert amended.model.body_mass == pytest.approx(plain.model.body_mass, rel=1e-4)


def test_a_search_for_wrong_torque_scales_begins_near_one_for_each_number_of_motors(mechanism):
    """An arm with half of its torques, a step of the usual grid, falls: that motion is no guide
    to one with 7 % more.
    """
    for effect_id, points in (("torque_scale", 2**3), ("torque_scale_of_one", 3 * 4)):
        starts = []
        for term in terms_of(effects_of(mechanism)[effect_id]):
            for z in grid_of(term):
                values = dict(term.present(z).values)
                starts.append([value for name, value in values.items() if name.endswith("factor")])
        factors = np.array(starts)
        assert len(factors) == points
        assert (np.abs(factors - 1.0) < 0.11).all(axis=1).any()
