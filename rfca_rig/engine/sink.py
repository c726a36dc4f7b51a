"""Interface to whatever takes the results of a run: the engine hands over, and knows nothing of files."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from rfca_rig.drivers.roles import ForceSamples, Photo, ShaftSamples
from rfca_rig.engine.stopping import Standstill
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.cycles import Cycles
from rfca_rig.protocol.plan import Approach, Flap, Hold


@dataclass(frozen=True)
class RecordedSamples:
    """Samples of one stage, as the devices gave them.

    `start_s` is the host time of the commanded start, before which the shaft had stood for `stood_s`. `turns_rad` is to be subtracted from
    the continuous shaft angle to get an angle within one turn of the stage's own. `photo_fault` says why a planned photo is missing.
    """

    shaft: ShaftSamples
    force: ForceSamples
    start_s: float
    turns_rad: float
    settled: bool
    photo: Photo | None = None
    photo_fault: str = ""
    stood_s: float = 0.0


@dataclass(frozen=True)
class Cycle:
    """One turn of the shaft in numbers: largest force and moment, least fz, mean speed, and both clocks at its end."""

    number: int
    host_s: float
    device_s: float
    peak_force_N: float
    peak_moment_Nm: float
    min_fz_N: float
    mean_speed_rad_s: float


class Sink(Protocol):
    """Receives what a stage records as it comes, and the stage as soon as it is done.

    Called from within the control loop, so slow work belongs elsewhere. What a method raises ends the run.
    """

    def begin(self, stage: Flap | Hold | Cycles) -> None:
        """The stage records from now on. One that never gets to `flap`, `hold` or `cycles` was cut short."""

    def start(self, start_s: float, turns_rad: float) -> None:
        """The commanded start is at host time `start_s`; both values as in `RecordedSamples`."""

    def take(self, shaft: ShaftSamples, force: ForceSamples) -> None:
        """What the devices reported in one tick."""

    def flap(self, stage: Flap, recorded: RecordedSamples) -> None:
        """A stroke is done."""

    def hold(self, stage: Hold, recorded: RecordedSamples) -> None:
        """A static stage is done."""

    def cycle(self, cycle: Cycle) -> None:
        """One of a stage's cycles is done."""

    def cycles(self, stage: Cycles) -> None:
        """A stage of cycles is done, or was ended between two of them because of a stop request."""

    def take_tare(self, wrench: np.ndarray) -> None:
        """The leg hangs still at the start angle: `wrench` (6,) in N and N m is its weight and the sensor's zero, nothing else."""

    def take_first_stroke(self, stage: Approach, peak: Load) -> None:
        """A first stroke is done, with its largest load."""

    def off(self, worst_gap_s: float, standstill: Standstill) -> None:
        """The motor is without torque and the run is over; `worst_gap_s` is the longest time without a command to the drive."""
