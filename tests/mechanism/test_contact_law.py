"""Contacts with a stiffness of their own, against equations of their own."""

from dataclasses import replace

import numba
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rfca_rig.errors import BadInput
from rfca_rig.mechanism.contact_law import (
    ContactArrays,
    SphereOnPlane,
    apply_contact_forces,
    check_contacts,
)
from rfca_rig.mechanism.load import load_mechanism
from rfca_rig.mechanism.nuisances import NUISANCES
from rfca_rig.mechanism.plant import (
    add_contact_power,
    make_plant,
    scale_contact_damping,
    scale_contact_friction,
    scale_contact_stiffness,
)
from rfca_rig.mechanism.rollout import CommandTrace, simulate_plant

KG = 0.4
RADIUS_M = 0.03
LAW = SphereOnPlane("ball", "floor", 4e4, 0.5, 0.3, 2e-4, 1.5)
T_S = np.linspace(0.002, 1.0, 500)
NEVER = 'contype="0" conaffinity="0"'


def ball(tmp_path, tilt="", integrator="implicitfast"):
    """A ball that slides up and along over a floor, which a force sensor bears."""
    floor = (
        f'<body><site name="below"/><geom name="floor" type="plane" size="2 2 1" {NEVER} '
        f"{tilt}/></body>"
    )
    path = tmp_path / "model.xml"
    path.write_text(
        '<mujoco><option gravity="0 0 -9.81" '
        f'integrator="{integrator}"/><worldbody>{floor}<body name="ball">'
        '<joint name="along" type="slide" axis="1 0 0"/><joint name="up" type="slide" '
        'axis="0 0 1"/>'
        f'<geom name="ball" size="{RADIUS_M}" mass="{KG}" {NEVER}/></body></worldbody>'
        '<contact><pair geom1="floor" geom2="ball"/></contact>'
        '<actuator><motor name="push" joint="along"/></actuator><sensor><force '
        'name="plate" site="below"/></sensor></mujoco>',
        encoding="utf-8",
    )
    return replace(load_mechanism(path), contacts=(LAW,))


def pushed(by_N):
    return CommandTrace(np.array([-0.1, 1.1]), np.full((2, 1), by_N))


@pytest.mark.parametrize(
    ("integrator", "step_s", "error_m"), [("implicitfast", 5e-5, 1e-3), ("RK4", 1e-3, 2e-5)]
)
def test_a_ball_bounces_as_hunt_and_crossley_say(tmp_path, integrator, step_s, error_m):
    plant = make_plant(ball(tmp_path, integrator=integrator), step_s, reads_sensors=True)
    found = simulate_plant(plant, pushed(0.0), np.array([0.0, 0.12]), np.zeros(2), T_S)

    def rate(_, x):
        depth = max(RADIUS_M - x[0], 0.0)
        return [
            x[1],
            LAW.stiffness_N_per_m1p5 * depth**1.5 * max(1.0 - LAW.damping_s_per_m * x[1], 0.0) / KG
            - 9.81,
        ]

    own = solve_ivp(
        rate, (0.0, 1.0), [0.12, 0.0], t_eval=T_S, rtol=1e-9, atol=1e-11, max_step=2e-4
    ).y
    own, speed = own
    assert own.min() < RADIUS_M - 0.004
    assert np.abs(found.position[:, 1] - own).max() < error_m
    depth = np.maximum(RADIUS_M - own, 0.0)
    pressed_N = (
        LAW.stiffness_N_per_m1p5 * depth**1.5 * np.maximum(1.0 - LAW.damping_s_per_m * speed, 0.0)
    )
    assert found.sensors[:, 2] == pytest.approx(pressed_N, abs=1e2 * error_m * pressed_N.max())
    assert found.touch_s[0] == pytest.approx(np.sqrt(2.0 * 0.09 / 9.81), abs=1e-3)


