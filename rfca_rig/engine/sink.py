"""Where a run's stages go: the engine hands over, and knows nothing of files."""

from dataclasses import dataclass
from typing import Protocol

from rfca_rig.drivers.roles import ForceSamples, Photo, ShaftSamples
from rfca_rig.protocol.plan import Flap, Hold


@dataclass(frozen=True)
class Recorded:
    """What a stage recorded, as the devices gave it. `start_s` is the host time of the commanded start.

    `turns_rad` is what to take off the continuous shaft angle to be within one turn of the stage's own angles. `photo_fault` says why
    a photo that was to be taken is not there.
    """

    shaft: ShaftSamples
    force: ForceSamples
    start_s: float
    turns_rad: float
    settled: bool
    photo: Photo | None = None
    photo_fault: str = ""


class Sink(Protocol):
    """Takes over what a stage records as it comes, and the stage as soon as it is done.

    Called from within the control loop: whatever takes long belongs elsewhere. What a method raises ends the run.
    """

    def begin(self, stage: Flap | Hold) -> None:
        """The stage records from now on; one that never gets to `flap` or `hold` was cut short."""

    def start(self, start_s: float, turns_rad: float) -> None:
        """The commanded start is now; as in `Recorded`."""

    def take(self, shaft: ShaftSamples, force: ForceSamples) -> None:
        """What the devices reported in one tick."""

    def flap(self, stage: Flap, recorded: Recorded) -> None:
        """A stroke is done."""

    def hold(self, stage: Hold, recorded: Recorded) -> None:
        """A static stage is done."""

    def off(self, worst_gap_s: float) -> None:
        """The motor is without torque, and the run over; `worst_gap_s` is the longest that the drive went without a command."""
