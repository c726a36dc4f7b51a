"""`check` of a file: a rig file and a protocol are read; of any other the message says what
reads it.
"""

import json
import shutil
from pathlib import Path

import pytest

from tests.cli.typed import typed

ROOT = Path(__file__).parents[2]


@pytest.fixture
def check(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    # The list of trusted code is that of an empty home.
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    return lambda *words: typed(monkeypatch, capsys, "check", *words)


def test_a_rig_file_is_read_and_doctor_goes_on(check, monkeypatch, capsys):
    typed(monkeypatch, capsys, "init", "--rig", "our-rig.toml", "--yes")
    said = check("our-rig.toml")
    assert said.exit_code == 0
    assert said.out == (
        "ok      our-rig.toml: SIM rig file, our-rig; drive odrive, force sensor "
        "ati-net-ft, a camera\n"
    )
    assert "lines hold a usual value" in said.err
    assert said.err.endswith("next: rfca-rig doctor --rig our-rig.toml\n")
    found = json.loads(check("our-rig.toml", "--json").out)
    assert (found["kind"], found["usual_values"] > 20) == ("rig", True)


def test_a_protocol_is_read_and_plan_goes_on(check):
    shutil.copy(ROOT / "protocols" / "table2.toml", ".")
    said = check("table2.toml")
    assert said.exit_code == 0
    assert said.out == "ok      table2.toml: dynamic protocol, Table II\n"
    assert said.err == "next: rfca-rig plan table2.toml\n"


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("bad.toml", '[rig]\ntitle = "ours"\nkind = "twin"\n', "bad.toml"),
        (
            "sweep.toml",
            'title = "ours"\n[[vary]]\nname = "height_mm"\n',
            "rfca-rig sweep sweep.toml reads it",
        ),
        ("model.toml", "[leg]\n", "rfca-rig predict --model model.toml reads it"),
        ("other.toml", "a = 1\n", "a rig file has [rig], a protocol has experiment"),
        ("notes.txt", "", "is a file, and no .toml"),
        ("run.h5", "", "rfca-rig check . checks all of them"),
        ("pendulum.toml", "a = 1\n", "pendulum.toml"),
        ("experiment.toml", "a = 1\n", "experiment.toml"),
        # Code from elsewhere is not executed by a check.
        (
            "own.toml",
            '[rig]\nkind = "real"\n[motor]\ndevice = "own"\nfile = "theirs.py"\n',
            "would execute",
        ),
    ],
)
def test_any_other_file_is_one_line_with_exit_code_2(check, name, text, message):
    Path(name).write_text(text)
    said = check(name)
    assert said.exit_code == 2
    assert message in said.err
    assert len(said.err.splitlines()) == 1
