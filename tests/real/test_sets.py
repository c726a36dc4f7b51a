"""The benchmark of real recordings is complete: every set has what its row needs, and the
commands accept it.
"""

import math

import pytest

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.diagnosis.mechanisms.check import check_experiment
from rfca_rig.mechanism.load import load_mechanism
from rfca_rig.mechanism.nuisances import NUISANCES, find_places
from tests.real.__main__ import (
    DATA,
    HERE,
    SPLITS,
    closed_share,
    contradicts,
    count,
    put_together,
    read_sets,
)

pytest.importorskip("mujoco")

SETS = read_sets()
NEEDED = {"split", "recordings", "concealed", "published", "right", "law"}
OPTIONAL = {"model", "negligible"}
# bytes of recordings
LARGEST = 1.5e6
LARGEST_IN_ALL = 6e6


def files_of(name):
    """The recordings that a set uses, as paths of tests/data."""
    runs = DATA / SETS[name]["recordings"] / "runs"
    return {
        runs / line.split('"')[1].split("/", 1)[1]
        for line in _lines(name)
        if line.startswith("file = ")
    }


def _lines(name):
    return (HERE / name / "experiment.toml").read_text(encoding="utf-8").splitlines()


def test_every_folder_is_a_set_and_every_set_a_folder():
    assert {path.parent.name for path in HERE.glob("*/experiment.toml")} == set(SETS)


@pytest.mark.parametrize("name", SETS)
def test_a_set_says_all_that_its_row_needs(name):
    described = SETS[name]
    assert NEEDED <= set(described) <= NEEDED | OPTIONAL
    assert described["split"] in SPLITS
    assert all(described[key] for key in NEEDED)


@pytest.mark.parametrize("name", SETS)
def test_the_licence_stands_beside_recordings_that_are_small(name):
    folder = DATA / SETS[name]["recordings"]
    assert "copyright" in (folder / "LICENSE.txt").read_text(encoding="utf-8").lower()
    assert sum(path.stat().st_size for path in (folder / "runs").iterdir()) < LARGEST


def test_all_recordings_together_are_small():
    folders = {DATA / described["recordings"] for described in SETS.values()}
    assert (
        sum(
            path.stat().st_size
            for folder in folders
            for path in folder.rglob("*")
            if path.is_file()
        )
        < LARGEST_IN_ALL
    )


def test_no_test_uses_a_recording_of_development():
    used = {split: [] for split in SPLITS}
    for name in SETS:
        used[SETS[name]["split"]].extend(files_of(name))
    assert all(file.is_file() for files in used.values() for file in files)
    assert not set(used["development"]) & set(used["test"])
    assert len(used["test"]) == len(set(used["test"]))


@pytest.mark.slow
@pytest.mark.parametrize("name", SETS)
def test_read_and_check_accept_a_set_and_doubt_no_sign_or_unit(name, tmp_path):
    folder = tmp_path / name
    put_together(name, SETS[name], folder)
    experiment = read_experiment(folder)
    # what is concealed may make the prediction of the nominal model poor
    assert [
        line.words
        for line in check_experiment(folder)
        if line.is_warning and line.about != "prediction"
    ] == []
    mechanism = load_mechanism(experiment.model)
    assert all(find_places(mechanism, NUISANCES[key].objects) for key in SETS[name]["law"])


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
    assert not contradicts(SAID, {"right": ["joint_friction"]})
    assert contradicts(SAID, {"right": ["joint_damping"]})
    assert not contradicts({**NOTHING, "family": "joint_dissipation"}, {"right": ["joint_drag"]})
    assert contradicts({**NOTHING, "family": "joint_dissipation"}, {"right": ["added_mass"]})


def test_counts_are_those_of_a_split():
    right, wrong = ({"split": "test", "right": [id_]} for id_ in ("joint_friction", "joint_drag"))
    perfect = {**SAID, "held_out": {"a_position_rad": [2.0, 0.1]}}
    found = [
        (right, perfect, BY_HAND),
        (wrong, SAID, BY_HAND),
        ({**right, "negligible": True}, NOTHING, BY_HAND),
        (right, {"refused": "too slow"}, {"refused": "too slow"}),
        ({**right, "split": "development"}, NOTHING, BY_HAND),
    ]
    silent = "1 silent (0 of them say that nothing is missing)"
    assert count("test", found) == (
        "test: 4 sets, 1 of 2 close 0.8 of what the hand fit closes, 1 contradicted, "
        f"{silent}, 1 refused"
    )
    assert count("development", found).endswith(
        "1 silent (1 of them say that nothing is missing), 0 refused"
    )
