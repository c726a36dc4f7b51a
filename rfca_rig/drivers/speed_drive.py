"""The motor on the shaft, for any drive that obeys speeds: what a lab's own driver is made of. See docs/add-a-motor.md."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import partial
from math import isfinite
from typing import Any, ClassVar, Generic, Protocol, TypeVar

import can

from rfca_rig.clock import Clock
from rfca_rig.drivers.can_frames import send, send_stop
from rfca_rig.drivers.drive_report import GUARDED, DriveReports, Report
from rfca_rig.drivers.report_period import LOOK_REPORTS, period_fault
from rfca_rig.drivers.roles import MotorStatus, ShaftSamples
from rfca_rig.drivers.shaft_gear import ShaftGear
from rfca_rig.errors import DeviceError

__all__ = ["DriveKeys", "Report", "SpeedDrive"]

Frames = Sequence[can.Message]

FILES = ("file", "twin_file")
POLL_S = 2e-3
ENABLE_S = 1.0
ANSWER_S = 0.05


class DriveKeys(Protocol):
    """What a section [motor] of such a drive has besides its own keys."""

    @property
    def gear_ratio(self) -> float: ...
    @property
    def direction(self) -> int: ...
    @property
    def zero_turns(self) -> float: ...
    @property
    def report_period_ms(self) -> float | None: ...
    @property
    def angle_gain_per_s(self) -> float: ...
    def model_dump(self) -> dict[str, Any]: ...


Keys = TypeVar("Keys", bound=DriveKeys)


class _Gear(ShaftGear):
    def __init__(self, keys: DriveKeys) -> None:
        self.gear_ratio, self.direction, self.zero_turns = keys.gear_ratio, keys.direction, keys.zero_turns
        self.check_gear()


class SpeedDrive(ABC, Generic[Keys]):
    """A `ShaftMotor` that leads its drive by speeds alone; an angle is a speed that brings the shaft there.

    Inherit, name the `make`, and say in frames what the drive understands and in reports what it says; speeds and positions are
    its motor's, in turns. Everything else is here: gear and zero, order of enabling, proof of the watchdog, stopping while the
    queue is full, time, restarts, lost zeros, silence, a failing bus. The drive must have a speed loop with an integrator and a
    watchdog that each of its commands feeds; nothing is sent but in answer to a call, so a caller that stands still lets it stop.
    """

    make: ClassVar[str]

    def __init__(self, bus: can.BusABC, clock: Clock, keys: Keys, silent_s: float) -> None:
        """`silent_s` without a report is a fault."""
        self.keys = keys
        self._bus = bus
        self._clock = clock
        self._silent_s = silent_s
        self._gear = _Gear(keys)
        self._period_s = None if keys.report_period_ms is None else 1e-3 * keys.report_period_ms
        self._reports = DriveReports(bus, clock, self._gear, self._period_s, self.hear)
        self._armed = self._has_asked = False

    # -- what the drive understands and says ---------------------------------------------------------------------------------

    @abstractmethod
    def hear(self, message: can.Message) -> Report | None:
        """The report that this frame completes; None for every other frame."""

    @abstractmethod
    def to_clear(self) -> Frames:
        """Has the drive forget its errors, and report. It is without torque before and after."""

    @abstractmethod
    def to_energise(self, last: Report) -> Frames:
        """The next step towards an energised motor that stands still, from the state in `last`; said every 2 ms until it `is_on`."""

    @abstractmethod
    def to_turn(self, turns_s: float) -> Frames:
        """Asks for a speed, and feeds the watchdog. Must not energise a drive that is not."""

    @abstractmethod
    def to_let_go(self) -> Frames:
        """Takes the torque away, in whatever state the drive is."""

    def to_ask(self) -> Frames:
        """Asks for a report, for drives that do not report by themselves (report_period_ms left out). Must not feed the watchdog."""
        return ()

    def restarted(self) -> None:
        """To be called by `hear` where the drive says that it was switched on anew: its zero cannot be believed any more."""
        self._reports.restarted = "the drive restarted: find its zero again"

    # -- ShaftMotor ----------------------------------------------------------------------------------------------------------

    def enable(self) -> None:
        """Energises, holding the shaft where it stands.

        Raises DeviceError saying what is missing, or with what error the drive refuses; the motor is off then.
        """
        self.disable()
        self._reports.drain()
        self._reports.samples()  # what has dammed up while nobody looked has holes, and is handed to nobody
        if self._reports.zero_lost is not None:
            raise DeviceError(f"drive not enabled: {self._reports.zero_lost}, then start anew")
        self._say(self.to_clear())
        self._await_reports()
        self._check_period()
        self._await_on()
        self._armed = True

    def _await_reports(self) -> None:
        """Two of them, for the first may have left the drive before its errors were cleared."""
        self._reports.recount()
        until_s = self._clock.now_s() + ENABLE_S
        while self._reports.heard < 2 or self._last().fault is not None:
            if self._clock.now_s() > until_s and self._reports.heard < 2:
                raise DeviceError(f"drive not enabled: within {ENABLE_S:g} s {self._reports.missing()}")
            self._refuse_if(self._clock.now_s() > until_s, "still reports")
            self._wait_and_drain()

    def _check_period(self) -> None:
        """A wrong one would stretch the time base of the whole recording."""
        if self._period_s is None:
            return
        if period_fault(partial(self._watched_period_s, self._period_s), self._period_s) is not None:
            raise DeviceError(
                f"drive not enabled: it does not report every {1e3 * self._period_s:g} ms; set report_period_ms to what the drive "
                "is set to, or the drive"
            )

    def _watched_period_s(self, period_s: float) -> float:
        self._reports.recount()
        began_s = self._clock.now_s()
        while self._clock.now_s() - began_s < LOOK_REPORTS * period_s:
            self._wait_and_drain()
        return (self._clock.now_s() - began_s) / max(self._reports.heard, 1)

    def _await_on(self) -> None:
        until_s = self._clock.now_s() + ENABLE_S
        while not self._last().is_on:
            self._say(self.to_energise(self._last()))
            self._wait_and_drain()
            self._refuse_if(self._last().fault is not None, "refuses with")
            self._refuse_if(self._clock.now_s() > until_s, f"not energised after {ENABLE_S:g} s:")

    def _refuse_if(self, refused: bool, how: str) -> None:
        if refused:
            last = self._last()
            self.disable()
            raise DeviceError(f"drive not enabled: it {how} {last.fault or 'no error'}, state {last.state}")

    def _last(self) -> Report:
        if self._reports.last is None:
            raise DeviceError(f"no report of the drive yet: {self._reports.missing()}")
        return self._reports.last

    def command_speed(self, speed_rad_s: float) -> None:
        """Asks for a shaft speed. Raises DeviceError when the frame cannot be sent."""
        self._turn(_finite(speed_rad_s, "speed"))

    def command_angle(self, angle_rad: float, speed_rad_s: float = 0.0) -> None:
        """Asks for the speed that leads to an angle which moves at `speed_rad_s`. Raises DeviceError when the frame cannot be sent."""
        angle_rad, speed_rad_s = _finite(angle_rad, "angle"), _finite(speed_rad_s, "speed")
        now_rad = self._reports.angle_rad + self._reports.speed_rad_s * (self._clock.now_s() - self._reports.heard_s)
        self._turn(speed_rad_s + self.keys.angle_gain_per_s * (angle_rad - now_rad))

    def _turn(self, speed_rad_s: float) -> None:
        """A drive that let go by itself is not led any further."""
        if not self._armed:
            raise DeviceError("drive is not enabled; nothing was sent to it")
        self._say(self.to_turn(self._gear.turns_s(speed_rad_s)) if self._last().is_on else self.to_let_go())

    def disable(self) -> None:
        """Takes the torque away, within 20 ms. Raises DeviceError when a frame cannot be sent; the watchdog stops the motor then."""
        self._armed = False
        send_stop(self._bus, self._clock, self.to_let_go(), GUARDED)

    def prove_watchdog(self, limit_s: float) -> float:
        """Says nothing to the enabled drive until it lets go, and returns how long that took; the motor is off then.

        A drive that only answers is asked once, at the end. Raises DeviceError where it still runs after `limit_s`.
        """
        began_s = self._clock.now_s()
        try:
            self._wait_for_off(limit_s) if self._period_s is not None else self._ask_after(limit_s)
            if self._last().is_on:
                raise DeviceError(
                    f"drive's watchdog let it run through {limit_s:g} s of silence; switch it on in the drive, such a drive is not moved"
                )
            return self._clock.now_s() - began_s
        finally:
            self.disable()

    def _wait_for_off(self, limit_s: float) -> None:
        until_s = self._clock.now_s() + limit_s
        while self._last().is_on and self._clock.now_s() < until_s:
            self._wait_and_drain()

    def _ask_after(self, limit_s: float) -> None:
        self._clock.wait_until(self._clock.now_s() + limit_s - ANSWER_S)
        self._reports.drain()
        self._reports.recount()
        self._ask()
        until_s = self._clock.now_s() + ANSWER_S
        while self._reports.heard == 0:
            if self._clock.now_s() > until_s:
                raise DeviceError(f"drive's watchdog not proven: the drive says nothing after {limit_s:g} s of silence; check its power")
            self._clock.wait_until(self._clock.now_s() + POLL_S)
            self._reports.drain()

    def read(self) -> ShaftSamples:
        """Samples since the last call. Raises DeviceError on a failing bus or a frame that cannot be read."""
        self._reports.drain()
        if not self._has_asked:
            self._ask()
        self._has_asked = False
        return self._reports.samples()

    def status(self) -> MotorStatus:
        """A motor that let go by itself is at fault, also where the drive names no error."""
        last = self._reports.last
        state, temperature_C = ("unknown", None) if last is None else (last.state, last.temperature_C)
        return MotorStatus(state, self._fault(last), self._reports.silent_s, temperature_C)

    def _fault(self, last: Report | None) -> str | None:
        silent_s = self._reports.silent_s
        if last is not None and last.fault is not None:
            return last.fault
        if self._reports.doubts is not None:
            return self._reports.doubts
        if last is not None and self._armed and not last.is_on:
            return f"let go by itself without an error, state {last.state}; was it stopped from elsewhere, or restarted?"
        if silent_s > self._silent_s:
            return f"no report for {silent_s:.2f} s, limit {self._silent_s:g} s; check the drive's power and the wiring"
        return None

    def identity(self) -> dict[str, str]:
        """For the recording: the make, the bus, and every key of the section but its files, which are recorded whole."""
        keys = {name: str(value) for name, value in self.keys.model_dump().items() if value is not None and name not in FILES}
        return {
            "make": self.make,
            "bus": str(self._bus.channel_info),
            **keys,
            "reports_lost": str(self._reports.lost),
            **self._reports.health.facts(),
        }

    def _say(self, frames: Frames) -> None:
        for message in frames:
            send(self._bus, message, GUARDED)
        self._ask()

    def _ask(self) -> None:
        for message in self.to_ask() if self._period_s is None else ():
            send(self._bus, message, GUARDED)
        self._reports.asked()
        self._has_asked = True

    def _wait_and_drain(self) -> None:
        if self._period_s is None and not self._has_asked:
            self._ask()
        self._has_asked = False
        self._clock.wait_until(self._clock.now_s() + POLL_S)
        self._reports.drain()


def _finite(value: float, name: str) -> float:
    if not isfinite(value):
        raise DeviceError(f"commanded {name} is {value}; nothing was sent to the drive")
    return value
