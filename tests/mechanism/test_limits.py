"""What a model file states and the recordings contradict, and parts of a file that are found,
dropped or tied.
"""

import shutil

import mujoco
import numpy as np
import pytest

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.diagnosis.mechanisms.check import check_experiment, refuse_misread_columns
from rfca_rig.diagnosis.mechanisms.limits import find_limit_conflicts
from rfca_rig.diagnosis.mechanisms.nuisances import MechanismInput
from rfca_rig.diagnosis.mechanisms.prepared import assign_roles, prepare_mechanism
from rfca_rig.errors import BadInput
from rfca_rig.mechanism.load import load_mechanism
from rfca_rig.mechanism.model_files import write_amended_model
from tests.mechanism.arm import Arm, record, write_campaign
from tests.mechanism.test_check import edit, edit_column, until_priors, warnings

ARM = Arm(length_m=(0.35, 0.3), mass_kg=(2.0, 1.4), zero_rad=(0.0, 0.0))
JOINT = 'type="hinge" axis="0 -1 0"'


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    folder = tmp_path_factory.mktemp("limits") / "arm"
    return write_campaign(folder, ARM, [record(ARM, 3.4, 0)], {"mass_relative": 0.02})


@pytest.fixture
def folder(campaign, tmp_path):
    return shutil.copytree(campaign, tmp_path / "arm")


def limit_joint(folder, text):
    """The attributes are those of the first joint."""
    model = folder / "model.xml"
    whole = model.read_text(encoding="utf-8")
    model.write_text(whole.replace(JOINT, f"{JOINT} {text}", 1), encoding="utf-8")


def limit_motor(folder, text):
    edit(folder / "model.xml", ('joint="joint1" gear="1"', f'joint="joint1" {text}'))


def find(folder):
    experiment = read_experiment(folder)
    return find_limit_conflicts(experiment, experiment.load_model())


def test_a_model_without_limits_contradicts_nothing(folder):
    assert find(folder) == []


def test_a_joint_beyond_its_range_is_named_with_the_share_of_its_samples(folder):
    angle_rad = np.radians(np.loadtxt(folder / "run1.csv", delimiter=",", skiprows=1)[:, 1])
    low, high = np.quantile(angle_rad, [0.0, 0.7])
    limit_joint(folder, f'range="{np.degrees(low):.6f} {np.degrees(high):.6f}"')
    (conflict,) = find(folder)
    assert (conflict.table, conflict.column, conflict.is_cut) == ("signal", "q1", False)
    beyond = float(np.mean(angle_rad > high + 0.02 * (high - low)))
    assert conflict.share == pytest.approx(beyond, abs=1e-3)
    assert f"{100.0 * conflict.share:.2g} % of the samples pass" in conflict.words
    experiment = read_experiment(folder)
    with pytest.raises(BadInput, match=r"model\.xml: joint joint1 is recorded from .* --as-is"):
        refuse_misread_columns(experiment, experiment.load_model())


def test_a_stop_that_is_just_reached_is_no_contradiction(folder):
    angle_deg = np.loadtxt(folder / "run1.csv", delimiter=",", skiprows=1)[:, 1]
    limit_joint(folder, f'range="{angle_deg.min():.6f} {angle_deg.max() - 0.01:.6f}"')
    assert find(folder) == []


