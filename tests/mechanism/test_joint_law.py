"""The torque in a joint as measured: on an arm with LuGre's friction from another engine, and in
the compiled loop.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.cli.main import app
from rfca_rig.diagnosis.inference.model_selection import search_models
from rfca_rig.diagnosis.inference.parameterization import EffectTerm, Parameterization
from rfca_rig.diagnosis.mechanisms.joint_law import _leave_out, measure_joint_law, parse_place
from rfca_rig.diagnosis.mechanisms.prepared import prepare_mechanism
from rfca_rig.diagnosis.simulator import make_dataset
from rfca_rig.errors import BadInput
from rfca_rig.executors.cores import single_threaded_blas
from rfca_rig.mechanism.laws import compute_own_law
from rfca_rig.mechanism.load import load_mechanism
from rfca_rig.mechanism.plant import JointLaw, make_plant
from rfca_rig.mechanism.rollout import simulate_plant
from tests.mechanism.arm import Arm, Friction
from tests.mechanism.test_diagnose import campaign
from tests.mechanism.test_rollout import ARM, START_RAD, START_RAD_S, T_S, loaded, mjcf, told

NONE = np.zeros(9)
KNOTS = np.linspace(-10.0, 10.0, 9)


def problem_of(folder, arm, seconds=6.0):
    experiment = read_experiment(campaign(folder, arm, seconds))
    return prepare_mechanism(experiment, load_mechanism(experiment.model))


def measured(problem, place):
    """The law beside the nominal model with its nuisance parameters."""
    with single_threaded_blas():
        found = search_models(
            make_dataset(problem.conditions, problem.simulator),
            Parameterization(problem.space),
            [],
            lambda *_: None,
        )
        return measure_joint_law(
            problem, found, found.nothing, parse_place(place, problem.simulator.mechanism)
        )


@pytest.mark.long
def test_lugre_friction_that_rises_at_rest_is_measured_within_its_band(tmp_path):
    """The truth is the steady curve of the bristles; their bend of 2 mrad makes two branches at
    low speeds, which the band holds.
    """
    friction = Friction((0.0, 0.4, 0.0), rise=0.8)
    found = measured(
        problem_of(tmp_path / "arm", replace(Arm(), friction=friction)), "joint2.speed"
    )
    law = found.stated.law
    assert (law.place, law.argument, law.unit, law.argument_unit) == (
        "joint2",
        "speed_rad_s",
        "N m",
        "rad/s",
    )
    assert (law.visited[0], law.visited[1]) == pytest.approx(
        (-2.75, 2.48), abs=0.3
    )  # as recorded, not as the nominal model runs away
    moving = law.knots != 0.0
    u = law.knots[moving]
    truth = 0.4 * (1.0 + 0.8 * np.exp(-((u / 0.3) ** 2))) * np.sign(u)
    off = np.abs(law.values[moving] - truth) / law.std[moving]
    assert np.mean(off < 2.0) > 0.8
    assert off.max() < 3.0
    assert law.std[moving][np.abs(u) > 0.5].max() < 0.05
    assert law.explained > 0.9
    assert law.memory is not None
    assert law.memory.has_memory
    (table,) = found.plant.laws
    assert (table.joint, table.by_speed) == (1, True)
    assert found.stated.instead_of == ()


@pytest.mark.long
def test_a_spring_is_measured_over_the_position(tmp_path):
    """The model has a spring that the arm has not: what is missing is minus its torque."""
    folder = campaign(tmp_path / "arm", Arm())
    model = folder / "model.xml"
    text = model.read_text(encoding="utf-8")
    model.write_text(text.replace('name="joint2"', 'name="joint2" stiffness="2"'), encoding="utf-8")
    experiment = read_experiment(folder)
    law = measured(prepare_mechanism(experiment, load_mechanism(model)), "joint2").stated.law
    assert (law.argument, law.argument_unit) == ("position_rad", "rad")
    assert np.abs(law.values + 2.0 * law.knots).max() < 0.2
    assert law.whole is not None
    assert np.mean(np.abs(law.whole) < 2.0 * law.whole_std) > 0.8
    assert law.explained > 0.8


@pytest.mark.long
def test_the_law_stands_in_the_answer_and_takes_the_place_of_a_stated_effect(tmp_path):
    folder = campaign(tmp_path / "arm", replace(Arm(), friction=Friction((0.0, 0.4, 0.0))))
    out = tmp_path / "out"
    ran = CliRunner().invoke(
        app,
        [
            "diagnose",
            str(folder),
            "--out",
            str(out),
            "--law",
            "joint2.speed",
            "--without",
            "added_mass",
        ],
    )
    assert ran.exit_code == 0, ran.output
    assert (
        "law at joint2 over speed_rad_s, measured beside the model without effects, in"
        in ran.output
    )
    assert "not looked for, as asked: added_mass" in ran.output
    answer = json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))
    law = answer["measured_law"]
    assert (law["instead_of"], law["beside"]) == (["joint_friction_of_one"], [])
    assert law["catalogue"]["values"][-1] == pytest.approx(0.4, abs=0.05)
    assert "not looked for, as asked: added_mass" in answer["remarks"]
    page = (out / "diagnosis.html").read_text(encoding="utf-8")
    assert "The law at joint2 as measured" in page
    assert "not looked for, as asked: added_mass" in page
    table = np.genfromtxt(out / "measured-law.csv", delimiter=",", names=True)
    assert table["residual_Nm"] == pytest.approx(law["values"], rel=1e-6)
    assert load_mechanism(out / "measured-law.xml").model.dof_frictionloss[1] == 0.0
    assert load_mechanism(out / "model.xml").model.dof_frictionloss[1] == pytest.approx(
        0.4, abs=0.05
    )
    scope: dict[str, object] = {}
    exec((out / "measured_law.py").read_text(encoding="utf-8"), scope)
    assert scope["measured_law"](law["knots"][3]) == pytest.approx(law["values"][3], rel=1e-5)


@pytest.mark.slow
def test_the_law_s_files_go_with_a_diagnosis_without_one(tmp_path):
    folder = campaign(tmp_path / "arm", Arm(), seconds=1.4, seeds=(0,))
    out = tmp_path / "out"
    for options, there in ((("--law", "joint1.speed"), True), ((), False)):
        ran = CliRunner().invoke(app, ["diagnose", str(folder), "--out", str(out), *options])
        assert ran.exit_code == 0, ran.output
        assert [
            (out / name).exists()
            for name in ("measured-law.csv", "measured-law.xml", "measured_law.py")
        ] == [there] * 3


def test_a_place_is_a_joint_or_one_of_its_quantities(tmp_path):
    text = mjcf(ARM).replace('"joint2"', '"elbow.speed"')
    mechanism = loaded(tmp_path, text)
    assert parse_place("joint1", mechanism).quantities == ("speed", "position")
    assert (
        parse_place("joint3.position", mechanism).joint,
        parse_place("joint3.position", mechanism).quantities,
    ) == (2, ("position",))
    assert parse_place("elbow.speed", mechanism).quantities == ("speed", "position")
    assert parse_place("elbow.speed.speed", mechanism).quantities == ("speed",)
    with pytest.raises(
        BadInput, match=r"--law joint4\.speed: no law can be measured there"
    ) as refused:
        parse_place("joint4.speed", mechanism)
    assert "\n" not in str(refused.value)


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    return problem_of(tmp_path_factory.mktemp("short") / "arm", Arm(), seconds=1.4)


@pytest.mark.slow
def test_an_effect_of_all_joints_stays_in_the_others(short):
    mechanism = short.simulator.mechanism
    place = parse_place("joint2.speed", short.simulator.mechanism)
    for name in ("joint_friction", "joint_stribeck", "joint_hysteresis"):
        term = EffectTerm(short.simulator.effects[name])
        left = _leave_out(term, mechanism, place)
        values = {parameter.name: 0.3 for parameter in left.effect.parameters}
        assert "joint2_torque_Nm" not in values
        plant = left.effect.apply(make_plant(mechanism, 1e-3), values)
        assert (plant.friction + plant.stribeck[0] + plant.hysteresis[0]).tolist() == [
            0.3,
            0.0,
            0.3,
        ]
    one = short.simulator.effects["joint_damping_of_one"]
    assert _leave_out(EffectTerm(one, (("joint", 2.0),)), mechanism, place) is None
    other = EffectTerm(one, (("joint", 1.0),))
    assert _leave_out(other, mechanism, place) is other
    spring = EffectTerm(short.simulator.effects["joint_spring"])
    assert _leave_out(spring, mechanism, place) is spring
    assert _leave_out(spring, mechanism, parse_place("joint2", mechanism)) is not spring


def moved(plant):
    return simulate_plant(plant, told([2.0, -1.0, 0.3]), START_RAD, START_RAD_S, T_S).position


@pytest.mark.parametrize(("by_speed", "field"), [(True, "dof_damping"), (False, "jnt_stiffness")])
def test_a_straight_table_is_a_damper_or_a_spring(tmp_path, by_speed, field):
    plant = make_plant(loaded(tmp_path, mjcf(ARM)), 2e-3)
    without = moved(plant)
    plant.laws = (JointLaw(1, by_speed, KNOTS, 0.5 * KNOTS, NONE),)
    with_table = moved(plant)
    plant.laws = ()
    getattr(plant.model, field).reshape(3, -1)[1, 0] = 0.5
    assert np.abs(with_table - moved(plant)).max() < 0.01 * np.abs(with_table - without).max()


def test_a_steep_table_is_dry_friction_whatever_the_step(tmp_path):
    """Explicit torques of 40 N m s/rad on 0.01 kg m2 would need steps below 0.5 ms."""
    plant = make_plant(loaded(tmp_path, mjcf(ARM)), 4e-3)
    without = moved(plant)
    knots = np.array([-5.0, -0.01, 0.0, 0.01, 5.0])
    values = np.array([-0.4, -0.4, 0.0, 0.4, 0.4])
    plant.laws = (JointLaw(2, True, knots, values, np.zeros(5)),)
    with_table = moved(plant)
    plant.laws = ()
    plant.friction[2] = 0.4
    assert np.abs(with_table - moved(plant)).max() < 0.02 * np.abs(with_table - without).max()


def test_a_table_takes_friction_of_the_model_away_and_drives_beyond_that(tmp_path):
    plant = make_plant(loaded(tmp_path, mjcf(ARM)), 1e-3)
    without = moved(plant)
    plant.friction[1] = 0.2
    knots = np.array([-9.0, -1e-3, 0.0, 1e-3, 9.0])
    less = np.array([0.2, 0.2, 0.0, -0.2, -0.2])
    plant.laws = (JointLaw(1, True, knots, less, np.zeros(5)),)
    assert np.abs(moved(plant) - without).max() < 1e-3
    plant.laws = (JointLaw(1, True, KNOTS, -0.1 * KNOTS, NONE),)
    driven = moved(plant)
    plant.laws = ()
    plant.model.dof_damping[1] = -0.1
    assert np.abs(driven - moved(plant)).max() < 0.05 * np.abs(driven - without).max()


def test_branches_act_while_the_argument_rises_and_against_it_while_it_falls(tmp_path):
    """A branch over the position is dry friction: it goes with the sign of the speed."""
    plant = make_plant(loaded(tmp_path, mjcf(ARM)), 1e-3)
    without = moved(plant)
    plant.laws = (JointLaw(1, False, KNOTS, NONE, NONE + 0.1, turning=0.01),)
    with_branch = moved(plant)
    plant.laws = ()
    plant.friction[1] = 0.1
    assert (
        np.abs(with_branch - moved(plant)).max() < 0.12 * np.abs(with_branch - without).max()
    )  # it does not stick


def test_what_a_plant_has_already_is_its_damper_friction_and_spring(tmp_path):
    text = mjcf(ARM).replace(
        'name="joint2"',
        'name="joint2" damping="0.3" stiffness="4" springref="0.1" frictionloss="0.2"',
    )
    plant = make_plant(
        loaded(tmp_path, text.replace("<option", '<compiler angle="radian"/><option')), 1e-3
    )
    plant.stribeck[0, 1] = 0.1
    plant.stribeck[1, 1] = 1.0
    plant.stribeck[2, 1] = 0.5
    u = np.array([-1.0, 0.0, 2.0])
    dry = 0.2 + 0.1 * (1.0 + np.exp(-np.abs(u) / 0.5))
    assert compute_own_law(plant, 1, True, u) == pytest.approx(0.3 * u + dry * np.sign(u))
    assert compute_own_law(plant, 1, False, u) == pytest.approx(4.0 * (u - 0.1))
    assert compute_own_law(plant, 0, True, u) is None
    assert compute_own_law(plant, 0, False, u) is None
