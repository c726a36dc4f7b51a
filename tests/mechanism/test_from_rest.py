"""Motions from rest with a joint that has no encoder: what is refused, what is compared, and the
diagnosis.
"""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.diagnosis.diagnose import diagnose
from rfca_rig.diagnosis.mechanisms.check import check_experiment
from rfca_rig.diagnosis.mechanisms.nuisances import MechanismInput
from rfca_rig.diagnosis.mechanisms.prepared import prepare_mechanism
from rfca_rig.diagnosis.mechanisms.problem import MechanismProblem
from rfca_rig.errors import BadInput
from rfca_rig.mechanism.load import load_mechanism
from rfca_rig.progress import ignore_share
from tests.mechanism.arm import Arm, Friction
from tests.mechanism.pulled import record, write_campaign

NOMINAL = Arm(
    length_m=(0.35, 0.3),
    mass_kg=(2.0, 1.4),
    friction=Friction((0.0, 0.0)),
    rotor_kg_m2=(0.0, 0.0),
    zero_rad=(0.0, 0.0),
)
KNOWN_TO = {"mass_relative": 0.02, "joint_damping_Nm_s_per_rad": 0.003}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("pulled") / "campaign"
    return write_campaign(place, NOMINAL, [record(NOMINAL, seed) for seed in range(4)], KNOWN_TO)


def problem_of(folder):
    experiment = read_experiment(folder)
    return prepare_mechanism(experiment, load_mechanism(experiment.model))


def changed(folder, tmp_path, old, new):
    """The experiment with another text."""
    text = (folder / "experiment.toml").read_text(encoding="utf-8")
    assert old in text
    for name in ("model.xml", *(f"run{k}.csv" for k in range(1, 5))):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    (tmp_path / "experiment.toml").write_text(text.replace(old, new, 1), encoding="utf-8")
    return tmp_path


@pytest.mark.slow
def test_a_recording_is_one_window_from_rest_that_the_right_model_predicts(folder):
    problem = problem_of(folder)
    assert [len(condition.windows) for condition in problem.conditions] == [1, 1, 1, 1]
    assert problem.simulator.mechanism.unmeasured == (1,)
    for condition in problem.conditions:
        window = condition.windows[0]
        left = window.window.measured - problem.simulator.simulate(
            MechanismInput(), condition
        ).reshape(window.window.measured.shape)
        assert np.abs(window.window.measured[0]).max() > 0.3
        assert (
            np.sqrt(np.mean(left**2, axis=1))
            < 0.02 * np.sqrt(np.mean(window.window.measured**2, axis=1))
        ).all()
        assert not len(window.start_effect)
    # 1.5 s are compared, but for the sample in which the motion begins
    assert problem.conditions[0].windows[0].window.t_s[-1] == pytest.approx(1.498)


def test_repeats_of_a_condition_are_averaged(folder, tmp_path):
    text = 'file = "run2.csv", condition = "pulls 2"'
    place = changed(folder, tmp_path, text, 'file = "run2.csv", condition = "pulls 1", repeat = 2')
    rows = np.loadtxt(place / "run1.csv", delimiter=",", skiprows=1)
    rows[:, 1] += 0.002
    np.savetxt(
        place / "run2.csv",
        rows[:-100],
        delimiter=",",
        header="t,q1,w1,tau1",
        comments="",
        fmt="%.8g",
    )
    problem = problem_of(place)
    assert len(problem.conditions) == 3
    both = problem.conditions[0]
    single = problem_of(folder).conditions[0]
    bins = both.windows[0].window.measured.shape[1]
    shift = both.windows[0].window.measured[0] - single.windows[0].window.measured[0, :bins]
    assert shift[:-1] == pytest.approx(0.001, abs=1e-6)
    assert both.repeats.shape == (2, both.rows().measured.size)
    assert both.repeats.mean(axis=0) == pytest.approx(both.rows().measured)
    assert both.windows[0].window.sensor_std[:, 0] == pytest.approx(
        single.windows[0].window.sensor_std[:, 0] / np.sqrt(2.0)
    )


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            'state = "at rest"',
            'state = "estimated"',
            (
                "no signal holds the position of joint 'joint2', so its start cannot be "
                "estimated; measure it, or record from rest and"
            ),
        ),
        ('state = "at rest"', 'state = "still"', "start.state"),
        (
            "[known_to]",
            '[[prescribed]]\njoint = "joint1"\ncolumn = "q1"\nunit = "rad"\n[known_to]',
            "joint 'joint1' is prescribed and a signal; remove one",
        ),
        (
            "[known_to]",
            '[[prescribed]]\njoint = "joint3"\ncolumn = "q1"\nunit = "rad"\n[known_to]',
            "joint 'joint3' is not in the model; it has joint1, joint2",
        ),
        (
            "[known_to]",
            '[[prescribed]]\njoint = "joint2"\ncolumn = "q2"\nunit = "rad"\n[known_to]',
            "column q2, which is to hold the motion of joint joint2, is missing",
        ),
        (
            "[known_to]",
            '[[prescribed]]\njoint = "joint2"\ncolumn = "q1"\nunit = "mm"\n[known_to]',
            (
                "the unit of prescribed joint 'joint2' does not suit: the model has it in "
                "rad, not in m"
            ),
        ),
        (
            "[known_to]",
            '[[prescribed]]\njoint = "joint2"\ncolumn = "q1"\nunit = "N"\n[known_to]',
            "unit 'N' of a position should be",
        ),
        (
            "[known_to]",
            '[alike]\narms = ["link1", "limb2"]\n[known_to]',
            "alike: 'limb2' is no joint, body or actuator of the model",
        ),
        (
            "[known_to]",
            '[alike]\none = ["link1", "link2"]\ntwo = ["link2", "joint1"]\n[known_to]',
            "alike: 'link2' is in two groups",
        ),
        (
            "[known_to]",
            (
                '[[contacts]]\nspheres = ["tip"]\nplane = "floor"\nstiffness_N_per_m1p5 = '
                "1e5\n[known_to]"
            ),
            "'tip' is no sphere",
        ),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_line(folder, tmp_path, old, new, said):
    with pytest.raises(BadInput) as refused:
        problem_of(changed(folder, tmp_path, old, new))
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_swing_at_the_start_is_of_motions_from_rest(folder, tmp_path):
    both = "[known_to]\nstart_swing_relative = 0.3\n"
    place = changed(
        folder, tmp_path, 'state = "at rest"\n[known_to]\n', f'state = "estimated"\n{both}'
    )
    text = (place / "experiment.toml").read_text(encoding="utf-8")
    signal = (
        '{ joint = "joint2", quantity = "position", column = "q1", unit = "rad" },\n]\ncommands'
    )
    (place / "experiment.toml").write_text(text.replace("]\ncommands", signal, 1), encoding="utf-8")
    with pytest.raises(BadInput, match=r"known_to\.start_swing_relative is of motions from rest"):
        problem_of(place)


