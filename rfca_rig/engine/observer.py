"""Who observes a run: is told all that the loop knows, and can only request a stop."""

from dataclasses import dataclass
from typing import Protocol

from rfca_rig.drivers.roles import ForceSamples, MotorStatus, ShaftSamples
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import Stage


@dataclass(frozen=True, slots=True)
class Tick:
    """What one tick brought, and how it stands with the limits.

    The shaft should be at `target_rad`, moving at `target_speed_rad_s`. The tick came `late_s` after it should have; the longest so far
    took `worst_gap_s`. `status` is what the drive said of itself by the tick before, None at first.
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
        """A stage begins, in which the sensor is expected to feel so much; None where nobody knows."""

    def energising(self) -> None:
        """The rack is set, and the motor about to be energised; a stop request that came up meanwhile is to be made now."""

    def tick(self, tick: Tick) -> None:
        """A tick is over. Its samples are with the sink by now; the limits have not been held against them yet."""


class NullObserver:
    """Observes nothing."""

    def stage(self, stage: Stage, expected: Load | None) -> None:
        del stage, expected

    def energising(self) -> None:
        pass

    def tick(self, tick: Tick) -> None:
        del tick


NULL_OBSERVER = NullObserver()
