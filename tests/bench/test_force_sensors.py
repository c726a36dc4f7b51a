"""Rig files with each force sensor, and runs on their twins."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from can.interfaces.virtual import VirtualBus

from rfca_rig.bench.factory import open_bench
from rfca_rig.description.rig_file import RigFile, read_rig
from rfca_rig.devices.ati_daq.driver import DaqFtSensor
from rfca_rig.devices.ati_daq.section import AtiDaqSection
from rfca_rig.devices.ati_serial.driver import AtiSerialSensor
from rfca_rig.devices.ati_serial.section import AtiSerialSection
from rfca_rig.devices.netft.driver import NetFtSensor
from rfca_rig.devices.netft.section import NetFtSection
from rfca_rig.errors import BadInput, DeviceError
from tests.cli.typed import typed
from tests.engine.rigs import ROOT

CAL = ROOT / "calibration" / "made-up-gamma.cal"
SECTIONS = {
    "ati-net-ft": (
        'counts_per_N = 1e6\ncounts_per_Nm = 1e6\nrate_Hz = 7000.0\nconfiguration = "http"\n'
    ),
    "ati-serial": (
        "counts_per_N = 20.0\ncounts_per_Nm = 333.3333\nrate_Hz = 250.0\nrecord = "
        '"binary-checksum"\n'
    ),
    "ati-daq": (
        'calibration_file = "gamma.cal"\nrate_Hz = 15000.0\nunloaded_V = [0.3, -0.2, 0.1, '
        "0.0, 0.2, -0.1]\n"
    ),
}


def written(folder: Path, device: str, section: str | None = None, real: bool = False) -> Path:
    """The twin's rig file with another force sensor, and the calibration file beside it."""
    text = (ROOT / ("tests/data/real-rig.toml" if real else "calibration/twin.toml")).read_text()
    before, rest = text.split("[force_sensor]\n")
    after = rest[rest.index("[twin]") :] if "[twin]" in rest else ""
    (folder / "gamma.cal").write_bytes(CAL.read_bytes())
    path = folder / f"{device}.toml"
    path.write_text(
        f'{before}[force_sensor]\ndevice = "{device}"\n{section or SECTIONS[device]}\n{after}'
    )
    return path


def rig_with(folder: Path, device: str, section: str | None = None, real: bool = False) -> RigFile:
    return read_rig(written(folder, device, section, real))


@pytest.mark.parametrize(
    ("device", "section", "driver"),
    [
        ("ati-net-ft", NetFtSection, NetFtSensor),
        ("ati-serial", AtiSerialSection, AtiSerialSensor),
        ("ati-daq", AtiDaqSection, DaqFtSensor),
    ],
)
def test_a_rig_file_names_its_force_sensor(tmp_path, device, section, driver):
    rig = rig_with(tmp_path, device)
    assert isinstance(rig.force_sensor, section)
    with open_bench(rig, 1) as bench:
        assert isinstance(bench.sensor, driver)
        assert bench.sensor.scale().rate_Hz == pytest.approx(rig.facts().rates.force_Hz)
        assert rig.facts().rates.force_Hz == rig.force_sensor.rate_Hz


