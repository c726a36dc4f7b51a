"""Whatever a name is, it stays a name in every language that is written: property tests over the
writers.
"""

import ast
import csv
import html
import io
import json
import shutil
import tomllib
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from rfca_rig.campaign.experiment import make_draft
from rfca_rig.campaign.pendulum import LinkSection, write_pendulum_model
from rfca_rig.cli.main import app
from rfca_rig.cli.terminal import echo
from rfca_rig.description.model_file import write_model
from rfca_rig.diagnosis.experiment_design.mechanism_experiment import Excitation, write_excitation
from rfca_rig.errors import BadInput
from rfca_rig.escaping import (
    TURNS_DIRECTION,
    find_unusable_sign,
    html_text,
    json_text,
    printable,
    python_docstring,
    toml_comment,
    toml_key,
    toml_string,
)
from rfca_rig.mechanism.laws_file import write_laws
from rfca_rig.mechanism.load import load_mechanism
from rfca_rig.mechanism.plant import JointLaw, make_plant
from rfca_rig.public_data.registry import SETS
from rfca_rig.reports.html_table import as_html
from rfca_rig.reports.table import Table, TableColumn, TableRow, as_csv, as_tex
from rfca_rig.toml import format_value, table

MODEL = """<mujoco><worldbody><body name="link"><joint name="{joint}" type="hinge" axis="0 1 0"/>
<inertial pos="0 0 -0.1" mass="1" diaginertia="0.1 0.1 0.1"/></body></worldbody>
<actuator><motor name="{actuator}" joint="{joint}"/></actuator></mujoco>"""
HOSTILE = (
    's"""\nimport os\nos.system("true")\n"""',
    "ends with a backslash \\",
    '"""',
    'a"',
    "x\n[known_to]\nmass_relative = 1",
    '"] = 1\n[[signals]]',
    "\x1b]0;owned\x07\x9b2J\x7f",
    "\u202etxt.exe\u2066",
    "</title><script>alert(1)</script>",
    "' onmouseover='alert(1)",
    "a,b;c\td",
    "$\\frac{1}{2}$ {{ 7 * 7 }} %d {0}",
    "\u2028\u2029\x85\r\n\x00",
    "\\end{tabular}\\input{/etc/passwd}",
    "=1+1",
    "a\rb",
)
# Half of a surrogate pair can be in no file of UTF-8, so that no reader gives one.
ANY_NAME = st.one_of(
    st.sampled_from(HOSTILE),
    st.text(st.characters(exclude_categories=("Cs",)), min_size=1, max_size=40),
)
ONE_LINE = ANY_NAME.map(lambda name: " ".join(name.split()) or "x")


def hostile_names(function):
    """A property of one name: the known tricks, and whatever Hypothesis finds."""
    for name in HOSTILE:
        function = example(name)(function)
    return settings(max_examples=60, deadline=None)(given(ANY_NAME)(function))


@hostile_names
def test_python_reads_the_same_from_a_docstring(name):
    module = ast.parse(f'"""{python_docstring("first")}\n{python_docstring(name)}\n"""\n')
    assert len(module.body) == 1
    assert ast.get_docstring(module, clean=False) == f"first\n{name}\n"


@hostile_names
def test_toml_reads_the_same(name):
    # In a table of its own, since the name may be "a".
    assert tomllib.loads(f"a = {toml_string(name)}\n[b]\n{toml_key(name)} = 1\n") == {
        "a": name,
        "b": {name: 1},
    }
    nested = {"names": [name, {name: name}]}
    assert tomllib.loads(table("all", nested))["all"] == nested
    assert tomllib.loads(f"{toml_comment(name)}a = {format_value([name])}\n") == {"a": [name]}


@hostile_names
def test_html_reads_the_same_but_for_control_characters(name):
    assert html.unescape(html_text(name)) == printable(name)
    assert _elements(f'<p title="{html_text(name)}">{html_text(name)}</p>') == ["p"]


@hostile_names
def test_json_reads_the_same(name):
    written = json_text(json.dumps({name: name}, ensure_ascii=False))
    assert json.loads(written) == {name: name}
    assert printable(written) == written


@hostile_names
def test_a_terminal_gets_text_alone(name):
    stream = io.StringIO()
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("sys.stdout", stream)
        echo(name)
    controls = {*map(chr, range(32)), *map(chr, range(127, 160)), *TURNS_DIRECTION} - {"\n", "\t"}
    assert not controls & set(stream.getvalue())


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "model.xml"
    path.write_text(MODEL.format(joint="hinge", actuator="motor"), encoding="utf-8")
    plant = make_plant(load_mechanism(path), 1e-3)
    law = JointLaw(
        0,
        by_speed=True,
        knots=np.array([-1.0, 1.0]),
        values=np.array([0.1, 0.2]),
        branches=np.zeros(2),
    )
    one = np.array([0.1])
    return replace(
        plant, laws=(law,), stribeck=(one, one, one), hysteresis=(one, one), load_loss=one
    )


