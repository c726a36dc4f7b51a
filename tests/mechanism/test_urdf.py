"""A URDF arm with two joints, whose meshes are not there, through the whole path."""

import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

from rfca_rig.cli.main import app
from rfca_rig.errors import BadInput
from rfca_rig.mechanism.load import load_mechanism
from tests.mechanism.arm import Arm, Friction, mjcf, record, write_campaign

ARM = Arm(length_m=(0.35, 0.3), mass_kg=(2.0, 1.4), zero_rad=(0.0, 0.0))
MESH = '<{kind}><geometry><mesh filename="package://arm/{name}.stl"/></geometry></{kind}>'


def urdf(arm, kind="visual", compiler=""):
    """The arm as its MJCF has it, with a mesh on every link."""
    links = '<link name="base"/>'
    joints = ""
    for number, (length, mass) in enumerate(zip(arm.length_m, arm.mass_kg, strict=True), start=1):
        about = mass * length**2 / 12.0
        inertia = f'<inertia ixx="{about}" iyy="{about}" izz="1e-4" ixy="0" ixz="0" iyz="0"/>'
        inertial = (
            f'<inertial><origin xyz="0 0 {-length / 2}"/><mass value="{mass}"/>{inertia}</inertial>'
        )
        links += (
            "<link "
            f'name="link{number}">{inertial}{MESH.format(kind=kind, name=f"link{number}")}</link>'
        )
        if number > 1:
            parent = f"link{number - 1}"
            at = -arm.length_m[number - 2]
        else:
            parent = "base"
            at = 0.0
        joints += (
            f'<joint name="joint{number}" type="continuous"><parent '
            f'link="{parent}"/><child link="link{number}"/>'
            f'<origin xyz="0 0 {at}"/><axis xyz="0 -1 0"/></joint>'
        )
    return f'<robot name="arm">{compiler}{links}{joints}</robot>'


SHOWN = '<mujoco><compiler discardvisual="false"/></mujoco>'


@pytest.mark.parametrize("compiler", ["", SHOWN])
def test_a_urdf_without_its_visual_meshes_is_the_same_arm_with_a_motor_on_every_joint(
    tmp_path, compiler
):
    (tmp_path / "arm.urdf").write_text(urdf(ARM, compiler=compiler), encoding="utf-8")
    (tmp_path / "arm.xml").write_text(mjcf(ARM), encoding="utf-8")
    ours = load_mechanism(tmp_path / "arm.urdf")
    theirs = load_mechanism(tmp_path / "arm.xml")
    assert ours.joints == ours.actuators == ("joint1", "joint2")
    assert ours.driven.all()
    accelerations = []
    for model in (ours.model, theirs.model):
        data = mujoco.MjData(model)
        data.qpos[:] = (0.7, -0.3)
        data.qvel[:] = (1.0, 2.0)
        data.ctrl[:] = (3.0, -1.0)
        mujoco.mj_forward(model, data)
        accelerations.append(data.qacc.copy())
    assert accelerations[0] == pytest.approx(accelerations[1], rel=1e-6)


def test_a_missing_mesh_of_a_collision_is_refused_in_one_line(tmp_path):
    (tmp_path / "arm.urdf").write_text(urdf(ARM, "collision"), encoding="utf-8")
    with pytest.raises(BadInput) as refused:
        load_mechanism(tmp_path / "arm.urdf")
    assert (
        "mesh package://arm/link1.stl of body 'link1' is not there, and contacts depend on it"
        in str(refused.value)
    )
    assert "\n" not in str(refused.value)


def test_a_missing_mesh_that_a_mass_comes_from_is_refused(tmp_path):
    text = urdf(ARM, compiler=SHOWN)
    start = text.index("<inertial>")
    end = text.index("</inertial>") + len("</inertial>")
    (tmp_path / "arm.urdf").write_text(text[:start] + text[end:], encoding="utf-8")
    with pytest.raises(BadInput, match="the mass depends on it"):
        load_mechanism(tmp_path / "arm.urdf")


@pytest.fixture
def folder(tmp_path):
    recordings = [record(replace(ARM, friction=Friction((0.3, 0.2))), 6.0, seed) for seed in (0, 1)]
    folder = write_campaign(
        tmp_path / "arm", ARM, recordings, {"mass_relative": 0.02, "zero_offset_rad": 0.002}
    )
    (folder / "model.xml").unlink()
    (folder / "arm.urdf").write_text(urdf(ARM), encoding="utf-8")
    return folder


@pytest.mark.slow
def test_a_urdf_is_drafted_and_checked(folder):
    path = folder / "experiment.toml"
    text = path.read_text(encoding="utf-8")
    path.unlink()
    ran = CliRunner().invoke(
        app, ["init", "--urdf", str(folder / "arm.urdf"), "--data", str(folder)]
    )
    assert ran.exit_code == 0, ran.output
    draft = path.read_text(encoding="utf-8")
    assert 'model = "arm.urdf"' in draft
    assert draft.count('actuator = "joint') == 2
    path.write_text(
        text.replace("model.xml", "arm.urdf").replace('"motor', '"joint'), encoding="utf-8"
    )
    ran = CliRunner().invoke(app, ["check", str(folder), "--json"])
    assert ran.exit_code == 0, ran.output
    assert "WARNING" not in ran.output


@pytest.mark.long
def test_friction_of_a_urdf_arm_is_stated_and_stands_in_the_amended_model(folder, tmp_path):
    path = folder / "experiment.toml"
    path.write_text(
        path.read_text(encoding="utf-8")
        .replace("model.xml", "arm.urdf")
        .replace('"motor', '"joint'),
        encoding="utf-8",
    )
    ran = CliRunner().invoke(app, ["diagnose", str(folder), "--out", str(tmp_path / "out")])
    assert ran.exit_code == 0, ran.output
    answer = json.loads((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))
    assert [effect["id"] for effect in answer["effects"]] == ["joint_friction"]
    amended = load_mechanism(tmp_path / "out" / "model.xml")
    assert amended.actuators == ("joint1", "joint2")
    assert np.asarray(amended.model.dof_frictionloss) == pytest.approx([0.3, 0.2], rel=0.25)
