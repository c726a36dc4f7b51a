"""`rfca-rig plan` prints the list that a run walks, and refuses what a run would refuse."""

import json
from pathlib import Path

import pytest

from rfca_rig.description.protocol_file import read_plan
from rfca_rig.description.rig_file import read_rig
from rfca_rig.errors import BadInput
from tests.cli.typed import typed

ROOT = Path(__file__).parents[2]
TWIN = ROOT / "calibration" / "twin.toml"


@pytest.mark.parametrize(
    "protocol", sorted(path.stem for path in (ROOT / "protocols").glob("*.toml"))
)
def test_every_protocol_s_plan_is_the_one_that_is_run(protocol, monkeypatch, capsys):
    said = json.loads(typed(monkeypatch, capsys, "plan", protocol, "--json").out)
    plan = read_plan(ROOT / "protocols" / f"{protocol}.toml", read_rig(TWIN).facts())
    assert [stage["label"] for stage in said["stages"]] == [stage.label for stage in plan.stages]
    assert (
        sum(stage["at_most_s"] for stage in said["stages"])
        == pytest.approx(plan.duration_s)
        == said["at_most_s"]
    )


def test_a_line_a_stage_with_its_time_and_what_the_model_expects(monkeypatch, capsys):
    lines = typed(monkeypatch, capsys, "plan", "flapping").out.splitlines()
    assert all(line.startswith("SIM ") for line in lines)
    (first,) = [line for line in lines if "repeat 1" in line]
    assert first.split()[2:6] == ["0:14.2", "0.6", "61", "6.2"]
    assert lines[1].split()[2:6] == ["until", "MB", "N", "N"]
    assert "within the limits: 300 N, 25 N m, 20 rad/s" in lines[-1]
    assert max(map(len, lines)) <= 80


def test_a_long_plan_is_cut_unless_all_of_it_is_asked_for(monkeypatch, capsys):
    cut = typed(monkeypatch, capsys, "plan", "table2").out.splitlines()
    whole = typed(monkeypatch, capsys, "plan", "table2", "--all").out.splitlines()
    assert any("stages more; --all prints them" in line for line in cut)
    assert len(whole) == 6 + 66


def test_what_a_limit_forbids_is_refused_in_one_line(monkeypatch, capsys, tmp_path):
    rig = tmp_path / "weak.toml"
    rig.write_text(TWIN.read_text().replace("force_N = 300.0", "force_N = 50.0"))
    said = typed(monkeypatch, capsys, "plan", "flapping", "--rig", rig)
    assert (said.exit_code, said.out) == (2, "")
    assert "the model expects 61 N" in said.err.splitlines()[-1]


def test_first_strokes_come_before_each_condition_of_a_rig_that_asks_for_them(tmp_path):
    rig = tmp_path / "careful.toml"
    rig.write_text(
        TWIN.read_text().replace("late_ms = 50.0", "first_strokes = [0.75, 0.5]\nlate_ms = 50.0")
    )
    labels = [
        stage.label
        for stage in read_plan(ROOT / "protocols" / "table2.toml", read_rig(rig).facts()).stages
    ]
    first = [label for label in labels if label.startswith("first strokes")]
    assert len(first) == 8
    assert first[:2] == [
        "first strokes at 215 mm: 1.2165 of 2.433 rad/s",
        "first strokes at 215 mm: 1.82475 of 2.433 rad/s",
    ]


@pytest.mark.parametrize("text", ['title = "x"\n', 'experiment = "dance"\n'])
def test_a_file_that_is_no_protocol_is_told_what_one_is(text, tmp_path):
    path = tmp_path / "odd.toml"
    path.write_text(text)
    with pytest.raises(
        BadInput, match=r"odd\.toml.*a protocol says one of 'dynamic', 'static', 'fatigue'"
    ):
        read_plan(path, read_rig(TWIN).facts())
