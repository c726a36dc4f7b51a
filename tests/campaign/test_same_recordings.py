"""One campaign as CSV, HDF5, MCAP and ROS 2 bags: the same runs and the same answer, whatever
kind of file holds them.
"""

import json
import shutil

import can
import h5py
import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin
from typer.testing import CliRunner

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.cli.main import app
from rfca_rig.diagnosis.mechanisms.prepared import prepare_mechanism
from rfca_rig.mechanism.load import load_mechanism
from rfca_rig.recording.layout import identity_of_tables
from rfca_rig.reports.provenance import fingerprint
from tests.campaign import bags
from tests.mechanism.arm import Arm, record, write_campaign

JOINTS = ("joint1", "joint2", "joint3")
OF_STATES = {"q": "/joint_states:position", "w": "/joint_states:velocity"}


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    recordings = [record(Arm(), 1.4, seed) for seed in (0, 1)]
    return write_campaign(
        tmp_path_factory.mktemp("csv") / "arm", Arm(), recordings, {"mass_relative": 0.02}
    )


def write_hdf5(path, t_s, angles, speeds, torques):
    with h5py.File(path, "w") as file:
        file["t"] = t_s
        file["arm/q"] = angles
        file["arm/w"] = speeds
        file["tau"] = torques


def write_ros(path, t_s, angles, speeds, torques, storage):
    states = [
        (t, bags.joint_state(t, JOINTS, q, w)) for t, q, w in zip(t_s, angles, speeds, strict=True)
    ]
    told = [
        (t, bags.joint_state(t, JOINTS, (), (), tau)) for t, tau in zip(t_s, torques, strict=True)
    ]
    bags.write_rosbag(
        path,
        {"/joint_states": (bags.JOINT_STATE, states), "/told": (bags.JOINT_STATE, told)},
        storage,
    )


def write_json(path, t_s, angles, speeds, torques, leave_out_s=(0.0, 0.0)):
    states = [
        (t, {"name": JOINTS, "position": list(q), "velocity": list(w)})
        for t, q, w in zip(t_s, angles, speeds, strict=True)
    ]
    begin_s, end_s = leave_out_s
    told = [
        (t, {"name": JOINTS, "effort": list(tau)})
        for t, tau in zip(t_s, torques, strict=True)
        if not begin_s < t < end_s
    ]
    bags.write_mcap(path, {"/joint_states": states, "/told": told})


def make_database():
    """Messages of CAN FD with the states and torques as doubles."""
    signals = {
        "State": [f"{letter}{place}" for letter in "qw" for place in (1, 2, 3)],
        "Torque": [f"tau{place}" for place in (1, 2, 3)],
    }
    lines = ['VERSION ""', "BU_: Arm"]
    doubles = []
    formats = []
    for identifier, (message, names) in enumerate(signals.items(), start=0x100):
        lines.append(f"BO_ {identifier} {message}: {8 * len(names)} Arm")
        for place, name in enumerate(names):
            lines.append(f' SG_ {name} : {64 * place}|64@1- (1,0) [0|0] "" Arm')
            doubles.append(f"SIG_VALTYPE_ {identifier} {name} : 2;")
        formats.append(f'BA_ "VFrameFormat" BO_ {identifier} 2;')
    enum = '"StandardCAN","ExtendedCAN","StandardCAN_FD","ExtendedCAN_FD"'
    lines += [*doubles, f'BA_DEF_ BO_ "VFrameFormat" ENUM {enum};', *formats]
    return "\n".join(lines) + "\n"


def write_can_log(path, t_s, angles, speeds, torques):
    path.with_name("arm.dbc").write_text(make_database(), encoding="utf-8")
    with can.Logger(path) as log:
        for t, state, torque in zip(t_s, np.hstack([angles, speeds]), torques, strict=True):
            for identifier, values in ((0x100, state), (0x101, torque)):
                log.on_message_received(
                    can.Message(
                        timestamp=1.7e9 + t,
                        arbitration_id=identifier,
                        data=values.astype("<f8").tobytes(),
                        is_extended_id=False,
                        is_fd=True,
                        channel=0,
                    )
                )


