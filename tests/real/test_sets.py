"""The benchmark of real recordings is complete: every set has what its row needs, and the
commands accept it.
"""

import math

import pytest

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.diagnosis.mechanisms.check import check_experiment
from rfca_rig.mechanism.load import load_mechanism
from rfca_rig.mechanism.nuisances import NUISANCES, find_places
from rfca_rig.public_data.registry import SETS as FOLDERS
from rfca_rig.public_data.registry import PublicSet, RecordingGroup, SourceRepository, read_registry
from tests.public_recordings import write_public_set
from tests.real.__main__ import SPLITS, closed_share, contradicts, count

pytest.importorskip("mujoco")

SETS = read_registry().sets
SOURCE = SourceRepository("owner/name", "0" * 40, "MIT", "2020 Somebody", "", {})
GROUP = RecordingGroup("made/up", SOURCE, "acrobot", "nothing", ())


def made_up(split="test", right=(), negligible=False):
    return PublicSet(
        "made-up", GROUP, split, "friction", "friction", tuple(right), (), "", negligible
    )


def sources_of(name):
    """What a set's recordings are made from: source files, and which part of them."""
    return {
        (path, tuple(file.options.items()))
        for file in SETS[name].recordings
        for path in file.sources
    }


def test_every_folder_is_a_set_and_every_set_a_folder():
    assert {path.parent.name for path in FOLDERS.glob("*/experiment.toml")} == set(SETS)


@pytest.mark.parametrize("name", SETS)
def test_a_set_says_all_that_its_row_needs(name):
    public_set = SETS[name]
    assert public_set.split in SPLITS
    assert public_set.concealed and public_set.published and public_set.law
    assert public_set.right or public_set.negligible
    assert public_set.recordings
    assert all(path.is_file() for path in public_set.files.values())


def test_no_test_uses_a_recording_of_development():
    used = {split: [] for split in SPLITS}
    for name, public_set in SETS.items():
        used[public_set.split].extend(sources_of(name))
    assert not set(used["development"]) & set(used["test"])
    assert len(used["test"]) == len(set(used["test"]))


@pytest.mark.slow
@pytest.mark.parametrize("name", SETS)
def test_read_and_check_accept_a_set_and_doubt_no_sign_or_unit(name, tmp_path):
    folder = tmp_path / name
    write_public_set(name, folder)
    experiment = read_experiment(folder)
    doubts = []
    for line in check_experiment(folder):
        # What is concealed may make the prediction of the nominal model poor, and the speeds of one
        # set are differences over a sample of 30 ms.
        is_expected = line.about == "prediction" or "ms behind the derivative" in line.words
        if line.is_warning and not is_expected:
            doubts.append(line.words)
    assert doubts == []
    mechanism = load_mechanism(experiment.model)
    assert all(find_places(mechanism, NUISANCES[key].objects) for key in SETS[name].law)


SAID = {
    "grade": "mostly",
    "effects": {"joint_friction": {}},
    "family": "",
    "held_out": {"a_position_rad": [2.0, 1.0]},
}
NOTHING = {
    "grade": "nothing missing",
    "effects": {},
    "family": "",
    "held_out": {"a_position_rad": [2.0, 2.0]},
}
BY_HAND = {"held_out": {"a_position_rad": 0.0}}


def test_a_statement_closes_a_share_of_the_mean_square():
    assert closed_share(SAID, BY_HAND) == pytest.approx(0.75)
    assert math.isnan(closed_share(SAID, {"held_out": {"a_position_rad": 3.0}}))


def test_what_was_not_published_contradicts():
    assert not contradicts(SAID, made_up(right=["joint_friction"]))
    assert contradicts(SAID, made_up(right=["joint_damping"]))
    assert not contradicts(
        {**NOTHING, "family": "joint_dissipation"}, made_up(right=["joint_drag"])
    )
    assert contradicts({**NOTHING, "family": "joint_dissipation"}, made_up(right=["added_mass"]))


def test_counts_are_those_of_a_split():
    right = made_up(right=["joint_friction"])
    wrong = made_up(right=["joint_drag"])
    negligible = made_up(right=["joint_friction"], negligible=True)
    development = made_up("development", ["joint_friction"])
    perfect = {**SAID, "held_out": {"a_position_rad": [2.0, 0.1]}}
    found = [
        (right, perfect, BY_HAND),
        (wrong, SAID, BY_HAND),
        (negligible, NOTHING, BY_HAND),
        (right, {"refused": "too slow"}, {"refused": "too slow"}),
        (development, NOTHING, BY_HAND),
    ]
    silent = "1 silent (0 of them say that nothing is missing)"
    assert count("test", found) == (
        "test: 4 sets, 1 of 2 close 0.8 of what the hand fit closes, 1 contradicted, "
        f"{silent}, 1 refused"
    )
    assert count("development", found).endswith(
        "1 silent (1 of them say that nothing is missing), 0 refused"
    )