BEYOND = (
    "measured laws",
    "friction that falls with speed",
    "friction that grows with load",
    "hysteresis of the joints",
    "saturation of the commands",
)


def _laws(plant, folder: Path, name: str) -> str:
    mechanism = replace(plant.mechanism, joints=(name,), actuators=(name,))
    write_laws(
        replace(plant, mechanism=mechanism),
        BEYOND,
        folder / "laws.py",
        [f"found in {name}"],
        "model.xml",
    )
    return (folder / "laws.py").read_bytes().decode("utf-8")


@hostile_names
def test_laws_have_no_further_statements(plant, tmp_path_factory, name):
    folder = tmp_path_factory.getbasetemp()
    harmless, written = (ast.parse(_laws(plant, folder, one)) for one in ("hinge", name))
    assert [type(node) for node in ast.walk(written)] == [type(node) for node in ast.walk(harmless)]
    assert f"Joints, in this order: {name}.\n" in ast.get_docstring(written, clean=False)
    # Everything but the docstrings is the same program.
    assert _without_docstrings(written) == _without_docstrings(harmless)


def _without_docstrings(module: ast.Module) -> str:
    for node in ast.walk(module):
        if isinstance(node, ast.Module | ast.FunctionDef) and ast.get_docstring(node) is not None:
            del node.body[0]
    return ast.dump(module)


@settings(max_examples=40, deadline=None)
@given(ONE_LINE, ANY_NAME)
@example("t", HOSTILE[4])
@example(HOSTILE[5], HOSTILE[6])
def test_a_draft_names_columns_and_joints(plant, tmp_path_factory, time, name):
    folder = tmp_path_factory.mktemp("draft")
    with (folder / "a.csv").open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow([time, name])
        rows.writerows([[k, 1.0] for k in range(30)])
    mechanism = replace(
        plant.mechanism, joints=(name,), actuators=(name,), path=folder / "model.xml"
    )
    try:
        text = make_draft(mechanism, folder, {"CSV": [folder / "a.csv"]})
    except BadInput:
        return  # the table itself is refused, as for two columns of one name
    written = tomllib.loads(text)
    assert [signal["joint"] for signal in written["signals"] if "joint" in signal] == [name, name]
    assert [command["actuator"] for command in written["commands"]] == [name]
    assert set(written) == {
        "format",
        "title",
        "model",
        "time",
        "signals",
        "commands",
        "known_to",
        "recordings",
    }
    assert set(written["known_to"]) == {"mass_relative", "zero_offset_deg", "torque_error_relative"}


@hostile_names
def test_model_files_keep_comments_and_texts(tmp_path_factory, name):
    path = tmp_path_factory.getbasetemp() / "pendulum.toml"
    link = LinkSection(
        length_m=0.5,
        mass_kg=1.0,
        centre_of_mass_m=0.3,
        inertia_kg_m2=0.1,
        joint_damping_Nm_s_per_rad=0.01,
    )
    write_pendulum_model(path, [link], {}, [name])
    assert set(tomllib.loads(path.read_bytes().decode())) == {"format", "link1", "known_to"}
    sections = {"leg": {"title": name}, "ground": {}, "sensor": {}, "drive": {}}
    write_model(path, sections, {}, [name])
    assert tomllib.loads(path.read_bytes().decode())["leg"] == {"title": name}


@hostile_names
def test_csv_files_keep_their_columns(plant, tmp_path_factory, name):
    path = tmp_path_factory.getbasetemp() / "commands.csv"
    mechanism = replace(plant.mechanism, joints=(name,), actuators=(name,))
    write_excitation(path, mechanism, Excitation(np.zeros(2), np.zeros((2, 1)), np.zeros((2, 1))))
    head, *rows = csv.reader(io.StringIO(path.read_bytes().decode("utf-8"), newline=""))
    assert head == ["t_s", f"{name}_position_rad", f"{name}_command"]
    assert [len(row) for row in rows] == [3, 3]
    (key,), (value,) = csv.reader(io.StringIO(as_csv(_table_of(name)), newline=""))
    assert (key, value) == ("name", name)


