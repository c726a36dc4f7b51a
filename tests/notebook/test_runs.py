"""All runs below a folder as a table of pandas."""

import json

import pytest

import rfca_rig as rr
from rfca_rig.errors import BadInput
from tests.cli.typed import typed
from tests.logbook.made import DONE, TRIPPED, plan, run

pytest.importorskip("pandas")


@pytest.fixture
def table(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for number, ending in enumerate([DONE, TRIPPED, DONE]):
        folder = tmp_path / "runs" / f"SIM-{number}"
        run(folder, plan("flapping"), ending=ending, sample=f"leg {number}")
    return rr.runs()


def test_the_table_has_the_rows_that_the_command_lists(table, monkeypatch, capsys):
    listed = json.loads(typed(monkeypatch, capsys, "runs", "--json").out)["runs"]
    assert list(table["run"]) == [row["run"] for row in listed]
    for name in ("title", "source", "kind", "operator", "sample", "ended", "code", "strokes"):
        assert list(table[name]) == [row[name] for row in listed], name


def test_runs_are_found_by_what_is_known_about_them(table):
    tripped = table[table["ended"] == "tripped"]
    assert list(tripped["sample"]) == ["leg 1"]
    assert (table["began"].dt.tz_convert("UTC").diff().dropna().dt.total_seconds() <= 0.0).all()
    assert all(heights for heights in table["heights_mm"])


def test_provenance_is_a_column_each_without_whole_files(tmp_path):
    rr.run(height_mm=235, speed_rad_s=2.0, repeats=1, seed=5, runs=tmp_path / "runs")
    (row,) = rr.runs(tmp_path / "runs").to_dict("records")
    assert (row["seed"], row["sensor_counts_per_N"], row["heights_mm"]) == (
        "5",
        "1000000.0",
        (235.0,),
    )
    assert row["rfca_rig_version"] == rr.__version__
    assert "rig_file" not in row and "plan" not in row
    assert row["verdict"] == "" and row["effects"] == ()


def test_a_damaged_run_keeps_its_row(table, tmp_path):
    (tmp_path / "runs" / "SIM-0" / "run.json").write_text("{")
    again = rr.runs(tmp_path / "runs")
    assert sorted(again["ended"]) == ["damaged", "done", "tripped"]


def test_a_folder_that_is_not_there_is_one_line(tmp_path):
    with pytest.raises(BadInput, match="is no folder"):
        rr.runs(tmp_path / "nowhere")
