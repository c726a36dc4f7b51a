"""Base class of plug-in motor drivers, for any drive with a speed command. See
docs/add-a-motor.md.
"""

from abc import abstractmethod
from collections.abc import Sequence
from functools import partial
from typing import Any, ClassVar, Generic, Protocol, TypeVar

import can

from rfca_rig.clock import Clock
from rfca_rig.drivers.device_time import PERIODS_PER_ATTEMPT, find_wrong_period
from rfca_rig.drivers.drive_report import (
    WATCHDOG_REMEDY,
    DriveReports,
    Report,
    ShaftGear,
    check_command,
)
from rfca_rig.drivers.motor_drive import MotorDrive
from rfca_rig.drivers.roles import MotorStatus, ShaftSamples
from rfca_rig.errors import DeviceError

__all__ = ["DriveKeys", "Report", "SpeedDrive"]

Frames = Sequence[can.Message]

FILES = ("file", "twin_file")
# Limits in s for enabling, and for one answer at the end of the watchdog test.
ENABLE_S = 1.0
ANSWER_S = 0.05


class DriveKeys(Protocol):
    """Keys of [motor] that every plug-in drive has, besides its own."""

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
        self.gear_ratio = keys.gear_ratio
        self.direction = keys.direction
        self.zero_turns = keys.zero_turns
        self.check_gear()