@pytest.mark.slow
def test_a_dynamic_run_works_with_each_sensor_and_they_measure_the_same_valley(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    valleys = {}
    for device in SECTIONS:
        path = written(tmp_path, device)
        said = typed(
            monkeypatch,
            capsys,
            "dynamic",
            "run",
            "--rig",
            path,
            "--height",
            215,
            "--speed",
            3.249,
            "--repeats",
            1,
            "--json",
        )
        assert said.exit_code == 0
        (stroke,) = json.loads(said.out)["strokes"]
        valleys[device] = (stroke["valley_time_s"], stroke["valley_fz_N"])
    for time_s, fz_N in valleys.values():
        assert time_s == pytest.approx(valleys["ati-net-ft"][0], abs=0.015)
        assert fz_N == pytest.approx(valleys["ati-net-ft"][1], abs=0.5)


def test_the_calibration_file_counts_from_the_folder_of_the_rig_file(tmp_path, monkeypatch):
    rig = rig_with(tmp_path, "ati-daq")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    with open_bench(rig, 1) as bench:
        assert bench.sensor.identity()["serial_number"] == "MADE-UP-1"


@pytest.mark.slow
@pytest.mark.parametrize("device", list(SECTIONS))
def test_every_sensor_feels_the_same_plant(tmp_path, device):
    """Lifted off the ground at rest, all that is felt is the leg's weight of 0.32 kg."""
    with open_bench(rig_with(tmp_path, device), 1) as bench:
        bench.rack.set_height(0.4)
        bench.sensor.start()
        felt = []
        for _ in range(500):
            bench.clock.wait_until(bench.clock.now_s() + 0.01)
            samples = bench.sensor.read()
            scale = bench.sensor.scale()
            felt += (samples.counts[:, 2] / scale.counts_per_N).tolist()
        assert np.mean(felt[-int(2.0 * scale.rate_Hz) :]) == pytest.approx(0.32 * 9.81, abs=0.3)


@pytest.mark.parametrize(
    ("device", "section", "said"),
    [
        (
            "ati-netft",
            SECTIONS["ati-net-ft"],
            (
                r"force_sensor: 'device' should be one of 'ati-net-ft', 'ati-serial', "
                r"'ati-daq', 'own', not 'ati-netft'"
            ),
        ),
        (
            "ati-serial",
            SECTIONS["ati-net-ft"],
            r"force_sensor\.configuration: unknown key; known are device, counts_per_N",
        ),
        (
            "ati-serial",
            "counts_per_N = 20.0\ncounts_per_Nm = 333.0\nrate_Hz = 250.0\n",
            r"the line carries 85\.3 records/s in the form 'ascii'",
        ),
        (
            "ati-serial",
            SECTIONS["ati-serial"].replace("binary-checksum", "hex"),
            r"force_sensor\.record: should be 'ascii', 'binary' or",
        ),
        ("ati-daq", "rate_Hz = 15000.0\n", r"force_sensor\.calibration_file: missing"),
        (
            "ati-daq",
            SECTIONS["ati-daq"].replace("0.3, ", ""),
            r"unloaded_V: should have 6 or more entries, not 5",
        ),
        (
            "ati-net-ft",
            SECTIONS["ati-net-ft"].replace('"http"', '"web"'),
            r"force_sensor\.configuration: should be 'http', 'commands' or",
        ),
    ],
)
def test_a_sensor_that_cannot_be_is_refused_with_file_and_line(tmp_path, device, section, said):
    with pytest.raises(BadInput, match=said) as caught:
        rig_with(tmp_path, device, section)
    assert str(caught.value).startswith(f"{tmp_path}/{device}.toml:")
    assert "\n" not in str(caught.value)


def test_a_calibration_file_that_is_missing_or_none_is_one_line(tmp_path):
    rig = rig_with(tmp_path, "ati-daq")
    (tmp_path / "gamma.cal").write_text("<html/>")
    with pytest.raises(BadInput, match=r"gamma\.cal: begins with <html>"), open_bench(rig, 1):
        pass
    (tmp_path / "gamma.cal").unlink()
    with (
        pytest.raises(BadInput, match=r"gamma\.cal: cannot be read: No such file"),
        open_bench(rig, 1),
    ):
        pass


def test_real_sensors_that_are_not_there_are_told(tmp_path, monkeypatch):
    monkeypatch.setattr("can.Bus", lambda **_: VirtualBus(channel="nobody"))
    serial = SECTIONS["ati-serial"] + 'port = "/dev/not-there"\n'
    with pytest.raises(DeviceError, match="serial port /dev/not-there cannot be opened"):
        opened(rig_with(tmp_path, "ati-serial", serial, real=True))
    monkeypatch.setitem(sys.modules, "nidaqmx", None)
    with pytest.raises(BadInput, match="ati-daq needs NI's package"):
        opened(rig_with(tmp_path, "ati-daq", real=True))


def opened(rig: RigFile) -> None:
    with open_bench(rig, None):
        pass


def test_a_box_that_does_not_answer_stops_a_real_run_before_the_motor(tmp_path, monkeypatch):
    monkeypatch.setattr("can.Bus", lambda **_: VirtualBus(channel="nobody"))
    section = SECTIONS["ati-net-ft"] + 'host = "127.0.0.1"\nhttp_port = 1\n'
    with (
        open_bench(rig_with(tmp_path, "ati-net-ft", section, real=True), None) as bench,
        pytest.raises(DeviceError, match="no configuration"),
    ):
        bench.sensor.start()


def test_the_shipped_rig_with_a_daq_sensor_differs_from_the_twin_in_nothing_else():
    plain, daq = (read_rig(ROOT / "calibration" / f"{name}.toml") for name in ("twin", "twin-daq"))
    assert isinstance(daq.force_sensor, AtiDaqSection)
    assert daq.force_sensor.rate_Hz == 15_000.0
    assert Path(daq.force_sensor.calibration_file).is_file()
    same = {
        "force_sensor": plain.force_sensor,
        "rig": daq.rig.model_copy(update={"title": plain.rig.title}),
    }
    assert daq.model_copy(update=same) == plain
