"""Turns the options that every run command takes into its configuration."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rfca_rig.bench.fault_injection import FaultInjection
from rfca_rig.cli.paths import find_file
from rfca_rig.cli.run_config import RunConfig, Viewing
from rfca_rig.cli.trusted_code import find_rig
from rfca_rig.description.model_file import read_model_file
from rfca_rig.description.rig_file import RigFile, read_rig
from rfca_rig.description.toml import read_text
from rfca_rig.errors import BadInput
from rfca_rig.protocol.experiments import RigFacts
from rfca_rig.protocol.plan import Plan
from rfca_rig.twin_server.faults import FaultEvent, parse_fault_events


@dataclass(frozen=True)
class RunOptions:
    """The options as typed: names or paths of rig and protocol, a model in place of the nominal one, folder of runs, and so on."""

    rig: str
    protocol: str
    model: Path | None
    runs: Path
    seed: int | None = None
    operator: str = ""
    sample: str = ""
    is_dry: bool = False
    is_quiet: bool = False
    viewing: Viewing | None = None
    faults: Sequence[str] = ()


def make_run_config(asked: RunOptions, plan_of: Callable[[Path, RigFacts], Plan]) -> RunConfig:
    """The configuration; `plan_of` reads a protocol's file into a plan of the rig. Raises BadInput for anything unusable."""
    rig_path, protocol_path = find_rig(asked.rig), find_file("protocols", asked.protocol)
    rig = read_rig(rig_path)
    plan = plan_of(protocol_path, rig.facts())
    # The calibration file need not exist where no photo is to be taken.
    if rig.camera is None or not plan.photos:
        eye, camera_text = None, ""
    else:
        eye, camera_text = rig.eye(), read_text(Path(rig.camera.calibration_file))
    return RunConfig(
        rig=rig,
        rig_text=read_text(rig_path),
        protocol_text=read_text(protocol_path),
        plan=plan,
        seed=asked.seed,
        runs=asked.runs,
        quiet=asked.is_quiet,
        dry=asked.is_dry,
        model=read_model_file(asked.model) if asked.model else None,
        model_text=read_text(asked.model) if asked.model else "",
        eye=eye,
        camera_text=camera_text,
        rig_name=asked.rig,
        operator=asked.operator,
        sample=asked.sample,
        viewing=asked.viewing,
        faults=_faults(rig, asked.faults),
    )


def _faults(rig: RigFile, words: Sequence[str]) -> tuple[FaultEvent, ...]:
    """The faults to be injected into a twin. Raises BadInput for faults that this rig cannot have."""
    if words and rig.is_real:
        raise BadInput(f"{rig.rig.title}: --fault is for twins; nothing is broken on purpose on a real rig")
    orders = parse_fault_events(words)
    # Made only for its check: an unknown fault must be refused before the run begins.
    FaultInjection(rig, orders)
    return orders
