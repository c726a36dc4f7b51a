"""What the engine works with: the bench, requests to stop, and observers of a run."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

from rfca_rig.clock import Clock
from rfca_rig.drivers.roles import (
    ForceSamples,
    ForceSensor,
    MotorStatus,
    Photographer,
    Rack,
    ShaftMotor,
    ShaftSamples,
)
from rfca_rig.errors import Stopped
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import Stage


@dataclass(frozen=True)
class Bench:
    """One rig, ready to run. `is_real` is False for twins; `camera` is None where the run needs
    none or the rig has none.
    """

    motor: ShaftMotor
    sensor: ForceSensor
    rack: Rack
    clock: Clock
    is_real: bool
    camera: Photographer | None = None


@dataclass(frozen=True, slots=True)
class Tick:
    """Samples and state of one tick.

    The shaft should be at `target_rad`, moving at `target_speed_rad_s`. The tick came `late_s`
    after it should have; the longest so far took `worst_gap_s`. `status` is the drive's status as
    of the tick before, None at first.
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

    def stage(self, stage: Stage, expected: Load | None, turns_rad: float | None) -> None:
        """A stage begins, with the load that the model predicts; None where there is no
        prediction.

        `turns_rad` are the whole turns to subtract from the shaft's continuous angle in this stage,
        as in its recording; None where the stage goes on with those of the stage before.
        """

    def start(self, start_s: float) -> None:
        """The commanded motion of a stroke begins, at host time `start_s`; in a recording this is
        time 0.
        """

    def energising(self) -> None:
        """The rack is set, and the motor is about to be energised: the last moment for a stop
        request that came up meanwhile.
        """

    def pause(self, is_paused: bool) -> None:
        """The run waits before its next stage, because the operator asked for it, with the shaft
        held; or it goes on.
        """

    def tick(self, tick: Tick) -> None:
        """A tick is over. Its samples are with the sink by now; the limits have not been checked
        on them yet.
        """


class NullObserver:
    """Observes nothing."""

    def stage(self, stage: Stage, expected: Load | None, turns_rad: float | None) -> None:
        del stage, expected, turns_rad

    def start(self, start_s: float) -> None:
        del start_s

    def energising(self) -> None:
        pass

    def pause(self, is_paused: bool) -> None:
        del is_paused

    def tick(self, tick: Tick) -> None:
        del tick


NULL_OBSERVER = NullObserver()


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

    `is_ticking` means that the loop runs and sees a request within milliseconds; otherwise the run
    waits for a person, with the motor off. `is_over` means that the stop is under way and further
    requests change nothing. `is_pause_asked` is no stop: the run waits before the next stage that
    it reaches with the leg in the air, for as long as it stays set.
    """

    level: StopLevel = StopLevel.GO_ON
    why: str = ""
    is_ticking: bool = False
    is_over: bool = False
    is_pause_asked: bool = False

    def ask(self, level: StopLevel, why: str) -> None:
        """Requests a stop; a request is only ever replaced by a more urgent one."""
        if level > self.level:
            self.level = level
            self.why = why

    def raise_if_urgent(self) -> None:
        """Raises Stopped where the stop cannot wait for the next safe point, and is not under
        way yet.
        """
        # `is_over` guards the ramp-down itself, which ticks the same loop and would be stopped by
        # its own request.
        if self.level >= StopLevel.RAMP_DOWN and not self.is_over:
            raise Stopped(self.why)

    def raise_at_safe_point(self) -> None:
        """Raises Stopped; to be called when the leg is in the air and every completed stage is
        handed over.
        """
        raise Stopped(f"{self.why}, at a safe point")