@pytest.mark.parametrize("what", ["ctrlrange", "forcerange", "actuatorfrcrange"])
@pytest.mark.parametrize("gear", [1.0, -2.0])
def test_a_torque_beyond_a_limit_is_named_and_simulated_uncut(folder, what, gear):
    torque_Nm = np.loadtxt(folder / "run1.csv", delimiter=",", skiprows=1)[:, 5]
    edit_column(folder, "tau1", lambda torque: torque / gear, ("run1.csv",))
    most = float(np.quantile(np.abs(torque_Nm), 0.6))
    # The command, the actuator's force, and the joint's torque differ by the gear.
    of_limit = most if what == "actuatorfrcrange" else most / abs(gear)
    limit_motor(folder, f'gear="{gear:g}"')
    if what == "actuatorfrcrange":
        limit_joint(folder, f'actuatorfrcrange="-{of_limit:.6f} {of_limit:.6f}"')
    else:
        limit_motor_by(folder, gear, f'{what}="-{of_limit:.6f} {of_limit:.6f}"')
    (conflict,) = find(folder)
    assert (conflict.table, conflict.column, conflict.is_cut) == ("command", "tau1", True)
    assert conflict.share == pytest.approx(0.4, abs=0.01)
    assert what in conflict.words
    assert f"{most / abs(gear):.4g}" in conflict.words
    lines = [line for line in until_priors(folder) if line.is_warning]
    assert [line.name for line in lines] == ["tau1"]
    experiment = read_experiment(folder)
    mechanism = assign_roles(experiment, experiment.load_model())
    data = mujoco.MjData(mechanism.model)
    data.ctrl[0] = 3.0 * most / gear
    mujoco.mj_forward(mechanism.model, data)
    assert data.qfrc_actuator[0] == pytest.approx(3.0 * most)


def limit_motor_by(folder, gear, text):
    edit(
        folder / "model.xml",
        (f'joint="joint1" gear="{gear:g}"', f'joint="joint1" gear="{gear:g}" {text}'),
    )


def test_the_model_of_a_diagnosis_does_not_cut_the_torque_either(folder, tmp_path):
    limit_motor(folder, 'gear="1" ctrlrange="-0.1 0.1"')
    experiment = read_experiment(folder)
    prepared = prepare_mechanism(experiment, experiment.load_model())
    plant = prepared.simulator.plant(MechanismInput())
    write_amended_model(plant, tmp_path / "amended.xml")
    amended = load_mechanism(tmp_path / "amended.xml").model
    assert not amended.actuator_ctrllimited[0]


def test_a_balance_of_less_than_half_is_a_warning(folder):
    edit(
        folder / "model.xml",
        ('<body name="link1"', '<body name="link1" gravcomp="1"'),
        ('<body name="link2"', '<body name="link2" gravcomp="1"'),
    )
    said = warnings(until_priors(folder))
    balance = [words for words in said if words.startswith("balance")]
    assert balance
    assert all("look at the zero and the sign of the joint" in words for words in balance)
    assert all("gravcomp" in words for words in balance)


def write_mesh(path):
    """A tetrahedron."""
    path.parent.mkdir(parents=True, exist_ok=True)
    corners = ((0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.1))
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    lines += ["f 1 3 2", "f 1 2 4", "f 1 4 3", "f 2 3 4"]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


BODY = """<mujoco>{compiler}<asset><mesh name="arm" file="{file}"/></asset><worldbody>
<body name="link"><joint name="joint" axis="0 -1 0"/>
<inertial pos="0 0 -0.1" mass="1" diaginertia="0.01 0.01 0.001"/>
<geom type="mesh" mesh="arm" {contacts}/></body></worldbody></mujoco>"""
VISUAL = 'contype="0" conaffinity="0"'
INCLUDING = '<mujoco><include file="robot/robot.xml"/></mujoco>'
ATTACHING = """<mujoco><asset><model name="robot" file="robot/robot.xml"/></asset>
<worldbody><attach model="robot" body="link" prefix="a_"/></worldbody></mujoco>"""
# The model, the file of the part, its compiler and the name of the mesh, and where the mesh is.
PLACES = {
    "beside the model": (None, "", "arm.obj", "arm.obj"),
    "meshdir": (None, '<compiler meshdir="assets"/>', "arm.obj", "assets/arm.obj"),
    "strippath": (
        None,
        '<compiler meshdir="assets" strippath="true"/>',
        "cad/v2/arm.obj",
        "assets/arm.obj",
    ),
    "an included part": (INCLUDING, "", "arm.obj", "robot/arm.obj"),
    "an attached part": (
        ATTACHING,
        '<compiler meshdir="assets"/>',
        "arm.obj",
        "robot/assets/arm.obj",
    ),
}


