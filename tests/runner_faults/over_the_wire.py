"""A run as on a real rig, against the twin server and through a proxy, in which something goes
wrong while the shaft is held or moves.
"""

import builtins
import json
import os
import re
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from math import nan
from pathlib import Path
from unittest import mock

import can

from rfca_rig.bench import factory
from rfca_rig.bench.factory import open_bench, open_commanding_bus
from rfca_rig.bench.photo_reader import PhotoReader
from rfca_rig.bench.recorder import Recorder
from rfca_rig.cli.run_experiment import handle_signals
from rfca_rig.clock import WallClock
from rfca_rig.description.rig_file import RigFile, read_rig
from rfca_rig.engine.run import Supervision, prove_stop, run_plan
from rfca_rig.errors import RigError
from rfca_rig.protocol.plan import Flap, Hold, Plan, Rest, Stage
from rfca_rig.recording import run_folder
from rfca_rig.recording.backend import RecorderClient
from rfca_rig.recording.model import Recording
from tests.bench.test_photo_reader import EYE
from tests.guardian import rigs as guarded_rigs
from tests.runner_faults.breakable import BreakableBus
from tests.runner_faults.cause import GOES_ON, Cause
from tests.runner_faults.outcome import Hooked, code_of
from tests.runner_faults.rig import EXPECTED_LOAD, TRUE, short_plan
from tests.twin_server.can_proxy import (
    LoggedFrame,
    RunningProxy,
    can_proxy,
    last_torque_s,
    shows_odrive_torque,
)
from tests.twin_server.server import COMMAND, Server, serving
from tests.twin_server.test_real_run import real_rig

# From the begin of the stage to the fault, and for how long the shaft is held.
AFTER_S = 0.3
HELD_S = 4.0


@dataclass(frozen=True)
class WireRun:
    """How a run ended: by which code or error, what it said, and when the fault began; NaN where
    the run ended before.
    """

    ended: str
    message: str
    begun_s: float
    frames: list[LoggedFrame]
    shows_torque: Callable[[LoggedFrame], bool] = shows_odrive_torque
    # When the motor last gave torque, where the server tells.
    motor_s: float | None = None

    @property
    def torque_s(self) -> float:
        """Time from the fault to the last torque of the motor, else to the last one that the
        drive reports.
        """
        if self.motor_s is None:
            last_s = last_torque_s(self.frames, self.shows_torque)
        else:
            last_s = self.motor_s
        return last_s - self.begun_s

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
    # The process that reads photos, where the run was to have one.
    photo_reader: PhotoReader | None = None
    # This process's end of the bus, where it was asked for.
    adapter: BreakableBus | None = None

    def kill_recorder(self) -> float:
        """Returns when it did."""
        return kill_process(self.recorder_id)

    def kill_photo_reader(self) -> float:
        """Returns when it did."""
        return kill_process(self.photo_reader._process.pid)

    def kill_guardian(self) -> float:
        """Returns when it did."""
        children = (
            Path(f"/proc/self/task/{threading.main_thread().native_id}/children")
            .read_text(encoding="utf-8")
            .split()
        )
        guardians = [
            child
            for child in children
            if "guarded_bus" in Path(f"/proc/{child}/cmdline").read_text(encoding="utf-8")
        ]
        return kill_process(int(guardians[0]))


def kill_process(process_id: int) -> float:
    """Returns when it did."""
    begun_s = time.monotonic()
    os.kill(process_id, signal.SIGKILL)
    return begun_s


@contextmanager
def served_rig(folder: Path, command: Sequence[str] = COMMAND) -> Iterator[tuple[Server, RigFile]]:
    """A twin server, and the rig file of a real rig at its addresses."""
    with serving(command=command) as server:
        yield server, real_rig(folder, server)


@contextmanager
def served_guarded_rig(folder: Path) -> Iterator[tuple[Server, RigFile]]:
    """The same with an AK drive in MIT mode, whose bus a guardian holds."""
    with guarded_rigs.served_rig(folder, "mit") as served:
        real_rig(folder, served.server)
        text = (folder / "real.toml").read_text(encoding="utf-8")
        motor = (
            'interface = "socketcand"\nchannel = "can0"\nguardian = true\n'
            + guarded_rigs.SECTIONS["mit"]
        )
        before, rest = text.split("[motor]\n")
        (folder / "real.toml").write_text(
            f"{before}[motor]\n{motor}\n{rest[rest.index('[force_sensor]') :]}", encoding="utf-8"
        )
        yield served.server, read_rig(folder / "real.toml")


def shows_mit_torque(frame: LoggedFrame) -> bool:
    """Whether the AK drive reports a torque in this frame."""
    frames = guarded_rigs.LAST_WORDS["mit"]
    torque_Nm = frames.torque_Nm(
        can.Message(arbitration_id=frame.can_id, data=frame.data, is_extended_id=False)
    )
    return torque_Nm is not None and abs(torque_Nm) >= frames.min_visible_torque_Nm()


class Adapter(BreakableBus):
    """A real bus that fails in this process, as the driver of an adapter does."""

    def shutdown(self) -> None:
        super().shutdown()
        self._end.shutdown()


