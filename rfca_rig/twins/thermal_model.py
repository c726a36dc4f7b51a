"""Thermal model of a motor: one mass, heated by the torque and cooled by the air."""

from dataclasses import dataclass
from math import exp


@dataclass(frozen=True)
class ThermalParameters:
    """First order: dT/dt = (T_air - T) / time_constant_s + rise_K_per_Nm2 * torque^2 / time_constant_s.

    The steady-state rise above the air is `rise_K_per_Nm2` times the squared torque, as copper losses grow with the squared current.
    By default 10 N m at the shaft lead to a rise of 30 K, after some ten minutes.
    """

    air_degC: float = 30.0
    time_constant_s: float = 600.0
    rise_K_per_Nm2: float = 0.3


class MotorThermalModel:
    """True and reported temperature. `fever_K_s` is an additional heating rate of a fault, independent of the torque."""

    def __init__(self, warming: ThermalParameters) -> None:
        self._warming = warming
        self._degC = warming.air_degC
        self._stuck_degC: float | None = None
        self.fever_K_s = 0.0

    def passed(self, elapsed_s: float, torque_Nm: float) -> None:
        """Advances the temperature; exact for a constant torque over the step."""
        warming = self._warming
        steady_degC = warming.air_degC + warming.rise_K_per_Nm2 * torque_Nm**2 + self.fever_K_s * warming.time_constant_s
        self._degC = steady_degC + (self._degC - steady_degC) * exp(-elapsed_s / warming.time_constant_s)

    def stick(self) -> None:
        """Fault: from now on the drive reports the present temperature, whatever it becomes."""
        self._stuck_degC = self._degC

    @property
    def told_degC(self) -> float:
        return self._degC if self._stuck_degC is None else self._stuck_degC