@pytest.mark.parametrize("contacts", [VISUAL, ""], ids=["visual", "touching"])
@pytest.mark.parametrize("place", PLACES)
def test_a_mesh_is_where_mujoco_looks_for_it(tmp_path, monkeypatch, place, contacts):
    outer, compiler, file, mesh = PLACES[place]
    model = tmp_path / "model.xml"
    part = model if outer is None else tmp_path / "robot" / "robot.xml"
    part.parent.mkdir(exist_ok=True)
    part.write_text(BODY.format(compiler=compiler, file=file, contacts=contacts), encoding="utf-8")
    if outer is not None:
        model.write_text(outer, encoding="utf-8")
    write_mesh(tmp_path / mesh)
    loaded = load_mechanism(model)
    assert loaded.model.ngeom == 1
    assert loaded.dropped == ()
    # The same by a path from the working directory.
    monkeypatch.chdir(tmp_path)
    assert load_mechanism(model.relative_to(tmp_path)).model.ngeom == 1
    (tmp_path / mesh).unlink()
    if contacts == VISUAL:
        without = load_mechanism(model)
        assert without.model.ngeom == 0
        (words,) = without.dropped
        assert "arm.obj, which is not there" in words
    else:
        with pytest.raises(BadInput, match=r"arm\.obj of body .* is not there, and contacts"):
            load_mechanism(model)


def test_what_was_dropped_is_a_line_of_the_check(folder):
    edit(
        folder / "model.xml",
        ("<worldbody>", '<asset><mesh name="arm" file="arm.obj"/></asset><worldbody>'),
        ("<inertial", f'<geom type="mesh" mesh="arm" {VISUAL}/><inertial'),
    )
    lines = [line.words for line in until_priors(folder) if line.about == "model"]
    assert lines[1] == "left out: the visual mesh arm.obj, which is not there"


@pytest.mark.parametrize(
    ("polynomial", "said"),
    [
        ("0 -1 0 0 0", "state the column of joint 'joint1' for it, with sign = -1"),
        ("0 1 0 0 0", "state the column of joint 'joint1' for it, with sign = 1"),
        ("0 0.5 0 0 0", "compute its column from that of joint 'joint1', and state it"),
    ],
)
def test_a_joint_that_an_equality_ties_says_how_to_state_its_column(folder, polynomial, said):
    edit(
        folder / "model.xml",
        (
            "<actuator>",
            f'<equality><joint joint1="joint2" joint2="joint1" polycoef="{polynomial}"/>'
            "</equality><actuator>",
        ),
    )
    edit(
        folder / "experiment.toml",
        (', { joint = "joint2", quantity = "position", column = "q2", unit = "deg" }', ""),
    )
    experiment = read_experiment(folder)
    with pytest.raises(BadInput) as refused:
        assign_roles(experiment, experiment.load_model())
    assert "no signal holds the position of joint 'joint2'; an equality ties it" in str(
        refused.value
    )
    assert said in str(refused.value)


def state_units(folder, of_torque):
    """A row of units in the file of the recordings."""
    path = folder / "run1.csv"
    header, rest = path.read_text(encoding="utf-8").split("\n", 1)
    units = ["s", "deg", "deg", "rad/s", "rad/s", of_torque, "N m"]
    path.write_text(f"{header}\n{','.join(units)}\n{rest}", encoding="utf-8")


def test_a_unit_of_the_file_that_contradicts_the_description_is_a_warning(folder):
    state_units(folder, "Nm")
    lines = list(until_priors(folder))
    assert warnings(lines) == []
    assert [line.words for line in lines if "units" in line.words] == ["line 2 holds units"]


def test_a_diagnosis_refuses_a_unit_that_the_file_contradicts(folder):
    state_units(folder, "mNm")
    words = "the file states the unit mNm, experiment.toml N m; correct one"
    assert f"signal tau1: {words}" in warnings(check_experiment(folder))
    experiment = read_experiment(folder)
    with pytest.raises(BadInput, match=rf"column tau1 of .*: {words}, or take it with --as-is"):
        refuse_misread_columns(experiment, experiment.load_model())