KINDS = {
    "hdf5": (write_hdf5, ".h5", "t", {"q": "arm/q[{0}]", "w": "arm/w[{0}]", "tau": "tau[{0}]"}),
    "db3": (lambda *a: write_ros(*a, StoragePlugin.SQLITE3), "", "header.stamp", {}),
    "mcap": (lambda *a: write_ros(*a, StoragePlugin.MCAP), "", "log time", {}),
    "json": (write_json, ".mcap", "log time", {}),
    "can": (
        write_can_log,
        ".blf",
        "log time",
        {"q": "State.q{2}", "w": "State.w{2}", "tau": "Torque.tau{2}"},
    ),
}
OF_BAGS = {
    "q": "/joint_states:position[{1}]",
    "w": "/joint_states:velocity[{1}]",
    "tau": "/told:effort[{1}]",
}


def convert(campaign, folder, kind, **options):
    """The same campaign with its recordings as files of another kind."""
    write, ending, time, columns = KINDS[kind]
    shutil.copytree(campaign, folder)
    text = (
        (folder / "experiment.toml")
        .read_text(encoding="utf-8")
        .replace('column = "t"', f'column = "{time}"')
    )
    for file in folder.glob("*.csv"):
        rows = np.loadtxt(file, delimiter=",", skiprows=1)
        write(
            file.with_suffix(ending),
            rows[:, 0],
            rows[:, 1:4],
            rows[:, 4:7],
            rows[:, 7:10],
            **options,
        )
        text = text.replace(file.name, file.with_suffix(ending).name)
        file.unlink()
    for letter, column in (columns or OF_BAGS).items():
        for place, joint in enumerate(JOINTS):
            column_name = column.format(place, joint, place + 1)
            text = text.replace(f'"{letter}{place + 1}"', f'"{column_name}"')
    if kind == "can":
        text += '\n[can]\ndatabases = ["arm.dbc"]\n'
    (folder / "experiment.toml").write_text(text, encoding="utf-8")
    return folder


def window_starts_s(folder):
    """Where the windows of the recordings begin."""
    experiment = read_experiment(folder)
    conditions = prepare_mechanism(experiment, load_mechanism(experiment.model)).conditions
    return [corrected.window.start_s for condition in conditions for corrected in condition.windows]


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_file_gives_the_runs_that_csv_files_give(campaign, tmp_path, kind):
    found = read_experiment(convert(campaign, tmp_path / "arm", kind))
    expected = read_experiment(campaign)
    assert len(found.runs) == len(expected.runs) == 2
    for run, same in zip(found.runs, expected.runs, strict=True):
        assert (run.label, run.condition, run.driven) == (same.label, same.condition, same.driven)
        np.testing.assert_allclose(run.t_s, same.t_s, rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(run.signals, same.signals, rtol=1e-12)
        np.testing.assert_allclose(run.commands, same.commands, rtol=1e-12)


@pytest.mark.long
def test_a_bag_is_diagnosed_as_the_csv_file_is(campaign, tmp_path):
    answers = []
    for folder in (campaign, convert(campaign, tmp_path / "arm", "db3")):
        out = tmp_path / f"of {folder.parent.name}"
        ran = CliRunner().invoke(app, ["diagnose", str(folder), "--out", str(out)])
        assert ran.exit_code == 0, ran.output
        answers.append(json.loads((out / "diagnosis.json").read_text(encoding="utf-8")))
    assert answers[0]["grade"] == answers[1]["grade"]
    assert answers[0]["recordings"] != answers[1]["recordings"]


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_recording_that_changes_makes_another_campaign(campaign, tmp_path, kind):
    folder = convert(campaign, tmp_path / "arm", kind)
    identity = identity_of_tables("arm", folder)
    sums = fingerprint(folder)
    (file,) = [file for file in folder.rglob("*run1*") if file.is_file()]
    file.write_bytes(file.read_bytes() + b"more")
    assert identity_of_tables("arm", folder) != identity
    assert fingerprint(folder) != sums


@pytest.fixture(scope="module")
def longer(tmp_path_factory):
    return write_campaign(
        tmp_path_factory.mktemp("longer") / "arm", Arm(), [record(Arm(), 3.0, 0)], {}
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gap_s", "expected_s"),
    [
        ((0.0, 0.0), [0.06, 0.56, 1.06, 1.56, 2.06]),
        ((1.0, 1.2), [0.06, 1.56, 2.06]),
        ((0.9, 1.9), [0.06, 2.06]),
    ],
)
def test_no_window_reaches_into_a_gap_of_one_topic(longer, tmp_path, gap_s, expected_s):
    """Each lasts 0.5 s, with a margin of 0.1 s on both sides."""
    assert window_starts_s(
        convert(longer, tmp_path / "arm", "json", leave_out_s=gap_s)
    ) == pytest.approx(expected_s)
