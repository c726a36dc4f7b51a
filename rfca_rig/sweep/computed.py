"""Intermediate results of one case, each computed once and only if an output needs it."""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.phases import TOUCHDOWN_LASTS_S, Valley, find_valley
from rfca_rig.errors import SimulationFailed
from rfca_rig.model.catalogue import set_up
from rfca_rig.model.kernel.state import Chain
from rfca_rig.model.motion import ShaftMotion, ramp_to_speed
from rfca_rig.model.parameters import RigModel
from rfca_rig.model.stroke import SimulatedStroke, simulate_stroke
from rfca_rig.sweep.quantities import SweepCase

Floats = NDArray[np.float64]

BEFORE_S = 0.1
# Power and impulse are sums over these; ten times as many change them by less than 1 in 10 000.
SAMPLES_PER_S = 4000
# The valley is evaluated at 1 kHz, as in `rfca-rig predict`.
VALLEY_EVERY = 4


class OutputMissing(Exception):
    """An output that this case does not have, with the reason."""


class CaseResults:
    """One design and its stroke; arrays over the stroke are (m,)."""

    def __init__(self, design: SweepCase) -> None:
        self.design = design

    @cached_property
    def rig(self) -> RigModel:
        """The rig model with the design's strip and links."""
        return self.design.model()

    @cached_property
    def motion(self) -> ShaftMotion:
        """Rest, the drive's ramp, constant speed."""
        return ramp_to_speed(self.rig.leg.start_angle_rad, self.design.speed_rad_s, self.rig.drive.ramp_s, self._end_s)

    @cached_property
    def chain(self) -> Chain:
        """The chain as it is simulated, effects included."""
        return set_up(self.rig, self.design.height_m, self.motion).chain()

    @property
    def stroke(self) -> SimulatedStroke:
        """From 0.1 s before the start to the end of the turn. Raises SimulationFailed, on every access."""
        if isinstance(self._stroke, SimulationFailed):
            raise self._stroke
        return self._stroke

    @cached_property
    def _stroke(self) -> SimulatedStroke | SimulationFailed:
        t_s = np.arange(-round(BEFORE_S * SAMPLES_PER_S), int(self._end_s * SAMPLES_PER_S) + 1, dtype=np.float64) / SAMPLES_PER_S
        # The failure is cached too: otherwise every output of the case would simulate again.
        try:
            return simulate_stroke(self.rig, self.design.height_m, self.motion, t_s)
        except SimulationFailed as failed:
            return failed

    @property
    def _end_s(self) -> float:
        # The ramp covers half the angle of a turn at full speed, so the turn takes half a ramp longer.
        return self.design.turn_rad / self.design.speed_rad_s + 0.5 * self.rig.drive.ramp_s

    @cached_property
    def moving(self) -> slice:
        """The samples from the start on."""
        return slice(int(np.searchsorted(self.stroke.t_s, 0.0)), None)

    @cached_property
    def normal_N(self) -> Floats:
        """Normal force of the ground, (m,) in N, summed over the link ends."""
        return np.asarray(self.stroke.normal_N.sum(axis=1))

    @cached_property
    def valley(self) -> Valley:
        """The valley of fz. Raises Missing where there is none."""
        if self.normal_N[0] > 0.0:
            raise OutputMissing("the leg lies on the ground before it starts")
        found = find_valley(self.stroke.t_s[::VALLEY_EVERY], self.stroke.fz_N[::VALLEY_EVERY])
        if not isinstance(found, Valley):
            raise OutputMissing(f"no valley: {found.reason}")
        return found

    @cached_property
    def touchdown(self) -> int:
        """The first sample in contact. Raises Missing where the leg never touches."""
        if not self.normal_N.any():
            raise OutputMissing("the leg does not touch the ground")
        return int((self.normal_N > 0.0).argmax())

    @cached_property
    def pressing(self) -> int:
        """The sample of the greatest load while the leg presses: in contact, more than 30 ms after touchdown."""
        stroke = self.stroke
        pressed = (stroke.t_s >= stroke.t_s[self.touchdown] + TOUCHDOWN_LASTS_S) & (self.normal_N > 0.0)
        if not pressed.any():
            raise OutputMissing(f"the leg does not press for longer than {1e3 * TOUCHDOWN_LASTS_S:.0f} ms")
        return int(np.where(pressed, -stroke.fz_N, -np.inf).argmax())

    def integrate(self, values: Floats) -> float:
        """Integral of values (m,) over the stroke from the start on, by the trapezoidal rule (order 2).

        It is a plain sum, because the rounding of a dot product may depend on the number of threads.
        """
        moving, t_s = values[self.moving], self.stroke.t_s[self.moving]
        return float(np.sum(0.5 * (moving[1:] + moving[:-1]) * np.diff(t_s)))
