"""A moteus on a fdcanusb as on a real rig, wall clock and all; the far end of the serial line is
the twin server.
"""

import builtins
import json
import re
from pathlib import Path

import numpy as np
import pytest

from rfca_rig.bench.factory import open_bench
from rfca_rig.clock import WallClock
from rfca_rig.description.rig_file import RigFile, read_rig
from rfca_rig.devices.drive_setup import DriveNeeds
from rfca_rig.devices.moteus import DEVICE
from rfca_rig.drivers.roles import StreamHealth
from rfca_rig.engine.run import prove_stop, run_plan
from rfca_rig.errors import DeviceError, Tripped
from rfca_rig.recording.model import Stroke
from tests.bench.test_moteus_and_odrive_rigs import MOTEUS, rig_with
from tests.cli.typed import typed
from tests.engine.rigs import nothing, one_condition
from tests.twin_server.server import Server, serving
from tests.twin_server.test_real_run import InMemory

# A machine that is busy with something else is late, and its twins lose time. Here the bytes of the
# adapter are tested, not the time.
PATIENT_LIMITS = {
    "force_N": 3000.0,
    "torque_Nm": 250.0,
    "speed_rad_s": 100.0,
    "following_error_deg": 360.0,
    "sensor_silent_ms": 5000.0,
    "drive_silent_ms": 5000.0,
    "above_expected": 50.0,
    "late_ms": 300.0,
}

NEEDS = DriveNeeds(speed_rad_s=20.0, torque_Nm=25.0, watchdog_s=0.1, late_s=0.05)


def write_real_rig(folder: Path, served: Server) -> Path:
    """The served twin's rig file, as one writes it for a real rig at those addresses."""
    text = (folder / "rig.toml").read_text().partition("[twin]")[0]
    text = text.replace('kind = "twin"', 'kind = "real"')
    motor = f'[motor]\ninterface = "fdcanusb"\nchannel = "{served.ports["fdcanusb"]}"\n'
    sensor = (
        f'[force_sensor]\nhost = "{served.host}"\nport = {served.rdt[1]}\nconfiguration = '
        f'"http"\nhttp_port = {served.ports["http_port"]}\n'
    )
    for key, limit in PATIENT_LIMITS.items():
        text, count = re.subn(rf"(?m)^{key} = \S+", f"{key} = {limit}", text)
        assert count == 1, key
    text = text.replace("[limits]\n", "[limits]\nreading_age_ms = 5000.0\n")
    motor += "watchdog_ms = 400.0\n"
    text = text.replace("[motor]\n", motor).replace("[force_sensor]\n", sensor)
    file = folder / "real.toml"
    file.write_text(text)
    return file


def run_once(rig: RigFile) -> tuple[Stroke, StreamHealth, dict[str, str]]:
    with open_bench(rig, None) as bench:
        assert prove_stop(bench) > 0.2
        sink = InMemory(bench.sensor.scale())
        run_plan(one_condition(rig), bench, sink, nothing)
        return sink.strokes[0], bench.sensor.health(), bench.motor.identity()


@pytest.mark.realtime
def test_one_stroke_is_run_over_the_adapter_as_in_simulated_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A machine that is busier still may trip: that is right, and the stroke tried again."""
    twin = rig_with(tmp_path, MOTEUS)
    with serving("--rig", str(tmp_path / "rig.toml")) as served:

        def hand(prompt: str) -> str:
            height_mm = re.search(r"^REAL motor off. Set the rack to ([\d.]+) mm", prompt)[1]
            assert served.told(f"height {height_mm}") == "ok\n"
            return ""

        monkeypatch.setattr(builtins, "input", hand)
        rig = read_rig(write_real_rig(tmp_path, served))
        for attempt in range(5):
            try:
                stroke, health, identity = run_once(rig)
                break
            except (Tripped, DeviceError) as trip:
                assert "adapter" not in str(trip), trip
                assert attempt < 4, trip
    assert health.malformed == 0
    assert identity["bus"] == f"fdcanusb {served.ports['fdcanusb']}"
    assert identity["can_error_frames"] == "0"
    with open_bench(twin, 1) as simulated:
        sink = InMemory(simulated.sensor.scale())
        run_plan(one_condition(twin), simulated, sink, nothing)
    expected = sink.strokes[0].streams["shaft"].columns["shaft_angle_rad"].values
    turned = stroke.streams["shaft"].columns["shaft_angle_rad"].values
    assert np.ptp(turned) == pytest.approx(np.ptp(expected), abs=0.1)


@pytest.mark.realtime
def test_the_doctor_finds_the_drive_behind_the_adapter_and_the_settings_that_are_wrong(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rig_with(tmp_path, MOTEUS)
    with serving("--rig", str(tmp_path / "rig.toml")) as served:
        file = write_real_rig(tmp_path, served)
        said = typed(monkeypatch, capsys, "doctor", "--rig", file, "--runs", tmp_path, "--json")
        findings = {one["subject"]: one for one in json.loads(said.out)["findings"]}
        assert findings["CAN bus"]["seen"] == f"fdcanusb {served.ports['fdcanusb']} opens"
        assert findings["drive"]["seen"].startswith("moteus 3, 24.0 V")
        served.told("on factory-settings")
        keys = read_rig(file).motor
        with keys.open() as bus:
            setup = DEVICE.make_setup(keys, bus, WallClock(), NEEDS)
            wrong = [setting for setting in setup.read() if setting.is_wrong]
            assert [setting.name for setting in wrong] == [
                "id.id",
                "servopos.position_min",
                "servopos.position_max",
                "servo.default_timeout_s",
            ]
            setup.write(wrong)
            setup.save()
        served.told("on drive-restart")
        with keys.open() as bus:
            setup = DEVICE.make_setup(keys, bus, WallClock(), NEEDS)
            assert not any(setting.is_wrong for setting in setup.read())
