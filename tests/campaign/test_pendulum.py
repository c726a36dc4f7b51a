"""Folders of pendulum recordings: what is read, and one line for whatever cannot be."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from rfca_rig.campaign.pendulum import fit_links, read_pendulum, read_pendulum_file
from rfca_rig.errors import BadInput
from rfca_rig.mechanism.nuisances import NUISANCES
from rfca_rig.mechanism.plant import make_plant
from tests.campaign.small import cell, edit, line, swap

DATA = Path(__file__).parents[1] / "data" / "pendulums"
TOML = "pendulum.toml"
RUN = "runs/sines-1.csv"


@pytest.mark.parametrize(("name", "joints", "runs"), [("geared", 1, 2), ("double", 2, 2)])
def test_recordings_are_read_as_they_stand(name, joints, runs):
    experiment = read_pendulum(DATA / name)
    assert experiment.load_model().joints == tuple(f"joint{n + 1}" for n in range(joints))
    assert len(experiment.runs) == runs
    for run in experiment.runs:
        assert run.signals.shape == (len(run.t_s), 2 * joints)
        assert run.commands.shape == (len(run.t_s), joints)


def test_every_column_lands_where_the_file_says():
    experiment = read_pendulum(DATA / "double")
    run = experiment.runs[1]
    raw = np.loadtxt(DATA / "double" / "runs" / "sines-2.csv", delimiter=",", skiprows=1)
    read = np.column_stack([run.t_s, run.signals, run.commands])
    assert (read == raw).all()
    assert run.label == "sines, repeat 2"
    assert [(signal.name, signal.quantity) for signal in experiment.signals] == [
        ("joint1", "position"),
        ("joint2", "position"),
        ("joint1", "speed"),
        ("joint2", "speed"),
    ]


def test_believed_values_and_how_well_they_are_known_are_those_of_the_file():
    experiment = read_pendulum(DATA / "double")
    model = experiment.load_model().model
    assert model.body("link2").ipos[2] == -0.2557
    assert model.dof_frictionloss[0] == 0.0
    assert experiment.known_to == {
        "mass_relative": 0.05,
        "centre_of_mass_m": 0.01,
        "joint_damping_Nm_s_per_rad": 0.003,
        "zero_offset_rad": 0.005,
        "command_delay_s": 0.004,
        "torque_error_relative": 0.03,
    }


def copied(folder: Path, name: str = "double") -> Path:
    return Path(shutil.copytree(DATA / name, folder / name))


def test_only_the_part_that_counts_is_kept(tmp_path):
    campaign = copied(tmp_path)
    edit(campaign / TOML, swap("repeat = 1", "repeat = 1\nfrom_s = 1.0\nto_s = 2.0"))
    t_s = read_pendulum(campaign).runs[0].t_s
    assert 1.0 <= t_s[0] < 1.01 and 1.99 < t_s[-1] <= 2.0


def test_a_joint_that_is_not_driven_needs_no_torque_and_speeds_may_be_absent(tmp_path):
    campaign = copied(tmp_path)
    edit(campaign / TOML, swap('torque2_Nm = "tau_meas2"\n', ""))
    edit(campaign / TOML, swap('speed2_rad_s = "vel_meas2"\n', ""))
    edit(campaign / TOML, swap("[known_to]", "driven = false\n[known_to]"))
    experiment = read_pendulum(campaign)
    assert [signal.quantity for signal in experiment.signals] == ["position", "position"]
    assert experiment.actuators == ("motor1",)
    assert experiment.load_model().driven.tolist() == [True, False]
    assert (experiment.runs[0].commands != 0.0).any()


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
        f"{RUN}:1: column pos2, which is to hold the position of joint joint2, is missing",
    ),
    "a file that is not there": (TOML, swap("sines-2.csv", "sines-3.csv"), "runs[2].file: "),
    "a file named twice": (
        TOML,
        swap("sines-2.csv", "sines-1.csv"),
        f"runs[2].file: {RUN} is already the file of runs[1]",
    ),
    "a repeat twice": (
        TOML,
        swap("repeat = 2", "repeat = 1"),
        "runs[2].repeat: sines, repeat 1 is already runs[1]",
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
        read_pendulum(campaign)
    assert "\n" not in str(caught.value)
    assert said in str(caught.value)
    assert str(campaign) in str(caught.value)


def test_columns_of_a_second_link_that_is_not_there_are_refused(tmp_path):
    campaign = copied(tmp_path, "geared")
    edit(
        campaign / TOML,
        swap('torque1_Nm = "torque"', 'torque1_Nm = "torque"\nangle2_rad = "position"'),
    )
    with pytest.raises(BadInput, match=r"columns\.angle2_rad: there is no \[link2\]"):
        read_pendulum(campaign)


def test_a_folder_that_is_none_says_what_one_is(tmp_path):
    with pytest.raises(
        BadInput, match=r"recordings of a pendulum are a folder with pendulum\.toml"
    ):
        read_pendulum(tmp_path)


def edited(folder: Path, old: str, new: str) -> Path:
    campaign = copied(folder, "geared")
    edit(campaign / TOML, swap(old, new))
    return campaign


def test_nominal_delays_and_offsets_of_the_torque_are_in_the_commands(tmp_path):
    plain = read_pendulum(DATA / "geared").runs[0]
    keys = "[known_to]"
    late = "torque_delay_s = 0.01\ntorque_offset_Nm = 0.02\nzero_offset_rad = 0.1\n[known_to]"
    experiment = read_pendulum(edited(tmp_path, keys, late))
    run = experiment.runs[0]
    inside = run.t_s > run.t_s[0] + 0.02
    expected = np.interp(run.t_s - 0.01, run.t_s, plain.commands[:, 0]) + 0.02
    assert run.commands[inside, 0] == pytest.approx(expected[inside])
    # The reading of a hanging pendulum is the offset of its zero.
    assert experiment.load_model().model.qpos0[0] == 0.1


def test_a_run_without_torques_has_its_motors_off(tmp_path):
    campaign = copied(tmp_path, "geared")
    run = sorted((campaign / "runs").glob("*.csv"))[0]
    header, *lines = run.read_text().splitlines()
    column = header.split(",").index("torque")
    rows = [line.split(",") for line in lines]
    for row in rows:
        row[column] = "0.0"
    run.write_text("\n".join([header, *(",".join(row) for row in rows)]) + "\n")
    driven = {run.label: run.driven for run in read_pendulum(campaign).runs}
    assert sorted(driven.values()) == [False, True]


def test_fitted_values_are_those_of_the_mechanism(tmp_path):
    """A shift of a nominal value does the same to the links of the file as to the mechanism."""
    described = read_pendulum_file(DATA / "double")
    mechanism = read_pendulum(DATA / "double").load_model()
    shifts = {
        "mass_relative": 0.1,
        "inertia_about_joint_relative": 0.2,
        "centre_of_mass_m": 0.01,
    }
    for key, by in shifts.items():
        plant = make_plant(mechanism, 1e-3)
        NUISANCES[key].shift(plant, 1, by)
        link = fit_links(described.links, {f"link2.{key}": by})[1]
        body = plant.model.body("link2")
        centre_m = float(np.linalg.norm(body.ipos))
        about_joint = float(body.inertia[1] + body.mass[0] * centre_m**2)
        assert link.mass_kg == pytest.approx(float(body.mass[0]))
        assert link.centre_of_mass_m == pytest.approx(centre_m)
        assert link.inertia_kg_m2 == pytest.approx(about_joint)
