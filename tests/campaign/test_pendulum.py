"""Folders of pendulum recordings: what is read, and one line for whatever cannot be."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from rfca_rig.campaign.pendulum import read_pendulum_campaign
from rfca_rig.errors import BadInput
from tests.campaign.small import cell, edit, line, swap

DATA = Path(__file__).parents[1] / "data" / "dfki-pendulum"
TOML = "pendulum.toml"
RUN = "runs/swing-up-1.csv"


@pytest.mark.parametrize(
    ("name", "joints", "runs"), [("simple", 1, 2), ("simple-heavier", 1, 1), ("double", 2, 2)]
)
def test_the_real_recordings_are_read_as_they_stand(name, joints, runs):
    campaign = read_pendulum_campaign(DATA / name)
    assert len(campaign.pendulum.links) == joints
    assert len(campaign.runs) == runs
    for run in campaign.runs:
        assert (
            run.angle_rad.shape
            == run.speed_rad_s.shape
            == run.torque_Nm.shape
            == (len(run.t_s), joints)
        )
    assert "Redistribution" in (DATA / name / "LICENSE.txt").read_text()


def test_every_column_lands_where_the_file_says():
    run = read_pendulum_campaign(DATA / "double").runs[1]
    raw = np.loadtxt(DATA / "double" / "runs" / "swing-up-2.csv", delimiter=",", skiprows=1)
    read = np.column_stack([run.t_s, run.angle_rad, run.speed_rad_s, run.torque_Nm])
    assert (read == raw).all()
    assert run.label == "swing-up, repeat 2"


def test_believed_values_and_how_well_they_are_known_are_those_of_the_file():
    campaign = read_pendulum_campaign(DATA / "double")
    assert campaign.pendulum.links[1].centre_of_mass_m == 0.2557
    assert campaign.pendulum.links[0].joint_friction_Nm == 0.0
    assert campaign.known_to == {
        "mass_relative": 0.05,
        "centre_of_mass_m": 0.01,
        "joint_damping_Nm_s_per_rad": 0.003,
        "zero_offset_rad": 0.005,
        "torque_delay_s": 0.004,
        "torque_error_relative": 0.03,
    }


def copied(folder: Path, name: str = "double") -> Path:
    return Path(shutil.copytree(DATA / name, folder / name))


def test_only_the_part_that_counts_is_kept(tmp_path):
    campaign = copied(tmp_path)
    edit(campaign / TOML, swap("repeat = 1", "repeat = 1\nfrom_s = 1.0\nto_s = 2.0"))
    t_s = read_pendulum_campaign(campaign).runs[0].t_s
    assert 1.0 <= t_s[0] < 1.01 and 1.99 < t_s[-1] <= 2.0


def test_a_joint_that_is_not_driven_needs_no_torque_and_speeds_may_be_absent(tmp_path):
    campaign = copied(tmp_path)
    edit(campaign / TOML, swap('torque2_Nm = "tau_meas2"\n', ""))
    edit(campaign / TOML, swap('speed2_rad_s = "vel_meas2"\n', ""))
    edit(campaign / TOML, swap("[known_to]", "driven = false\n[known_to]"))
    run = read_pendulum_campaign(campaign).runs[0]
    assert run.speed_rad_s is None
    assert (run.torque_Nm[:, 1] == 0.0).all() and (run.torque_Nm[:, 0] != 0.0).any()


FAULTS = {
    "another format": (
        TOML,
        swap("rfca-pendulum/1", "rfca-pendulum/2"),
        f"{TOML}:1: format: should be 'rfca-pendulum/1'",
    ),
    "misspelt key": (
        TOML,
        swap("centre_of_mass_m", "center_of_mass_m"),
        f"{TOML}:7: link1.center_of_mass_m: unknown key; did you mean",
    ),
    "no mass": (TOML, swap("mass_kg = 0.5235\n", ""), f"{TOML}:4: link1.mass_kg: missing"),
    "inertia about the centre": (
        TOML,
        swap("0.03189", "0.00189"),
        "link1: inertia_kg_m2 is about the joint and so at least 0.02094",
    ),
    "no torque named": (
        TOML,
        swap('torque2_Nm = "tau_meas2"\n', ""),
        "columns.torque2_Nm: missing; name the CSV column that holds it",
    ),
    "a column that is not there": (
        TOML,
        swap('"pos_meas2"', '"pos2"'),
        f"{RUN}:1: column pos2, which is to hold angle2_rad, is missing",
    ),
    "a file that is not there": (TOML, swap("swing-up-2.csv", "swing-up-3.csv"), "runs[2].file: "),
    "a file named twice": (
        TOML,
        swap("swing-up-2.csv", "swing-up-1.csv"),
        f"runs[2].file: {RUN} is already the file of runs[1]",
    ),
    "a repeat twice": (
        TOML,
        swap("repeat = 2", "repeat = 1"),
        "runs[2].repeat: swing-up, repeat 1 is already runs[1]",
    ),
    "a file outside": (
        TOML,
        swap(RUN, "../secret.csv"),
        "runs[1].file: must lie inside the folder",
    ),
    "an end before the start": (
        TOML,
        swap("repeat = 1", "from_s = 2.0\nto_s = 1.0"),
        "runs[1]: to_s should be after from_s, 2 s",
    ),
    "nothing in the part": (
        TOML,
        swap("repeat = 1", "from_s = 100.0"),
        f"{RUN}: 0 samples between from_s and to_s",
    ),
    "not a number": (RUN, cell(5, 3, "nan"), f"{RUN}:5: column pos_meas2: nan is not a value"),
    "time backwards": (RUN, cell(5, 1, "0.0"), f"{RUN}:5: time does not run forwards"),
    "a row cut short": (RUN, line(6, "0.1,2"), f"{RUN}:6: 2 cells in the line for 7 columns"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_one_line_that_says_where(tmp_path, fault):
    file, change, said = FAULTS[fault]
    campaign = copied(tmp_path)
    edit(campaign / file, change)
    with pytest.raises(BadInput) as caught:
        read_pendulum_campaign(campaign)
    assert "\n" not in str(caught.value)
    assert said in str(caught.value)
    assert str(campaign) in str(caught.value)


def test_columns_of_a_second_link_that_is_not_there_are_refused(tmp_path):
    campaign = copied(tmp_path, "simple")
    edit(
        campaign / TOML,
        swap('torque1_Nm = "torque"', 'torque1_Nm = "torque"\nangle2_rad = "position"'),
    )
    with pytest.raises(BadInput, match=r"columns\.angle2_rad: there is no \[link2\]"):
        read_pendulum_campaign(campaign)


def test_a_folder_that_is_none_says_what_one_is(tmp_path):
    with pytest.raises(
        BadInput, match=r"recordings of a pendulum are a folder with pendulum\.toml"
    ):
        read_pendulum_campaign(tmp_path)
