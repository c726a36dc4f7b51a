"""What a drive of a lab's own says of itself, taken in and stamped."""

import struct
from collections.abc import Callable
from dataclasses import dataclass

import can
import numpy as np

from rfca_rig.clock import Clock
from rfca_rig.drivers.blocks import join
from rfca_rig.drivers.bus_health import BusHealth
from rfca_rig.drivers.can_frames import DAMMED_UP_S, arrived
from rfca_rig.drivers.encoder_jump import LeapWatch
from rfca_rig.drivers.frame_count import FrameCount
from rfca_rig.drivers.roles import ShaftSamples
from rfca_rig.drivers.shaft_gear import ShaftGear
from rfca_rig.errors import DeviceError

GUARDED = "the drive's watchdog stops the motor"
NOTHING = ShaftSamples(*(np.empty(0) for _ in range(5)))


@dataclass(frozen=True)
class Report:
    """How a drive says it is: turns, turns/s and torque of its motor, before the gear.

    `is_on` says that it is energised and obeys; `state` in words; `fault` is None or its own error code with what that means;
    `temperature_C` of drive or motor, whichever is warmer, None where it does not tell.
    """

    turns: float
    turns_s: float
    torque_Nm: float
    is_on: bool
    state: str
    fault: str | None = None
    temperature_C: float | None = None


class DriveReports:
    """Listens for one drive. `last` is its last report, drained at host time `heard_s`.

    With a period, reports come by themselves and are stamped by counting them. Without one each answers a question, and is stamped with
    when the last question was asked: late answers and those of two questions at once cost a sample, never the order of time.
    """

    def __init__(
        self, bus: can.BusABC, clock: Clock, gear: ShaftGear, period_s: float | None, understand: Callable[[can.Message], Report | None]
    ) -> None:
        self._bus = bus
        self._clock = clock
        self._gear = gear
        self._understand = understand
        self._count = None if period_s is None else FrameCount(period_s)
        self._leap = LeapWatch()
        self._asked_s = self._stamped_s = self._open_s = self._first_s = np.nan
        self._samples: list[ShaftSamples] = []
        self.health = BusHealth()
        self.last: Report | None = None
        self.restarted: str | None = None
        self.angle_rad = self.speed_rad_s = np.nan
        self.drained_s = self.heard_s = clock.now_s()
        self.recount()

    def recount(self) -> None:
        """What `heard` counts and `missing` speaks of begins now."""
        self.heard = 0
        self._foreign: set[int] = set()

    def asked(self) -> None:
        """To be called with every question; what comes next answers it."""
        self._asked_s = self._clock.now_s()
        if np.isnan(self._open_s):
            self._open_s = self._asked_s

    def drain(self) -> None:
        """Takes in everything the bus holds; never waits. Raises DeviceError on a failing bus or a frame that cannot be read."""
        before_s, self.drained_s = self.drained_s, self._clock.now_s()
        reports: list[Report] = []
        try:
            for message in arrived(self._bus, self.health, GUARDED):
                self._take(message, reports)
        finally:
            self._stamp(reports, is_whole=self.drained_s - before_s < DAMMED_UP_S)

    def _take(self, message: can.Message, reports: list[Report]) -> None:
        try:
            report = self._understand(message)
        except (struct.error, IndexError, ValueError) as error:
            raise DeviceError(f"CAN frame 0x{message.arbitration_id:x} {message.data.hex()} cannot be read: {error}; {GUARDED}") from error
        if report is None:
            self._foreign.add(message.arbitration_id)
        else:
            reports.append(report)

    def _stamp(self, reports: list[Report], is_whole: bool) -> None:
        if not reports:
            return
        self.last, self.heard_s, self._open_s = reports[-1], self.drained_s, np.nan
        self.heard += len(reports)
        taken = reports if self._count is not None else reports[-1:]
        samples = self._samples_of(taken, self._device_s(len(taken)))
        for stamp_s, angle_rad, speed_rad_s in zip(samples.device_s, samples.angle_rad, samples.speed_rad_s, strict=True):
            self._leap.follow(self.drained_s, float(stamp_s), float(angle_rad), float(speed_rad_s), judged=is_whole)
        self.angle_rad, self.speed_rad_s = float(samples.angle_rad[-1]), float(samples.speed_rad_s[-1])
        is_new = self._count is not None or np.isnan(self._stamped_s) or samples.device_s[-1] > self._stamped_s
        self._stamped_s = float(samples.device_s[-1])
        self._samples += [samples] if is_new else []

    def _device_s(self, reports: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        if self._count is not None:
            return np.asarray(self._count.stamp(reports, self.drained_s)).reshape(reports)
        moment_s = self.drained_s if np.isnan(self._asked_s) else self._asked_s
        self._first_s = moment_s if np.isnan(self._first_s) else self._first_s
        return np.full(reports, moment_s - self._first_s)

    def _samples_of(self, reports: list[Report], device_s: np.ndarray[tuple[int], np.dtype[np.float64]]) -> ShaftSamples:
        gear, rows = self._gear, np.array([(one.turns, one.turns_s, one.torque_Nm) for one in reports])
        if not np.isfinite(rows[:, :2]).all():
            raise DeviceError(f"the drive tells no position or speed, state {reports[-1].state}; check its encoder")
        return ShaftSamples(
            host_s=np.full(len(rows), self.drained_s),
            device_s=device_s,
            angle_rad=(rows[:, 0] - gear.zero_turns) * gear.shaft_rad_per_turn,
            speed_rad_s=rows[:, 1] * gear.shaft_rad_per_turn,
            torque_Nm=rows[:, 2] * gear.shaft_torque_per_drive_torque,
        )

    def samples(self) -> ShaftSamples:
        """Everything drained since the last call."""
        blocks, self._samples = self._samples, []
        return join([NOTHING, *blocks])

    @property
    def silent_s(self) -> float:
        """How long the drive has said nothing that was due, as of the last `drain`."""
        since_s = self.heard_s if self._count is not None else self.drained_s if np.isnan(self._open_s) else self._open_s
        return self.drained_s - since_s

    @property
    def lost(self) -> int:
        return 0 if self._count is None else self._count.lost

    @property
    def zero_lost(self) -> str | None:
        """Why the angle is not to be believed any more; not forgiven."""
        return self.restarted or self._leap.fault

    @property
    def doubts(self) -> str | None:
        """What is wrong with the reports themselves, where the drive says nothing of it."""
        return self.zero_lost or (self._count.fault if self._count else None) or self.health.fault

    def missing(self) -> str:
        """Why there is no report, and what to do about it."""
        if self._foreign:
            heard = ", ".join(f"0x{one:x}" for one in sorted(self._foreign)[:5])
            return f"frames {heard} but no report of the drive; check its address under [motor], and which messages it is set to send"
        return "no frames at all on the CAN bus; check the drive's power, the wiring, the termination and the bit rate"
