"""The paper's impact test runs on every rig that is shipped, parked above the plate."""

import csv

import pytest

from tests.cli.test_trips_on_record import PROTOCOLS, RIGS
from tests.cli.typed import typed


@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_the_parked_leg_clears_the_plate_of_every_protocol(monkeypatch, capsys, protocol, rig):
    assert typed(monkeypatch, capsys, "plan", protocol, "--rig", rig).exit_code == 0


@pytest.mark.slow
@pytest.mark.parametrize("rig", RIGS)
def test_the_impact_test_runs_and_gives_the_papers_table(tmp_path, monkeypatch, capsys, rig):
    report = tmp_path / "report"
    ran = typed(
        monkeypatch,
        capsys,
        "dynamic",
        "run",
        "--protocol",
        "impact",
        "--rig",
        rig,
        "--runs",
        tmp_path / "runs",
        "--report",
        report,
    )
    assert ran.exit_code == 0
    with (report / "peak-forces.csv").open(encoding="utf-8") as file:
        (row,) = csv.DictReader(file)
    assert float(row["height_mm"]) == 155.0
    assert float(row["speed_rad_s"]) == 15.0
    assert int(row["repeats"]) == 5
    # The model expects 139.6 N; the twin's noise and scatter are 3 N at most.
    measured_N, simulated_N = (float(row[f"{kind}_force_N"]) for kind in ("measured", "simulated"))
    assert simulated_N == pytest.approx(139.6, abs=1.0)
    assert measured_N == pytest.approx(simulated_N, abs=5.0)
    assert "The paper\u2019s own peak at 155 mm, 15 rad/s" in (report / "report.html").read_text(
        encoding="utf-8"
    )