def test_friction_sticks_until_its_limit_and_then_slides(tmp_path):
    plant = make_plant(ball(tmp_path), 1e-4)
    weight_N = 9.81 * KG
    on_floor = np.array([0.0, RADIUS_M - (weight_N / LAW.stiffness_N_per_m1p5) ** (2 / 3)])
    held = simulate_plant(plant, pushed(0.5 * LAW.friction * weight_N), on_floor, np.zeros(2), T_S)
    # pushed with half of what holds it, it yields by half of the presliding
    assert np.mean(held.position[250:, 0]) == pytest.approx(0.5 * LAW.presliding_m, rel=0.02)
    slides = simulate_plant(
        plant, pushed(2.0 * LAW.friction * weight_N), on_floor, np.zeros(2), T_S
    )
    net_N = LAW.friction * weight_N
    speed = (
        net_N / LAW.drag_N_s_per_m * (1.0 - np.exp(-LAW.drag_N_s_per_m / KG * T_S))
    )  # drag brakes what friction leaves
    assert (
        np.abs(slides.speed[:, 0] - speed).max() < 0.03 * speed.max()
    )  # it gains 2 % while it still sticks


def test_a_ball_rolls_down_a_tilted_plane_that_is_slippery(tmp_path):
    """The normal force acts along the plane's normal: a ball on a plane of 0.2 rad slides down
    it with g sin cos.
    """
    angle = 0.2
    tilted = replace(
        ball(tmp_path, f'euler="0 {np.degrees(angle)} 0"'),
        contacts=(replace(LAW, friction=0.0, drag_N_s_per_m=0.0),),
    )
    depth_m = (9.81 * KG * np.cos(angle) / LAW.stiffness_N_per_m1p5) ** (2 / 3)
    start = np.array([0.0, (RADIUS_M - depth_m) / np.cos(angle)])
    found = simulate_plant(make_plant(tilted, 1e-4), pushed(0.0), start, np.zeros(2), T_S)
    assert found.speed[:, 0] == pytest.approx(
        9.81 * np.sin(angle) * np.cos(angle) * T_S, rel=1e-3, abs=1e-4
    )


def test_the_law_takes_the_place_of_mujoco_s_contact(tmp_path):
    """Without stiffness the ball falls through the floor on which MuJoCo's own pair would stop
    it.
    """
    mechanism = ball(tmp_path)
    soft = replace(mechanism, contacts=(replace(LAW, stiffness_N_per_m1p5=1e-6),))
    t_s = T_S[:150]
    found = simulate_plant(
        make_plant(soft, 1e-3), pushed(0.0), np.array([0.0, 0.12]), np.zeros(2), t_s
    )
    assert found.position[-1, 1] == pytest.approx(0.12 - 0.5 * 9.81 * t_s[-1] ** 2, abs=2e-3)
    stopped = simulate_plant(
        make_plant(replace(mechanism, contacts=()), 1e-3),
        pushed(0.0),
        np.array([0.0, 0.12]),
        np.zeros(2),
        t_s,
    )
    assert stopped.position[-1, 1] > 0.02


def test_nuisance_parameters_and_effects_scale_the_law(tmp_path):
    plant = make_plant(ball(tmp_path), 1e-3)
    scale_contact_stiffness(plant, 2.0)
    scale_contact_damping(plant, 3.0)
    scale_contact_friction(plant, 0.5)
    NUISANCES["contact_presliding_relative"].shift(plant, 0, 1.0)
    NUISANCES["contact_drag_relative"].shift(plant, 0, -0.5)
    assert plant.contact_law[0, :5] == pytest.approx((8e4, 1.5, 0.15, 4e-4, 0.75))
    assert make_plant(plant.mechanism, 1e-3).contact_law[0] == pytest.approx(
        LAW.list_numbers(9.81 * KG)
    )


def test_at_rest_a_ball_lies_as_deep_as_its_weight_presses_it(tmp_path):
    found = simulate_plant(make_plant(ball(tmp_path), 1e-4), pushed(0.0), None, None, T_S)
    expected = RADIUS_M - (9.81 * KG / LAW.stiffness_N_per_m1p5) ** (2 / 3)
    assert found.position[:, 1] == pytest.approx(expected, abs=1e-7)
    assert found.touch_s[0] == 0.0


