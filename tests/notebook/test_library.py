"""`import rfca_rig as rr`: its names, results as tables, arrays, pages and pictures, and errors
instead of prints and exits.
"""

import builtins
import importlib
import re
import subprocess
import sys
from html import unescape
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest
from matplotlib import pyplot

import rfca_rig as rr
from rfca_rig.errors import BadInput, RigError
from rfca_rig.notebook import recordings as shared
from tests.mechanism.arm import Arm, record, write_campaign

DATA = Path(__file__).parents[1] / "data"
SMALL = DATA / "small-campaign"
NAMES = [
    "Rig",
    "datasets",
    "diagnose",
    "effects",
    "fit",
    "mechanics",
    "open",
    "plan",
    "report",
    "run",
    "runs",
    "simulate",
]


@pytest.fixture(autouse=True)
def _close_figures():
    yield
    pyplot.close("all")


@pytest.fixture(scope="module")
def recordings():
    return rr.open(SMALL)


@pytest.fixture(scope="module")
def flapped(tmp_path_factory):
    return rr.run(
        height_mm=215, speed_rad_s=2.433, repeats=1, seed=3, runs=tmp_path_factory.mktemp("runs")
    )


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_stable_names_are_these():
    """A name that is added, dropped or renamed must be so on purpose: users have it in their
    scripts.
    """
    assert rr.__all__ == NAMES
    assert set(NAMES) <= set(dir(rr))
    with pytest.raises(AttributeError, match="it has Rig, datasets"):
        _ = rr.no_such_name


def test_names_are_what_they_say_whatever_was_imported_before():
    """A package of the same name would take a name's place as soon as it is imported."""
    for name in NAMES:
        importlib.import_module("rfca_rig.reports.strokes.page")
        found = getattr(rr, name)
        assert callable(found) or name in ("datasets", "mechanics")
    assert rr.mechanics.coulomb_friction_N(np.array([1.0]), np.array([10.0]), 0.5) is not None


def test_the_import_alone_loads_nothing_heavy():
    said = (
        "import sys, rfca_rig; print([name for name in ('numpy', 'numba', 'matplotlib', "
        "'typer') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", said], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_rig_is_read_and_described():
    rig = rr.Rig.from_file("twin")
    assert not rig.is_real and "SIM" in repr(rig)
    assert "<table>" in rig._repr_html_()
    with pytest.raises(BadInput, match="no such file"):
        rr.Rig.from_file("twinn")


def test_a_simulated_stroke_is_a_dataset_with_units_and_a_picture(capsys):
    stroke = rr.simulate(height_mm=215, speed_rad_s=2.433)
    data = stroke.to_xarray()
    assert data["fz_N"].attrs["units"] == "N" and data["link_angle_rad"].dims == ("t_s", "link")
    valley = float(data["fz_N"].sel(t_s=stroke.summary["valley_time_s"], method="nearest"))
    assert valley == pytest.approx(stroke.summary["valley_fz_N"], abs=0.5)
    axes = pyplot.subplots()[1]
    assert stroke.plot(axes) is axes and len(axes.lines) == 2 and "N" in axes.get_ylabel()
    assert "valley_fz_N" in stroke._repr_html_()
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("name", "value"), [("height_mm", 0.215), ("speed_rad_s", -1.0), ("sweep_deg", float("nan"))]
)
def test_a_value_outside_of_its_range_is_refused_with_its_limits(name, value):
    with pytest.raises(BadInput, match=rf"{name} = .*: should be a number from"):
        rr.simulate(**{"height_mm": 215, "speed_rad_s": 2.4, name: value})


def test_a_campaign_is_tables_and_datasets(recordings):
    table = recordings.table()
    assert len(table) == len(recordings) > 0 and {"height_mm", "valley_fz_N"} <= set(table.columns)
    data = recordings.to_xarray(1)
    stroke = recordings.strokes[1]
    t_s, fz_N = stroke.channel("fz_N")
    assert np.array_equal(data["fz_N"].values, fz_N) and data["fz_N"].attrs["units"] == "N"
    (along,) = data["fz_N"].dims
    assert np.array_equal(data[along].values, t_s) and data.attrs["height_mm"] == pytest.approx(
        1e3 * stroke.height_m
    )
    static = recordings.static_table()
    assert len(static) == len(recordings.recording.static) and "hinge2_deg" in static.columns
    assert recordings.plot(0).get_xlabel() == "time in s"
    with pytest.raises(BadInput, match="numbered from 0; there is no 99"):
        recordings.to_xarray(99)


