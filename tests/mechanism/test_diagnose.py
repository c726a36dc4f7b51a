"""The diagnosis of mechanisms: an arm that another engine simulated, and a real pendulum, with
their physics left out of the model file.
"""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.cli.main import app
from rfca_rig.diagnosis.diagnose import diagnose
from rfca_rig.diagnosis.mechanisms.nuisances import MechanismInput
from rfca_rig.diagnosis.mechanisms.prepared import prepare_mechanism
from rfca_rig.diagnosis.mechanisms.problem import MechanismProblem
from rfca_rig.errors import BadInput
from rfca_rig.mechanism.load import load_mechanism
from rfca_rig.progress import ignore_share
from tests.mechanism import hopper
from tests.mechanism.arm import Arm, Friction, Gear, record, write_campaign
from tests.public_recordings import write_public_set

NOMINAL = Arm()
KNOWN_TO = {"mass_relative": 0.02, "centre_of_mass_m": 0.003, "zero_offset_rad": 0.002}


def campaign(folder, arm, seconds=6.0, seeds=(0, 1), nominal=NOMINAL):
    return write_campaign(folder, nominal, [record(arm, seconds, seed) for seed in seeds], KNOWN_TO)


def diagnosed(folder):
    shares = []
    problem = MechanismProblem(read_experiment(folder))
    found = diagnose(problem, lambda _, share: shares.append(share)).diagnosis
    assert shares == sorted(shares)
    return found


def sizes(effect):
    return {name: value.value for name, value in effect.parameters.items()}


@pytest.mark.slow
def test_commands_that_were_held_act_half_a_sample_late_unless_the_file_says_so(tmp_path):
    """The arm's controller holds its torques. Taken as lines from row to row, they look 1 ms
    late: the first effect to be named.
    """
    folder = campaign(tmp_path / "arm", replace(NOMINAL, angle_error_rad=0.0), seeds=(0,))

    def misfit():
        experiment = read_experiment(folder)
        problem = prepare_mechanism(experiment, load_mechanism(experiment.model))
        plant = problem.simulator.plant(MechanismInput())
        windows = [each.window for condition in problem.conditions for each in condition.windows]
        return np.sqrt(
            np.mean(
                [
                    (problem.simulator.follow(plant, one)[0] - one.measured[0]) ** 2
                    for one in windows
                ]
            )
        )

    told = misfit()
    path = folder / "experiment.toml"
    path.write_text(path.read_text(encoding="utf-8").replace(", held = true", ""), encoding="utf-8")
    untold = misfit()
    assert told < 0.3 * untold


@pytest.mark.long
def test_nothing_is_said_to_be_missing_of_an_arm_that_is_as_its_model(tmp_path):
    found = diagnosed(campaign(tmp_path / "arm", NOMINAL))
    assert found.grade == "nothing missing"
    assert not found.effects
    assert {one.id for one in found.not_seen} >= {
        "joint_friction",
        "joint_damping",
        "joint_inertia",
        "torque_scale",
    }


@pytest.mark.long
def test_nothing_is_said_to_be_missing_of_a_hopper_whose_contact_has_another_law(tmp_path):
    """Hunt and Crossley's sole against MuJoCo's contact, with a force plate."""
    known_to = {
        "mass_relative": 0.01,
        "zero_offset_m": 0.0002,
        "contact_stiffness_relative": 0.1,
        "contact_damping_relative": 0.5,
    }
    recordings = [hopper.record(hopper.Hopper(), 5.2, seed) for seed in (0, 1)]
    hopper.write_campaign(
        tmp_path / "hopper", hopper.Hopper(), recordings, known_to | {"command_delay_s": 0.001}
    )
    found = diagnosed(tmp_path / "hopper")
    assert found.grade == "nothing missing"
    assert {one.id for one in found.not_seen} >= {
        "contact_stiffness",
        "sensor_gain",
        "sensor_lag",
        "added_mass",
    }
    assert any("plate_force" in name for name in found.fit)


@pytest.mark.long
def test_friction_of_bristles_in_one_joint_is_identified_with_joint_and_size(tmp_path):
    found = diagnosed(
        campaign(tmp_path / "arm", replace(NOMINAL, friction=Friction((0.0, 0.4, 0.0))))
    )
    (effect,) = found.effects
    assert found.grade in ("identified", "mostly")
    assert effect.id == "joint_friction_of_one"
    assert sizes(effect) == pytest.approx({"joint": 2.0, "torque_Nm": 0.4}, rel=0.1)
    assert all(figure.after < 0.2 * figure.before for figure in found.held_out.values())


