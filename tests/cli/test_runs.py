"""`rfca-rig runs` as a user types it."""

import json
import os
from pathlib import Path

import pytest

from tests.cli.typed import typed
from tests.logbook.made import DONE, STOPPED, TRIPPED, plan, run


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A static run, a trip, and thirty strokes at one condition; a minute apart."""
    monkeypatch.chdir(tmp_path)
    made = [
        run(
            tmp_path / "runs" / "SIM-static-001",
            plan("static-angle"),
            ending=DONE,
            operator="M. Kölle",
        ),
        run(
            tmp_path / "runs" / "SIM-table-ii-001",
            plan("table2"),
            recorded=3,
            ending=TRIPPED,
            sample="leg 7",
        ),
        *(
            run(
                tmp_path / "runs" / f"SIM-{'a-very-long-name-' * 4}{k:03d}",
                plan("flapping"),
                ending=STOPPED,
            )
            for k in range(30)
        ),
    ]
    for age, folder in enumerate(made):
        os.utime(folder / "run.json", (2e9 - 60 * age, 2e9 - 60 * age))
    return tmp_path


def runs(monkeypatch, capsys, *words):
    said = typed(monkeypatch, capsys, "runs", *words)
    assert said.exit_code == 0
    return said


def test_a_table_of_the_newest_in_80_columns(here, monkeypatch, capsys):
    said = runs(monkeypatch, capsys)
    lines = said.out.splitlines()
    assert lines[0].split() == ["run", "begun", "ended"]
    assert lines[1].split()[0] == "SIM-static-001" and lines[1].endswith("done")
    assert any(line.startswith("SIM-table-ii-001") and line.endswith("trip F-02") for line in lines)
    assert any("3 strokes; 215 mm; 2.433 rad/s; sample leg 7" in line for line in lines)
    assert max(map(len, lines)) <= 80
    assert said.err == "20 of 32 runs below runs; --last 0 shows all 32\n"
    assert {
        folder.name for folder in Path("runs").glob("SIM-a*") if folder.name[-3:] < "018"
    } <= set(lines), "long names stay whole"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "found"),
    [
        (("--kind", "static"), ["SIM-static-001"]),
        (("--height", "235"), ["SIM-static-001"]),
        (("--height", "215", "--speed", "2.4..2.5", "--ended", "tripped"), ["SIM-table-ii-001"]),
        (("--ended", "F-02", "table"), ["SIM-table-ii-001"]),
        (("--operator", "kölle"), ["SIM-static-001"]),
        (("--sample", "Leg"), ["SIM-table-ii-001"]),
        (("--verdict", "none", "--last", "1"), ["SIM-static-001"]),
        (("--verdict", "hinge_backlash"), []),
        (("--since", "2040-01-01"), []),
    ],
)
def test_paths_of_what_was_looked_for_and_nothing_else(here, monkeypatch, capsys, words, found):
    assert runs(monkeypatch, capsys, *words, "--paths").out.split() == [
        f"runs/{name}" for name in found
    ]


def test_json_owns_the_output_and_holds_all(here, monkeypatch, capsys):
    said = runs(monkeypatch, capsys, "--json")
    answer = json.loads(said.out)
    assert (said.err, answer["format"], len(answer["runs"])) == ("", "rfca-runs/1", 32)
    first = answer["runs"][0]
    assert (first["run"], first["kind"], first["ended"]) == (
        "runs/SIM-static-001",
        "static",
        "done",
    )


def test_nothing_found_says_so_and_an_empty_folder_says_what_to_type(here, monkeypatch, capsys):
    assert "none of the 32 runs" in runs(monkeypatch, capsys, "--kind", "fatigue").err
    (here / "new").mkdir()
    assert "rfca-rig dynamic run" in runs(monkeypatch, capsys, "--runs", "new").err
    assert list((here / "new").iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--kind", "dynmic"), "did you mean dynamic?"),
        (("--ended", "triped"), "did you mean tripped?"),
        (("--verdict", "motor_speed_drop"), "did you mean motor_speed_droop?"),
        (("--height", "nan"), "--height nan"),
        (("--speed", "3..2"), "--speed 3..2"),
        (("--since", "yesterday"), "2026-11-01"),
        (("--runs", "nowhere"), "--runs"),
        (("--json", "--paths"), "give one of them"),
    ],
)
def test_a_mistake_is_one_line(here, monkeypatch, capsys, words, said):
    answer = typed(monkeypatch, capsys, "runs", *words)
    assert (answer.exit_code, answer.out, len(answer.err.splitlines())) == (2, "", 1)
    assert said in answer.err
