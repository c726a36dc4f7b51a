"""What stop the operator, or the computer, requests of a run under way. The loop looks at every tick; nobody interrupts it."""

from dataclasses import dataclass
from enum import IntEnum

from rfca_rig.errors import Stopped


class StopLevel(IntEnum):
    """Each is more urgent than the one before."""

    GO_ON = 0
    SAFE_POINT = 1  # finish this stage, bring the leg into the air, then stop
    RAMP_DOWN = 2  # slow down at once, then torque off
    TORQUE_OFF = 3  # no torque from the next tick on


@dataclass
class StopRequest:
    """Written by whoever hears the operator, read by the engine.

    `is_ticking` says that the loop runs and will see a request within milliseconds; otherwise the run waits for a person, with the
    motor off. `is_over` says that the stop is under way, and nothing is left to request.
    """

    level: StopLevel = StopLevel.GO_ON
    why: str = ""
    is_ticking: bool = False
    is_over: bool = False

    def ask(self, level: StopLevel, why: str) -> None:
        """A request is only ever replaced by a more urgent one."""
        if level > self.level:
            self.level, self.why = level, why

    def obey_now(self) -> None:
        """Raises Stopped where a stop cannot wait for the next safe point, and is not under way yet."""
        if self.level >= StopLevel.RAMP_DOWN and not self.is_over:
            raise Stopped(self.why)

    def obey_at_safe_point(self) -> None:
        """Raises Stopped; for when the leg is in the air, every stage done is handed over, and others were left out."""
        raise Stopped(f"{self.why}, at a safe point")