class SpeedDrive(MotorDrive, Generic[Keys]):
    """A `ShaftMotor` that commands its drive by speed only; an angle command becomes a speed
    towards that angle.

    Inherit, set `make`, and implement the frames to the drive and the decoding of its reports.
    Speeds and positions are those of the motor, in turns. This class handles gear and zero,
    enabling, the watchdog test, stopping with a full queue, time stamps, restarts, lost zeros,
    silence and bus failures. The drive needs a speed loop with an integrator, and a watchdog that
    every command feeds. Frames are sent only from within calls, so the watchdog stops the motor
    when the caller hangs.
    """

    make: ClassVar[str]
    wire_name = "the wiring"
    remedy = WATCHDOG_REMEDY

    _reports: DriveReports

    def __init__(self, bus: can.BusABC, clock: Clock, keys: Keys, silent_s: float) -> None:
        """`silent_s`: time without a report after which the drive is at fault."""
        super().__init__(bus, clock, silent_s)
        self.keys = keys
        self._gear = _Gear(keys)
        self._period_s: float | None = None
        if keys.report_period_ms is not None:
            self._period_s = 1e-3 * keys.report_period_ms
        self._reports = DriveReports(bus, clock, self._gear, self._period_s, self.hear)
        self._has_asked = False

    # -- frames of the drive, to be implemented
    # ------------------------------------------------------------------------------

    @abstractmethod
    def hear(self, message: can.Message) -> Report | None:
        """Decodes a frame: the report that it completes, None for every other frame."""

    @abstractmethod
    def to_clear(self) -> Frames:
        """Frames that clear the drive's errors and start its reports. The motor has no torque
        before and after.
        """

    @abstractmethod
    def to_energise(self, last: Report) -> Frames:
        """Frames of the next step towards an energised motor at rest, from the state in `last`;
        repeated every 2 ms until it `is_on`.
        """

    @abstractmethod
    def to_turn(self, turns_s: float) -> Frames:
        """Frames that command a speed and feed the watchdog. They must not energise a drive that
        is off.
        """

    @abstractmethod
    def to_let_go(self) -> Frames:
        """Frames that disable the motor, in any state of the drive."""

    def to_ask(self) -> Frames:
        """Frames that request a report, for drives without cyclic reports (no report_period_ms).
        They must not feed the watchdog.
        """
        return ()

    def restarted(self) -> None:
        """Call it in `hear` when the drive reports a restart: its zero is no longer valid."""
        self._reports.restarted = "the drive restarted: find its zero again"

    # -- ShaftMotor
    # ----------------------------------------------------------------------------------------------

    def enable(self) -> None:
        """Energises the motor and holds the shaft at its present angle.

        Raises DeviceError with the missing message, or with the error of a drive that refuses; the
        motor is then off.
        """
        self._begin_enabling()
        # Frames that piled up during a pause may have gaps, so they are discarded.
        self._reports.samples()
        self._say(self.to_clear())
        self._await_reports()
        period_s = self._period_s
        # A wrong period would stretch the time base of the whole recording.
        if (
            period_s is not None
            and find_wrong_period(partial(self._measure_report_period_s, period_s), period_s)
            is not None
        ):
            raise DeviceError(
                f"drive not enabled: it does not report every {1e3 * period_s:g} ms; set "
                "report_period_ms to what the drive is set to, "
                "or the drive"
            )
        until_s = self._clock.now_s() + ENABLE_S
        while not self._last().is_on:
            self._say(self.to_energise(self._last()))
            self._wait_and_drain()
            self._refuse_if(self._last().fault is not None, "refuses with")
            self._refuse_if(self._clock.now_s() > until_s, f"not energised after {ENABLE_S:g} s:")
        self._armed = True

    def _await_reports(self) -> None:
        """Waits for two reports: the first may have been sent before the errors were cleared."""
        self._reports.reset_counters()
        until_s = self._clock.now_s() + ENABLE_S
        while self._reports.heard < 2 or self._last().fault is not None:
            # After the limit, a fault that is still reported is a refusal, and too few reports mean
            # a wiring or address problem.
            if self._clock.now_s() > until_s and self._reports.heard < 2:
                raise DeviceError(
                    f"drive not enabled: within {ENABLE_S:g} s {self._reports.missing()}"
                )
            self._refuse_if(self._clock.now_s() > until_s, "still reports")
            self._wait_and_drain()

    def _measure_report_period_s(self, period_s: float) -> float:
        self._reports.reset_counters()
        began_s = self._clock.now_s()
        while self._clock.now_s() - began_s < PERIODS_PER_ATTEMPT * period_s:
            self._wait_and_drain()
        return (self._clock.now_s() - began_s) / max(self._reports.heard, 1)

    def _refuse_if(self, refused: bool, how: str) -> None:
        if refused:
            last = self._last()
            self._refuse(f"it {how} {last.fault or 'no error'}, state {last.state}")

    def _last(self) -> Report:
        if self._reports.last is None:
            raise DeviceError(f"no report of the drive yet: {self._reports.missing()}")
        return self._reports.last

    def command_speed(self, speed_rad_s: float) -> None:
        """Commands a shaft speed. Raises DeviceError if the frame cannot be sent."""
        self._turn(check_command(speed_rad_s, "speed"))

    def command_angle(self, angle_rad: float, speed_rad_s: float = 0.0) -> None:
        """Commands the speed towards an angle that moves at `speed_rad_s`. Raises DeviceError if
        the frame cannot be sent.
        """
        angle_rad = check_command(angle_rad, "angle")
        speed_rad_s = check_command(speed_rad_s, "speed")
        # The last report is extrapolated to now, since the angle may be several milliseconds old.
        now_rad = self._reports.angle_rad + self._reports.speed_rad_s * (
            self._clock.now_s() - self._reports.heard_s
        )
        self._turn(speed_rad_s + self.keys.angle_gain_per_s * (angle_rad - now_rad))

    def _turn(self, speed_rad_s: float) -> None:
        """Commands a speed, or torque off if the drive has disabled itself: it must not start
        again on its own.
        """
        if not self._armed:
            raise DeviceError("drive is not enabled; nothing was sent to it")
        if self._last().is_on:
            self._say(self.to_turn(self._gear.turns_s(speed_rad_s)))
        else:
            self._say(self.to_let_go())

    def disable(self) -> None:
        """Disables the motor within 20 ms. Raises DeviceError if a frame cannot be sent; the
        watchdog then stops the motor.
        """
        self._stop(self.to_let_go())

    def _await_torque_off(self, limit_s: float) -> float:
        """A drive without cyclic reports is asked once, at the end."""
        if self._period_s is None:
            took_s = self._ask_after(limit_s)
        else:
            took_s = self._await_watchdog(limit_s, self._is_off, self._wait_and_drain)
        if took_s is None:
            raise DeviceError(
                f"drive's watchdog let it run through {limit_s:g} s of silence; "
                "switch it on in the drive, such a drive is not moved"
            )
        return took_s

    def _is_off(self) -> bool:
        return not self._last().is_on

    def _ask_after(self, limit_s: float) -> float | None:
        """The time in s until the drive reports that it is off; None if it still runs."""
        began_s = self._clock.now_s()
        # The single question comes at the end: a request in between could feed a watchdog that
        # counts any frame.
        self._clock.wait_until(began_s + limit_s - ANSWER_S)
        self._reports.drain()
        self._reports.reset_counters()
        self._ask()
        until_s = self._clock.now_s() + ANSWER_S
        while self._reports.heard == 0:
            if self._clock.now_s() > until_s:
                raise DeviceError(
                    "drive's watchdog not proven: the drive says nothing after "
                    f"{limit_s:g} s of silence; check its power"
                )
            super()._wait_and_drain()
        if self._is_off():
            return self._clock.now_s() - began_s
        return None

    def read(self) -> ShaftSamples:
        """Samples (m,) since the last call. Raises DeviceError if the bus fails or a frame
        cannot be decoded.
        """
        self._reports.drain()
        # A command already requested a report; only a read without one needs its own request.
        if not self._has_asked:
            self._ask()
        self._has_asked = False
        return self._reports.samples()

    def status(self) -> MotorStatus:
        """State of the drive. A motor that disabled itself is at fault, even if the drive
        reports no error.
        """
        last = self._reports.last
        if last is None:
            return self._make_status("unknown")
        exit_text = None
        if not last.is_on:
            exit_text = (
                f"let go by itself without an error, state {last.state}; was it stopped from "
                "elsewhere, or restarted?"
            )
        return self._make_status(last.state, last.fault, exit_text)

    def identity(self) -> dict[str, str]:
        """For the recording: make, bus, and all keys of the section except its files, which are
        recorded in full.
        """
        keys = {
            name: str(value)
            for name, value in self.keys.model_dump().items()
            if value is not None and name not in FILES
        }
        return {
            "make": self.make,
            "bus": str(self._bus.channel_info),
            **keys,
            "reports_lost": str(self._reports.lost),
            "bad_reports": self._reports.bad_reports,
            **self._reports.health.facts(),
        }

    def _say(self, frames: Frames) -> None:
        for message in frames:
            self._send(message)
        self._ask()

    def _ask(self) -> None:
        if self._period_s is None:
            for message in self.to_ask():
                self._send(message)
        self._reports.note_query()
        self._has_asked = True

    def _wait_and_drain(self) -> None:
        if self._period_s is None and not self._has_asked:
            self._ask()
        self._has_asked = False
        super()._wait_and_drain()
