"""rfca-rig setup sensor: what it finds, on a twin that is pushed, and what it writes."""

import json
import re
import tomllib

import pytest

from rfca_rig.cli.paths import SHIPPED_RIGS, is_shipped
from rfca_rig.description.rig_file import read_rig
from tests.bench.test_sensor_mount import written
from tests.cli.typed import typed
from tests.engine.rigs import ROOT

SETUP = ("setup", "sensor", "--rig")
# What went unnoticed before: the fault of the twin, and the finding that names it.
CASES = {
    "sensor-turned-90": ("sensor's axes", "yellow", "turned by 90 degrees about its z axis"),
    "sensor-turned-180": ("sensor's axes", "yellow", "turned by 180 degrees about its z axis"),
    "sensor-upside-down": ("sensor's axes", "yellow", "its y axis, upside down"),
    "sensor-mirrored": ("sensor's axes", "red", "mirrored, left-handed frame"),
    "channels-swapped": ("sensor's axes", "red", "fx and fy are swapped"),
    "channel-inverted": ("sensor's axes", "red", "fz has the wrong sign"),
    "sensor-gain": ("counts per newton", "red", "+20.0 %, where 5 % may differ"),
    "sensor-lower": ("below_shaft", "red", "(tx / fy), the rig file says 45"),
    "box-turned": ("sensor's box", "red", "turn 0, 0, 90 degrees"),
    "box-filter": ("sensor's box", "yellow", "code 8, about 5 Hz (not verified): forces come"),
    "box-pounds": ("sensor's box", "red", "1e+06 per lbf"),
    "box-axia": ("sensor's box", "red", "is an Ethernet Axia, whose status bits"),
}


@pytest.fixture
def rig(tmp_path):
    return written(tmp_path, noise_N="0.12")


def set_up(monkeypatch, capsys, rig, *options):
    said = typed(monkeypatch, capsys, *SETUP, rig, "--json", "--yes", *options)
    document = json.loads(said.out)
    return said, document, [one for one in document["findings"] if one["colour"] != "green"]


def test_there_are_twelve_cases():
    assert len(CASES) == 12


@pytest.mark.parametrize("fault", CASES)
def test_each_case_is_named_once_with_the_right_words(monkeypatch, capsys, rig, fault):
    before = rig.read_bytes()
    said, document, findings = set_up(monkeypatch, capsys, rig, "--fault", f"{fault}@0")
    subject, colour, words = CASES[fault]
    assert [(one["subject"], one["colour"]) for one in findings] == [(subject, colour)]
    assert words in findings[0]["seen"]
    assert said.exit_code == (colour == "red")
    # Nothing is written where something is red.
    assert document["written"] == (colour != "red")
    assert (rig.read_bytes() != before) == document["written"]


def test_counts_in_pounds_that_no_page_states_are_found_by_the_mass(monkeypatch, capsys, tmp_path):
    rig = written(tmp_path, "", 'configuration = "unchecked"\n', noise_N="0.12")
    said, _, findings = set_up(monkeypatch, capsys, rig, "--fault", "box-pounds@0")
    assert said.exit_code == 1
    assert "as if the sensor counted in lbf" in findings[0]["seen"]


def test_a_right_sensor_is_written_down_with_all_comments_kept(monkeypatch, capsys, rig):
    before = rig.read_text()
    said, document, findings = set_up(monkeypatch, capsys, rig, "--mass-kg", "2")
    assert (said.exit_code, findings, document["written"]) == (0, [], True)
    lines = [line for line in rig.read_text().splitlines() if line not in before.splitlines()]
    assert len(lines) == 1 and lines[0].startswith("checked = { date = ")
    checked = read_rig(rig).sensor.checked
    assert (checked.source, checked.mass_kg, checked.axes) == ("SIM", 2.0, ("x", "y", "z"))
    assert checked.force_N == pytest.approx(19.6, abs=0.1)
    assert set(before.splitlines()) <= set(rig.read_text().splitlines())
    # A second time it takes the place of the first.
    set_up(monkeypatch, capsys, rig)
    assert rig.read_text().count("checked = ") == 1
    assert read_rig(rig).sensor.checked.mass_kg == 1.0


def test_a_turned_sensor_is_written_and_then_as_the_file_says(monkeypatch, capsys, rig):
    set_up(monkeypatch, capsys, rig, "--fault", "sensor-turned-90@0")
    assert tomllib.loads(rig.read_text())["sensor"]["axes"] == ["-y", "x", "z"]
    assert set_up(monkeypatch, capsys, rig)[2] == []


