"""Gear between a drive and the shaft, what receives the reports of a drive, and that of a plug-in
drive (see docs/add-a-motor.md).
"""

import struct
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf, isfinite, isnan, tau

import can
import numpy as np

from rfca_rig.clock import Clock
from rfca_rig.drivers.can_frames import (
    MAX_READ_PAUSE_S,
    BusHealth,
    arrival_s,
    receive_frames,
)
from rfca_rig.drivers.device_time import FrameCount
from rfca_rig.drivers.reading_check import (
    POSITION,
    SPEED,
    TEMPERATURE,
    TORQUE,
    OptionalReading,
    ReadingCheck,
    describe_bad,
)
from rfca_rig.drivers.roles import ShaftSamples
from rfca_rig.errors import BadInput, DeviceError

# Margin in rad on top of any possible motion.
JUMP_MARGIN_RAD = 0.1
# Factor on the faster of the two reported speeds, as the speed between two reports may be higher.
SPEED_FACTOR = 1.5
# Largest acceleration: 40 N m on a bare rotor of 0.008 kg m2.
MAX_ACCELERATION_RAD_S2 = 5000.0
# Time from a question to its answer: as old as a reading may be by default. One late answer may be
# the fault of this computer.
MAX_ANSWER_S = 0.1
MAX_ANSWERS = 3
# Cap on the assumed speed, so that a long gap does not allow any step.
MAX_SPEED_RAD_S = 60.0


class ShaftGear:
    """Base of settings with these three values.

    `gear_ratio` is drive turns per shaft turn, `direction` +1 or -1, `zero_turns` the drive's
    reading with the shaft horizontal.
    """

    gear_ratio: float
    direction: int
    zero_turns: float

    def check_gear(self) -> None:
        """Raises BadInput for invalid values."""
        if self.direction not in {1, -1}:
            raise BadInput(f"drive: direction is {self.direction}, must be 1 or -1")
        if not isfinite(self.zero_turns):
            raise BadInput(f"drive: zero_turns is {self.zero_turns}, must be a number")
        check_positive("gear_ratio", self.gear_ratio)

    def turns(self, angle_rad: float) -> float:
        """Drive position in turns at a shaft angle in rad."""
        return self.zero_turns + self.turns_s(angle_rad)

    def turns_s(self, speed_rad_s: float) -> float:
        """Drive speed in turns/s at a shaft speed in rad/s."""
        return self.direction * self.gear_ratio * speed_rad_s / tau

    @property
    def shaft_rad_per_turn(self) -> float:
        """Shaft angle in rad per turn of the drive, signed."""
        return self.direction * tau / self.gear_ratio

    @property
    def shaft_torque_per_drive_torque(self) -> float:
        """Shaft torque over drive torque, signed, for a gear without losses."""
        return self.direction * self.gear_ratio


def check_positive(name: str, value: float) -> None:
    """Raises BadInput if `value` is not a finite number above 0."""
    if not (isfinite(value) and value > 0.0):
        raise BadInput(f"drive: {name} is {value}, must be above 0")


def check_command(value: float, name: str) -> float:
    """The commanded value. Raises DeviceError if it is not finite, before anything is sent."""
    if not isfinite(value):
        raise DeviceError(f"commanded {name} is {value}; nothing was sent to the drive")
    return value


def refuse_late_answers(
    asked_s: float, ask: Callable[[], float], await_answer: Callable[[float], float | None]
) -> None:
    """Refuses a drive whose answers take longer than MAX_ANSWER_S: its readings are as old, and
    nothing else in them shows it.

    Parameters
    ----------
    asked_s
        Host time of a request that was sent already, and whose answer cannot be taken for that of
        another one.
    ask
        Sends one more, and returns the time. Called where an answer was late: this program may have
        been late once.
    await_answer
        Waits for the answer to the request of that time; returns when it came, or None where it did
        not.

    Raises
    ------
    DeviceError
        Where MAX_ANSWERS answers in a row were late.
    """
    quickest_s = inf
    for attempt in range(MAX_ANSWERS):
        if attempt:
            asked_s = ask()
        answered_s = await_answer(asked_s)
        if answered_s is None or answered_s - asked_s <= MAX_ANSWER_S:
            return
        quickest_s = min(answered_s - asked_s, quickest_s)
    raise DeviceError(
        f"drive not enabled: it answers {1e3 * quickest_s:.0f} ms after the question, "
        f"{1e3 * MAX_ANSWER_S:g} ms are the most, and its "
        "readings are as old; check whether the adapter or the network holds frames "
        "back, and what else talks on the bus"
    )