def test_recordings_of_a_pendulum_are_opened_with_the_same_name():
    swings = rr.open(DATA / "pendulums" / "free-swing")
    data = swings.to_xarray(0)
    assert (
        data.sizes["t_s"] == swings.table()["samples"][0]
        and data["joint1.position"].attrs["units"] == "rad"
    )
    assert swings.plot(0).lines and len(swings.static_table()) == 0


def test_recordings_of_a_mechanism_are_opened_with_the_same_name(tmp_path):
    recorded = record(Arm(), 1.0, 0)
    opened = rr.open(write_campaign(tmp_path / "arm", Arm(), [recorded], {"mass_relative": 0.01}))
    data = opened.to_xarray(0)
    assert (
        np.allclose(data["joint1.position"], recorded[1][:, 0], atol=1e-6)
        and data["joint1.position"].attrs["units"] == "rad"
    )
    assert "motor1.command" in data and opened.plot(0).lines


def test_text_from_files_is_escaped_on_a_page():
    assert "<script>" not in shared.html_table("<script>", [{"<b>": "<script>"}])


def test_a_plan_has_a_row_per_stage_and_refuses_what_passes_a_limit():
    planned = rr.plan("table2")
    assert len(planned.table()) == len(planned.plan.stages) and "at most" in planned._repr_html_()
    with pytest.raises(BadInput, match="together"):
        rr.plan(height_mm=215)
    with pytest.raises(BadInput):
        rr.plan(height_mm=215, speed_rad_s=50.0)


@pytest.mark.slow
def test_a_run_on_the_twin_prints_nothing_and_gives_its_recording(here, capsys):
    done = rr.run(height_mm=215, speed_rad_s=2.433, repeats=1, runs="own")
    assert len(done) == 1 and done.path.parent == Path("own")
    assert capsys.readouterr() == ("", "")


@pytest.mark.slow
def test_a_report_is_a_page_and_a_table(here, flapped):
    written = rr.report(flapped, out=here / "report")
    assert written.page.is_file() and len(written.table()) == 1
    assert written.html == written.page.read_text(encoding="utf-8")
    assert written.table()["force_error_pct"][0] < 5.0
    assert "measured_fz_N" in written._repr_html_()


@pytest.mark.slow
def test_a_report_without_a_folder_is_shown_and_writes_nothing(here, flapped):
    before = sorted(here.rglob("*"))
    shown = rr.report(flapped)
    assert sorted(here.rglob("*")) == before
    assert shown.page is None and len(shown.table()) == 1
    assert shown.html.startswith("<!DOCTYPE html>") and shown.html.rstrip().endswith("</html>")
    html = shown._repr_html_()
    assert "measured_fz_N" in html
    (page,) = re.findall(r'<iframe sandbox srcdoc="([^"]*)"', html)
    assert unescape(page) == shown.html


def test_hardware_is_left_to_a_terminal():
    example = DATA / "real-rig.toml"
    with pytest.raises(BadInput, match="only a terminal may run"):
        rr.run(rig=example)


def test_a_fit_is_a_table(flapped):
    fitted = rr.fit(flapped, parameters=["friction"], progress=False)
    assert list(fitted.table()["name"]) == ["friction"] and "friction" in fitted._repr_html_()
    with pytest.raises(BadInput, match="of a mechanism"):
        rr.fit(flapped, effects=["joint_friction"])


def test_the_catalogue_is_a_table():
    table = rr.effects()
    assert {"id", "law", "source"} <= set(table.columns) and "hinge_backlash" in set(table["id"])


