"""Requests to stop a run under way, from the operator or the system. The loop reads them at every tick; nothing interrupts it."""

from dataclasses import dataclass
from enum import IntEnum

from rfca_rig.errors import Stopped


class StopLevel(IntEnum):
    """How urgent a stop is; each is more urgent than the one before."""

    GO_ON = 0
    # Finish this stage, bring the leg into the air, then stop.
    SAFE_POINT = 1
    # Slow down at once, then remove the torque.
    RAMP_DOWN = 2
    # No torque from the next tick on.
    TORQUE_OFF = 3


@dataclass
class StopRequest:
    """Written by whatever hears the operator, read by the engine.

    `is_ticking` means that the loop runs and sees a request within milliseconds; otherwise the run waits for a person, with the motor off.
    `is_over` means that the stop is under way and further requests change nothing.
    """

    level: StopLevel = StopLevel.GO_ON
    why: str = ""
    is_ticking: bool = False
    is_over: bool = False

    def ask(self, level: StopLevel, why: str) -> None:
        """Requests a stop; a request is only ever replaced by a more urgent one."""
        if level > self.level:
            self.level, self.why = level, why

    def raise_if_urgent(self) -> None:
        """Raises Stopped where the stop cannot wait for the next safe point, and is not under way yet."""
        # `is_over` guards the ramp-down itself, which ticks the same loop and would be stopped by its own request.
        if self.level >= StopLevel.RAMP_DOWN and not self.is_over:
            raise Stopped(self.why)

    def raise_at_safe_point(self) -> None:
        """Raises Stopped; to be called when the leg is in the air and every completed stage is handed over."""
        raise Stopped(f"{self.why}, at a safe point")
