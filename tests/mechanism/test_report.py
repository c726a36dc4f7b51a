"""`report` of recordings of a mechanism: signals, residuals, errors with and without a fit, and
another model in place.
"""

import csv
import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.diagnosis.mechanisms.fit import compare_mechanism
from rfca_rig.diagnosis.result import SignalOverlay
from rfca_rig.diagnosis.window_fit import ALL, FittedShift, SignalError, WindowFit
from rfca_rig.reports.diagnosis.pictures import _with_breaks
from rfca_rig.reports.provenance import Origin
from rfca_rig.reports.strokes.motions import MOST_SHOWN, MotionsReport, write_motions
from tests.cli.typed import typed, typed_in
from tests.mechanism.arm import Arm, Friction, record, write_campaign

ARM = replace(Arm(), friction=Friction((0.0, 0.4, 0.0)))
SIGNALS = [f"joint{j}_{kind}" for kind in ("position_rad", "speed_rad_s") for j in (1, 2, 3)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    known_to = {"mass_relative": 0.02}
    return write_campaign(
        tmp_path_factory.mktemp("report") / "arm",
        Arm(),
        [record(ARM, 3.4, seed) for seed in (0, 1)],
        known_to,
    )


@pytest.fixture(scope="module")
def reported(folder, tmp_path_factory):
    """What the command says of these recordings, and where: it fits them, for three seconds."""
    place = tmp_path_factory.mktemp("reported")
    return typed_in(place, "report", folder), place


def rows_of(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
def test_the_page_shows_every_signal_with_its_errors_and_residuals(folder, reported):
    done, place = reported
    assert done.exit_code == 0
    assert done.err == "report/report.html: measured and simulated signals of 2 recordings\n"
    page = (place / "report" / "report.html").read_text(encoding="utf-8")
    assert (
        page.count("<figure>") == 6 + 6 + 3
    )  # signals, their residuals, what the model lacks in each joint
    assert "simulated, fitted values" in page
    assert "Diagnosis: <code>rfca-rig diagnose" in page
    found = json.loads((place / "report" / "mechanism.json").read_text(encoding="utf-8"))
    errors = rows_of(place / "report" / "mechanism-errors.csv")
    assert [row["run"] for row in errors] == ["sines 1, repeat 1"] * 6 + ["sines 2, repeat 1"] * 6
    assert [float(row["held_out"]) for row in errors] == pytest.approx(
        [error["held_out"] for error in found["errors"]]
    )
    assert [error["signal"] for error in found["totals"]] == SIGNALS
    values = rows_of(place / "report" / "mechanism-values.csv")
    assert [row["name"] for row in values] == [f"link{j}.mass_relative" for j in (1, 2, 3)]
    signals = rows_of(place / "report" / "mechanism-signals.csv")
    assert len(signals) == 2 * 6 * 6 * 10  # recordings, signals, windows, bins
    for error in found["errors"]:
        here = [
            row for row in signals if (row["run"], row["signal"]) == (error["run"], error["signal"])
        ]
        for column in ("nominal", "fitted"):
            square = np.mean([(float(row["measured"]) - float(row[column])) ** 2 for row in here])
            assert np.sqrt(square) == pytest.approx(error[column])
    assert typed_in(place, "report", folder).exit_code == 0
    assert (place / "report" / "report.html").read_text(encoding="utf-8") == page


@pytest.mark.slow
def test_another_model_takes_the_place_of_the_nominal_one(
    folder, reported, tmp_path, monkeypatch, capsys
):
    amended = tmp_path / "amended.xml"
    text = (folder / "model.xml").read_text(encoding="utf-8")
    amended.write_text(
        text.replace('name="joint2" type="hinge"', 'name="joint2" type="hinge" frictionloss="0.4"'),
        encoding="utf-8",
    )
    done = typed(
        monkeypatch,
        capsys,
        "report",
        folder,
        "--model",
        amended,
        "--json",
        "--out",
        tmp_path / "report",
    )
    nominal, other = (
        {error["signal"]: error["nominal"] for error in json.loads(text)["totals"]}
        for text in (
            (reported[1] / "report" / "mechanism.json").read_text(encoding="utf-8"),
            done.out,
        )
    )
    assert all(other[signal] < 0.4 * nominal[signal] for signal in SIGNALS)
    page = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    assert "the model file amended.xml" in page
    assert "report arm --model amended.xml" in page


@pytest.mark.slow
def test_without_priors_the_nominal_model_alone_is_shown(folder, tmp_path, monkeypatch, capsys):
    shutil.copytree(folder, tmp_path / "arm")
    text = (tmp_path / "arm" / "experiment.toml").read_text(encoding="utf-8")
    (tmp_path / "arm" / "experiment.toml").write_text(
        text.partition("[known_to]")[0], encoding="utf-8"
    )
    done = typed(monkeypatch, capsys, "report", tmp_path / "arm", "--out", tmp_path / "report")
    assert done.exit_code == 0
    page = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    assert "Nothing is fitted" in page
    assert "fitted values" not in page
    assert not (tmp_path / "report" / "mechanism-values.csv").exists()
    assert "held_out" not in (tmp_path / "report" / "mechanism-errors.csv").read_text(
        encoding="utf-8"
    )
    drawn = page.partition(">Signals</h2>")[2]
    assert "#d07f0e" not in drawn  # nothing is drawn as fitted


@pytest.mark.slow
def test_dry_friction_is_a_step_of_the_torque_that_the_model_lacks(folder):
    first, second, third = compare_mechanism(read_experiment(folder), lambda *_: None).joints
    fast = np.abs(second.speed) > 0.5
    assert second.remainder[fast] == pytest.approx(-0.4 * np.sign(second.speed[fast]), abs=0.1)
    assert np.sqrt(np.mean(first.remainder**2)) < 0.2
    assert np.sqrt(np.mean(third.remainder**2)) < 0.02
    assert [one.joint for one in (first, second, third)] == ["joint1", "joint2", "joint3"]


def test_lines_are_broken_where_windows_start_and_keep_their_peaks():
    t_s = np.linspace(0.0, 1.0, 101)
    values = np.zeros(101)
    values[37] = 5.0
    values[50] = np.nan
    x, y = _with_breaks(t_s, values, np.array([0, 25, 60]), 20)
    assert np.isnan(x).tolist() == np.isnan(y).tolist()
    assert np.isnan(y).sum() == 2
    assert np.nanmax(y) == 5.0
    assert np.nanmin(x) == 0.0 and np.nanmax(x) == 1.0


def test_of_many_recordings_those_are_drawn_that_the_model_misses_most(tmp_path):
    names = [f"run {k}, repeat 1" for k in range(MOST_SHOWN + 3)]
    t_s = np.linspace(0.0, 1.0, 20)
    sizes = {name: 1.0 + (k * 7) % len(names) for k, name in enumerate(names)}
    errors = [
        SignalError(name, "arm_position_rad", 0.1, size, size, size) for name, size in sizes.items()
    ]
    overlays = [
        SignalOverlay(
            name, "arm_position_rad", t_s, t_s, t_s + size, t_s + size, np.array([0.0, 0.5])
        )
        for name, size in sizes.items()
    ]
    total = SignalError(ALL, "arm_position_rad", 0.1, 8.0, 8.0, 8.0)
    fit = WindowFit(
        (FittedShift("arm.mass_relative", 0.02, 0.2, 0.01),),
        (),
        (),
        tuple(errors),
        (total,),
        tuple(overlays),
    )
    write_motions(
        MotionsReport("arm", "model.xml", 0.5),
        fit,
        tmp_path,
        Origin(),
    )
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert f"Of {len(names)} recordings the {MOST_SHOWN} are drawn" in page
    pictures = page.partition(">Signals</h2>")[2]
    for name, size in sizes.items():
        assert (name in pictures) == (size > 3.0)
    assert 'class="marked"' in page and "probably lacks an effect" in page


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ("--shaft", "recorded"),
            "--shaft: is an option for recordings of a leg; leave it out here",
        ),
        (("--model", "none.xml"), "none.xml: is not there"),
        (("tests",), "which has a model of its own; give it alone"),
    ],
)
def test_what_makes_no_sense_is_one_line(folder, tmp_path, monkeypatch, capsys, words, said):
    monkeypatch.chdir(tmp_path)
    answer = typed(monkeypatch, capsys, "report", folder, *words)
    assert answer.exit_code == 2
    assert said in answer.err
    assert answer.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
