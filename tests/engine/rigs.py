"""Benches on the twin, with something wrong where a test wants it."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from rfca_rig.bench.make import open_bench
from rfca_rig.bench.recorder import Recorder
from rfca_rig.description.protocol_file import read_dynamic
from rfca_rig.description.rig_file import RigFile, read_rig
from rfca_rig.engine.bench import Bench
from rfca_rig.protocol.experiments import flapping_plan
from rfca_rig.protocol.plan import Plan
from rfca_rig.recording.form import Recording
from rfca_rig.recording.run_file import RunFile

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


@contextmanager
def recorder_on(rig: RigFile, path: Path, seed: int = 1) -> Iterator[tuple[Bench, Recorder, RunFile]]:
    with open_bench(rig, seed) as bench:
        file = RunFile.create(path, Recording("a run", "SIM", rig.believed(), {}, (), ()))
        yield bench, Recorder(file, bench.sensor.scale()), file


def nothing(_stage: object) -> None:
    """Progress nobody watches."""
