"""What to record next of a mechanism: motions that its motors can make, which separate what is
open.
"""

import csv

import numpy as np
import pytest

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.diagnosis.experiment_design.mechanism_experiment import _sines, propose_motion
from rfca_rig.diagnosis.mechanisms.nuisances import MechanismInput
from rfca_rig.diagnosis.mechanisms.prepared import prepare_mechanism
from rfca_rig.diagnosis.mechanisms.problem import NEXT_COMMANDS, MechanismProblem
from rfca_rig.executors.cores import single_threaded_blas
from rfca_rig.mechanism.inverse_dynamics import compute_feed_forward, has_torque_motors
from rfca_rig.mechanism.load import load_mechanism
from rfca_rig.mechanism.plant import make_plant
from rfca_rig.mechanism.rollout import CommandTrace, simulate_plant
from rfca_rig.model.parameters import PresentEffect
from rfca_rig.progress import ignore_share
from tests.mechanism import hopper
from tests.mechanism.arm import Arm, Friction, mjcf, record, write_campaign

T_S = np.arange(0.0, 0.6, 1e-3)


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    path = tmp_path_factory.mktemp("arm") / "model.xml"
    path.write_text(
        mjcf(Arm()).replace('joint="joint2" gear="1"', 'joint="joint2" gear="5"'), encoding="utf-8"
    )
    return load_mechanism(path)


@pytest.fixture(scope="module")
def experiment(tmp_path_factory):
    folder = tmp_path_factory.mktemp("short") / "arm"
    return read_experiment(
        write_campaign(folder, Arm(), [record(Arm(), 1.4, 0)], {"mass_relative": 0.02})
    )


@pytest.mark.parametrize("change", ["", "friction", "load_loss", "torque_offset", "zero_offset"])
def test_the_feed_forward_carries_a_mechanism_along_the_reference(arm, change):
    """MuJoCo's forward dynamics under the commands of the inverse; without what was changed the
    arm leaves the reference.
    """
    plant = make_plant(arm, 1e-3)
    if change:
        getattr(plant, change)[:] = 0.1
    reference = 0.3 * np.sin(6.0 * T_S)[:, None] + 0.4 * T_S[:, None] * (1.0, -0.5, 2.0)
    speed = np.gradient(reference, 1e-3, axis=0)
    command = compute_feed_forward(plant, reference, speed, np.gradient(speed, 1e-3, axis=0))
    trace = CommandTrace(T_S - 0.05, command)
    read = simulate_plant(plant, trace, reference[50], speed[50], np.array([0.1, 0.2])).position
    assert read == pytest.approx(reference[[150, 250]], abs=4e-3)
    if change:
        bare = make_plant(arm, 1e-3)
        assert (
            np.abs(
                simulate_plant(bare, trace, reference[50], speed[50], np.array([0.2])).position
                - reference[250]
            ).max()
            > 0.01
        )


def test_a_joint_without_a_motor_of_its_own_follows_no_reference(arm, tmp_path):
    (tmp_path / "hopper.xml").write_text(hopper.mjcf(hopper.Hopper()), encoding="utf-8")
    (tmp_path / "servo.xml").write_text(
        mjcf(Arm()).replace("<motor", '<position kp="10"').replace(' gear="1"', ""),
        encoding="utf-8",
    )
    assert has_torque_motors(arm)
    assert not has_torque_motors(load_mechanism(tmp_path / "hopper.xml"))
    assert not has_torque_motors(load_mechanism(tmp_path / "servo.xml"))


@pytest.mark.parametrize(
    "every", [pytest.param(4, marks=pytest.mark.slow), pytest.param(1, marks=pytest.mark.long)]
)
def test_motions_keep_to_the_recorded_range_and_to_the_recorded_commands(experiment, every):
    """Every fourth is of every joint and of all together, each with other travels and speeds."""
    mechanism = load_mechanism(experiment.model)
    problem = prepare_mechanism(experiment, mechanism)
    simulator = problem.simulator
    designs = list(_sines(problem))
    assert {design.settings["joint"] for design in designs} <= {
        "joint1",
        "joint2",
        "joint3",
        "all joints",
    }
    planned = [
        condition
        for design in designs[::every]
        if (condition := design.simulate(MechanismInput())) is not None
    ]
    assert len(planned) > 2
    for condition in planned:
        rows = condition.rows()
        assert np.abs(rows.measured - simulator.simulate(MechanismInput(), condition)).max() < 1e-9
        for each in condition.windows:
            assert (each.window.position <= problem.usual.highest + 1e-9).all()
            assert (each.window.position >= problem.usual.lowest - 1e-9).all()
            assert (np.abs(each.window.trace.command).max(axis=0) <= problem.usual.command).all()


@pytest.mark.slow
def test_a_motion_that_needs_larger_commands_is_not_proposed(experiment):
    mechanism = load_mechanism(experiment.model)
    problem = prepare_mechanism(experiment, mechanism)
    friction = problem.simulator.effects["joint_friction"]
    values = tuple(
        (parameter.name, float(10.0 * problem.usual.command.max()))
        for parameter in friction.parameters
    )
    stuck = MechanismInput(effects=(PresentEffect("joint_friction", values),))
    assert all(design.simulate(stuck) is None for design in _sines(problem))


@pytest.mark.long
def test_what_is_open_gets_a_motion_as_a_file(tmp_path):
    rubs = Arm(friction=Friction((0.6, 0.3, 0.1)))
    folder = write_campaign(
        tmp_path / "arm", Arm(), [record(rubs, 3.9, 0)], {"mass_relative": 0.02}
    )
    with single_threaded_blas():
        solution = MechanismProblem(read_experiment(folder)).solve((), ignore_share)
        experiment = solution.propose_experiment(None)
        finding = solution.finding
        # Too few conditions for a verdict.
        motion = propose_motion(solution.short, finding.search, finding.decision, False)
    assert solution.describe().grade == "not enough data"
    assert experiment.stated["kind"] == "sine"
    assert experiment.stated == motion.proposal
    (line,) = experiment.write_files(tmp_path)
    assert line.startswith(f"{tmp_path / NEXT_COMMANDS}: the proposed motion of the joints")
    with (tmp_path / NEXT_COMMANDS).open(encoding="utf-8") as file:
        names, *rows = list(csv.reader(file))
    assert names[:2] == ["t_s", "joint1_position_rad"]
    assert names[4:] == ["motor1_command", "motor2_command", "motor3_command"]
    values = np.array(rows, dtype=float)
    assert values[:, 0] == pytest.approx(motion.excitation.t_s)
    assert values[:, 1:4] == pytest.approx(motion.excitation.reference, rel=1e-6, abs=1e-6)
    assert values[0, 1:4] == pytest.approx(values[1, 1:4], abs=1e-4)  # it begins at rest
