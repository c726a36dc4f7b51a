"""Torque over angle of a hinge whose strip has play in the shells' grooves: the only way in which the strip alone hardens much.

All hinges are bent alike, so half a pitch p repeats: from the middle of a link (slope 0, by symmetry) to the pin (slope phi/2). The groove
ends at the mouth, m before the pin, and lets the strip move by the play d in all. With x from the link's middle, b the distance from
where the strip lies flat to the mouth, and slopes small within a link (phi/2 is half of what a hinge turns):

    free      the strip bends evenly over the pitch:                                     M = EI phi / p
    touching  from phi = 2 p d / (p/2 - m)^2 on: middle and mouth press on opposite walls, M grows linearly between them
    flat      the middle lies along its wall; 3 d = M b^2 / 2EI and phi/2 = M (b/2 + m) / EI, hence   M = EI phi / (2m + b)

so that the secant stiffness goes from EI / p to EI / 2m. With the paper's strips, m = 3.0 mm and d = 0.32 mm this follows the fitted
10.98 (phi + 4.56 phi^3) to 2.5 % of its end over 0 to 23.5 degrees, as far as the hinges turn in the paper's stroke. But the curvature at
the pin is M / EI: there the strips would be at twice the strength of Table I. The shape can be the groove's doing, the size not alone.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class LooseGroove:
    """`pitch_m` is p, `mouth_m` is m, `play_m` is d: how much wider the groove is than the strip is thick. Raises BadInput."""

    EI_Nm2: float
    pitch_m: float
    mouth_m: float
    play_m: float

    def __post_init__(self) -> None:
        if not (0.0 < self.mouth_m < 0.5 * self.pitch_m and self.play_m > 0.0):
            raise BadInput(
                f"groove with {1e3 * self.play_m:.2f} mm of play ending {1e3 * self.mouth_m:.1f} mm before the pin: the play must be above "
                f"zero and the end between zero and half the pitch, {500.0 * self.pitch_m:.1f} mm"
            )

    @property
    def reach_m(self) -> float:
        """From the link's middle to the groove's mouth."""
        return 0.5 * self.pitch_m - self.mouth_m

    @property
    def touches_rad(self) -> float:
        """Hinge angle from which on the strip touches both walls."""
        return 2.0 * self.play_m * self.pitch_m / self.reach_m**2

    @property
    def flat_rad(self) -> float:
        """Hinge angle from which on it lies along one wall."""
        return 6.0 * self.play_m / self.reach_m + 12.0 * self.play_m * self.mouth_m / self.reach_m**2

    def torque_Nm(self, phi_rad: Floats) -> Floats:
        """(m,) for hinge angles (m,) from zero up."""
        free = self.EI_Nm2 * phi_rad / self.pitch_m
        # All three branches are computed for all angles; at the borders they agree, so the curve is continuous.
        torque = np.where(phi_rad < self.flat_rad, self._touching(phi_rad), self._flat(phi_rad))
        return np.where(phi_rad < self.touches_rad, free, torque)

    def _touching(self, phi_rad: Floats) -> Floats:
        """M from M0 in the middle to M at the mouth over r: rise M0 r^2/3 + M r^2/6 = d EI, slope (M0 + M) r/2 + M m = EI phi/2."""
        r = self.reach_m
        from_rise = 3.0 * self.play_m * self.EI_Nm2 / r**2
        torque: Floats = (0.5 * self.EI_Nm2 * phi_rad - 0.5 * r * from_rise) / (0.25 * r + self.mouth_m)
        return torque

    def _flat(self, phi_rad: Floats) -> Floats:
        """phi/2 = 3 d / b + 6 d m / b^2, solved for b. (Rise of a strip flat at the far end: M b^2 / 6 EI = d.)"""
        # Smaller angles belong to other branches; the bound keeps the division finite at zero.
        phi = np.maximum(phi_rad, self.flat_rad)
        b = (3.0 * self.play_m + np.sqrt(9.0 * self.play_m**2 + 12.0 * phi * self.play_m * self.mouth_m)) / phi
        torque: Floats = self.EI_Nm2 * phi / (2.0 * self.mouth_m + b)
        return torque
