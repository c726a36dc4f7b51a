"""How warm a drive's motor is: one body that the torque heats and the air cools."""

from dataclasses import dataclass
from math import exp


@dataclass(frozen=True)
class Warming:
    """First order: dT/dt = (T_air - T) / time_constant_s + rise_K_per_Nm2 * torque^2 / time_constant_s.

    A torque held for ever ends `rise_K_per_Nm2` times its square above the air; copper losses go with the square of the current.
    By default 10 N m at the shaft end 30 K above, after some ten minutes.
    """

    air_degC: float = 30.0
    time_constant_s: float = 600.0
    rise_K_per_Nm2: float = 0.3


class Warmth:
    """The temperature, and what is told of it. `fever_K_s` heats on top, without any torque."""

    def __init__(self, warming: Warming) -> None:
        self._warming = warming
        self._degC = warming.air_degC
        self._stuck_degC: float | None = None
        self.fever_K_s = 0.0

    def passed(self, elapsed_s: float, torque_Nm: float) -> None:
        """Exact for a torque that stood still over the step."""
        warming = self._warming
        ends_degC = warming.air_degC + warming.rise_K_per_Nm2 * torque_Nm**2 + self.fever_K_s * warming.time_constant_s
        self._degC = ends_degC + (self._degC - ends_degC) * exp(-elapsed_s / warming.time_constant_s)

    def stick(self) -> None:
        """From now on the drive tells this temperature, whatever it is."""
        self._stuck_degC = self._degC

    @property
    def told_degC(self) -> float:
        return self._degC if self._stuck_degC is None else self._stuck_degC
