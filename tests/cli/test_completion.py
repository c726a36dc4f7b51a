"""What the shell offers behind <TAB>, asked the way that bash and zsh ask."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from rfca_rig.analysis.fitting.parameters import PARAMETERS
from rfca_rig.analysis.phases import PHASES as REAL_PHASES
from rfca_rig.cli import names
from rfca_rig.description.rig_file import read_rig
from rfca_rig.model.catalogue import declarations
from tests.cli.typed import typed

ROOT = Path(__file__).parents[2]
HEAVY = ("numpy", "scipy", "numba", "h5py", "matplotlib", "cv2", "can", "jinja2")


@pytest.fixture
def here(tmp_path, monkeypatch):
    """Three runs, one of them imported, the last one made the newest; and something that is
    none.
    """
    monkeypatch.chdir(tmp_path)
    for age, name in enumerate(("SIM-old", "IMPORT-mid", "SIM-new")):
        (tmp_path / "runs" / name).mkdir(parents=True)
        (tmp_path / "runs" / name / ("run.h5" if name.startswith("IMPORT") else "run.json")).touch()
        os.utime(tmp_path / "runs" / name, (1e9 + age, 1e9 + age))
    (tmp_path / "runs" / "SIM-nothing").mkdir()
    return tmp_path


def bash(monkeypatch, capsys, line):
    """The words that are offered for the last one of the line."""
    words = line.split(" ")
    monkeypatch.setenv("_RFCA_RIG_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", line)
    monkeypatch.setenv("COMP_CWORD", str(len(words) - 1))
    said = typed(monkeypatch, capsys)
    assert (said.exit_code, said.err) == (0, "")
    return said.out.split("\n")[:-1]


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("rfca-rig pred", ["predict"]),
        ("rfca-rig plan ta", ["table2"]),
        ("rfca-rig dynamic run --protocol fl", ["flapping"]),
        ("rfca-rig static run --rig twin-d", ["twin-daq"]),
        ("rfca-rig check runs/", ["runs/SIM-new", "runs/IMPORT-mid", "runs/SIM-old"]),
        ("rfca-rig report runs/SIM-old runs/I", ["runs/IMPORT-mid"]),
        ("rfca-rig diagnose ", ["runs/SIM-new", "runs/IMPORT-mid", "runs/SIM-old"]),
        ("rfca-rig fit runs/SIM-old --parameters k0,hinge", ["k0,hinge_damping"]),
        ("rfca-rig fit runs/SIM-old --parameters k0,k", ["k0,k2"]),
        ("rfca-rig fit runs/SIM-old --phases re", ["rest", "release"]),
        (
            "rfca-rig fit runs/SIM-old --effects joint_damping,joint_st",
            ["joint_damping,joint_stribeck", "joint_damping,joint_stop"],
        ),
        ("rfca-rig runs --verdict hinge_b", ["hinge_backlash"]),
        ("rfca-rig runs --ended F-0", ["F-01", "F-02", "F-03", "F-04"]),
        ("rfca-rig runs --kind s", ["static"]),
    ],
)
def test_names_and_folders_are_offered_newest_first(here, monkeypatch, capsys, line, offered):
    assert [word for word in bash(monkeypatch, capsys, line) if word != "rebound"] == offered


def test_zsh_is_answered_in_its_own_way(here, monkeypatch, capsys):
    monkeypatch.setenv("_RFCA_RIG_COMPLETE", "complete_zsh")
    monkeypatch.setenv("_TYPER_COMPLETE_ARGS", "rfca-rig check runs/SIM-")
    said = typed(monkeypatch, capsys)
    assert said.exit_code == 0
    assert said.out.index('"runs/SIM-new"') < said.out.index('"runs/SIM-old"')
    monkeypatch.setenv("_TYPER_COMPLETE_ARGS", "rfca-rig check elsewhere/")
    assert "_files" in typed(monkeypatch, capsys).out, "where nothing is known, files are offered"


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")
def test_a_real_bash_completes(here):
    env = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    script = subprocess.run(
        ["rfca-rig"],
        env={**env, "_RFCA_RIG_COMPLETE": "source_bash"},
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    asks = (
        "COMP_WORDS=(rfca-rig check runs/SIM-n); COMP_CWORD=2; _rfca_rig_completion "
        'rfca-rig; echo "${COMPREPLY[@]}"'
    )
    said = subprocess.run(
        ["bash", "--norc", "-c", f"{script}\n{asks}"],
        env=env,
        capture_output=True,
        text=True,
        check=True,
    )
    assert said.stdout.split() == ["runs/SIM-new"]


def test_an_answer_loads_nothing_heavy(here):
    code = (
        "import sys\nsys.argv = ['rfca-rig']\nfrom rfca_rig.cli.main import run\ntry: "
        "run()\nexcept SystemExit: pass\n"
        f"print([name for name in {HEAVY} if name in sys.modules])"
    )
    env = {
        **os.environ,
        "_RFCA_RIG_COMPLETE": "complete_bash",
        "COMP_WORDS": "rfca-rig check runs/",
        "COMP_CWORD": "2",
    }
    said = subprocess.run(
        [sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True
    ).stdout
    assert said.splitlines()[-1] == "[]"


def test_what_is_known_without_loading_is_what_there_is(tmp_path, monkeypatch):
    assert set(names.FIT_PARAMETERS) == set(PARAMETERS)
    assert set(names.PHASES) == set(REAL_PHASES)
    assert set(names.effect_names()) == {declared.id for declared in declarations()}
    monkeypatch.chdir(tmp_path)
    assert "twin-camera" not in names.rig_names()
    for name in names.rig_names():
        read_rig(ROOT / "calibration" / f"{name}.toml")
