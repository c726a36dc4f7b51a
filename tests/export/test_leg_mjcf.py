"""The leg as a mechanism: MuJoCo's strokes against those of the compiled chain, and the folder
that a user gets.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import PPoly

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.diagnosis.diagnose import diagnose
from rfca_rig.diagnosis.mechanisms.nuisances import MechanismInput
from rfca_rig.diagnosis.mechanisms.prepared import prepare_mechanism
from rfca_rig.diagnosis.mechanisms.problem import MechanismProblem
from rfca_rig.exam.cases import NOTHING, ExamDesign, draw_cases
from rfca_rig.exam.simulate_campaign import write_campaign
from rfca_rig.export.leg_mjcf import export_leg
from rfca_rig.mechanism.contact_law import SphereOnPlane
from rfca_rig.mechanism.load import load_mechanism
from rfca_rig.mechanism.model_files import FLOOR, end_names, write_amended_model, write_leg_mjcf
from rfca_rig.mechanism.plant import make_plant
from rfca_rig.mechanism.prescribed import PrescribedMotion
from rfca_rig.mechanism.rollout import CommandTrace, simulate_plant
from rfca_rig.model.chain import Tolerance
from rfca_rig.model.motion import ramp_to_speed
from rfca_rig.model.stroke import simulate_stroke
from rfca_rig.progress import ignore_share
from rfca_rig.recording.atomic import write_atomically
from tests.campaign.small import SMALL
from tests.cli.typed import typed
from tests.model.legs import PAPER

SHORT = ExamDesign(
    tuple((height, speed) for height in (205.0, 225.0) for speed in (2.4, 4.0)), 2, (205.0,)
)
HEIGHT_M = 0.215
SPEED_RAD_S = 3.25
TIGHT = Tolerance(angle_rad=1e-7, speed_rad_s=3e-4)


def leg_of(tmp_path, rig):
    path = tmp_path / "leg.xml"
    write_atomically(path, write_leg_mjcf(rig).encode("utf-8"))
    ground = rig.ground
    law = (
        ground.stiffness_N_per_m1p5,
        ground.damping_s_per_m,
        ground.friction_coefficient,
        ground.presliding_m,
        ground.drag_N_s_per_m,
    )
    contacts = tuple(SphereOnPlane(end, FLOOR, *law) for end in end_names(rig.leg))
    return replace(load_mechanism(path), prescribed=(0, 1), contacts=contacts)


def strokes(tmp_path, rig, step_s, half_gap_rad=0.0):
    """fy, fz and tx (3, m) of the compiled chain, and of MuJoCo with the same ground."""
    motion = ramp_to_speed(rig.leg.start_angle_rad, SPEED_RAD_S, rig.drive.ramp_s, 1.0)
    t_s = np.arange(1, 900) * 1e-3
    chain = simulate_stroke(rig, HEIGHT_M, motion, t_s, TIGHT)
    coefficients = motion.coefficients[:, ::-1].T[:, :, None] * np.array([0.0, 1.0])
    coefficients[3, :, 0] = HEIGHT_M
    plant = make_plant(leg_of(tmp_path, rig), step_s, reads_sensors=True)
    plant.spring_half_gap[2:] = half_gap_rad
    still = CommandTrace(np.array([0.0, 1.0]), np.empty((2, 0)))
    found = simulate_plant(
        plant, still, None, None, t_s, 0.0, PrescribedMotion(PPoly(coefficients, motion.breaks_s))
    )
    return np.stack([chain.fy_N, chain.fz_N, chain.tx_Nm]), -found.sensors[:, 1:4].T


@pytest.mark.slow
def test_the_leg_in_mujoco_feels_what_the_compiled_chain_does(tmp_path):
    """The mechanism's own code, MuJoCo's mechanics and the contact law share nothing with the
    chain: at most 0.2 % of each force.
    """
    chain, mujoco = strokes(tmp_path, PAPER, 5e-5)
    assert chain[1].min() < -30.0
    assert (np.linalg.norm(mujoco - chain, axis=1) < 1e-3 * np.linalg.norm(chain, axis=1)).all()
    assert mujoco[1].min() == pytest.approx(chain[1].min(), rel=2e-4)
    coarse = strokes(tmp_path, PAPER, 1e-3)[1]
    assert (np.linalg.norm(coarse - chain, axis=1) < 1.5e-2 * np.linalg.norm(chain, axis=1)).all()
    assert coarse[1].min() == pytest.approx(chain[1].min(), rel=5e-4)


def test_a_leg_that_is_bent_at_rest_is_bent_in_mujoco_too(tmp_path):
    bent = replace(
        PAPER, leg=replace(PAPER.leg, rest_angles_rad=(0.02, -0.03, 0.05, 0.0, 0.01, -0.02))
    )
    chain, mujoco = strokes(tmp_path, bent, 2.5e-4)
    assert (np.linalg.norm(mujoco - chain, axis=1) < 5e-3 * np.linalg.norm(chain, axis=1)).all()
    straight = strokes(tmp_path, PAPER, 2.5e-4)[0]
    assert (np.linalg.norm(straight - chain, axis=1) > 3e-2 * np.linalg.norm(chain, axis=1)).all()


def test_the_amended_model_of_the_leg_has_no_heavy_joints_and_says_what_it_lacks(tmp_path):
    plant = make_plant(leg_of(tmp_path, PAPER), 1e-3)
    assert plant.model.dof_armature.max() > 1e8
    plant.spring_half_gap[2:] = 0.01
    beyond = write_amended_model(plant, tmp_path / "amended.xml")
    assert set(beyond) == {"play of the springs", "contact laws of spheres on planes"}
    assert load_mechanism(tmp_path / "amended.xml").model.dof_armature.max() == 0.0


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    place = tmp_path_factory.mktemp("leg")
    (case,) = draw_cases(7, {NOTHING: 1})
    write_campaign(replace(case, design=SHORT), place / "campaign")
    export_leg(place / "campaign", place / "mjcf")
    return place / "mjcf"


@pytest.mark.slow
def test_the_folder_is_an_experiment_whose_model_predicts_its_strokes(exported):
    experiment = read_experiment(exported)
    mechanism = load_mechanism(experiment.model)
    problem = prepare_mechanism(experiment, mechanism)
    assert [run.label for run in experiment.runs][:2] == [
        "205 mm, 2.4 rad/s, repeat 1",
        "205 mm, 2.4 rad/s, repeat 2",
    ]
    assert len(problem.conditions) == 4
    assert [len(condition.repeats) for condition in problem.conditions] == [2, 2, 2, 2]
    assert problem.simulator.mechanism.prescribed == (0, 1)
    assert problem.simulator.mechanism.unmeasured == (2, 3, 4, 5, 6, 7)
    assert {joint.name: joint.scatter_std for joint in experiment.prescribed} == {
        "rack": pytest.approx(1.5e-4),
        "shaft": None,
    }
    assert set(experiment.known_to) >= {
        "zero_offset_m",
        "joint_stiffness_relative",
        "contact_friction_relative",
        "start_swing_relative",
    }
    for condition in problem.conditions:
        measured = condition.windows[0].window.measured
        left = measured - problem.simulator.simulate(MechanismInput(), condition).reshape(
            measured.shape
        )
        assert (
            np.sqrt(np.mean(left**2, axis=1)) < 0.15 * np.sqrt(np.mean(measured**2, axis=1))
        ).all()


def test_the_folder_holds_the_motion_and_what_it_does_not_is_said(exported, monkeypatch, capsys):
    """The shaft turns as commanded from the measured start, and static stages stay behind."""
    run = np.genfromtxt(exported / "stroke-01.csv", delimiter=",", names=True)
    moving = run["t_s"] > 0.06
    assert np.polyfit(run["t_s"][moving], run["shaft_rad"][moving], 1)[0] == pytest.approx(
        2.4, rel=1e-6
    )
    assert (run["height_mm"] == 205.0).all()
    said = typed(
        monkeypatch,
        capsys,
        "export",
        "mjcf",
        exported.parent / "campaign",
        "--out",
        exported.parent / "again",
        "--json",
    )
    told = json.loads(said.out)
    assert (said.exit_code, told["recordings"]) == (0, 8)
    assert told["left_out"] == ["static stages: a mechanism is diagnosed from its motion"]
    shown = typed(monkeypatch, capsys, "check", exported)
    assert shown.exit_code == 0
    assert "4 motions from rest" in " ".join(shown.out.split())


def test_a_campaign_without_strokes_or_a_folder_that_is_there_is_refused_in_one_line(
    tmp_path, monkeypatch, capsys
):
    for out, line in (
        (tmp_path, "is there already"),
        (tmp_path / "new", "no stroke shows a touchdown and a valley"),
    ):
        said = typed(monkeypatch, capsys, "export", "mjcf", SMALL, "--out", out)
        assert said.exit_code == 2
        assert line in " ".join(said.err.split())
        assert "Traceback" not in said.err
    assert not (tmp_path / "new").exists()


@pytest.mark.long
def test_the_exported_leg_lacks_nothing(exported):
    found = diagnose(MechanismProblem(read_experiment(exported)), ignore_share).diagnosis
    assert found.grade == "nothing missing"
    assert not found.effects
    assert {one.id for one in found.not_seen} >= {
        "joint_friction",
        "joint_spring_play",
        "sensor_gain",
    }