def test_a_run_records_the_check(monkeypatch, capsys, rig, tmp_path):
    import h5py

    monkeypatch.chdir(tmp_path)
    set_up(monkeypatch, capsys, rig)
    said = typed(
        monkeypatch, capsys, "dynamic", "run", "--rig", rig, "--height", 320, "--speed", 3,
        "--repeats", 1,
    )  # fmt: skip
    assert said.exit_code == 0, said.err
    (run,) = tmp_path.glob("runs/*")
    with h5py.File(run / "run.h5") as recording:
        stored = json.loads(recording["provenance"].asstr()[()])
    assert "deviation_percent" in stored["rig_file"]
    assert stored["sensor_checked"].startswith("2000-01-01 on the twin: 1 kg read 9.8")


def test_without_a_terminal_and_a_yes_nothing_begins(monkeypatch, capsys, rig):
    said = typed(monkeypatch, capsys, *SETUP, rig)
    assert (said.exit_code, said.out) == (2, "")
    assert "answer on a terminal, or let it write by --yes" in said.err
    assert len(said.err.splitlines()) == 1


@pytest.mark.parametrize(("answer", "written_down"), [("y", True), ("n", False)])
def test_on_a_terminal_it_asks(monkeypatch, capsys, rig, answer, written_down):
    before = rig.read_text()
    monkeypatch.setattr("rfca_rig.cli.commands.setup.sensor._check_terminal", lambda: None)
    monkeypatch.setattr("typer.confirm", lambda *_, **__: answer == "y")
    said = typed(monkeypatch, capsys, *SETUP, rig)
    assert said.exit_code == 0
    assert (rig.read_text() != before) == written_down
    assert "push straight down on the shaft" in said.err
    assert "green   sensor's axes" in said.out


def test_a_rig_of_the_package_is_not_changed(monkeypatch, capsys):
    said, document, findings = set_up(monkeypatch, capsys, "twin")
    assert (said.exit_code, findings, document["written"]) == (0, [], False)


def test_the_rigs_of_the_package_are_known():
    shipped = ROOT / "calibration"
    rigs = [path for path in shipped.glob("*.toml") if "[rig]" in path.read_text()]
    assert sorted(path.stem for path in rigs) == sorted(SHIPPED_RIGS)
    assert all(map(is_shipped, rigs))
    # In a clone a lab's own file may stand beside them.
    assert not is_shipped(shipped / "our-rig.toml")


def test_a_filter_that_is_known_is_given_to_the_model(monkeypatch, capsys, tmp_path):
    """As docs/force-sensors.md says: the nominal model of a real rig has the lag."""
    lag = '[[effects]]\nid = "sensor_lag"\nparameters = { time_constant_s = 0.032 }\n\n[drive]'
    rig = written(tmp_path, "", "low_pass = 8\n")
    rig.write_text(rig.read_text().replace('kind = "twin"', 'kind = "real"'))
    words = ("predict", "--height", 215, "--speed", 3, "--rig", rig)
    without = typed(monkeypatch, capsys, *words)
    rig.write_text(rig.read_text().replace("[drive]", lag, 1))
    assert [effect.id for effect in read_rig(rig).effects] == ["sensor_lag"]
    late = typed(monkeypatch, capsys, *words)
    assert (without.exit_code, late.exit_code) == (0, 0), late.err
    # The valley comes later, by less than the time constant, and is less deep.
    (before_s, before_N), (after_s, after_N) = (
        map(float, re.search(r"valley at ([\d.]+) s, fz (-[\d.]+) N", said.out).groups())
        for said in (without, late)
    )
    assert 0.01 < after_s - before_s < 0.032
    assert before_N < after_N


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--mass-kg", "0"), "--mass-kg"),
        (("--fault", "flood@0"), "no fault is called 'flood'"),
        (("--lever-mm", "5000"), "--lever-mm"),
    ],
)
def test_bad_input_is_refused(monkeypatch, capsys, rig, options, words):
    said = typed(monkeypatch, capsys, *SETUP, rig, "--yes", *options)
    assert said.exit_code == 2
    assert words in said.err


def test_a_fault_on_a_real_rig_is_refused(monkeypatch, capsys, rig):
    rig.write_text(rig.read_text().replace('kind = "twin"', 'kind = "real"'))
    said = typed(monkeypatch, capsys, *SETUP, rig, "--yes", "--fault", "sensor-gain@0")
    assert said.exit_code == 2
    assert "--fault is for twins" in said.err
