"""The one way a run stops: torque off first, then the shaft is watched until it stands, then the
sensor is stopped.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from rfca_rig.clock import Clock
from rfca_rig.drivers.roles import ForceSamples, Photo, ShaftMotor, ShaftSamples
from rfca_rig.engine.interfaces import Bench
from rfca_rig.engine.loop import Loop
from rfca_rig.engine.loop_gaps import GapCounter
from rfca_rig.errors import DeviceError, RigError
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import Approach, Cycles, Flap, Hold

# How often the disable command is sent before the bus counts as dead.
TRIES = 3
RETRY_AFTER_S = 0.005
# A drive that cannot be reached stops by its own watchdog, or by the guardian, within about 0.1 s.
WATCHDOG_WAIT_S = 0.25
POLL_S = 0.01
# The shaft counts as standing below this speed for STANDS_FOR_S.
STANDS_RAD_S = 0.05
STANDS_FOR_S = 0.05
# A leg that swings in the air takes longer to come to rest; it is safe then.
WATCH_LIMIT_S = 0.6
RAMP_DOWN_S = 0.2
RAMP_DOWN_TICK_S = 0.002


@dataclass(frozen=True)
class Standstill:
    """What the drive reported after the torque was off.

    `latency_s` is the time until the shaft stood. It is NaN where the shaft did not stand within
    the observed time, or the drive reported nothing. `turned_rad` is the angle that the shaft moved
    meanwhile.
    """

    latency_s: float
    turned_rad: float

    def text(self) -> str:
        """For the run's events and a line of output."""
        if np.isnan(self.turned_rad):
            return "the drive tells nothing of the shaft once it is off"
        turned = f"turned by {np.degrees(self.turned_rad):.1f} deg after the torque was gone"
        if np.isnan(self.latency_s):
            return f"the shaft {turned}, and still swings {WATCH_LIMIT_S:g} s later"
        return f"the shaft {turned}, and stands since {1e3 * self.latency_s:.0f} ms later"


UNKNOWN_STANDSTILL = Standstill(np.nan, np.nan)


def stop(bench: Bench) -> Standstill:
    """Removes the torque and reports the shaft's motion afterwards. May be called at any time, any
    number of times.

    Every step is tried, whatever became of the one before, and bounded in time. Raises DeviceError
    where the drive could not be reached.
    """
    try:
        try:
            disable_motor(bench.motor, bench.clock)
        except DeviceError:
            # The run must not be reported as over while the drive may still have torque: its
            # watchdog or the guardian must have acted.
            bench.clock.wait_until(bench.clock.now_s() + WATCHDOG_WAIT_S)
            raise
        return _watch_shaft(bench)
    finally:
        # Also where the drive could not be reached.
        bench.sensor.stop()


def switch_off(bench: Bench) -> None:
    """Disables the motor and stops the sensor, without watching the shaft: a person sees that
    nothing moves before coming near.
    """
    try:
        disable_motor(bench.motor, bench.clock)
    finally:
        bench.sensor.stop()


def disable_motor(motor: ShaftMotor, clock: Clock) -> None:
    """Disables the motor. Tries three times in all, because a bus may refuse a frame once."""
    for left in reversed(range(TRIES)):
        try:
            motor.disable()
            return
        except DeviceError as error:
            if not left:
                raise DeviceError(
                    f"the motor could not be disabled ({error}); press the emergency stop"
                ) from error
            clock.wait_until(clock.now_s() + RETRY_AFTER_S)


def _watch_shaft(bench: Bench) -> Standstill:
    """Watches the reported shaft until it stands or WATCH_LIMIT_S is over."""
    began_s = stood_s = bench.clock.now_s()
    angles: list[float] = []
    while (now_s := bench.clock.now_s()) - began_s < WATCH_LIMIT_S:
        try:
            shaft = bench.motor.read()
        # The torque is off already: a bus that fails now ends the observation, nothing else.
        except RigError:
            break
        angles += shaft.angle_rad.tolist()
        # Written so that a speed that is no number is no standstill.
        if len(shaft.speed_rad_s) and not np.abs(shaft.speed_rad_s).max() <= STANDS_RAD_S:
            stood_s = now_s
        # At least one report is needed: silence is no standstill.
        if angles and now_s - stood_s > STANDS_FOR_S:
            return Standstill(stood_s - began_s, _largest_turn(angles))
        bench.clock.wait_until(now_s + POLL_S)
    if angles:
        return Standstill(np.nan, _largest_turn(angles))
    return UNKNOWN_STANDSTILL


def _largest_turn(angles_rad: list[float]) -> float:
    return max(abs(angle_rad - angles_rad[0]) for angle_rad in angles_rad)


def ramp_down(loop: Loop) -> None:
    """Slows the shaft down evenly within RAMP_DOWN_S, with every limit checked; for stops that
    are no emergency. Raises Tripped.
    """
    speed_rad_s = loop.speed_rad_s
    # From where the shaft is: a drive that was behind would otherwise catch up first, that is
    # accelerate.
    loop.target_rad = loop.angle_rad
    steps = round(RAMP_DOWN_S / RAMP_DOWN_TICK_S)
    for k in range(steps):
        # A command stands for a whole tick, so it takes the speed of the tick's middle.
        loop.step_at_speed(speed_rad_s * (1.0 - (k + 0.5) / steps), RAMP_DOWN_TICK_S)


@dataclass(frozen=True)
class RecordedSamples:
    """Samples of one stage, as the devices gave them.

    `start_s` is the host time of the commanded start, before which the shaft had stood for
    `stood_s`. `turns_rad` is to be subtracted from the continuous shaft angle to get an angle
    within one turn of the stage's own. `photo_fault` says why a planned photo is missing.
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
    """One turn of the shaft in numbers: largest force and moment, least fz, mean speed, and both
    clocks at its end.
    """

    number: int
    host_s: float
    device_s: float
    peak_force_N: float
    peak_moment_Nm: float
    min_fz_N: float
    mean_speed_rad_s: float


class Sink(Protocol):
    """Receives what a stage records as it comes, and the stage as soon as it is done.

    Called from within the control loop, so slow work belongs elsewhere. What a method raises ends
    the run.
    """

    def begin(self, stage: Flap | Hold | Cycles) -> None:
        """The stage records from now on. One that never gets to `flap`, `hold` or `cycles` was
        cut short.
        """

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
        """The leg hangs still at the start angle: `wrench` (6,) in N and N m is its weight and
        the sensor's zero, nothing else.
        """

    def take_first_stroke(self, stage: Approach, peak: Load) -> None:
        """A first stroke is done, with its largest load."""

    def begin_pause(self) -> None:
        """The run waits between two stages, because the operator asked for it."""

    def end_pause(self, waited_s: float) -> None:
        """The run goes on, or is stopped, after so long."""

    def off(self, gaps: GapCounter, standstill: Standstill, bad_samples: str) -> None:
        """The motor is without torque and the run is over.

        `gaps` are the times without a command to the drive, `bad_samples` how many samples were no
        numbers, by column.
        """
