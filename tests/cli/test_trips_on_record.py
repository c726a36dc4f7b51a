"""Every trip leaves a run: of every protocol, on every rig that is shipped, at the first tick
and later.
"""

import re

import pytest

from rfca_rig.engine.limit_monitor import LimitMonitor
from rfca_rig.errors import Trip, Tripped
from rfca_rig.toml import read_data
from tests.cli.test_commands import ROOT
from tests.cli.typed import typed

PROTOCOLS = sorted(path.stem for path in (ROOT / "protocols").glob("*.toml"))
RIGS = sorted(
    path.stem for path in (ROOT / "calibration").glob("*.toml") if "rig" in read_data(path)
)


def trip_at(at_s: float):
    motion = LimitMonitor.motion

    def trip_or_go_on(monitor, now_s, *arguments):
        if now_s >= at_s:
            raise Tripped(Trip.FORCE, "injected")
        motion(monitor, now_s, *arguments)

    return trip_or_go_on


def test_the_rigs_that_are_shipped_are_found():
    assert RIGS == ["twin", "twin-daq"]
    assert len(PROTOCOLS) == 6


@pytest.mark.slow
@pytest.mark.parametrize("at_s", [0.0, 1.5])
@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_trip_leaves_a_run_that_can_be_checked_and_continued(
    tmp_path, monkeypatch, capsys, protocol, rig, at_s
):
    experiment = read_data(ROOT / "protocols" / f"{protocol}.toml")["experiment"]
    runs = tmp_path / "runs"
    with monkeypatch.context() as tripping:
        tripping.setattr(LimitMonitor, "motion", trip_at(at_s))
        tripped = typed(
            tripping,
            capsys,
            experiment,
            "run",
            "--protocol",
            protocol,
            "--rig",
            rig,
            "--runs",
            runs,
        )
    assert tripped.exit_code == Tripped.exit_code
    (run,) = runs.iterdir()
    kept = " ".join((tripped.out + tripped.err).split())
    assert f"rfca-rig resume {run} --after-trip goes on" in kept
    checked = typed(monkeypatch, capsys, "check", run)
    assert checked.exit_code == 0, checked.out
    assert re.search(r"end\.json: TRIP L-01: injected", checked.out)
    refused = typed(monkeypatch, capsys, "resume", run)
    assert refused.exit_code == 2
    assert "say --after-trip to go on" in refused.err
    assert typed(monkeypatch, capsys, "resume", run, "--after-trip", "--dry-run").exit_code == 0


def test_a_plan_that_parks_the_leg_in_the_plate_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "calibration" / "twin.toml").read_text()
    (tmp_path / "twin-camera.toml").write_bytes(
        (ROOT / "calibration" / "twin-camera.toml").read_bytes()
    )
    rig = tmp_path / "rig.toml"
    rig.write_text(text.replace("parked_angle_deg = 20.0", "parked_angle_deg = 40.0"))
    refused = typed(monkeypatch, capsys, "plan", "impact", "--rig", rig)
    assert refused.exit_code == 2
    said = re.fullmatch(
        r"rfca-rig: impact test: the leg parked at 40 deg hangs 197 mm below the shaft "
        r"and reaches the plate, which is 155\.0 mm below it; "
        r"set \[rig\] parked_angle_deg in the rig file to (\d+) or less, or raise the rack\n",
        refused.err,
    )
    assert said
    rig.write_text(text.replace("parked_angle_deg = 20.0", f"parked_angle_deg = {said[1]}"))
    assert typed(monkeypatch, capsys, "plan", "impact", "--rig", rig).exit_code == 0
    rig.write_text(
        text.replace("parked_angle_deg = 20.0", f"parked_angle_deg = {int(said[1]) + 1}")
    )
    assert typed(monkeypatch, capsys, "plan", "impact", "--rig", rig).exit_code == 2
