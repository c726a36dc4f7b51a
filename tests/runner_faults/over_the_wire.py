"""A run as on a real rig, against the twin server and through a proxy, in which something goes wrong while the shaft is held or moves."""

import builtins
import json
import os
import re
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from unittest import mock

from rfca_rig.bench.factory import open_bench
from rfca_rig.bench.recorder import Recorder
from rfca_rig.description.rig_file import RigFile
from rfca_rig.engine.run import Supervision, run_plan
from rfca_rig.errors import RigError, Tripped
from rfca_rig.protocol.plan import Flap, Hold, Stage
from rfca_rig.recording import run_folder
from rfca_rig.recording.backend import RecorderClient
from rfca_rig.recording.model import Recording
from tests.runner_faults.outcome import Hooked
from tests.runner_faults.rig import TRUE, short_plan
from tests.twin_server.can_proxy import LoggedFrame, RunningProxy, can_proxy, last_torque_s
from tests.twin_server.server import Server, serving
from tests.twin_server.test_real_run import real_rig

# From the begin of the stage to the fault, and for how long the shaft is held at least.
AFTER_S = 0.3
HELD_S = 6.0


@dataclass(frozen=True)
class WireRun:
    """How a run ended: by which code or error, what it said, and the time from the fault to the last torque of the drive."""

    ended: str
    message: str
    begun_s: float
    frames: list[LoggedFrame]

    @property
    def torque_s(self) -> float:
        return last_torque_s(self.frames) - self.begun_s

    @property
    def since_third_damaged_s(self) -> float:
        """Time from the third damaged frame to the last torque of the drive."""
        damaged = [frame for frame in self.frames if frame.is_damaged]
        return last_torque_s(self.frames) - damaged[2].t_s


@dataclass
class Wire:
    """What a fault may lay hands on."""

    proxy: RunningProxy
    server: Server
    recorder_id: int

    def kill_recorder(self) -> float:
        begun_s = time.monotonic()
        os.kill(self.recorder_id, signal.SIGKILL)
        return begun_s


@contextmanager
def served_rig(folder: Path) -> Iterator[tuple[Server, RigFile]]:
    with serving() as server:
        rig = real_rig(folder, server)
        yield server, rig


def run_with_fault(server: Server, rig: RigFile, begin: Callable[[Wire], float], in_hold: bool, speed_rad_s: float = 3.0) -> WireRun:
    """Runs the short plan; `begin` starts the fault, in the hold or in the stroke, and returns when it did."""
    with can_proxy(server.host, int(server.ports["can_port"])) as proxy, tempfile.TemporaryDirectory() as place:
        where = json.dumps({"host": "127.0.0.1", "port": proxy.port})
        with mock.patch.dict(os.environ, {"CAN_CONFIG": where}), mock.patch.object(builtins, "input", lambda text: _set_rack(server, text)):
            ended, message, begun_s = _run(rig, Path(place) / "run", proxy, server, begin, in_hold, speed_rad_s)
        return WireRun(ended, message, begun_s, proxy.finish())


def _set_rack(server: Server, prompt: str) -> str:
    height_mm = re.search(r"Set the rack to ([\d.]+) mm", prompt)[1]
    assert server.told(f"height {height_mm}") == "ok\n"
    return ""


def _run(
    rig: RigFile,
    folder: Path,
    proxy: RunningProxy,
    server: Server,
    begin: Callable[[Wire], float],
    in_hold: bool,
    speed_rad_s: float,
) -> tuple[str, str, float]:
    run_folder.create(folder, Recording("a run", "SIM", rig.nominal(), {}, (), ()))
    keeper = RecorderClient(folder, patient=False)
    wire = Wire(proxy, server, keeper.process_id)
    begun: list[float] = []

    def on_begin(stage: Flap | Hold, _start_s: float) -> None:
        if isinstance(stage, Hold) == in_hold:
            threading.Timer(AFTER_S, lambda: begun.append(begin(wire))).start()

    plan = short_plan(
        rig.facts().limits, replace(TRUE, encoder_s=1e-3 * rig.motor.encoder_period_ms), speed_rad_s, HELD_S if in_hold else 0.1
    )
    ended, message = "goes on", ""
    with open_bench(rig, None) as bench:
        supervision = Supervision()
        keeper.watch(supervision.helpers)
        recorder = Recorder(keeper, bench.sensor.scale(), bench.clock)
        try:
            run_plan(plan, bench, Hooked(recorder, on_begin), _nothing, supervision)
        except RigError as error:
            ended, message = (str(error.code) if isinstance(error, Tripped) else type(error).__name__), str(error)
        finally:
            _finish(keeper, ended)
    return ended, message, begun[0] if begun else float("nan")


def _finish(keeper: RecorderClient, why: str) -> None:
    try:
        keeper.finish(why)
    except RigError:
        # A recorder that was killed is what some faults are about.
        return


def _nothing(_stage: Stage) -> None:
    """Progress nobody watches."""