def test_effects_are_those_that_the_recordings_could_show(flapped):
    of_leg = set(rr.effects(flapped)["id"])
    assert "hinge_backlash" in of_leg and "joint_friction" not in of_leg
    of_rod = rr.effects(DATA / "pendulums" / "free-swing").set_index("id")
    assert "hinge_backlash" not in of_rod.index
    # A rod that is released has no torque that could be late.
    assert "joint_friction" in of_rod.index and "torque_lag" not in of_rod.index
    assert of_rod.loc["joint_friction", "parameters"].startswith("torque_Nm ")


@pytest.mark.slow
def test_a_diagnosis_is_a_grade_with_tables_and_a_picture(here):
    # tests/diagnosis/test_pendulum.py looks for all effects in these recordings, which takes
    # several times as long.
    without = ["added_mass", "centre_of_mass", "gravity_tilt", "joint_hysteresis", "joint_inertia"]
    without += ["joint_spring", "joint_stop", "joint_stribeck"]
    found = rr.diagnose(DATA / "pendulums" / "free-swing", without=without, progress=False)
    assert found.grade == found.diagnosis.grade and found.grade in repr(found)
    assert {"signal", "before", "after"} <= set(found.errors().columns) and len(
        found.rivals()
    ) == len(found.diagnosis.rivals)
    assert set(found.effects()["effect"]) == {effect.id for effect in found.diagnosis.effects}
    assert len(found.plot(0).lines) == 3 and "rms error" in found._repr_html_()
    assert found.save(here / "diagnosis").is_file()
    with pytest.raises(BadInput, match="there is no 999"):
        found.plot(999)


@pytest.mark.parametrize("call", [rr.diagnose, rr.fit, rr.report])
def test_nothing_to_analyse_is_an_error_in_one_line(call, here):
    with pytest.raises(RigError) as error:
        call("nowhere")
    assert "nowhere" in str(error.value) and "\n" not in str(error.value)
    with pytest.raises(BadInput):
        call()


def test_without_the_extra_the_command_that_installs_it_is_named(monkeypatch, recordings):
    really = builtins.__import__

    def without(name, *rest, **named):
        if name in ("pandas", "xarray", "tqdm.auto"):
            raise ImportError(name)
        return really(name, *rest, **named)

    monkeypatch.setattr(builtins, "__import__", without)
    monkeypatch.setattr(shared, "import_module", without)
    with pytest.raises(
        BadInput, match=r'pandas is not installed; pip install "rfca-rig\[notebook\]"'
    ):
        recordings.table()
    with shared.show_progress("work", True) as move:
        move("step", 0.5)  # no bar, and no error


def test_progress_moves_a_bar(capsys):
    with shared.show_progress("work", True) as move:
        move("reading", 0.25)
        move("fitting", 0.5)
    assert "50%" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("use", "inner"),
    [
        (rr.diagnose, "rfca_rig.diagnosis.leg.problem.LegProblem.solve"),
        (rr.fit, "rfca_rig.diagnosis.leg.problem.fit_recordings"),
        (rr.report, "rfca_rig.reports.problems.write_report"),
    ],
)
def test_a_value_in_another_unit_is_taken_only_as_it_is(tmp_path, monkeypatch, use, inner):
    copytree(SMALL, tmp_path / "slipped")
    description = tmp_path / "slipped" / "campaign.toml"
    description.write_text(
        re.sub(r"height_mm = (2\d\d)\.0", r"height_mm = 0.\1", description.read_text())
    )
    with pytest.raises(BadInput, match="height"):
        use(tmp_path / "slipped")

    def stop(*_):
        raise RigError("it came to the analysis")

    monkeypatch.setattr(inner, stop)
    with pytest.raises(RigError, match="it came to the analysis"):
        use(tmp_path / "slipped", as_is=True)


def test_a_link_out_of_one_folder_is_not_followed_because_another_one_may(tmp_path):
    copytree(SMALL, tmp_path / "theirs")
    moved = tmp_path / "moved.csv"
    linked = sorted((tmp_path / "theirs").rglob("*.csv"))[0]
    linked.rename(moved)
    linked.symlink_to(moved)
    ours = rr.open(SMALL, allow_outside=True)
    with pytest.raises(BadInput, match="outside"):
        rr.report(ours, tmp_path / "theirs", out=tmp_path / "out")
