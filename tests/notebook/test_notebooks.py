"""The notebooks of the documentation run as written, and reach the verdicts that their text
states.
"""

import ast
import re
from pathlib import Path

import matplotlib as mpl
import pytest
from matplotlib import pyplot

from rfca_rig.diagnosis.diagnose import diagnose as diagnose_problem
from rfca_rig.model.catalogue import FOLDER_VARIABLE, catalogue
from rfca_rig.notebook import analyses

NOTEBOOKS = Path(__file__).parents[2] / "docs" / "notebooks"
CELL = re.compile(r"^```\{code-cell\}\n(.*?)^```$", re.DOTALL | re.MULTILINE)

pytestmark = pytest.mark.slow


@pytest.fixture
def execute(tmp_path, monkeypatch):
    """Executes all cells of a notebook in an empty folder, and returns its names. The effects of
    other tests stay as they are.
    """
    monkeypatch.chdir(tmp_path)
    # Set and deleted, so that what a notebook sets is taken back.
    monkeypatch.setenv(FOLDER_VARIABLE, "")
    monkeypatch.delenv(FOLDER_VARIABLE)

    def run(name):
        names = {"__name__": "__main__"}
        with mpl.rc_context({"backend": "agg"}):
            for number, cell in enumerate(
                CELL.findall((NOTEBOOKS / f"{name}.md").read_text(encoding="utf-8")), start=1
            ):
                exec(compile(ast.parse(cell), f"{name}, cell {number}", "exec"), names)
        return names

    yield run
    pyplot.close("all")


@pytest.fixture
def look_for(monkeypatch):
    """Has the diagnosis of a leg look for these effects alone."""

    def narrow(*ids):
        def diagnose(problem, progress, _, law_at, budget):
            without = [effect_id for effect_id in catalogue() if effect_id not in ids]
            return diagnose_problem(problem, progress, without, law_at, budget=budget)

        monkeypatch.setattr(analyses, "diagnose_problem", diagnose)

    return narrow


def test_the_list_of_notebooks_is_whole():
    assert {path.stem for path in NOTEBOOKS.glob("*.md")} == {
        "first-run",
        "own-data",
        "own-effect-and-simulator",
    }
    assert all(
        len(CELL.findall(path.read_text(encoding="utf-8"))) >= 5 for path in NOTEBOOKS.glob("*.md")
    )


def test_a_first_run_finds_the_compliance_of_the_twins_drive(execute, look_for, tmp_path):
    """tests/test_readme.py finds it among all effects, in more repeats of the same strokes; that
    takes three times as long.
    """
    look_for("motor_speed_droop", "motor_speed_ripple", "shaft_compliance", "sensor_lag")
    result = execute("first-run")["result"]
    assert result.grade == "identified" and set(result.effects()["effect"]) == {"motor_speed_droop"}
    values = result.effects().set_index("parameter")["value"]
    assert values["kp_Nm_s_per_rad"] == pytest.approx(8.0, rel=0.15) and values[
        "ki_Nm_per_rad"
    ] == pytest.approx(60.0, rel=0.15)
    assert (tmp_path / "diagnosis" / "diagnosis.html").is_file() and (
        tmp_path / "report" / "report.html"
    ).is_file()


def test_own_recordings_have_the_simulated_friction(execute):
    result = execute("own-data")["result"]
    assert result.grade == "identified"
    (effect,) = result.diagnosis.effects
    assert effect.id == "joint_friction"
    assert effect.parameters["torque_Nm"].value == pytest.approx(0.18, abs=0.07)
    assert set(result.rivals()["effects"].head(2)) == {"joint_friction", "joint_stribeck"}


def test_an_own_effect_acts_and_an_own_simulator_is_diagnosed(execute):
    names = execute("own-effect-and-simulator")
    assert "cubic_damping" in catalogue()
    with_effect, without = (
        line.get_ydata() for line in (names["axes"].lines[0], names["axes"].lines[-1])
    )
    # After the release, where the leg whips; the valley hardly moves.
    assert abs(with_effect - without).max() > 1.0
    (effect,) = names["decision"].effects
    assert names["decision"].grade in ("identified", "mostly") and effect.id == "coulomb"
    assert effect.parameters["friction_N"].value == pytest.approx(0.4, rel=0.1)
