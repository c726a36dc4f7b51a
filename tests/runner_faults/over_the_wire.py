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
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from math import nan
from pathlib import Path
from unittest import mock

import can

from rfca_rig.bench.factory import open_bench
from rfca_rig.bench.recorder import Recorder
from rfca_rig.cli.run_experiment import handle_signals
from rfca_rig.description.rig_file import RigFile, read_rig
from rfca_rig.engine.run import Supervision, run_plan
from rfca_rig.errors import RigError
from rfca_rig.protocol.plan import Flap, Hold, Plan, Rest, Stage
from rfca_rig.recording import run_folder
from rfca_rig.recording.backend import RecorderClient
from rfca_rig.recording.model import Recording
from tests.guardian import rigs as guarded_rigs
from tests.runner_faults.cause import GOES_ON
from tests.runner_faults.outcome import Hooked, code_of
from tests.runner_faults.rig import TRUE, short_plan
from tests.twin_server.can_proxy import LoggedFrame, RunningProxy, can_proxy, last_torque_s, shows_odrive_torque
from tests.twin_server.server import Server, serving
from tests.twin_server.test_real_run import real_rig

# From the begin of the stage to the fault, and for how long the shaft is held.
AFTER_S = 0.3
HELD_S = 4.0


@dataclass(frozen=True)
class WireRun:
    """How a run ended: by which code or error, what it said, and when the fault began; NaN where the run ended before."""

    ended: str
    message: str
    begun_s: float
    frames: list[LoggedFrame]
    shows_torque: Callable[[LoggedFrame], bool] = shows_odrive_torque

    @property
    def torque_s(self) -> float:
        """Time from the fault to the last torque of the drive."""
        return last_torque_s(self.frames, self.shows_torque) - self.begun_s

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
        """Returns when it did."""
        return kill_process(self.recorder_id)

    def kill_guardian(self) -> float:
        """Returns when it did."""
        children = Path(f"/proc/self/task/{threading.main_thread().native_id}/children").read_text(encoding="utf-8").split()
        guardians = [child for child in children if "guarded_bus" in Path(f"/proc/{child}/cmdline").read_text(encoding="utf-8")]
        return kill_process(int(guardians[0]))


def kill_process(process_id: int) -> float:
    """Returns when it did."""
    begun_s = time.monotonic()
    os.kill(process_id, signal.SIGKILL)
    return begun_s


@contextmanager
def served_rig(folder: Path) -> Iterator[tuple[Server, RigFile]]:
    """A twin server, and the rig file of a real rig at its addresses."""
    with serving() as server:
        yield server, real_rig(folder, server)


@contextmanager
def served_guarded_rig(folder: Path) -> Iterator[tuple[Server, RigFile]]:
    """The same with an AK drive in MIT mode, whose bus a guardian holds."""
    with guarded_rigs.served_rig(folder, "mit") as served:
        real_rig(folder, served.server)
        text = (folder / "real.toml").read_text(encoding="utf-8")
        motor = 'interface = "socketcand"\nchannel = "can0"\nguardian = true\n' + guarded_rigs.SECTIONS["mit"]
        before, rest = text.split("[motor]\n")
        (folder / "real.toml").write_text(f"{before}[motor]\n{motor}\n{rest[rest.index('[force_sensor]') :]}", encoding="utf-8")
        yield served.server, read_rig(folder / "real.toml")


def shows_mit_torque(frame: LoggedFrame) -> bool:
    """Whether the AK drive reports a torque in this frame."""
    frames = guarded_rigs.LAST_WORDS["mit"]
    torque_Nm = frames.torque_Nm(can.Message(arbitration_id=frame.can_id, data=frame.data, is_extended_id=False))
    return torque_Nm is not None and abs(torque_Nm) >= frames.min_visible_torque_Nm()


def run_with_fault(server: Server, rig: RigFile, begin: Callable[[Wire], float], in_hold: bool) -> WireRun:
    """Runs the short plan; `begin` starts the fault and returns when it did.

    It begins in the stroke, or while the shaft is held and nothing is recorded.
    """
    with can_proxy(server.host, int(server.ports["can_port"])) as proxy, tempfile.TemporaryDirectory() as place, ExitStack() as patches:
        where = json.dumps({"host": "127.0.0.1", "port": proxy.port})
        patches.enter_context(mock.patch.dict(os.environ, {"CAN_CONFIG": where}))
        patches.enter_context(mock.patch.object(builtins, "input", lambda text: _set_rack(server, text)))
        folder = Path(place) / "run"
        run_folder.create(folder, Recording("a run", "SIM", rig.nominal(), {}, (), ()))
        keeper = RecorderClient(folder, patient=False)
        error, begun_s = _run(rig, keeper, Wire(proxy, server, keeper.process_id), begin, in_hold)
        shows_torque = shows_odrive_torque if rig.motor.device == "odrive" else shows_mit_torque
        return WireRun(GOES_ON if error is None else code_of(error), str(error or ""), begun_s, proxy.finish(), shows_torque)


def _set_rack(server: Server, prompt: str) -> str:
    height_mm = re.search(r"Set the rack to ([\d.]+) mm", prompt)[1]
    assert server.told(f"height {height_mm}") == "ok\n"
    return ""


def _run(rig: RigFile, keeper: RecorderClient, wire: Wire, begin: Callable[[Wire], float], in_hold: bool) -> tuple[RigError | None, float]:
    """The error that ended the run, if any, and when the fault began."""
    begun: list[float] = []

    def begin_soon() -> None:
        threading.Timer(AFTER_S, lambda: begun.append(begin(wire))).start()

    def on_begin(stage: Flap | Hold, _start_s: float) -> None:
        if isinstance(stage, Flap) and not in_hold:
            begin_soon()

    def on_stage(stage: Stage) -> None:
        # The hold comes next.
        if isinstance(stage, Rest) and in_hold:
            begin_soon()

    supervision, error = Supervision(), None
    with open_bench(rig, None) as bench, handle_signals(supervision.stop_request, lambda _: None):
        keeper.watch(supervision.helpers)
        recorder = Recorder(keeper, bench.sensor.scale(), bench.clock)
        try:
            run_plan(_plan(rig, in_hold), bench, Hooked(recorder, on_begin), on_stage, supervision)
        except RigError as caught:
            error = caught
    # A recorder that was killed cannot finish.
    with suppress(RigError):
        keeper.finish("done")
    return error, begun[0] if begun else nan


def _plan(rig: RigFile, in_hold: bool) -> Plan:
    fidelity = replace(TRUE, encoder_s=1.0 / rig.motor.reports_Hz)
    plan = short_plan(rig.facts().limits, fidelity, speed_rad_s=3.0)
    dwell_s = HELD_S if in_hold else 0.0
    stages = [replace(stage, timing=replace(stage.timing, dwell_s=dwell_s)) if isinstance(stage, Hold) else stage for stage in plan.stages]
    return replace(plan, stages=tuple(stages))
