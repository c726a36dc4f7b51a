"""Base class of all motor drivers: the rules of enabling, of the test of the watchdog, of faults
and of stopping.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import partial
from typing import ClassVar, NoReturn

import can

from rfca_rig.clock import Clock
from rfca_rig.drivers.can_frames import EMERGENCY_STOP_REMEDY, send, send_stop
from rfca_rig.drivers.device_time import PERIODS_PER_ATTEMPT, find_wrong_period
from rfca_rig.drivers.drive_report import DriveReceiver
from rfca_rig.drivers.guard import Guard, TorqueOffFrames, arm, prove_guard
from rfca_rig.drivers.roles import MotorStatus
from rfca_rig.errors import DeviceError

# Interval between two polls while waiting, in s; docs/add-a-motor.md promises plug-ins a call
# every 2 ms.
POLL_S = 2e-3


class MotorDrive(ABC):
    """Base class of a `ShaftMotor` over any `can.BusABC`. Waits only through the clock, and only in
    `enable` and `prove_watchdog`.

    A driver implements the methods of `ShaftMotor` by the rules here. `enable` begins with
    `_begin_enabling` and sets `_armed` at its end, `disable` is `_stop`, `status` is
    `_make_status`. `prove_watchdog` is here; the driver implements `_await_torque_off`, by
    `_await_watchdog` or `_prove_guardian`. Whether an angle is followed by a loop in the drive or
    in the driver is up to `command_angle`. Frames are sent only from within calls, so the watchdog
    stops the motor when the caller hangs.
    """

    # Words of messages: what the drive sends regularly, and how its wire is called.
    report_name: ClassVar[str] = "report"
    wire_name: ClassVar[str] = "the CAN wiring"
    # What remains to be done when the bus fails.
    remedy: ClassVar[str] = EMERGENCY_STOP_REMEDY

    _reports: DriveReceiver

    def __init__(
        self, bus: can.BusABC, clock: Clock, silent_s: float, guard: Guard | None = None
    ) -> None:
        """`silent_s`: time without a report after which the drive is at fault. `guard`: the
        guardian that holds the bus of a drive without a watchdog, if any.
        """
        self._bus = bus
        self._clock = clock
        self._silent_s = silent_s
        self._guard = guard
        # For the recording: what was seen when the guardian was tested.
        self._guardian_proof = "none"
        # Set at the end of `enable`, until the motor is disabled.
        self._armed = False

    @abstractmethod
    def disable(self) -> None:
        """As in `ShaftMotor`."""

    def prove_watchdog(self, limit_s: float) -> float:
        """Sends no command to the enabled drive until its watchdog, or the guardian, has disabled
        the motor; returns the time in s that this took.

        Call it with the shaft at rest. Raises DeviceError if the motor was not seen to be off
        within `limit_s`. The motor is off afterwards, also after an error.
        """
        try:
            return self._await_torque_off(limit_s)
        finally:
            self.disable()

    @abstractmethod
    def _await_torque_off(self, limit_s: float) -> float:
        """Waits until the motor is seen to be off; returns the time in s that this took. Raises
        DeviceError if it was not within `limit_s`.
        """

    def _begin_enabling(self) -> None:
        """Disables the motor. With a lost zero every angle is wrong, so the zero must be found
        again before a new start: raises DeviceError then.
        """
        self.disable()
        self._reports.drain()
        if self._reports.zero_lost is not None:
            raise DeviceError(f"drive not enabled: {self._reports.zero_lost}, then start again")

    def _await_cyclic_reports(self, period_s: float, timeout_s: float) -> float | None:
        """Waits until no kind of report is missing, and measures their period. Returns the measured
        one in s if it is not `period_s`, which would stretch the time base of the recording.

        Raises DeviceError with what is missing after `timeout_s`.
        """
        self._reports.drain()
        # Frames that piled up during a pause may have gaps, so they are discarded.
        self._reports.samples()
        return find_wrong_period(partial(self._measure_period_s, period_s, timeout_s), period_s)

    def _measure_period_s(self, period_s: float, timeout_s: float) -> float:
        reports = self._reports
        reports.reset_counters()
        started_s = self._clock.now_s()
        look_s = PERIODS_PER_ATTEMPT * period_s
        while reports.missing() is not None or self._clock.now_s() - started_s < look_s:
            if self._clock.now_s() - started_s > max(timeout_s, look_s):
                raise DeviceError(f"drive not enabled: within {timeout_s:g} s {reports.missing()}")
            self._wait_and_drain()
        return (self._clock.now_s() - started_s) / reports.heard

    def _refuse(self, why: str) -> NoReturn:
        """Disables a drive that cannot be enabled, then raises DeviceError."""
        self.disable()
        raise DeviceError(f"drive not enabled: {why}")

    def _await_watchdog(
        self, limit_s: float, has_acted: Callable[[], bool], poll: Callable[[], None]
    ) -> float | None:
        """Waits until the last report shows that the watchdog has disabled the motor (`has_acted`).

        `poll` waits for the next report, and sends nothing that feeds the watchdog. Returns the
        time in s that it took; None if the drive still runs after `limit_s`.
        """
        started_s = self._clock.now_s()
        while not has_acted():
            if self._clock.now_s() - started_s > limit_s:
                return None
            poll()
        return self._clock.now_s() - started_s

    def _arm_guardian(self) -> None:
        """Call it before the frame that energises: from here on a silence must disable the
        motor.
        """
        if self._guard is not None:
            arm(self._guard)

    def _describe_guardian(self) -> str:
        if self._guard is None:
            return "none"
        return self._guard.describe()

    def _prove_guardian(
        self, guard: Guard, frames: TorqueOffFrames, held_Nm: float, limit_s: float, answers: bool
    ) -> float:
        """Tests the guardian in place of the watchdog, as `prove_guard` does; returns the time in s
        that it took.
        """
        proof = prove_guard(guard, held_Nm, frames.min_visible_torque_Nm(), limit_s, answers)
        self._guardian_proof = proof.seen
        return proof.took_s

    def _make_status(
        self, state: str, error: str | None = None, fault_if_enabled: str | None = None
    ) -> MotorStatus:
        """The status, with the first reason not to trust the drive.

        `error` is what the drive itself reports: it comes first, since it names the cause.
        `fault_if_enabled` is a fault only between `enable` and `disable`, as that the motor is off.
        """
        reports = self._reports
        if not self._armed:
            fault_if_enabled = None
        fault = (
            error
            or reports.doubts
            or fault_if_enabled
            or self._find_silence()
            or reports.health.fault
        )
        return MotorStatus(
            state,
            fault,
            reports.silent_s,
            reports.temperature_C,
            reports.torque_age_s,
            reports.uptime_s,
            reports.zero_lost,
        )

    def _find_silence(self) -> str | None:
        silent_s = self._reports.silent_s
        if silent_s <= self._silent_s:
            return None
        return (
            f"no {self.report_name} for {silent_s:.2f} s, limit {self._silent_s:g} s; check the "
            f"drive's power and {self.wire_name}"
        )

    def _stop(self, frames: Sequence[can.Message]) -> None:
        """Sends the frames that disable the motor, within 20 ms. Raises DeviceError if one cannot
        be sent.
        """
        self._armed = False
        send_stop(self._bus, self._clock, frames, self.remedy)

    def _send(self, message: can.Message) -> None:
        send(self._bus, message, self.remedy)

    def _wait_and_drain(self) -> None:
        self._clock.wait_until(self._clock.now_s() + POLL_S)
        self._reports.drain()
