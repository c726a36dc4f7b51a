"""rfca-rig fatigue as a person types it: cycles counted, stiffness checked, and an end where the
leg is worn.
"""

import json
from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.bench.expectation import predict_bending
from rfca_rig.bench.recorder import Recorder
from rfca_rig.description.protocol_file import read_fatigue
from rfca_rig.description.rig_file import read_rig
from rfca_rig.recording.store import read_recording
from rfca_rig.recording.tables import cycle_table
from tests.cli.test_commands import ROOT
from tests.cli.test_resume import FEW
from tests.cli.typed import typed

SOFTER = 0.85


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def protocol(here, *changes):
    text = (ROOT / "protocols" / "fatigue.toml").read_text()
    for old, new in (*FEW, *changes):
        assert old in text
        text = text.replace(old, new)
    (here / "few.toml").write_text(text)
    return here / "few.toml"


def test_110_degrees_is_what_the_protocol_s_height_bends_the_twin_s_leg_by():
    asked = read_fatigue(ROOT / "protocols" / "fatigue.toml").fatigue()
    rig = read_rig(ROOT / "calibration" / "twin.toml").model()
    bending = predict_bending(rig, asked.height_m, asked.speed_rad_s)
    assert np.degrees(bending.bending_rad) == pytest.approx(110.0, abs=0.1)
    assert predict_bending(rig, 0.215, asked.speed_rad_s).bending_rad > bending.bending_rad


def test_a_dry_run_of_a_million_says_what_a_cycle_is_how_many_there_are_and_how_long_they_take(
    here, monkeypatch, capsys
):
    said = typed(monkeypatch, capsys, "fatigue", "run", "--dry-run")
    assert said.exit_code == 0
    assert (
        "a cycle at 222.8 mm bends the leg by 110.0 deg between first and last link, "
        "with the shaft at 148 deg"
    ) in said.err
    assert (
        "222.8 mm, 6 rad/s on and on, model expects up to 50 N and 7.1 N m, 999900 times"
        in said.err
    )
    assert (
        "check at 100.0 deg, 222.8 mm, model expects up to 21 N and 4.5 N m, 101 times" in said.err
    )
    assert not (here / "runs").exists()


class Wearing:
    """Makes the twin's leg softer once it has been bent for a while."""

    def __init__(self, carry_out):
        self._carry_out = carry_out

    def __call__(self, plan, bench, recorder, *more):
        plant = bench.rack._plant
        done = Recorder.cycles

        def worn(stage):
            done(recorder, stage)
            plant.rig = replace(
                plant.rig,
                leg=replace(plant.rig.leg, k0_Nm_per_rad=SOFTER * plant.rig.leg.k0_Nm_per_rad),
            )
            plant._stand(plant.shaft().angle_rad, plant.height_m)

        recorder.cycles = worn
        self._carry_out(plan, bench, recorder, *more)


@pytest.mark.long
def test_a_leg_that_has_become_too_soft_ends_the_run(here, monkeypatch, capsys):
    import rfca_rig.cli.run_experiment

    monkeypatch.setattr(
        "rfca_rig.cli.run_experiment.run_plan", Wearing(rfca_rig.cli.run_experiment.run_plan)
    )
    path = protocol(here, ("every = 12", "every = 2"))
    said = typed(monkeypatch, capsys, "fatigue", "run", "--protocol", path, "--cycles", 8)
    assert said.exit_code == 4
    last = said.err.splitlines()[-1]
    assert last.startswith("rfca-rig: stiffness check 2: the forces are -1")
    assert "limit 5 %; look at the leg before anything else" in last
    (run,) = (here / "runs").iterdir()
    found = read_recording(run / "run.h5")
    assert (cycle_table(found).numbers.tolist(), len(found.static)) == ([2], 2)
    drift = found.static[1].fz_N / found.static[0].fz_N - 1.0
    assert drift == pytest.approx(SOFTER - 1.0, abs=0.04)
    assert found.provenance["ended"].startswith("stiffness check 2")
    again = typed(monkeypatch, capsys, "resume", run)
    assert again.exit_code == 4


@pytest.mark.slow
def test_cycles_are_counted_and_the_results_are_there_as_data(here, monkeypatch, capsys):
    said = typed(
        monkeypatch, capsys, "fatigue", "run", "--protocol", protocol(here), "--cycles", 3, "--json"
    )
    assert said.exit_code == 0
    found = json.loads(said.out)
    assert (found["source"], found["cycles"], found["planned"]) == ("SIM", 3, 3)
    (check,) = found["checks"]
    assert abs(check["drift_percent"]) < 4.0
    assert 0.0 < check["std_percent"] < 4.0


def test_a_number_of_cycles_that_cannot_be_is_refused(here, monkeypatch, capsys):
    path = protocol(here, ("drift_percent = 5.0", "drift_percent = 0"))
    said = typed(monkeypatch, capsys, "fatigue", "run", "--protocol", path)
    assert said.exit_code == 2
    assert "check.drift_percent: should be greater than 0" in said.err
