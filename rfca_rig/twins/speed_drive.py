"""The drive's side of the CAN wire, for any drive that obeys speeds: what the twin of a lab's own motor is made of."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from math import isfinite, tau
from typing import ClassVar, Protocol

import can

from rfca_rig.codecs.odrive_messages import ControlMode
from rfca_rig.twins.encoder import Encoder
from rfca_rig.twins.motor import moments_between
from rfca_rig.twins.plant import ShaftDrive, ShaftState
from rfca_rig.twins.speed_loop import LoopGains, SetPoint, SpeedLoop
from rfca_rig.twins.thermal_model import Warming, Warmth
from rfca_rig.twins.ticks import Ticks


class TwinnedKeys(Protocol):
    """What the twin needs of [motor]."""

    @property
    def gear_ratio(self) -> float: ...
    @property
    def direction(self) -> int: ...
    @property
    def zero_turns(self) -> float: ...
    @property
    def report_period_ms(self) -> float | None: ...


class SpeedDriveTwin(ABC):
    """Holds the speed loop, the encoder, the watchdog and the time; inherit, and say what frames do and what the drive says.

    `is_on` is the drive's own: energised. `fault` is its error code, 0 for none; `refuses_with` is one in which every attempt to energise
    ends. A world brings it forward step by step: `take_frames`, `drive`, then, after the plant moved, `passed`.
    """

    tells_temperature: ClassVar[bool] = False

    def __init__(self, bus: can.BusABC, keys: TwinnedKeys, gains: LoopGains, watchdog_s: float | None) -> None:
        """`watchdog_s` None for a drive that runs on for ever."""
        self._bus = bus
        self._gear = keys.gear_ratio, keys.direction, keys.zero_turns
        self._loop = SpeedLoop(gains)
        self._wanted = SetPoint(ControlMode.VELOCITY)
        self._watchdog_s = watchdog_s
        self._fed_s = self.now_s = 0.0
        self._ticks = None if keys.report_period_ms is None else Ticks(1e-3 * keys.report_period_ms)
        self._asked = self._restarts = False
        self._counted_from_rad = 0.0
        self.encoder, self.warmth = Encoder(), Warmth(Warming())
        self.is_on = False
        self.fault = self.refuses_with = 0

    # -- what the drive does and says ----------------------------------------------------------------------------------------

    @abstractmethod
    def obey(self, message: can.Message) -> None:
        """Does what a frame orders: sets `is_on` and `fault`, calls `turn`, `feed` and `asked`."""

    @abstractmethod
    def report(self, turns: float, turns_s: float, torque_Nm: float) -> Sequence[can.Message]:
        """The frames of one report; before the gear."""

    @abstractmethod
    def starve(self) -> None:
        """The watchdog ran out: lets go, with the error that the drive then has."""

    @abstractmethod
    def stale_set_point(self) -> Sequence[can.Message]:
        """Frames by which somebody, before, wanted the drive to be fast; for the contract."""

    @abstractmethod
    def fail(self) -> str:
        """Has the drive fail; returns a pattern of what its driver must say of it: the code, and what it means. For the contract."""

    @abstractmethod
    def refuse(self) -> str:
        """Has every attempt to energise fail; returns the same."""

    def reboot(self) -> Sequence[can.Message]:
        """What the drive says when it was switched on anew, if anything."""
        return ()

    def turn(self, turns_s: float) -> None:
        """A new set-point."""
        ratio, direction, _ = self._gear
        speed_rad_s = direction * tau / ratio * turns_s
        self._wanted.speed_rad_s = speed_rad_s if isfinite(speed_rad_s) else 0.0

    def feed(self) -> None:
        """The watchdog starts anew."""
        self._fed_s = self.now_s

    def asked(self) -> None:
        """One report is wanted, by a drive that makes none by itself."""
        self._asked = True

    def switch_on(self) -> None:
        """Energises, unless it is already."""
        if not self.is_on:
            self._loop.reset()
        self.is_on = True

    # -- as a world carries it -----------------------------------------------------------------------------------------------

    def restart(self) -> None:
        """Power off and on: without torque or error, and an encoder that counts from nothing where it finds itself."""
        self.is_on, self.fault, self._restarts = False, 0, True
        self._wanted = SetPoint(ControlMode.VELOCITY)
        self._send(self.reboot())

    def take_frames(self, now_s: float) -> None:
        """Obeys what has come in since the last step."""
        self.now_s = now_s
        while (message := self._bus.recv(timeout=0)) is not None:
            if not (message.is_error_frame or message.is_remote_frame):
                self.obey(message)
        if self._watchdog_s is not None and self.is_on and now_s - self._fed_s > self._watchdog_s:
            self.starve()

    def drive(self, shaft: ShaftState) -> ShaftDrive:
        """The torque on the shaft until the next step; answers what was asked."""
        ratio, direction, zero_turns = self._gear
        if self._restarts:
            self._restarts, self._counted_from_rad = False, shaft.angle_rad + zero_turns * direction * tau / ratio
        law = self._loop.law(self._wanted, shaft) if self.is_on else ShaftDrive()
        if self._asked:
            self._asked = False
            self._tell(shaft.angle_rad, shaft.speed_rad_s, law)
        return law

    def passed(self, elapsed_s: float, now_s: float, before: ShaftState, after: ShaftState, law: ShaftDrive) -> None:
        """Takes in a step of the plant under `law` that ended at `now_s`, and reports what became due in it."""
        if self.is_on:
            self._loop.passed(self._wanted, elapsed_s, before, after)
        self.warmth.passed(elapsed_s, after.torque_Nm)
        due_s = [] if self._ticks is None else self._ticks.until(now_s).tolist()
        for angle_rad, speed_rad_s in moments_between(due_s, elapsed_s, now_s, before, after):
            self._tell(angle_rad, speed_rad_s, law)

    def _tell(self, angle_rad: float, speed_rad_s: float, law: ShaftDrive) -> None:
        ratio, direction, zero_turns = self._gear
        torque_Nm = law.torque_Nm(angle_rad, speed_rad_s)
        told_rad, told_rad_s = self.encoder.told(angle_rad - self._counted_from_rad, speed_rad_s)
        per_rad = direction * ratio / tau
        self._send(self.report(zero_turns + told_rad * per_rad, told_rad_s * per_rad, torque_Nm / (direction * ratio)))

    def _send(self, frames: Sequence[can.Message]) -> None:
        for message in frames:
            self._bus.send(message)
