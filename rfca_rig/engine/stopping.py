"""The one way a run stops: torque away first, then watch until the shaft stands, then the sensor."""

from dataclasses import dataclass

import numpy as np

from rfca_rig.clock import Clock
from rfca_rig.drivers.roles import ShaftMotor
from rfca_rig.engine.bench import Bench
from rfca_rig.engine.loop import Loop
from rfca_rig.errors import DeviceError, RigError

TRIES = 3
BETWEEN_TRIES_S = 0.005
LEFT_ALONE_S = 0.25  # watchdogs and guardians act within 0.1 s or so
LOOK_S = 0.01
STANDS_RAD_S = 0.05
STANDS_FOR_S = 0.05
WATCHED_S = 0.6  # a leg that swings in the air takes longer to come to rest; it is safe then
EASE_S = 0.2
EASE_TICK_S = 0.002


@dataclass(frozen=True)
class Standstill:
    """What was seen after the torque was gone.

    `latency_s` is the time until the shaft stood, nan where it did not within the time that it was watched, or the drive told
    nothing; `turned_rad` how far it went on.
    """

    latency_s: float
    turned_rad: float

    def text(self) -> str:
        """For the run's events and a line of output."""
        if np.isnan(self.turned_rad):
            return "the drive tells nothing of the shaft once it is off"
        turned = f"turned by {np.degrees(self.turned_rad):.1f} deg after the torque was gone"
        if np.isnan(self.latency_s):
            return f"the shaft {turned}, and still swings {WATCHED_S:g} s later"
        return f"the shaft {turned}, and stands since {1e3 * self.latency_s:.0f} ms later"


UNSEEN = Standstill(np.nan, np.nan)


def stop(bench: Bench) -> Standstill:
    """Takes the torque away and reports what the shaft then did. May be called at any time, any number of times.

    Every step is tried whatever became of the one before, and bounded in time. Raises DeviceError where the drive could not be told.
    """
    try:
        _let_go_or_outwait(bench)
        return _watch_shaft(bench)
    finally:
        bench.sensor.stop()


def _let_go_or_outwait(bench: Bench) -> None:
    """A drive that cannot be told any more stops by its own watchdog, or the guardian's word: the run is not over before."""
    try:
        let_go(bench.motor, bench.clock)
    except DeviceError:
        bench.clock.wait_until(bench.clock.now_s() + LEFT_ALONE_S)
        raise


def switch_off(bench: Bench) -> None:
    """The same without looking: for when a person is to see that nothing moves, before hands come near."""
    try:
        let_go(bench.motor, bench.clock)
    finally:
        bench.sensor.stop()


def let_go(motor: ShaftMotor, clock: Clock) -> None:
    """Disables the motor; a bus that refuses the frame is asked again, three times in all."""
    for left in reversed(range(TRIES)):
        try:
            motor.disable()
            return
        except DeviceError as error:
            if not left:
                raise DeviceError(f"the motor could not be told to let go ({error}); press the emergency stop") from error
            clock.wait_until(clock.now_s() + BETWEEN_TRIES_S)


def _watch_shaft(bench: Bench) -> Standstill:
    """Looks at what the drive reports; a bus that fails now changes nothing any more."""
    began_s = stood_s = bench.clock.now_s()
    angles: list[float] = []
    while (now_s := bench.clock.now_s()) - began_s < WATCHED_S:
        try:
            shaft = bench.motor.read()
        except RigError:
            break
        angles += shaft.angle_rad.tolist()
        if len(shaft.speed_rad_s) and np.abs(shaft.speed_rad_s).max() > STANDS_RAD_S:
            stood_s = now_s
        if angles and now_s - stood_s > STANDS_FOR_S:
            return Standstill(stood_s - began_s, _way(angles))
        bench.clock.wait_until(now_s + LOOK_S)
    return Standstill(np.nan, _way(angles)) if angles else UNSEEN


def _way(angles_rad: list[float]) -> float:
    return max(abs(angle_rad - angles_rad[0]) for angle_rad in angles_rad)


def ease(loop: Loop) -> None:
    """Slows the shaft down evenly, every limit watched; for stops that are no emergency. Raises what the watch raises."""
    speed_rad_s = loop.speed_rad_s
    loop.target_rad = loop.angle_rad
    steps = round(EASE_S / EASE_TICK_S)
    for k in range(steps):
        loop.at_speed(speed_rad_s * (1.0 - (k + 0.5) / steps), EASE_TICK_S)
