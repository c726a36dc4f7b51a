"""What motor twins share: their base class, encoder, thermal model of the motor, and a cascaded
speed loop.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from math import exp, remainder
from typing import ClassVar

import can

from rfca_rig.twins.world import ShaftDrive, ShaftState


def reading_after_power_up(reading: float, per_motor_turn: float, policy: str) -> float:
    """What an encoder that read `reading` reads at the same place after a power cycle.

    `per_motor_turn` is the change of the reading in one turn of the motor. The policies are those
    of `zero_policy` in a rig file: an encoder behind a gear has forgotten whole turns of the motor,
    an incremental one counts from zero.
    """
    if policy == "absolute":
        return reading
    if policy == "behind-gear":
        return remainder(reading, per_motor_turn)
    return 0.0


class LoopMode(IntEnum):
    """What a set-point commands."""

    TORQUE = 1
    VELOCITY = 2
    POSITION = 3


class Encoder:
    """Reports the true motion until it is frozen."""

    def __init__(self) -> None:
        self._stands = False
        self._standing: tuple[float, float] | None = None

    def freeze(self) -> None:
        """Fault: every later report repeats the angle and speed of the next one."""
        self._stands = True

    def report(self, angle: float, speed: float) -> tuple[float, float]:
        """Angle and speed as reported, in the units of the arguments."""
        if self._stands and self._standing is None:
            self._standing = angle, speed
        return self._standing or (angle, speed)


@dataclass(frozen=True)
class ThermalParameters:
    """First order: dT/dt = (T_air - T) / time_constant_s + rise_K_per_Nm2 * torque^2 /
    time_constant_s.

    The steady-state rise above the air is `rise_K_per_Nm2` times the squared torque, as copper
    losses grow with the squared current. By default 10 N m at the shaft lead to a rise of 30 K,
    after some ten minutes.
    """

    air_degC: float = 30.0
    time_constant_s: float = 600.0
    rise_K_per_Nm2: float = 0.3


class MotorThermalModel:
    """True and reported temperature. `fever_K_s` is an additional heating rate of a fault,
    independent of the torque.
    """

    def __init__(self, warming: ThermalParameters) -> None:
        self._warming = warming
        self._degC = warming.air_degC
        self._stuck_degC: float | None = None
        self.fever_K_s = 0.0

    def advance(self, elapsed_s: float, torque_Nm: float) -> None:
        """Advances the temperature; exact for a constant torque over the step."""
        warming = self._warming
        steady_degC = (
            warming.air_degC
            + warming.rise_K_per_Nm2 * torque_Nm**2
            + self.fever_K_s * warming.time_constant_s
        )
        self._degC = steady_degC + (self._degC - steady_degC) * exp(
            -elapsed_s / warming.time_constant_s
        )

    def stick(self) -> None:
        """Fault: from now on the drive reports the present temperature, whatever it becomes."""
        self._stuck_degC = self._degC

    @property
    def reported_degC(self) -> float:
        if self._stuck_degC is None:
            return self._degC
        return self._stuck_degC


class DriveTwin(ABC):
    """Base class of the twin of any drive: what faults and conformance tests need beside a
    `MotorTwin`.

    `tells_temperature`: reports carry the motor's temperature. `tolerances` replaces values of
    `contracts.motor_rig.MotorHooks`, for a protocol that is coarser than most.
    """

    tells_temperature: ClassVar[bool] = False
    tolerances: ClassVar[Mapping[str, float]] = {}

    encoder: Encoder
    warmth: MotorThermalModel

    @abstractmethod
    def restart(self) -> None:
        """Power cycle: no torque, no error, the settings that were saved, and of the encoder's
        reading what `zero_policy` leaves of it.
        """

    @abstractmethod
    def stale_set_point(self) -> Sequence[can.Message]:
        """Frames of an earlier session that commanded a high speed."""

    @abstractmethod
    def fail(self) -> str:
        """Puts the drive into an error; returns the regular expression that the driver's text
        must match: code and meaning.
        """

    @abstractmethod
    def refuse(self) -> str:
        """Makes every attempt to energise fail; returns a regular expression as `fail` does."""


@dataclass(frozen=True)
class LoopGains:
    """Gains at the shaft. The angle gain converts an angle error to a speed set-point."""

    speed_gain_Nm_s_per_rad: float = 8.0
    integral_gain_Nm_per_rad: float = 60.0
    angle_gain_per_s: float = 20.0
    torque_limit_Nm: float = 40.0


@dataclass
class MotorSetPoint:
    """Last commanded set-points, at the shaft. The mode decides which of them are used."""

    mode: int = LoopMode.POSITION
    angle_rad: float = 0.0
    speed_rad_s: float = 0.0
    torque_Nm: float = 0.0


class SpeedLoop:
    """Control loop with an integrator. `law` is the torque until the next step; `advance`
    updates the integrator after it.
    """

    def __init__(self, gains: LoopGains) -> None:
        self._gains = gains
        self._integral_Nm = 0.0
        self._limited = False

    def reset(self) -> None:
        self._integral_Nm = 0.0

    def law(self, wanted: MotorSetPoint, shaft: ShaftState) -> ShaftDrive:
        """Torque law, limited at the beginning of the step.

        Beyond the limit the whole law is scaled down to it for that step, so that the torque still
        decreases with the error. A constant torque would drive a light shaft past its set-point
        within one step, and cause chatter.
        """
        free = self._law_without_limit(wanted)
        torque_Nm = abs(free.torque_Nm(shaft.angle_rad, shaft.speed_rad_s))
        self._limited = torque_Nm > self._gains.torque_limit_Nm
        if self._limited:
            return free.scale(self._gains.torque_limit_Nm / torque_Nm)
        return free

    def _law_without_limit(self, wanted: MotorSetPoint) -> ShaftDrive:
        gains = self._gains
        if wanted.mode == LoopMode.TORQUE:
            return ShaftDrive(feed_Nm=wanted.torque_Nm)
        # The angle error times the angle gain is a speed, which the speed gain turns into torque.
        if wanted.mode == LoopMode.POSITION:
            angle_gain = gains.angle_gain_per_s * gains.speed_gain_Nm_s_per_rad
        else:
            angle_gain = 0.0
        feed_Nm = wanted.torque_Nm + self._integral_Nm
        return ShaftDrive(
            feed_Nm, angle_gain, wanted.angle_rad, gains.speed_gain_Nm_s_per_rad, wanted.speed_rad_s
        )

    def advance(
        self, wanted: MotorSetPoint, elapsed_s: float, before: ShaftState, after: ShaftState
    ) -> None:
        """Updates the integrator with the speed error over the step. The rotation is exact, the
        mean angle is trapezoidal.

        The integrator is held while the torque is limited, the usual anti-windup of drives.
        """
        # In torque mode the integrator is not part of the law.
        if self._limited or wanted.mode == LoopMode.TORQUE:
            return
        error_rad = wanted.speed_rad_s * elapsed_s - (after.angle_rad - before.angle_rad)
        if wanted.mode == LoopMode.POSITION:
            behind_rad = wanted.angle_rad - 0.5 * (before.angle_rad + after.angle_rad)
            error_rad += self._gains.angle_gain_per_s * behind_rad * elapsed_s
        self._integral_Nm += self._gains.integral_gain_Nm_per_rad * error_rad
