"""A sensor that is mounted in other axes: limits, view, recording and reports see the rig's."""

import json

import h5py
import numpy as np
import pytest

from rfca_rig.bench.factory import open_bench
from rfca_rig.bench.sensor_bench import open_sensor
from rfca_rig.description.rig_file import RigFile, read_rig
from rfca_rig.drivers.rotated_sensor import RotatedSensor
from rfca_rig.errors import BadInput
from rfca_rig.twin_server.faults import parse_fault_events
from tests.cli.typed import typed
from tests.engine.rigs import ROOT

TURNED = 'axes = ["-y", "x", "z"]\n'


def written(folder, in_sensor="", in_force_sensor="", noise_N="0.0"):
    """The twin's rig file with these lines in two of its tables."""
    text = (ROOT / "calibration" / "twin.toml").read_text()
    (folder / "twin-camera.toml").write_bytes(
        (ROOT / "calibration" / "twin-camera.toml").read_bytes()
    )
    text = text.replace("[sensor]\n", f"[sensor]\n{in_sensor}")
    text = text.replace("[force_sensor]\n", f"[force_sensor]\n{in_force_sensor}")
    text = text.replace("noise_N = 0.12", f"noise_N = {noise_N}")
    text = text.replace("noise_Nm = 0.006", f"noise_Nm = {noise_N}")
    path = folder / "rig.toml"
    path.write_text(text)
    return path


def rig_with(folder, *lines: str) -> RigFile:
    return read_rig(written(folder, *lines))


def provenance(run) -> dict[str, str]:
    with h5py.File(run / "run.h5") as recording:
        return json.loads(recording["provenance"].asstr()[()])


def counts_at_rest(rig, faults=()) -> np.ndarray:
    with open_bench(rig, 1, faults=parse_fault_events(faults)) as bench:
        bench.rack.set_height(0.2)
        bench.sensor.start()
        bench.clock.wait_until(0.3)
        return bench.sensor.read().counts


def test_a_turned_twin_gives_the_same_counts_in_the_rigs_axes(tmp_path):
    straight = counts_at_rest(rig_with(tmp_path))
    assert np.abs(straight[:, [1, 2, 3]]).min(axis=1).max() > 0
    assert np.array_equal(counts_at_rest(rig_with(tmp_path, TURNED)), straight)


def test_without_axes_the_driver_is_the_devices_own(tmp_path):
    with open_bench(rig_with(tmp_path), 1) as bench:
        assert not isinstance(bench.sensor, RotatedSensor)
        assert "axes" not in bench.sensor.identity()
    with open_bench(rig_with(tmp_path, TURNED), 1) as bench:
        assert bench.sensor.identity()["axes"] == "-y x z"


def test_a_sensor_that_the_file_does_not_know_to_be_turned_reads_otherwise(tmp_path):
    straight = counts_at_rest(rig_with(tmp_path))
    turned = counts_at_rest(rig_with(tmp_path), ["sensor-turned-90@0"])
    # The device's x then lies along the rig's y.
    assert np.array_equal(turned[1:, 0], straight[1:, 1])
    assert np.array_equal(turned[1:, 2], straight[1:, 2])


def test_the_mounting_is_no_part_of_the_nominal_model(tmp_path):
    assert rig_with(tmp_path, TURNED).nominal() == rig_with(tmp_path).nominal()


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ('axes = ["x", "y", "-z"]\n', r"sensor.axes: is left-handed, which no mounting .* is"),
        ('axes = ["x", "x", "z"]\n', r"sensor.axes: should name each of x, y and z once"),
        ('axes = ["x", "y"]\n', r"sensor.axes"),
        ('axes = ["x", "y", "up"]\n', r"sensor.axes\[3\]: should be 'x', '-x'"),
    ],
)
def test_axes_that_cannot_be_are_refused_with_their_line(tmp_path, line, said):
    with pytest.raises(BadInput, match=rf"rig.toml:\d+: {said}"):
        rig_with(tmp_path, line)


