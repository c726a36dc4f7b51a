"""Torques of recorded motions, from an arm that is simulated from its own equations."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.diagnosis.config import DEFAULT_SEARCH, USUAL_ERROR
from rfca_rig.diagnosis.inference.model_selection import search_models
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.mechanisms.nuisances import MechanismInput
from rfca_rig.diagnosis.mechanisms.prepared import prepare_mechanism
from rfca_rig.diagnosis.mechanisms.torque_balance import (
    is_worth_balancing,
    make_torque_dataset,
)
from rfca_rig.progress import ignore_share
from tests.mechanism import arm

NOMINAL = arm.Arm()
KNOWN_TO = {"mass_relative": 0.02, "centre_of_mass_m": 0.002, "zero_offset_rad": 0.002}


def prepare(folder, actual):
    recordings = [arm.record(actual, 6.0, seed) for seed in (1, 2)]
    arm.write_campaign(folder, NOMINAL, recordings, KNOWN_TO)
    experiment = read_experiment(folder)
    return prepare_mechanism(experiment, experiment.load_model())


@pytest.fixture(scope="module")
def unchanged(tmp_path_factory):
    return prepare(tmp_path_factory.mktemp("arm") / "unchanged", NOMINAL)


def test_the_torques_of_the_true_model_are_missed_by_noise(unchanged):
    dataset = make_torque_dataset(unchanged)
    predicted = dataset.predicted(MechanismInput())
    for signal in np.unique(dataset.rows.signal):
        rows = dataset.rows.signal == signal
        missed = (dataset.rows.measured - predicted)[rows] / dataset.rows.noise[rows]
        assert 0.6 < np.sqrt(np.mean(missed**2)) < 1.3


def test_an_error_of_one_percent_is_one_of_the_usual_torque(unchanged):
    rows = make_torque_dataset(unchanged).rows
    of_joint = rows.scale[rows.signal == "joint1_torque_Nm"]
    assert of_joint == pytest.approx(unchanged.torque[0])
    assert rows.noise.min() > 0.0
    assert USUAL_ERROR * of_joint[0] < rows.measured[rows.signal == "joint1_torque_Nm"].std()


def test_gaps_are_left_out(unchanged):
    run = unchanged.experiment.runs[0]
    gappy = run.take((run.t_s < 2.5) | (run.t_s > 2.9))
    whole = replace(unchanged.experiment, runs=(run,))
    with_gap = replace(unchanged.experiment, runs=(gappy,))
    count = len(make_torque_dataset(replace(unchanged, experiment=whole)).parts)
    assert len(make_torque_dataset(replace(unchanged, experiment=with_gap)).parts) == count - 1


def test_recordings_that_are_too_short_have_no_torques(unchanged):
    runs = tuple(run.take(run.t_s < 0.5) for run in unchanged.experiment.runs)
    short = replace(unchanged, experiment=replace(unchanged.experiment, runs=runs))
    assert make_torque_dataset(short) is None


def test_of_long_recordings_some_stretches_are_used(unchanged):
    runs = unchanged.experiment.runs * 10
    long = replace(unchanged, experiment=replace(unchanged.experiment, runs=runs))
    parts = make_torque_dataset(long).parts
    assert len(parts) == 30
    assert {part.recording for part in parts} == {run.label for run in runs}


def test_contacts_and_few_joints_are_simulated_instead(unchanged):
    assert is_worth_balancing(unchanged)
    mechanism = unchanged.simulator.mechanism
    touching = replace(mechanism, has_contacts=True)
    assert not is_worth_balancing(
        replace(unchanged, simulator=replace(unchanged.simulator, mechanism=touching))
    )
    few = replace(mechanism, joints=mechanism.joints[:2])
    assert not is_worth_balancing(
        replace(unchanged, simulator=replace(unchanged.simulator, mechanism=few))
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "right"),
    [
        (
            {"friction": arm.Friction((0.6, 0.25, 0.07), 0.3, 0.3)},
            {"joint_friction", "joint_stribeck", "joint_hysteresis"},
        ),
        ({"torque_factor": 0.85}, {"torque_scale"}),
        ({"mass_kg": (2.0, 1.4, 1.0)}, {"added_mass"}),
    ],
)
def test_a_search_in_torques_begins_with_what_is_missing(tmp_path, changes, right):
    prepared = prepare(tmp_path / "arm", replace(NOMINAL, **changes))
    effects = list(prepared.simulator.effects.values())
    found = search_models(
        make_torque_dataset(prepared),
        Parameterization(prepared.space),
        effects,
        ignore_share,
        replace(DEFAULT_SEARCH, singles_only=True),
    )
    assert set(found.named[0].ids) <= right
    assert found.named[0].log_joint > found.nothing.log_joint + 50.0
