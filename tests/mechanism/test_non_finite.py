"""A number of a model file that is not finite is refused, whatever it belongs to: MuJoCo reads a
mass of "nan" as none, and goes on.
"""

import re
from pathlib import Path

import pytest

from rfca_rig.errors import BadInput
from rfca_rig.mechanism.load import load_mechanism

MODEL = """<mujoco model="m">
<compiler boundmass="0" boundinertia="0" angle="radian"/>
<option timestep="0.002" gravity="0 0 -9.81" wind="0 0 0" density="0" viscosity="0" impratio="1" tolerance="1e-8" noslip_tolerance="1e-6"/>
<!-- mass="nan" is what this is about, and
     inertia="inf" -->
<size memory="1M"/>
<visual><map znear="0.01"/></visual>
<statistic extent="1" meansize="0.1"/>
<default><joint damping="0.1" armature="0.01"/><default class="stiff"><joint stiffness="2"/></default></default>
<worldbody>
 <geom name="floor" type="plane" size="1 1 0.1" pos="0 0 -1" friction="1 0.005 0.0001" solref="0.02 1" solimp="0.9 0.95 0.001 0.5 2"/>
 <body name="link" pos="0 0 0.5" quat="1 0 0 0" gravcomp="0">
  <joint name="hinge" class="stiff" type="hinge" axis="0 1 0" pos="0 0 0" range="-1 1" ref="0" springref="0" margin="0"
   frictionloss="0.01"/>
  <inertial pos="0 0 -0.1" mass="1" diaginertia="0.1 0.1 0.1"/>
  <geom name="rod" type="capsule" fromto="0 0 0 0 0 -0.2" size="0.01" mass="0.1" rgba="1 1 1 1" margin="0" gap="0"/>
  <site name="tip" pos="0 0 -0.2" size="0.01"/>
  <body name="inner"><joint name="slide" type="slide" axis="0 0 1"/><geom name="ball" size="0.02" density="1000" euler="0 0 0"/></body>
 </body>
</worldbody>
<contact><pair geom1="floor" geom2="ball" friction="1 1 0.005 0.0001 0.0001" solref="0.02 1" margin="0"/></contact>
<equality><joint joint1="hinge" joint2="slide" polycoef="0 1 0 0 0" active="false"/></equality>
<actuator>
 <motor name="motor" joint="hinge" gear="1" ctrlrange="-1 1" forcerange="-1 1"/>
 <position name="servo" joint="slide" kp="10" kv="1"/>
</actuator>
<sensor><accelerometer name="acceleration" site="tip" noise="0.1" cutoff="0"/></sensor>
<keyframe><key name="start" qpos="0 0" qvel="0 0" time="0"/></keyframe>
</mujoco>
"""
URDF = """<robot name="r">
<link name="base"/>
<link name="arm"><inertial><origin xyz="0 0 -0.1" rpy="0 0 0"/><mass value="1"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 0" rpy="0 0 0"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="10" velocity="5"/><dynamics damping="0.1" friction="0.1"/></joint>
</robot>
"""
NUMBER = r"[-+]?\d[\d.e+-]*"
NUMERIC = re.compile(rf'(\w+)="({NUMBER}(?: {NUMBER})*)"')


def numeric_attributes(text: str) -> list[pytest.param]:
    """The place of each last number of an attribute, outside of comments."""
    if "<!--" in text:
        comment = range(*re.search(r"<!--.*-->", text, re.DOTALL).span())
    else:
        comment = range(0)
    attributes = [
        attribute for attribute in NUMERIC.finditer(text) if attribute.start() not in comment
    ]
    return [
        pytest.param(
            attribute.end(2) - len(attribute[2].split()[-1]), attribute.end(2), id=attribute[1]
        )
        for attribute in attributes
    ]


def check_refused(path: Path, text: str, start: int, end: int, word: str) -> None:
    path.write_text(f"{text[:start]}{word}{text[end:]}", encoding="utf-8")
    line = text.count("\n", 0, start) + 1
    with pytest.raises(BadInput) as refused:
        load_mechanism(path)
    assert re.fullmatch(
        rf"{re.escape(str(path))}:{line}: \w+: \w+ is '.*{re.escape(word)}', which is no "
        r"finite number; "
        "give a finite number, or remove the attribute",
        str(refused.value),
    )


@pytest.mark.parametrize(("start", "end"), numeric_attributes(MODEL))
def test_no_attribute_of_mjcf_may_be_other_than_finite(tmp_path, start, end):
    for word in ("nan", "inf"):
        check_refused(tmp_path / "model.xml", MODEL, start, end, word)


@pytest.mark.parametrize(("start", "end"), numeric_attributes(URDF))
def test_no_attribute_of_urdf_may_be_other_than_finite(tmp_path, start, end):
    check_refused(tmp_path / "model.urdf", URDF, start, end, "nan")


@pytest.mark.parametrize("word", ["NaN", "-nan", "nan(12)", "-INF", "+infinity", "1e999"])
def test_every_spelling_counts(tmp_path, word):
    start = MODEL.index('mass="1"') + len('mass="')
    check_refused(tmp_path / "model.xml", MODEL, start, start + 1, word)


def test_a_spelling_by_entities_counts(tmp_path):
    (tmp_path / "model.xml").write_text(
        MODEL.replace('mass="1"', 'mass="&#110;an"'), encoding="utf-8"
    )
    with pytest.raises(BadInput, match="inertial: mass is 'nan', which is no finite number"):
        load_mechanism(tmp_path / "model.xml")


@pytest.mark.parametrize("allow_outside", [True, False])
def test_an_included_file_counts(tmp_path, allow_outside):
    (tmp_path / "part.xml").write_text(
        '<mujocoinclude>\n<body><geom size="0.1" mass="nan"/></body></mujocoinclude>',
        encoding="utf-8",
    )
    (tmp_path / "model.xml").write_text(
        MODEL.replace("</worldbody>", '<include file="part.xml"/></worldbody>'), encoding="utf-8"
    )
    with pytest.raises(BadInput, match=r"part.xml:2: geom: mass is 'nan'"):
        load_mechanism(tmp_path / "model.xml", allow_outside=allow_outside)


def test_a_name_that_reads_as_such_a_number_is_refused(tmp_path):
    (tmp_path / "model.xml").write_text(MODEL.replace('name="rod"', 'name="inf"'), encoding="utf-8")
    with pytest.raises(BadInput, match="geom: name is 'inf', which is no finite number; rename it"):
        load_mechanism(tmp_path / "model.xml")


@pytest.mark.parametrize(("name", "text"), [("model.xml", MODEL), ("model.urdf", URDF)])
def test_the_same_models_with_finite_numbers_are_read(tmp_path, name, text):
    (tmp_path / name).write_text(text, encoding="utf-8")
    assert "hinge" in load_mechanism(tmp_path / name).joints


@pytest.mark.parametrize("attribute", ["damping", "armature", "frictionloss", "range", "springref"])
def test_values_beyond_any_mechanism_are_refused_by_the_name_of_their_array(tmp_path, attribute):
    text = re.sub(
        rf'\b{attribute}="[^"]*"',
        f'{attribute}="{"0 " if attribute == "range" else ""}1e20"',
        MODEL,
    )
    (tmp_path / "model.xml").write_text(text, encoding="utf-8")
    with pytest.raises(
        BadInput, match=r"holds 1e\+20; values are finite, and 1e\+12 or less in size"
    ):
        load_mechanism(tmp_path / "model.xml")