class EncoderJumpMonitor:
    """Checks each step of the shaft's position. `fault` stays set after a jump, as the zero is lost
    with it.

    The allowed speed between two reports is 1.5 times the faster of their speeds, plus half of what
    the largest acceleration adds. A step of 0.1 rad more than this speed allows is a jump. The
    elapsed time is the larger of device time and host time between two reads, so that lost reports
    do not look like a jump.
    """

    def __init__(self) -> None:
        self.fault: str | None = None
        self._last: tuple[float, float, float, float] | None = None

    def follow(
        self,
        host_s: float,
        device_s: float,
        angle_rad: float,
        speed_rad_s: float,
        judged: bool = True,
    ) -> None:
        """Takes in one report, later than the last, that the host read at `host_s`. With
        `judged` False this step is not checked.
        """
        last = self._last
        self._last = (host_s, device_s, angle_rad, abs(speed_rad_s))
        if last is None or self.fault is not None or not judged:
            return
        elapsed_s = max(host_s - last[0], device_s - last[1])
        fastest_rad_s = (
            max(last[3], abs(speed_rad_s)) * SPEED_FACTOR
            + 0.5 * MAX_ACCELERATION_RAD_S2 * elapsed_s
        )
        by_rad = angle_rad - last[2]
        # Written so that a step that is no number is a jump too.
        if not abs(by_rad) <= JUMP_MARGIN_RAD + min(fastest_rad_s, MAX_SPEED_RAD_S) * elapsed_s:
            self.fault = (
                f"position leapt by {by_rad:.2f} rad within {1e3 * elapsed_s:.1f} ms, "
                "more than the shaft can turn; "
                "the drive restarted, was zeroed, or its encoder slipped: find its zero again"
            )


WATCHDOG_REMEDY = "the drive's watchdog stops the motor"


class DriveReceiver(ABC):
    """Receives the reports of one drive. `drained_s` is the host time of the last `drain`, `heard`
    counts the reports since `reset_counters`.
    """

    heard: int

    def __init__(self, bus: can.BusABC, clock: Clock, remedy: str) -> None:
        self._bus = bus
        self._clock = clock
        self._remedy = remedy
        self._rows: list[tuple[float, float, float, float, float]] = []
        self.health = BusHealth()
        self.drained_s = clock.now_s()

    def drain(self) -> None:
        """Receives everything the bus holds; never waits. Raises DeviceError if the bus fails or
        a frame cannot be decoded.
        """
        # The time is read before the first frame, so that no frame gets a time later than its
        # arrival.
        before_s = self.drained_s
        self.drained_s = self._clock.now_s()
        wall_s = self._clock.wall_time().timestamp()
        try:
            for message in receive_frames(self._bus, self.health, self._remedy):
                self._take(message, arrival_s(message, before_s, self.drained_s, wall_s))
        # Reports decoded before a failure are still stamped and handed out. After a long pause
        # frames may be missing anywhere.
        finally:
            self._stamp(is_whole=self.drained_s - before_s < MAX_READ_PAUSE_S)

    def samples(self) -> ShaftSamples:
        """Samples (m,) drained since the last call."""
        rows = np.array(self._rows, np.float64).reshape(-1, 5)
        self._rows = []
        return ShaftSamples(*rows.T)

    @abstractmethod
    def _take(self, message: can.Message, arrived_s: float) -> None:
        """Takes in one frame that arrived at this host time. A report with known time becomes a
        row: host and device time, shaft angle, speed and torque.
        """

    def _stamp(self, is_whole: bool) -> None:  # noqa: B027 (nothing to do where reports are not counted)
        """Time-stamps the reports of this `drain`, for a drive whose reports are counted. Without
        `is_whole` frames may be missing among them.
        """

    @abstractmethod
    def reset_counters(self) -> None:
        """Restarts the counters behind `heard` and `missing`."""

    @abstractmethod
    def missing(self) -> str | None:
        """The first kind of report that has not arrived since `reset_counters`, with the remedy;
        None if none is missing.
        """

    @property
    @abstractmethod
    def silent_s(self) -> float:
        """Time in s for which a due report has been missing, at the last `drain`."""

    @property
    @abstractmethod
    def zero_lost(self) -> str | None:
        """Why the angle can no longer be trusted, or None. Never reset."""

    @property
    def doubts(self) -> str | None:
        """An error of the reports themselves that the drive does not report, or None."""
        return None

    @property
    def temperature_C(self) -> float | None:
        """As in `MotorStatus`."""
        return None

    @property
    def torque_age_s(self) -> float:
        """As in `MotorStatus`."""
        return 0.0

    @property
    def uptime_s(self) -> float | None:
        """As in `MotorStatus`."""
        return None


