"""Base classes of plug-in twins: motor twins for drives with a speed command on a CAN bus,
sensor twins for devices that stream records.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from math import isfinite, tau
from typing import Protocol

import can
import numpy as np
from numpy.typing import NDArray

from rfca_rig.twins.drive_parts import (
    DriveTwin,
    Encoder,
    LoopGains,
    LoopMode,
    MotorSetPoint,
    MotorThermalModel,
    SpeedLoop,
    ThermalParameters,
    reading_after_power_up,
)
from rfca_rig.twins.wires import SampleGrid, SerialLine
from rfca_rig.twins.world import ShaftDrive, ShaftState, interpolate_motion

Floats = NDArray[np.float64]


class TwinnedKeys(Protocol):
    """Keys of [motor] that the twin needs."""

    @property
    def gear_ratio(self) -> float: ...
    @property
    def direction(self) -> int: ...
    @property
    def zero_turns(self) -> float: ...
    @property
    def report_period_ms(self) -> float | None: ...
    @property
    def zero_policy(self) -> str | None: ...


class SpeedDriveTwin(DriveTwin):
    """Handles speed loop, encoder, watchdog and time. Inherit, and implement the commands and the
    reports of the drive.

    `is_on` means that the drive is energised. `fault` is its error code, 0 for none; `refuses_with`
    is the error that every attempt to energise ends in. A world advances it in steps:
    `take_frames`, `drive`, then, after the plant has moved, `advance`.
    """

    def __init__(
        self, bus: can.BusABC, keys: TwinnedKeys, gains: LoopGains, watchdog_s: float | None
    ) -> None:
        """`watchdog_s` None: a drive without a watchdog."""
        self._bus = bus
        self._gear = keys.gear_ratio, keys.direction, keys.zero_turns
        self._zero_policy = keys.zero_policy or "incremental"
        self._loop = SpeedLoop(gains)
        self._wanted = MotorSetPoint(LoopMode.VELOCITY)
        self._watchdog_s = watchdog_s
        self._fed_s = self.now_s = 0.0
        if keys.report_period_ms is None:
            self._ticks = None
        else:
            self._ticks = SampleGrid(1e-3 * keys.report_period_ms)
        self._asked = self._restarts = False
        self._counted_from_rad = 0.0
        self.encoder = Encoder()
        self.warmth = MotorThermalModel(ThermalParameters())
        self.is_on = False
        self.fault = self.refuses_with = 0

    # -- behaviour of the drive, to be implemented
    # ---------------------------------------------------------------------------

    @abstractmethod
    def obey(self, message: can.Message) -> None:
        """Executes a frame: sets `is_on` and `fault`, calls `turn`, `feed` and `asked`."""

    @abstractmethod
    def report(self, turns: float, turns_s: float, torque_Nm: float) -> Sequence[can.Message]:
        """Frames of one report; position, speed and torque are those of the motor, before the
        gear.
        """

    @abstractmethod
    def starve(self) -> None:
        """Watchdog timeout: disables the motor and sets the error that the drive has then."""

    def reboot(self) -> Sequence[can.Message]:
        """Frames that the drive sends after a restart, if any."""
        return ()

    def turn(self, turns_s: float) -> None:
        """Sets a new speed set-point."""
        ratio, direction, _ = self._gear
        speed_rad_s = direction * tau / ratio * turns_s
        # A set-point that is not finite is taken as zero.
        if isfinite(speed_rad_s):
            self._wanted.speed_rad_s = speed_rad_s
        else:
            self._wanted.speed_rad_s = 0.0

    def feed(self) -> None:
        """Restarts the watchdog."""
        self._fed_s = self.now_s

    def asked(self) -> None:
        """Requests one report, for a drive without cyclic reports."""
        self._asked = True

    def switch_on(self) -> None:
        """Energises the motor, unless it already is."""
        if not self.is_on:
            # An integrator left from an earlier run would move the shaft.
            self._loop.reset()
        self.is_on = True

    # -- as a world carries it
    # ----------------------------------------------------------------------------------------------

    def restart(self) -> None:
        """Power cycle: no torque, no error; an encoder of no stated policy counts from zero at
        its present position.
        """
        self.is_on = False
        self.fault = 0
        self._restarts = True
        self._wanted = MotorSetPoint(LoopMode.VELOCITY)
        self._send(self.reboot())

    def take_frames(self, now_s: float) -> None:
        """Executes frames received since the last step."""
        self.now_s = now_s
        while (message := self._bus.recv(timeout=0)) is not None:
            if not (message.is_error_frame or message.is_remote_frame):
                self.obey(message)
        if self._watchdog_s is not None and self.is_on and now_s - self._fed_s > self._watchdog_s:
            self.starve()

    def drive(self, shaft: ShaftState) -> ShaftDrive:
        """Torque law on the shaft until the next step; also sends a requested report."""
        ratio, direction, zero_turns = self._gear
        if self._restarts:
            # Where the shaft is, is known only here.
            self._restarts = False
            rad_per_turn = direction * tau / ratio
            turns = zero_turns + (shaft.angle_rad - self._counted_from_rad) / rad_per_turn
            turns = reading_after_power_up(turns, 1.0, self._zero_policy)
            self._counted_from_rad = shaft.angle_rad - (turns - zero_turns) * rad_per_turn
        if self.is_on:
            law = self._loop.law(self._wanted, shaft)
        else:
            law = ShaftDrive()
        if self._asked:
            self._asked = False
            self._send_shaft_report(shaft.angle_rad, shaft.speed_rad_s, law)
        return law

    def advance(
        self, elapsed_s: float, now_s: float, before: ShaftState, after: ShaftState, law: ShaftDrive
    ) -> None:
        """Takes in a step of the plant under `law` that ended at `now_s`, and sends the reports
        that became due in it.
        """
        if self.is_on:
            self._loop.advance(self._wanted, elapsed_s, before, after)
        self.warmth.advance(elapsed_s, after.torque_Nm)
        due_s = [] if self._ticks is None else self._ticks.until(now_s).tolist()
        for angle_rad, speed_rad_s in interpolate_motion(due_s, elapsed_s, now_s, before, after):
            self._send_shaft_report(angle_rad, speed_rad_s, law)

    def _send_shaft_report(self, angle_rad: float, speed_rad_s: float, law: ShaftDrive) -> None:
        ratio, direction, zero_turns = self._gear
        torque_Nm = law.torque_Nm(angle_rad, speed_rad_s)
        reported_rad, reported_rad_s = self.encoder.report(
            angle_rad - self._counted_from_rad, speed_rad_s
        )
        # From shaft radians to motor turns.
        per_rad = direction * ratio / tau
        self._send(
            self.report(
                zero_turns + reported_rad * per_rad,
                reported_rad_s * per_rad,
                torque_Nm / (direction * ratio),
            )
        )

    def _send(self, frames: Sequence[can.Message]) -> None:
        for message in frames:
            self._bus.send(message)


class TwinnedStream(Protocol):
    """Keys of [force_sensor] that the twin needs."""

    @property
    def rate_Hz(self) -> float: ...


class RecordStreamTwin(ABC):
    """Handles noise, range and time. Inherit, and implement the commands and the record format.

    A world advances it in steps: `take_requests`, `due`, then, after the plant has moved,
    `take_wrench`.
    """

    # Range per axis, in N and N m.
    full_scale: tuple[float, ...] = (1000.0,) * 3 + (50.0,) * 3

    def __init__(
        self,
        line: SerialLine,
        keys: TwinnedStream,
        noise_std: tuple[float, ...],
        random: np.random.Generator,
    ) -> None:
        """`noise_std`: noise standard deviation of a sample per axis, in N and N m."""
        self._line = line
        self._ticks = SampleGrid(1.0 / keys.rate_Hz)
        self._noise_std = np.array(noise_std)
        self._range = np.array(self.full_scale)
        self._random = random
        self.is_streaming = False

    @abstractmethod
    def obey(self, data: bytes) -> bytes:
        """Executes received bytes, sets `is_streaming`; returns the answer."""

    @abstractmethod
    def record(self, time_s: float, wrench: tuple[float, ...], is_saturated: bool) -> bytes:
        """Encodes one record from the device's own time in s and six values in N and N m."""

    def take_requests(self) -> None:
        """Executes commands received since the last step."""
        if data := self._line.read():
            self._line.write(self.obey(data))

    def due(self, to_s: float) -> Floats:
        """Sample times (m,) in s in the step that ends at `to_s`; none without a stream."""
        times_s = self._ticks.until(to_s)
        self._due_s = times_s if self.is_streaming else times_s[:0]
        return self._due_s

    def take_wrench(self, wrench: Floats) -> None:
        """Takes the true wrench (m, 6), in N and N m, at the times that were due, and sends a
        record for each.
        """
        noisy = wrench + self._random.standard_normal(wrench.shape) * self._noise_std
        clipped = np.clip(noisy, -self._range, self._range)
        for time_s, values, saturated in zip(
            self._due_s.tolist(),
            clipped.tolist(),
            (clipped != noisy).any(axis=1).tolist(),
            strict=True,
        ):
            self._line.write(self.record(time_s, tuple(values), saturated))
