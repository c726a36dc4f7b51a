"""The configuration of a run command."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from rfca_rig.bench.begun import InterruptedRun
from rfca_rig.description.model_file import ModelFile
from rfca_rig.description.rig_file import RigFile
from rfca_rig.protocol.plan import Plan
from rfca_rig.twin_server.fault_schedule import Switching
from rfca_rig.vision.leg_photo import Eye


@dataclass(frozen=True)
class Viewing:
    """That the run is to be looked at in the browser: on which port, 0 for any free one, and at how many times real time a twin may run.

    A pace of 0 leaves a twin as fast as it can be.
    """

    port: int = 0
    pace: float = 1.0


@dataclass(frozen=True)
class RunConfig:
    """What the command line asked for: the files as read, their text for the recording, where runs go, how to speak.

    A `model` replaces what the rig file believes; a twin stays what its rig file says. `eye` is there where photos are to be taken,
    with the text of the camera's calibration. `rig_name` is how the rig was named, for finding its file again.

    `begun` is there where a run goes on that was stopped; `plan` is what remains of it then, and `rig_changes` says what of the rig file
    is not as it was.
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
    eye: Eye | None = None
    camera_text: str = ""
    rig_name: str = ""
    begun: InterruptedRun | None = None
    rig_changes: Mapping[str, str] = field(default_factory=dict)
    operator: str = ""
    sample: str = ""
    viewing: Viewing | None = None
    faults: tuple[Switching, ...] = ()

    @property
    def believes(self) -> RigFile | ModelFile:
        """Whose model the run is expected to follow."""
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
