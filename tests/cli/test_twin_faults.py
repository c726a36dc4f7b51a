"""--fault on a run of the twin: what fails is met as on a real rig, and the run goes on without
it afterwards.
"""

from pathlib import Path

import pytest

from rfca_rig.recording.store import read_recording
from tests.cli.typed import typed

ROOT = Path(__file__).parents[2]
RUN = ("dynamic", "run", "--height", 215, "--speed", 3.249, "--repeats", 2)


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
def test_a_fault_trips_the_run_which_keeps_what_it_had_and_can_go_on_without_it(
    here, monkeypatch, capsys
):
    said = typed(monkeypatch, capsys, *RUN, "--fault", "force-silent@3")
    assert said.exit_code == 3
    assert said.err.splitlines()[-1].startswith("rfca-rig: TRIP S-01: force sensor silent for 5")
    (folder,) = (here / "runs").iterdir()
    kept = read_recording(folder / "run.h5")
    assert [stroke.repeat for stroke in kept.strokes] == [1]
    assert kept.provenance["twin_faults"] == "force-silent on at 3 s"
    assert typed(monkeypatch, capsys, "resume", folder, "--after-trip").exit_code == 0
    assert [stroke.repeat for stroke in read_recording(folder / "run.h5").strokes] == [1, 2]


def test_a_fault_inside_the_drive_happens_once(here, monkeypatch, capsys):
    said = typed(monkeypatch, capsys, *RUN, "--fault", "over-temperature@1.2")
    assert said.exit_code == 3
    assert "TRIP D-01: drive: error 0x00002000 (MOTOR_OVER_TEMP" in said.err.splitlines()[-1]


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("--fault", "force-quiet@3"), "no fault is called 'force-quiet'; there are force-lost, "),
        (("--fault", "force-silent"), "--fault force-silent: write NAME@SECONDS"),
        (("--fault", "http-busy@1"), "no fault is called 'http-busy'"),
        (
            ("--rig", ROOT / "tests" / "data" / "real-rig.toml", "--fault", "bus-off@1"),
            "nothing is broken on purpose on a real rig",
        ),
    ],
)
def test_what_cannot_fail_is_told_before_anything_moves(here, monkeypatch, capsys, words, why):
    said = typed(monkeypatch, capsys, *RUN, *words)
    assert (said.exit_code, len(said.err.splitlines())) == (2, 1)
    assert why in said.err
    assert list(here.iterdir()) == []
