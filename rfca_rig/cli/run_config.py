"""The configuration of a run command, made of the options that every run command takes."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rfca_rig.bench.fault_injection import FaultInjection
from rfca_rig.bench.resume import InterruptedRun
from rfca_rig.bench.rig_compatibility import Change, Noted
from rfca_rig.cli.paths import find_file, find_rig
from rfca_rig.description.model_file import ModelFile, read_model_file
from rfca_rig.description.rig_file import RigFile, read_rig
from rfca_rig.errors import BadInput
from rfca_rig.protocol.experiments import RigFacts
from rfca_rig.protocol.plan import Plan
from rfca_rig.toml import read_text
from rfca_rig.twin_server.faults import FaultEvent, parse_fault_events
from rfca_rig.vision.leg_photo import PhotoSetup


@dataclass(frozen=True)
class Viewing:
    """The live view: its port, 0 for any free one, and the multiple of real time at which a twin
    runs.

    A pace of 0 leaves a twin as fast as it can be.
    """

    port: int = 0
    pace: float = 1.0


@dataclass(frozen=True)
class RunConfig:
    """The options of a run command, resolved: files as read, their text for the recording, where
    runs go, how much to print.

    A `model` replaces the nominal model of the rig file; a twin stays as its rig file describes it.
    `eye` is set where photos are to be taken, with the text of the camera's calibration;
    `camera_path` is where it was, if it is not the rig file's. `rig_name` is the name of the rig as
    typed, for finding its file again; `rig_path` is that file, beside which the check of its zero
    is stored. `zero_facts` is what the recording states of the zero.

    `begun` is set where a stopped run is continued. `plan` is then the rest of its plan, and
    `rig_changes` are the changes of the rig file, `noted_changes` those that change no data. With
    `accepts_changes`, devices may be others than the run began with.
    """

    rig: RigFile
    rig_text: str
    protocol_text: str
    plan: Plan
    seed: int | None
    runs: Path
    quiet: bool
    dry: bool
    model: ModelFile | None = None
    model_text: str = ""
    eye: PhotoSetup | None = None
    camera_text: str = ""
    camera_path: str = ""
    rig_name: str = ""
    rig_path: Path | None = None
    begun: InterruptedRun | None = None
    rig_changes: Mapping[str, Change] = field(default_factory=dict)
    noted_changes: Noted = field(default_factory=dict)
    accepts_changes: bool = False
    operator: str = ""
    sample: str = ""
    viewing: Viewing | None = None
    faults: tuple[FaultEvent, ...] = ()
    zero_facts: Mapping[str, str] = field(default_factory=dict)

    @property
    def nominal_source(self) -> RigFile | ModelFile:
        """The file whose nominal model the run is expected to follow."""
        return self.model or self.rig

    @property
    def known_to(self) -> dict[str, float]:
        """One standard deviation of the values of that model; empty where none is stated."""
        known_to = self.nominal_source.known_to
        if known_to is None:
            return {}
        return known_to.model_dump(exclude_none=True)

    @property
    def mark(self) -> str:
        """SIM or REAL, at the head of every line."""
        if self.rig.is_real:
            return "REAL"
        return "SIM"

    @property
    def twin_seed(self) -> int | None:
        """The seed of this run, None on a real rig."""
        if self.rig.twin is None or self.rig.is_real:
            return None
        if self.seed is None:
            return self.rig.twin.seed
        return self.seed


@dataclass(frozen=True)
class RunOptions:
    """The options as typed: names or paths of rig and protocol, a model in place of the nominal
    one, folder of runs, and so on. `camera` is a calibration in place of the rig file's.
    """

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
    camera: Path | None = None


def make_run_config(asked: RunOptions, plan_of: Callable[[Path, RigFacts], Plan]) -> RunConfig:
    """The configuration; `plan_of` reads a protocol's file into a plan of the rig. Raises
    BadInput for anything unusable.
    """
    rig_path = find_rig(asked.rig)
    protocol_path = find_file("protocols", asked.protocol)
    rig = read_rig(rig_path)
    plan = plan_of(protocol_path, rig.facts())
    # The calibration file need not exist where no photo is to be taken.
    if asked.camera is not None and rig.camera is None:
        raise BadInput(f"--camera {asked.camera}: {asked.rig} has no [camera]; add that section")
    camera_path = ""
    if rig.camera is None or not plan.photos:
        eye = None
        camera_text = ""
    elif asked.camera is not None:
        camera_text = read_text(asked.camera)
        camera_path = str(asked.camera)
        eye = rig.eye_behind(camera_text, asked.camera)
    else:
        eye = rig.eye()
        camera_text = read_text(Path(rig.camera.calibration_file))
    model = None
    model_text = ""
    if asked.model:
        model = read_model_file(asked.model)
        model_text = read_text(asked.model)
    return RunConfig(
        rig=rig,
        rig_text=read_text(rig_path),
        protocol_text=read_text(protocol_path),
        plan=plan,
        seed=asked.seed,
        runs=asked.runs,
        quiet=asked.is_quiet,
        dry=asked.is_dry,
        model=model,
        model_text=model_text,
        eye=eye,
        camera_text=camera_text,
        camera_path=camera_path,
        rig_name=asked.rig,
        rig_path=rig_path,
        operator=asked.operator,
        sample=asked.sample,
        viewing=asked.viewing,
        faults=parse_faults(rig, asked.faults),
    )


def parse_faults(rig: RigFile, words: Sequence[str]) -> tuple[FaultEvent, ...]:
    """The faults to be injected into a twin. Raises BadInput for faults that this rig cannot
    have.
    """
    if words and rig.is_real:
        raise BadInput(
            f"{rig.rig.title}: --fault is for twins; nothing is broken on purpose on a real rig"
        )
    orders = parse_fault_events(words)
    # Made only for its check: an unknown fault must be refused before the run begins.
    FaultInjection(rig, orders)
    return orders
