"""rfca-rig sweep as it is typed."""

import json
import re
from contextlib import nullcontext
from pathlib import Path

import pytest

from rfca_rig.executors import mapping
from rfca_rig.executors.mapping import InProcessExecutor
from rfca_rig.reports.text import MINUS
from rfca_rig.sweep.outputs import OUTPUTS
from rfca_rig.sweep.quantities import list_quantities
from tests.cli.typed import typed
from tests.report.outline import Outline

ROOT = Path(__file__).parents[2]
GRID = ("--vary", "height_mm=215,235", "--vary", "k0=10:12:3", "--outputs", "valley_fz_N,energy_J")


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A folder to work in, and cases that are computed in this process: others are tested with
    the executor.
    """
    monkeypatch.setattr(mapping, "process_executor", lambda _: nullcontext(InProcessExecutor()))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def sweep(monkeypatch, capsys, *words):
    return typed(monkeypatch, capsys, "sweep", *words)


def test_what_is_written_and_said(monkeypatch, capsys, here):
    said = sweep(monkeypatch, capsys, *GRID, "--workers", 1, "--out", "out")
    assert said.exit_code == 0
    assert (
        said.err.splitlines()[-1]
        == "out/sweep.html: figures and definitions; all cases in sweep.csv and sweep.h5"
    )
    assert said.out.splitlines()[0] == "Sweep over height_mm, k0_Nm_per_rad: 6 cases"
    assert re.search(
        rf"^valley_fz_N: {MINUS}\d+\.\d+ \(height 215 mm, k0 12 N m/rad\) to {MINUS}\d",
        said.out,
        re.MULTILINE,
    )
    assert (here / "out" / "sweep.csv").read_text().splitlines()[
        0
    ] == "case,height_mm,k0_Nm_per_rad,valley_fz_N,energy_J,remark"
    page = (here / "out" / "sweep.html").read_text()
    outline = Outline(page)
    assert outline.fetched == [name for name in outline.fetched if name.startswith("#")]
    assert (
        "rfca-rig sweep --vary height_mm=215,235 --vary k0=10:12:3 --outputs "
        "valley_fz_N,energy_J --out out"
    ) in outline.text
    for words in (
        "Fz in the valley",
        "Energy per stroke",
        "k0 (N m/rad)",
        "valley fz (N)",
        "energy (J)",
        "height 215 mm",
        "W = ∫ τ ω dt",
    ):
        assert words in outline.text
    again = sweep(monkeypatch, capsys, *GRID, "--out", "out", "--json", "--workers", 1)
    assert again.err == "" and again.out == (here / "out" / "sweep.json").read_text()
    summary = json.loads(again.out)
    assert (summary["cases"], summary["failed"]) == (6, 0)
    assert summary["outputs"][0]["lowest"]["at"] == {"height_mm": 215.0, "k0_Nm_per_rad": 12.0}
    assert (here / "out" / "sweep.html").read_text() == page
    other = sweep(
        monkeypatch, capsys, "--vary", "height_mm=215,236", "--outputs", "energy_J", "--out", "out"
    )
    assert other.exit_code == 2 and len(other.err.splitlines()) == 1
    assert "holds a sweep with another title and grid and outputs" in other.err


def test_what_would_be_done(monkeypatch, capsys, here):
    said = sweep(monkeypatch, capsys, "height-and-speed", "--dry-run", "--workers", 2)
    assert said.exit_code == 0 and list(here.iterdir()) == []
    assert re.fullmatch(
        (
            r"Height and speed: 357 cases of height_mm, speed_rad_s\nabout [\d.]+ ms each, "
            r"\d+ \w+ on 2 cores; 0.1 MB\n"
        ),
        said.out,
    )
    told = json.loads(sweep(monkeypatch, capsys, *GRID, "--dry-run", "--json", "--workers", 3).out)
    assert (
        told["cases"] == 6
        and told["workers"] == 3
        and told["seconds"] == pytest.approx(told["seconds_per_case"] * 2)
    )


def test_all_that_can_be_varied_and_put_out_is_listed(monkeypatch, capsys):
    said = sweep(monkeypatch, capsys, "--list").out
    for name in (*list_quantities(), *OUTPUTS):
        assert f"\n  {name}" in said


@pytest.mark.slow
@pytest.mark.parametrize(
    "path", sorted((ROOT / "sweeps").glob("*.toml")), ids=lambda path: path.stem
)
def test_shipped_sweeps_are_whole(monkeypatch, capsys, here, path):
    said = sweep(monkeypatch, capsys, path.stem, "--dry-run", "--json")
    assert said.exit_code == 0 and json.loads(said.out)["cases"] >= 8


def test_the_file_in_the_docs_is_one(monkeypatch, capsys, here):
    text = (ROOT / "docs" / "sweeps.md").read_text()
    (here / "mine.toml").write_text(re.search(r"```toml\n(.*?)```", text, re.DOTALL)[1])
    assert (
        json.loads(sweep(monkeypatch, capsys, "mine.toml", "--dry-run", "--json").out)["cases"]
        == 3 * 9 * 256
    )


def test_wrong_input_is_one_line(monkeypatch, capsys, here):
    for words, said in (
        ((), "nothing is varied"),
        (("height-and-sped",), "no such file"),
        (("height-and-speed", "--vary", "k0=1,2"), "says what is varied; leave --vary"),
        ((*GRID, "--rig", "twin", "--model", "m.toml"), "name one of them"),
        ((*GRID, "--model", "m.toml"), "m.toml: cannot be read"),
    ):
        refused = sweep(monkeypatch, capsys, *words)
        assert refused.exit_code == 2 and said in refused.err and len(refused.err.splitlines()) == 1


def test_samples_are_drawn_with_what_they_explain(monkeypatch, capsys, here):
    """On a page of a sweep that needs no simulation."""
    words = (
        "--vary",
        "k0=10:12",
        "--vary",
        "friction=0.2:0.6",
        "--samples",
        64,
        "--seed",
        3,
        "--outputs",
        "hinge_k0_Nm_per_rad",
    )
    assert sweep(monkeypatch, capsys, *words, "--workers", 1, "--out", "out").exit_code == 0
    outline = Outline((here / "out" / "sweep.html").read_text())
    assert "explains 1.00 ± 0.00" in outline.text and re.search(
        rf"explains {MINUS}?0\.0", outline.text
    )
    assert "64 points (sobol, seed 3) in 2 ranges" in outline.text
    found = json.loads((here / "out" / "sweep.json").read_text())["sensitivities"]
    assert [each["of"] for each in found] == ["k0_Nm_per_rad", "friction"] and found[0][
        "index"
    ] == pytest.approx(1.0)