def run_with_fault(
    server: Server,
    rig: RigFile,
    begin: Callable[[Wire], float],
    in_hold: bool,
    cause: Cause | None = None,
    reads_photos: bool = False,
) -> WireRun:
    """Runs the short plan; `begin` starts the fault and returns when it did.

    It begins in the stroke, or while the shaft is held and nothing is recorded. With a cause of the
    fault table, the stroke, the moment in it and the expected loads are those of the run in
    simulated time, and the adapter can be made to fail.
    """
    with (
        can_proxy(server.host, int(server.ports["can_port"])) as proxy,
        tempfile.TemporaryDirectory() as place,
        ExitStack() as patches,
    ):
        where = json.dumps({"host": "127.0.0.1", "port": proxy.port})
        patches.enter_context(mock.patch.dict(os.environ, {"CAN_CONFIG": where}))
        patches.enter_context(
            mock.patch.object(builtins, "input", lambda text: _set_rack(server, text))
        )
        folder = Path(place) / "run"
        run_folder.create(folder, Recording("a run", "SIM", rig.nominal(), {}, (), ()))
        keeper = RecorderClient(folder, patient=False)
        wire = Wire(proxy, server, keeper.process_id)
        if reads_photos:
            wire.photo_reader = patches.enter_context(PhotoReader(folder, EYE))
        if cause is not None:
            patches.enter_context(
                mock.patch.object(
                    factory,
                    "open_commanding_bus",
                    lambda rig, clock: _open_adapter(wire, rig, clock),
                )
            )
        error, begun_s = _run(rig, keeper, wire, begin, in_hold, cause)
        if rig.motor.device == "odrive":
            shows_torque = shows_odrive_torque
        else:
            shows_torque = shows_mit_torque
        frames = proxy.finish()
    return WireRun(
        GOES_ON if error is None else code_of(error),
        str(error or ""),
        begun_s,
        frames,
        shows_torque,
        _motor_s(server),
    )


def _open_adapter(wire: Wire, rig: RigFile, clock: WallClock) -> BreakableBus:
    wire.adapter = Adapter(open_commanding_bus(rig, clock), clock)
    return wire.adapter


def _motor_s(server: Server) -> float | None:
    """When the motor last gave torque; None where the server is not the one of the tests, or is
    gone.
    """
    if server.process.poll() is not None:
        return None
    answer = server.told("torque")
    if answer.startswith("error"):
        return None
    return float(answer.split()[0])


def _set_rack(server: Server, prompt: str) -> str:
    height_mm = re.search(r"Set the rack to ([\d.]+) mm", prompt)[1]
    assert server.told(f"height {height_mm}") == "ok\n"
    return ""


def _run(
    rig: RigFile,
    keeper: RecorderClient,
    wire: Wire,
    begin: Callable[[Wire], float],
    in_hold: bool,
    cause: Cause | None,
) -> tuple[RigError | None, float]:
    """The error that ended the run, if any, and when the fault began."""
    begun: list[float] = []

    def begin_soon(after_s: float) -> None:
        threading.Timer(after_s, lambda: begun.append(begin(wire))).start()

    def on_begin(stage: Flap | Hold, start_s: float) -> None:
        if isinstance(stage, Flap) and not in_hold:
            begin_soon(
                AFTER_S if cause is None else start_s + 0.5 * stage.stroke_s - bench.clock.now_s()
            )

    def on_stage(stage: Stage) -> None:
        # The hold comes next.
        if isinstance(stage, Rest) and in_hold:
            begin_soon(AFTER_S)

    plan = _plan(rig, in_hold, cause)
    error = None
    if cause is None:
        expected = {}
    else:
        expected = {stage: EXPECTED_LOAD for stage in plan.stages if isinstance(stage, Flap)}
    supervision = Supervision(expected)
    with open_bench(rig, None) as bench, handle_signals(supervision.stop_request, lambda _: None):
        keeper.watch(supervision.helpers)
        if wire.photo_reader is not None:
            wire.photo_reader.watch(supervision.helpers)
        recorder = Recorder(keeper, bench.sensor.scale(), bench.clock)
        try:
            if cause is not None and cause.at_arming:
                begun.append(begin(wire))
                prove_stop(bench)
            else:
                run_plan(plan, bench, Hooked(recorder, on_begin), on_stage, supervision)
        except RigError as caught:
            error = caught
    # A recorder that was killed cannot finish.
    with suppress(RigError):
        keeper.finish("done")
    return error, begun[0] if begun else nan


def _plan(rig: RigFile, in_hold: bool, cause: Cause | None) -> Plan:
    fidelity = replace(TRUE, encoder_s=1.0 / rig.motor.reports_Hz)
    plan = short_plan(
        rig.facts().limits, fidelity, speed_rad_s=3.0 if cause is None else cause.speed_rad_s
    )
    dwell_s = HELD_S if in_hold else 0.0
    stages = [
        replace(stage, timing=replace(stage.timing, dwell_s=dwell_s))
        if isinstance(stage, Hold)
        else stage
        for stage in plan.stages
    ]
    return replace(plan, stages=tuple(stages))