@hostile_names
def test_tables_of_pages_and_latex_have_no_further_parts(name):
    page, usual = (str(as_html(_table_of(one), label=one)) for one in (name, "hinge"))
    assert _elements(page) == _elements(usual)
    assert not {"\x1b", "\x9b", "\u202e", "\x00"} & set(page)
    assert as_tex(_table_of(name)).count("\n") == as_tex(_table_of("hinge")).count("\n")
    _comment, *lines = as_tex(_table_of(name)).splitlines()
    assert "\n".join(lines).count("\\end{") == 1


def _table_of(name: str) -> Table:
    return Table("names", name, (TableColumn("name", "name"),), (TableRow({"name": name}),))


def _elements(text: str) -> list[str]:
    """The elements of a page, in their order."""
    found: list[str] = []

    class Parser(HTMLParser):
        def handle_starttag(self, tag, attrs):
            found.append(" ".join((tag, *(key for key, _ in attrs if key != "title"))))

    Parser().feed(text)
    return found


@pytest.mark.parametrize("kind", ["joint", "actuator"])
@pytest.mark.parametrize("sign", ['"', "'", "`", "\n", "\t", "\x7f", "\x85", "\u202e", "\u2028"])
def test_a_model_with_unusable_names_is_refused(tmp_path, kind, sign):
    names = {"joint": "hinge", "actuator": "motor", kind: f"left{sign}knee"}
    quoted = {
        key: "".join(f"&#{ord(one)};" if not one.isalnum() else one for one in name)
        for key, name in names.items()
    }
    (tmp_path / "model.xml").write_text(MODEL.format(**quoted), encoding="utf-8")
    with pytest.raises(BadInput) as refused:
        load_mechanism(tmp_path / "model.xml")
    line = str(refused.value)
    assert kind in line
    assert line.endswith("rename it in the model")
    assert "\n" not in line
    assert printable(line) == line


def test_usual_names_are_taken():
    for name in ("joint1", "left knee", "Gelenk ä", "robot/arm.1-a", "膝", "a+b", "50%", "<x>"):
        assert find_unusable_sign(name) is None


TRICK = "<img src=x onerror=alert(1)>\x1b]0;owned\x07\u202e\n[known_to]"
# Control characters and quotes are refused in the names of a model.
JOINT = "<img src=x onerror=alert(1)>{{ 7 * 7 }}"


@pytest.mark.slow
def test_a_whole_diagnosis_keeps_hostile_texts_as_texts(tmp_path):
    recorded = Path(__file__).parent / "data" / "pendulums" / "free-swing" / "runs"
    folder = tmp_path / "recordings"
    folder.mkdir()
    model = (SETS / "free-swing" / "model.xml").read_text("utf-8")
    (folder / "model.xml").write_text(model.replace('"pivot"', f'"{html.escape(JOINT)}"'), "utf-8")
    head = {"format": "rfca-experiment/1", "title": TRICK, "model": "model.xml"}
    text = "".join(f"{key} = {format_value(value)}\n" for key, value in head.items())
    text += '[time]\ncolumn = "time_s"\nunit = "s"\n[[signals]]\n'
    text += f"joint = {format_value(JOINT)}\n"
    text += 'quantity = "position"\ncolumn = "angle_rad"\nunit = "rad"\n'
    text += "[known_to]\ninertia_relative = 0.08\nzero_offset_rad = 0.01\n"
    for number, (name, from_s) in enumerate((("45", 0.5), ("90", 0.78), ("135", 0.68))):
        file = f"<b>{number}.csv"
        shutil.copy(recorded / f"release-{name}.csv", folder / file)
        text += f"[[recordings]]\nfile = {format_value(file)}\nfrom_s = {from_s}\nto_s = 4.6\n"
        text += f"condition = {format_value(f'{number} {TRICK}')}\n"
    (folder / "experiment.toml").write_text(text, encoding="utf-8")
    out = tmp_path / "<b>out"
    result = CliRunner().invoke(app, ["diagnose", str(folder), "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert not {"\x1b", "\x07", "\u202e"} & set(result.output)
    page = (out / "diagnosis.html").read_text(encoding="utf-8")
    assert "onerror=alert" in html.unescape(page)
    assert not any(element.startswith(("img", "b ")) for element in _elements(page))
    assert not {"\x1b", "\x07", "\u202e"} & set(page)
    answer = json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))
    assert answer["title"] == TRICK
    if (out / "laws.py").is_file():
        ast.parse((out / "laws.py").read_text(encoding="utf-8"))
    for model_file in out.glob("*.xml"):
        assert load_mechanism(model_file).joints == (JOINT,)