@pytest.mark.slow
def test_a_run_with_a_turned_sensor_is_recorded_in_the_rigs_axes(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    valleys = []
    for lines in ("", TURNED):
        path = written(tmp_path, lines, noise_N="0.01")
        said = typed(
            monkeypatch, capsys, "dynamic", "run", "--rig", path, "--height", 215, "--speed", 3,
            "--repeats", 1, "--json",
        )  # fmt: skip
        assert said.exit_code == 0, said.err
        valleys.append(json.loads(said.out)["strokes"][0]["valley_fz_N"])
    assert valleys[1] == pytest.approx(valleys[0], abs=0.05)
    (run,) = tmp_path.glob("runs/*-002")
    assert provenance(run)["sensor_axes"] == "-y x z"


def test_what_the_box_does_to_the_forces_is_said_before_a_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = ("dynamic", "run", "--rig", written(tmp_path), "--height", 320, "--speed", 3)
    one = ("--repeats", 1)
    refused = typed(monkeypatch, capsys, *words, *one, "--fault", "box-turned@0")
    assert refused.exit_code == 2
    assert "the tool transformation of the box" in refused.err
    assert not list(tmp_path.glob("runs/*"))


def test_a_filter_is_warned_of_and_recorded(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    path = written(tmp_path)
    said = typed(
        monkeypatch, capsys, "dynamic", "run", "--rig", path, "--height", 320, "--speed", 3,
        "--repeats", 1, "--fault", "box-filter@0",
    )  # fmt: skip
    assert said.exit_code == 0, said.err
    assert "force sensor: the box's low-pass filter is on, code 8, about 5 Hz" in said.err
    (run,) = tmp_path.glob("runs/*")
    assert provenance(run)["sensor_low_pass"] == "on, code 8, about 5 Hz (not verified)"
    assert provenance(run)["sensor_tool_transformation"] == "none"


def test_a_stated_filter_and_transformation_go_without_a_word_and_filter(tmp_path):
    stated = "low_pass = 8\ntool_transformation_deg = [0.0, 0.0, 90.0]\n"
    with open_sensor(rig_with(tmp_path, "", stated), 1) as bench:
        assert bench.sensor.check_configuration() == []
        identity = bench.sensor.identity()
        assert identity["low_pass"] == "on, code 8, about 5 Hz (not verified)"
        assert identity["tool_transformation"] == "shift 0, 0, 0 mm, turn 0, 0, 90 degrees"
        bench.sensor.start()
        bench.clock.wait_until(bench.clock.now_s() + 0.05)
        bench.load.push((0.0, 0.0, 10.0), 0.045)
        bench.clock.wait_until(bench.clock.now_s() + 0.1)
        samples = bench.sensor.read()
        # The answer of a first-order low-pass of 5 Hz to the step.
        since_s = samples.device_s[-1] - 0.05
        expected_N = 10.0 * (1.0 - np.exp(-2.0 * np.pi * 5.0 * since_s))
        assert 0.05 < since_s < 0.1
        assert samples.counts[-1, 2] / 1e6 == pytest.approx(expected_N, abs=0.1)


def test_an_axia_on_the_twin_tells_its_own_bits(tmp_path):
    axia = 'model = "axia"\n'
    text = written(tmp_path, "", axia).read_text().replace("rate_Hz = 7000.0", "rate_Hz = 7812.0")
    (tmp_path / "rig.toml").write_text(text)
    rig = read_rig(tmp_path / "rig.toml")
    with open_sensor(rig, 1) as bench:
        assert bench.sensor.identity()["make"] == "ATI Ethernet Axia, RDT"
        assert bench.sensor.scale().rate_Hz == pytest.approx(7812.0)
        bench.sensor.start()
        bench.load.push((0.0, 0.0, 3000.0), 0.045)
        bench.clock.wait_until(bench.clock.now_s() + 0.1)
        samples = bench.sensor.read()
        health = bench.sensor.health()
        assert health.saturated == len(samples.status) > 0
        assert "force or torque out of range" in health.notes[0]
        # As the Axia sent it, with the marks of this program.
        assert np.all(samples.status & ~np.uint32(0x28000) == 0xC0000000)
