"""A run as on the real rig, wall clock and all, where the far ends of the wires are the twin
server.
"""

import builtins
import json
import re

import numpy as np
import pytest

from rfca_rig.bench.factory import open_bench
from rfca_rig.bench.recorder import stroke_of
from rfca_rig.description.rig_file import RigFile, read_rig
from rfca_rig.drivers.roles import SensorScale, StreamHealth
from rfca_rig.engine.run import prove_stop, run_plan
from rfca_rig.engine.stopping import RecordedSamples, Sink
from rfca_rig.errors import DeviceError, Trip, Tripped
from rfca_rig.protocol.plan import Flap
from rfca_rig.recording.model import Stroke
from tests.engine.rigs import ROOT, nothing, one_condition, twin_rig
from tests.twin_server.server import Server, serving


def real_rig(folder, served: Server) -> RigFile:
    """The twin's rig file, as one writes it for a real rig at those addresses."""
    text = (ROOT / "calibration" / "twin.toml").read_text().partition("[twin]")[0]
    text = text.replace('kind = "twin"', 'kind = "real"')
    text = re.sub(r"\[motor\]\n", '[motor]\ninterface = "socketcand"\nchannel = "can0"\n', text)
    where = (
        f'[force_sensor]\nhost = "{served.host}"\nport = {served.rdt[1]}\nconfiguration = '
        f'"http"\nhttp_port = {served.ports["http_port"]}\n'
    )
    text = re.sub(r"\[force_sensor\]\n", where, text)
    file = folder / "real.toml"
    file.write_text(text)
    return read_rig(file)


@pytest.fixture
def served(monkeypatch):
    """The server; python-can finds it by its own environment, and the hand on the lead screws is
    the control port.
    """
    with serving() as server:
        monkeypatch.setenv(
            "CAN_CONFIG", json.dumps({"host": server.host, "port": server.ports["can_port"]})
        )

        def hand(prompt: str) -> str:
            height_mm = re.search(r"^REAL motor off. Set the rack to ([\d.]+) mm", prompt)[1]
            assert server.told(f"height {height_mm}") == "ok\n"
            return ""

        monkeypatch.setattr(builtins, "input", hand)
        yield server


class InMemory(Sink):
    """A sink that writes nothing to disk."""

    def __init__(self, scale: SensorScale) -> None:
        self._scale = scale
        self.strokes: list[Stroke] = []

    def flap(self, stage: Flap, recorded: RecordedSamples) -> None:
        self.strokes.append(stroke_of(stage, recorded, self._scale))

    def hold(self, stage: object, recorded: RecordedSamples) -> None:
        raise AssertionError(f"no hold in this plan, but {stage}: {recorded}")


def run_once(rig: RigFile) -> tuple[Stroke, StreamHealth]:
    with open_bench(rig, None) as bench:
        assert 0.05 < prove_stop(bench) < 0.5
        sink = InMemory(bench.sensor.scale())
        run_plan(one_condition(rig), bench, sink, nothing)
        return sink.strokes[0], bench.sensor.health()


@pytest.mark.realtime
def test_one_stroke_is_run_over_the_sockets_as_in_simulated_time(served, tmp_path):
    """A busy machine may be late, or leave drive or sensor without a word for too long: the trip
    is right, and tried again.
    """
    rig = real_rig(tmp_path, served)
    for attempt in range(5):
        try:
            stroke, health = run_once(rig)
            break
        except (Tripped, DeviceError) as late:
            by_time = isinstance(late, Tripped) and late.code in (Trip.LATE, Trip.SENSOR_SILENT)
            assert (by_time or "WATCHDOG" in str(late)) and attempt < 4, late
    force = stroke.streams["force"]
    shaft = stroke.streams["shaft"]
    assert (health.lost, health.malformed, health.notes) == (0, 0, [])
    assert np.diff(force.t_s) == pytest.approx(np.full(len(force.t_s) - 1, 1.0 / 7000.0))
    with open_bench(twin_rig(), 1) as simulated:
        sink = InMemory(simulated.sensor.scale())
        run_plan(one_condition(twin_rig()), simulated, sink, nothing)
    expected = sink.strokes[0].streams
    assert np.ptp(shaft.columns["shaft_angle_rad"].values) == pytest.approx(
        np.ptp(expected["shaft"].columns["shaft_angle_rad"].values), abs=0.1
    )
    valley, wanted = (
        streams["force"].columns["fz_N"].values.min() for streams in (stroke.streams, expected)
    )
    assert valley == pytest.approx(wanted, rel=0.15)