@pytest.mark.long
def test_rotors_are_identified_and_stand_in_the_amended_model(tmp_path):
    rotor_kg_m2 = (0.05, 0.02, 0.004)
    folder = campaign(tmp_path / "arm", replace(NOMINAL, rotor_kg_m2=rotor_kg_m2))
    ran = CliRunner().invoke(app, ["diagnose", str(folder), "--out", str(tmp_path / "out")])
    assert ran.exit_code == 0, ran.output
    answer = json.loads((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))
    assert [effect["id"] for effect in answer["effects"]] == ["joint_inertia"]
    amended = load_mechanism(tmp_path / "out" / "model.xml")
    assert amended.model.dof_armature == pytest.approx(rotor_kg_m2, rel=0.1)
    assert "joint1" in (tmp_path / "out" / "diagnosis.html").read_text(encoding="utf-8")


@pytest.mark.long
@pytest.mark.parametrize(
    ("gear", "effect_id"),
    [
        (Gear((2e4, 8e3, 2e3), (0.04, 0.04, 0.04), (5.0, 2.0, 0.5)), "gear_backlash"),
        (Gear((300.0, 120.0, 40.0), damping_Nm_s_per_rad=(2.0, 0.8, 0.2)), "gear_compliance"),
    ],
)
def test_rotors_that_are_bodies_of_their_own_are_said_to_have_gears_that_yield(
    tmp_path, gear, effect_id
):
    """Play, and springs, between rotors that the model file knows and their joints."""
    nominal = replace(NOMINAL, rotor_kg_m2=(0.06, 0.02, 0.004))
    found = diagnosed(campaign(tmp_path / "arm", replace(nominal, gear=gear), nominal=nominal))
    assert found.grade in ("identified", "mostly", "family")
    assert {effect.id for effect in found.effects} <= {effect_id, f"{effect_id}_of_one"}
    assert found.effects or found.family.id == "gear_yields"


@pytest.mark.slow
def test_a_real_pendulum_is_said_to_dissipate_through_this_simulator_too(tmp_path):
    write_public_set("simple", tmp_path)
    found = diagnosed(tmp_path)
    assert found.grade in ("identified", "mostly", "family")
    ids = {effect.id for effect in found.effects}
    assert ids <= {"joint_friction", "joint_stribeck"}
    assert ids or found.family.id == "joint_dissipation"
    # Over windows of two seconds the errors of an approximate friction add up: 0.56 and 0.50 of the
    # mean squares go, over half a second 0.85 and 0.74.
    removed = [1.0 - (figure.after / figure.before) ** 2 for figure in found.held_out.values()]
    assert min(removed) > 0.4


@pytest.mark.long
def test_recordings_are_diagnosed_where_all_nominal_values_count_as_exact(tmp_path):
    write_public_set("simple", tmp_path)
    text = (tmp_path / "experiment.toml").read_text(encoding="utf-8")
    before, _, after = text.partition("[known_to]")
    (tmp_path / "experiment.toml").write_text(
        before + after[after.index("[[recordings]]") :], encoding="utf-8"
    )
    found = diagnosed(tmp_path)
    assert not found.believed_values
    assert "joint_friction" in {effect.id for effect in found.effects}


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    return campaign(tmp_path_factory.mktemp("short") / "arm", NOMINAL, seconds=1.4, seeds=(0,))


def test_two_windows_are_not_enough_data(short):
    assert diagnosed(short).grade == "not enough data"


@pytest.mark.slow
def test_of_more_windows_than_asked_for_a_few_of_every_recording_are_used(tmp_path):
    folder = campaign(tmp_path / "arm", NOMINAL, seconds=4.0)
    experiment = read_experiment(folder)
    mechanism = load_mechanism(experiment.model)
    problem = prepare_mechanism(replace(experiment, most_windows=6), mechanism)
    assert (problem.windows, problem.recorded_windows) == (6, 14)
    starts = [
        [each.window.start_s for each in condition.windows] for condition in problem.conditions
    ]
    assert [len(of_run) for of_run in starts] == [3, 3]
    assert [of_run[0] for of_run in starts] == pytest.approx([starts[0][0]] * 2)
    assert starts[0][-1] - starts[0][0] == pytest.approx(3.0)
    assert prepare_mechanism(experiment, mechanism).windows == 14


def test_windows_lie_beside_what_the_model_says_of_them(short):
    experiment = read_experiment(short)
    problem = prepare_mechanism(experiment, load_mechanism(experiment.model))
    (condition,) = problem.conditions
    rows = condition.rows()
    predicted = problem.simulator.simulate(MechanismInput(), condition)
    usual = np.hypot(rows.noise, 0.01 * rows.scale)
    assert np.sqrt(np.mean(((rows.measured - predicted) / usual) ** 2)) < 1.0
    assert condition.signals[:2] == ("joint1_position_rad", "joint2_position_rad")
    assert problem.usual.is_driven


