"""Observers of a run: they see all that the loop knows, and can only request a stop."""

from dataclasses import dataclass
from typing import Protocol

from rfca_rig.drivers.roles import ForceSamples, MotorStatus, ShaftSamples
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import Stage


@dataclass(frozen=True, slots=True)
class Tick:
    """Samples and state of one tick.

    The shaft should be at `target_rad`, moving at `target_speed_rad_s`. The tick came `late_s` after it should have; the longest so far
    took `worst_gap_s`. `status` is the drive's status as of the tick before, None at first.
    """

    now_s: float
    shaft: ShaftSamples
    force: ForceSamples
    target_rad: float
    target_speed_rad_s: float
    late_s: float
    worst_gap_s: float
    status: MotorStatus | None


class RunObserver(Protocol):
    """Called from within the control loop: has microseconds, never waits, and raises nothing."""

    def stage(self, stage: Stage, expected: Load | None) -> None:
        """A stage begins, with the load that the model predicts; None where there is no prediction."""

    def energising(self) -> None:
        """The rack is set, and the motor is about to be energised: the last moment for a stop request that came up meanwhile."""

    def tick(self, tick: Tick) -> None:
        """A tick is over. Its samples are with the sink by now; the limits have not been checked on them yet."""


class NullObserver:
    """Observes nothing."""

    def stage(self, stage: Stage, expected: Load | None) -> None:
        del stage, expected

    def energising(self) -> None:
        pass

    def tick(self, tick: Tick) -> None:
        del tick


NULL_OBSERVER = NullObserver()