@dataclass(frozen=True)
class Report:
    """One report of a drive: turns, turns/s and torque of its motor, before the gear.

    `is_on` means that it is energised and follows commands. `state` is a text. `fault` is None, or
    the error code with its meaning. `temperature_C` is the higher of drive and motor temperature,
    `uptime_s` the time since the drive was powered up; None where the drive does not report them.
    """

    turns: float
    turns_s: float
    torque_Nm: float
    is_on: bool
    state: str
    fault: str | None = None
    temperature_C: float | None = None
    uptime_s: float | None = None


class DriveReports(DriveReceiver):
    """Receives the reports of one drive. `last` is its last report, drained at host time `heard_s`.

    With a period, reports are cyclic and are time-stamped by counting them. Without one, each
    report answers a request, and its time is that of the last request. A late answer, or two
    answers at once, then costs one sample but never breaks the order of time.
    """

    def __init__(
        self,
        bus: can.BusABC,
        clock: Clock,
        gear: ShaftGear,
        period_s: float | None,
        understand: Callable[[can.Message], Report | None],
    ) -> None:
        super().__init__(bus, clock, WATCHDOG_REMEDY)
        self._gear = gear
        self._understand = understand
        self._count = None if period_s is None else FrameCount(period_s)
        self._leap = EncoderJumpMonitor()
        self._check = ReadingCheck("the drive", POSITION, SPEED, TORQUE)
        self._temperature = OptionalReading("the drive", TEMPERATURE)
        self._asked_s = self._stamped_s = self._open_s = self._first_s = np.nan
        # Reports that have no time stamp yet, with the host times of their arrival.
        self._arrived: list[tuple[Report, float]] = []
        self.last: Report | None = None
        self.restarted: str | None = None
        self.angle_rad = self.speed_rad_s = np.nan
        self.heard_s = self.drained_s
        self.reset_counters()

    def reset_counters(self) -> None:
        self.heard = 0
        self._foreign: set[int] = set()

    def note_query(self) -> None:
        """Notes a request that was sent; the next report answers it."""
        self._asked_s = self._clock.now_s()
        # Silence counts from the first request that is still open, not from the last one.
        if np.isnan(self._open_s):
            self._open_s = self._asked_s

    def _take(self, message: can.Message, arrived_s: float) -> None:
        try:
            report = self._understand(message)
        # A plug-in decoder raises these on a frame of the wrong length or content; other exceptions
        # are its bugs and propagate.
        except (struct.error, IndexError, ValueError) as error:
            raise DeviceError(
                f"CAN frame 0x{message.arbitration_id:x} {message.data.hex()} cannot be "
                f"read: {error}; {WATCHDOG_REMEDY}"
            ) from error
        if report is None:
            self._foreign.add(message.arbitration_id)
        else:
            self._arrived.append((report, arrived_s))

    def _stamp(self, is_whole: bool) -> None:
        reports = self._arrived
        self._arrived = []
        if not reports:
            return
        self.heard_s = self.drained_s
        self._open_s = np.nan
        self.heard += len(reports)
        timed = reports
        # Without a period only the newest of several answers has a known time, so the others are
        # dropped.
        if self._count is None:
            timed = reports[-1:]
        # A refused report keeps its place until then, because the time of the others comes from
        # counting.
        stamps_s = self._list_stamps(len(timed))
        is_good = [self._accept(report) for report, _ in timed]
        gear = self._gear
        for device_s, (report, arrived_s), good in zip(stamps_s, timed, is_good, strict=True):
            if not good:
                continue
            self.angle_rad = (report.turns - gear.zero_turns) * gear.shaft_rad_per_turn
            self.speed_rad_s = report.turns_s * gear.shaft_rad_per_turn
            self._leap.follow(
                self.drained_s, device_s, self.angle_rad, self.speed_rad_s, judged=is_whole
            )
            # Time must increase strictly in a recording; a second answer to the same request is
            # dropped.
            if self._count is not None or not device_s <= self._stamped_s:
                torque_Nm = report.torque_Nm * gear.shaft_torque_per_drive_torque
                self._rows.append(
                    (arrived_s, device_s, self.angle_rad, self.speed_rad_s, torque_Nm)
                )
            self._stamped_s = device_s

    def _accept(self, report: Report) -> bool:
        """Whether the numbers of a report are possible. Raises BadReading at the third bad one
        in a row.
        """
        # Also that of a refused report: what the drive says of its state and error is true all the
        # same.
        if self.last is None:
            self.last = report
        else:
            self.last = replace(
                self.last, is_on=report.is_on, state=report.state, fault=report.fault
            )
        # An error of the drive is reported as such, whatever its numbers are.
        if report.fault is not None and not isfinite(
            report.turns + report.turns_s + report.torque_Nm
        ):
            return False
        if not self._check.accept(report.turns, report.turns_s, report.torque_Nm):
            return False
        if report.temperature_C is not None:
            self._temperature.take(report.temperature_C)
        if isnan(self._temperature.value):
            warmest_C = None
        else:
            warmest_C = self._temperature.value
        self.last = replace(report, temperature_C=warmest_C)
        return True

    @property
    def bad_reports(self) -> str:
        """How many reports were refused because of impossible numbers, by signal."""
        return describe_bad(self._check.bad, self._temperature.check.bad)

    def _list_stamps(self, reports: int) -> list[float]:
        if self._count is not None:
            return self._count.list_stamps(reports, self.drained_s)
        if np.isnan(self._asked_s):
            moment_s = self.drained_s
        else:
            moment_s = self._asked_s
        if np.isnan(self._first_s):
            self._first_s = moment_s
        return [moment_s - self._first_s] * reports

    @property
    def temperature_C(self) -> float | None:
        if self.last is None:
            return None
        return self.last.temperature_C

    @property
    def uptime_s(self) -> float | None:
        if self.last is None:
            return None
        return self.last.uptime_s

    @property
    def silent_s(self) -> float:
        if self._count is not None:
            since_s = self.heard_s
        elif np.isnan(self._open_s):
            since_s = self.drained_s
        else:
            since_s = self._open_s
        return self.drained_s - since_s

    @property
    def lost(self) -> int:
        if self._count is None:
            return 0
        return self._count.lost

    @property
    def zero_lost(self) -> str | None:
        return self.restarted or self._leap.fault

    @property
    def doubts(self) -> str | None:
        return self.zero_lost or (self._count.fault if self._count else None) or self.health.fault

    def missing(self) -> str:
        """Why there is no report, and the remedy."""
        if self._foreign:
            identifiers = ", ".join(f"0x{identifier:x}" for identifier in sorted(self._foreign)[:5])
            return (
                f"frames {identifiers} but no report of the drive; check its address under "
                "[motor], and which messages it is set to send"
            )
        return (
            "no frames at all on the CAN bus; check the drive's power, the wiring, the "
            "termination and the bit rate"
        )