def test_with_another_power_a_ball_lies_otherwise_only_where_more_than_its_weight_presses_it(
    tmp_path,
):
    """With p = -0.5 the law is N = k d_0^0.5 d: under twice its weight, the ball lies twice as
    deep as under its own.
    """
    depth_m = (9.81 * KG / LAW.stiffness_N_per_m1p5) ** (2 / 3)
    for gravity, expected in ((9.81, depth_m), (19.62, 2.0 * depth_m)):
        plant = make_plant(ball(tmp_path), 1e-4)
        add_contact_power(plant, -0.5)
        plant.model.opt.gravity[2] = -gravity
        found = simulate_plant(plant, pushed(0.0), None, None, T_S)
        assert RADIUS_M - found.position[:, 1] == pytest.approx(expected, rel=1e-4)


@numba.njit
def give_back(contact, along, depth, h):
    """The most energy that friction has given at any time along a path (k,) of the ball, and
    what passed [J].
    """
    F = total = most = passed = 0.0
    for k in range(1, along.size):
        moved = along[k] - along[k - 1]
        contact.geom_xpos[1, 0] = along[k]
        contact.geom_xpos[1, 2] = contact.radius[0] - depth[k]
        contact.cvel[1, 3] = moved / h
        apply_contact_forces(contact, h)
        after = contact.xfrc_applied[1, 0]
        work = 0.5 * (F + after) * moved
        F = after
        total = total + work
        passed = passed + abs(work)
        most = max(most, total)
    return most, passed


def one_contact():
    """A ball over a level floor: geoms and bodies 0 and 1 are the floor and the ball."""
    law = replace(LAW, damping_s_per_m=0.0, drag_N_s_per_m=0.0)
    at = np.ones(1, dtype=np.intp)
    levelled = np.tile(np.eye(3).ravel(), (2, 1))
    vectors = [np.zeros((2, 3)) for _ in range(3)]
    return ContactArrays(
        np.array([law.list_numbers(9.81 * KG)]),
        np.array([RADIUS_M]),
        at,
        0 * at,
        at,
        0 * at,
        np.zeros(2, dtype=np.intp),
        np.zeros((1, 3)),
        np.zeros(1),
        np.zeros(1),
        np.array([np.inf]),
        np.zeros((3, 3)),
        vectors[0],
        levelled,
        vectors[1],
        vectors[2],
        np.zeros((2, 6)),
        np.zeros((2, 6)),
    )


@pytest.mark.slow
def test_friction_gives_back_no_energy_on_random_closed_paths():
    """The load changes while the ball sticks, and it lifts off in some: sums of sines, gone
    through three times.
    """
    random = np.random.default_rng(1)
    t = np.linspace(0.0, 3.0, 1801)
    for _ in range(300):
        waves = np.sin(
            2.0 * np.pi * np.arange(1, 5)[:, None] * t + random.uniform(0.0, 2.0 * np.pi, (2, 4, 1))
        )
        along, load = (random.normal(size=(2, 4, 1)) / np.arange(1, 5)[:, None] * waves).sum(axis=1)
        along *= LAW.presliding_m * random.uniform(0.1, 3.0)
        load_N = np.maximum(0.0, 20.0 * (random.uniform(0.0, 2.0) + load))
        most, passed = give_back(
            one_contact(), along, (load_N / LAW.stiffness_N_per_m1p5) ** (2.0 / 3.0), 1e-4
        )
        assert passed > 0.0
        assert most < 1e-9 * passed


@pytest.mark.parametrize(
    ("contacts", "said"),
    [
        (
            (replace(LAW, sphere="floor"),),
            "contacts: 'floor' is no sphere of the model; it has ball",
        ),
        (
            (replace(LAW, plane="ground"),),
            "contacts: 'ground' is no plane of the model; it has floor",
        ),
        ((LAW, LAW), "contacts: 'ball' on 'floor' comes twice"),
    ],
)
def test_a_contact_that_is_not_in_the_model_is_refused_in_one_line(tmp_path, contacts, said):
    with pytest.raises(BadInput) as refused:
        check_contacts(ball(tmp_path).model, contacts, "experiment.toml")
    assert str(refused.value) == f"experiment.toml: {said}"
