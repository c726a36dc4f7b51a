"""The configuration of a run command."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from rfca_rig.bench.resume import InterruptedRun
from rfca_rig.description.model_file import ModelFile
from rfca_rig.description.rig_file import RigFile
from rfca_rig.protocol.plan import Plan
from rfca_rig.twin_server.faults import FaultEvent
from rfca_rig.vision.leg_photo import PhotoSetup


@dataclass(frozen=True)
class Viewing:
    """The live view: its port, 0 for any free one, and the multiple of real time at which a twin runs.

    A pace of 0 leaves a twin as fast as it can be.
    """

    port: int = 0
    pace: float = 1.0


@dataclass(frozen=True)
class RunConfig:
    """The options of a run command, resolved: files as read, their text for the recording, where runs go, how much to print.

    A `model` replaces the nominal model of the rig file; a twin stays as its rig file describes it. `eye` is set where photos are to be
    taken, with the text of the camera's calibration. `rig_name` is the name of the rig as typed, for finding its file again.

    `begun` is set where a stopped run is continued. `plan` is then the rest of its plan, and `rig_changes` are the changes of the rig file.
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
    rig_name: str = ""
    begun: InterruptedRun | None = None
    rig_changes: Mapping[str, str] = field(default_factory=dict)
    operator: str = ""
    sample: str = ""
    viewing: Viewing | None = None
    faults: tuple[FaultEvent, ...] = ()

    @property
    def nominal_source(self) -> RigFile | ModelFile:
        """The file whose nominal model the run is expected to follow."""
        return self.model or self.rig

    @property
    def mark(self) -> str:
        """SIM or REAL, at the head of every line."""
        return "REAL" if self.rig.is_real else "SIM"

    @property
    def twin_seed(self) -> int | None:
        """The seed of this run, None on a real rig."""
        if self.rig.twin is None or self.rig.is_real:
            return None
        return self.rig.twin.seed if self.seed is None else self.seed