def test_the_step_is_as_long_as_the_motion_allows(short, tmp_path):
    """A joint on a spring of 30 Hz and more needs shorter steps than one that swings freely."""
    folder = shutil.copytree(short, tmp_path / "arm")
    model = (folder / "model.xml").read_text(encoding="utf-8")
    experiment = read_experiment(folder)
    free_s = prepare_mechanism(experiment, load_mechanism(experiment.model)).simulator.step_s
    (folder / "model.xml").write_text(
        model.replace('name="joint3"', 'name="joint3" stiffness="1000"'), encoding="utf-8"
    )
    stiff_s = prepare_mechanism(experiment, load_mechanism(experiment.model)).simulator.step_s
    assert free_s == 8e-3
    assert 1.25e-4 < stiff_s < free_s


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            'joint = "joint3"',
            'joint = "joint4"',
            "joint 'joint4' is not in the model; it has joint1, joint2, joint3",
        ),
        ('actuator = "motor3"', 'actuator = "motor4"', "actuator 'motor4' is not in the model"),
        (
            '{ joint = "joint3", quantity = "speed", column = "w3", unit = "rad/s" }',
            '{ sensor = "plate", column = "w3", unit = "N" }',
            "sensor 'plate' is not in the model; it has none",
        ),
        (
            'column = "q1", unit = "deg"',
            'column = "q1", unit = "mm"',
            "the model has it in rad, not in m",
        ),
        (
            '{ joint = "joint3", quantity = "position", column = "q3", unit = "deg" }, ',
            "",
            "no signal holds the position of joint 'joint3'",
        ),
        ('model = "model.xml"', 'model = "none.xml"', "none.xml: is not there"),
        (
            "[known_to]",
            "windows = { length_s = 3.0, bin_s = 0.1 }\n[known_to]",
            "no recording is longer than 3.12 s",
        ),
    ],
)
def test_what_does_not_fit_the_model_is_refused_in_one_line(short, tmp_path, old, new, said):
    folder = shutil.copytree(short, tmp_path / "arm")
    text = (folder / "experiment.toml").read_text(encoding="utf-8")
    (folder / "experiment.toml").write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(BadInput) as refused:
        diagnosed(folder)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_an_unknown_effect_that_is_to_be_left_out_is_refused(short):
    with pytest.raises(
        BadInput,
        match="'joint_frition' is no effect of this mechanism; did you mean joint_friction",
    ):
        diagnose(MechanismProblem(read_experiment(short)), ignore_share, ("joint_frition",))


def test_options_for_a_leg_are_refused(short):
    for options, said in (
        (("--close-the-loop",), "leave it out for a mechanism"),
        (("--law", "joints"), "no law can be measured there"),
    ):
        ran = CliRunner().invoke(app, ["diagnose", str(short), *options])
        assert isinstance(ran.exception, BadInput)
        assert said in str(ran.exception)


def test_a_draft_names_what_it_cannot_know_and_is_read_once_that_is_filled_in(short, tmp_path):
    folder = tmp_path / "data"
    folder.mkdir()
    shutil.copy(short / "run1.csv", folder)
    ran = CliRunner().invoke(
        app, ["init", "--mjcf", str(short / "model.xml"), "--data", str(folder)]
    )
    assert ran.exit_code == 0, ran.output
    path = folder / "experiment.toml"
    text = path.read_text(encoding="utf-8")
    assert '[time]\ncolumn = "t"' in text
    with pytest.raises(BadInput, match=r"time\.unit: is still a question mark"):
        read_experiment(folder)
    units = {"time": "s", "position": "deg", "speed": "rad/s", "command": "N m"}
    letters = {"position": "q", "speed": "w", "command": "tau"}
    filled = []
    kind = "time"
    number = ""
    for line in text.splitlines():
        key, _, value = line.partition(" = ")
        number = value[-2] if key in ("joint", "actuator") else number
        if key == "actuator":
            kind = "command"
        else:
            kind = value.strip('"') if key == "quantity" else kind
        answers = {"column": f'"{letters.get(kind)}{number}"', "unit": f'"{units[kind]}"'}
        filled.append(f"{key} = {answers.get(key, 0.01)}" if value.startswith('"?"') else line)
    path.write_text("\n".join(filled), encoding="utf-8")
    run = read_experiment(folder).runs[0]
    assert run.signals.shape[1] == 6
    assert np.array_equal(
        run.signals, read_experiment(short).runs[0].signals[:, [0, 3, 1, 4, 2, 5]]
    )
    again = CliRunner().invoke(
        app, ["init", "--mjcf", str(short / "model.xml"), "--data", str(folder)]
    )
    assert isinstance(again.exception, BadInput)
