"""Benches on the twin, with something wrong where a test wants it."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from rfca_rig.bench.factory import open_bench
from rfca_rig.bench.recorder import Recorder
from rfca_rig.description.protocol_file import read_dynamic
from rfca_rig.description.rig_file import RigFile, read_rig
from rfca_rig.engine.interfaces import Bench
from rfca_rig.protocol.experiments import flapping_plan
from rfca_rig.protocol.plan import Plan
from rfca_rig.recording import run_folder
from rfca_rig.recording.backend import InProcessRecorder
from rfca_rig.recording.model import Recording
from rfca_rig.recording.store import read_recording

ROOT = Path(__file__).parents[2]


def twin_rig() -> RigFile:
    return read_rig(ROOT / "calibration" / "twin.toml")


def changed(rig: RigFile, section: str, **values: float) -> RigFile:
    """The rig with other values in one of its sections."""
    return rig.model_copy(update={section: getattr(rig, section).model_copy(update=values)})


def one_condition(rig: RigFile, repeats: int = 1, speed_rad_s: float = 3.249) -> Plan:
    protocol = read_dynamic(ROOT / "protocols" / "flapping.toml").flapping()
    condition = replace(protocol.conditions[0], speed_rad_s=speed_rad_s)
    return flapping_plan(replace(protocol, conditions=(condition,), repeats=repeats), rig.facts())


class Kept:
    """The folder into which a recorder writes, without a process of its own."""

    def __init__(self, folder: Path, header: Recording) -> None:
        run_folder.create(folder, header)
        self.folder = folder
        self.keeper = InProcessRecorder(folder)

    def so_far(self) -> Recording:
        """What is on disk."""
        return run_folder.read_stages(self.folder)

    def finish(self) -> Recording:
        """What the run's file holds."""
        self.keeper.finish("done")
        return read_recording(run_folder.build_recording(self.folder))


@contextmanager
def recorder_on(
    rig: RigFile, folder: Path, seed: int = 1
) -> Iterator[tuple[Bench, Recorder, Kept]]:
    with open_bench(rig, seed) as bench:
        kept = Kept(folder, Recording("a run", "SIM", rig.nominal(), {}, (), ()))
        yield bench, Recorder(kept.keeper, bench.sensor.scale(), bench.clock), kept
        kept.keeper.finish("done")


def nothing(_stage: object) -> None:
    """Progress nobody watches."""
