"""A served rig with other devices: an F/T controller on a pseudo terminal, a CubeMars drive on
socketcand, read by our own drivers.
"""

import json

import numpy as np
import pytest

from rfca_rig.bench.factory import open_bench
from rfca_rig.description.rig_file import read_rig
from tests.engine.rigs import ROOT
from tests.twin_server.server import serving

MOTOR = (
    '[motor]\ndevice = "cubemars-mit"\ndrive_id = 1\nmodel = "AK80-9"\ndirection = '
    "1\nzero_rad = 0.0\n"
)
SENSOR = (
    '[force_sensor]\ndevice = "ati-serial"\ncounts_per_N = 20.0\ncounts_per_Nm = '
    "333.33\nrate_Hz = 80.0\n"
)
TICK_S = 2e-3
SPEED_RAD_S = 0.5


def rig_text() -> str:
    """The shipped twin with these two in place of its own."""
    text = (ROOT / "calibration" / "twin.toml").read_text()
    before, _, devices = text.partition("[motor]")
    return f"{before}{MOTOR}\n{SENSOR}\n[twin]{devices.partition('[twin]')[2]}"


@pytest.mark.realtime
def test_both_are_read_over_their_wires(tmp_path, monkeypatch):
    served_file = tmp_path / "served.toml"
    real_file = tmp_path / "real.toml"
    served_file.write_text(rig_text())
    with serving("--rig", str(served_file)) as server:
        line = str(server.ports["serial"])
        assert "rdt_port" not in server.ports
        monkeypatch.setenv(
            "CAN_CONFIG", json.dumps({"host": server.host, "port": server.ports["can_port"]})
        )
        text = rig_text().partition("[twin]")[0].replace('kind = "twin"', 'kind = "real"')
        text = text.replace("[motor]\n", '[motor]\ninterface = "socketcand"\n').replace(
            "[force_sensor]\n", f'[force_sensor]\nport = "{line}"\n'
        )
        real_file.write_text(text)
        with open_bench(read_rig(real_file), None) as bench:
            bench.sensor.start()
            bench.motor.enable()
            bench.motor.read()
            began_s = due_s = bench.clock.now_s()
            angles = []
            counts = []
            for _ in range(400):
                bench.motor.command_speed(SPEED_RAD_S)
                due_s = max(due_s + TICK_S, bench.clock.now_s())
                bench.clock.wait_until(due_s)
                angles += bench.motor.read().angle_rad.tolist()
                counts += bench.sensor.read().counts.tolist()
            assert bench.motor.status().fault is None
            took_s = bench.clock.now_s() - began_s
            bench.motor.disable()
            bench.sensor.stop()
    # it takes a moment to come up to speed; a machine that is busy makes the ticks longer and the
    # twin slow
    assert 0.15 < angles[-1] - angles[0] < SPEED_RAD_S * took_s + 0.05
    assert len(counts) > 30
    assert np.abs(counts).max() < 2**15