def test_those_of_one_make_share_values_and_effects(folder, tmp_path):
    alone = problem_of(folder)
    place = changed(
        folder,
        tmp_path,
        "[known_to]",
        '[alike]\npins = ["joint1", "joint2"]\nrods = ["link1", "link2"]\n[known_to]',
    )
    shared = problem_of(place)
    assert alone.space.names[:2] == ("link1.mass_relative", "link2.mass_relative")
    assert shared.space.names == ("rods.mass_relative", "pins.joint_damping_Nm_s_per_rad")
    plant = shared.simulator.plant(shared.space.at(np.array([1.0, 0.0])))
    nominal = shared.simulator.plant(MechanismInput())
    assert plant.model.body_mass[1:] == pytest.approx(1.02 * nominal.model.body_mass[1:])
    names = [parameter.name for parameter in shared.simulator.effects["joint_friction"].parameters]
    assert names == ["torque_Nm"]
    assert len(alone.simulator.effects["joint_friction"].parameters) == 2
    rubs = shared.simulator.effects["joint_stribeck"].apply(
        nominal, {"torque_Nm": 0.2, "rise_relative": 1.0, "speed_relative": 0.1}
    )
    assert rubs.stribeck[0] == pytest.approx((0.2, 0.2))


def test_check_says_what_it_can_of_such_a_recording(folder):
    lines = list(check_experiment(folder))
    assert not [line.words for line in lines if line.is_warning]
    words = {(line.about, line.name): line.words for line in lines}
    assert words["recording", "pulls 1, repeat 1"].endswith("can be used as a whole, from rest")
    assert words["balance", "all joints"].startswith("not checked")
    assert words["diagnosis", "conditions"] == "4 motions from rest, each predicted from the others"


@pytest.mark.long
def test_damping_of_a_joint_without_an_encoder_is_found(tmp_path):
    damping = 0.06
    damped = replace(NOMINAL, friction=Friction((0.0, 0.0), viscous_Nm_s_per_rad=(0.0, damping)))
    place = write_campaign(
        tmp_path / "damped",
        NOMINAL,
        [record(damped, seed) for seed in range(4)],
        {"mass_relative": 0.02},
    )
    experiment = read_experiment(place)
    known = prepare_mechanism(experiment, load_mechanism(experiment.model)).simulator.effects
    rivals = (
        "joint_friction",
        "joint_damping",
        "joint_inertia",
        "torque_scale",
        "torque_delay",
        "added_mass",
    )
    without = [name for name in known if name.removesuffix("_of_one") not in rivals]
    found = diagnose(MechanismProblem(experiment), ignore_share, without).diagnosis
    values = {name: value.value for name, value in found.effects[0].parameters.items()}
    assert found.effects[0].id in ("joint_damping", "joint_damping_of_one")
    if found.effects[0].id == "joint_damping_of_one":
        assert values["joint"] == 2
        assert values["coefficient_Nm_s_per_rad"] == pytest.approx(damping, rel=0.1)
    else:
        assert values["joint2_coefficient_Nm_s_per_rad"] == pytest.approx(damping, rel=0.1)
        assert (
            values["joint1_coefficient_Nm_s_per_rad"] < 0.4 * damping
        )  # no size may be 0 there; a third was seen


@pytest.mark.long
def test_nothing_is_stated_where_nothing_is_missing(folder):
    """The recording holds each command for a sample, which the model does not: that is visible,
    and within the usual error.
    """
    found = diagnose(MechanismProblem(read_experiment(folder)), ignore_share).diagnosis
    assert found.effects == () and found.family is None
    assert found.grade == "nothing missing" or "within the usual model error" in found.sentence
