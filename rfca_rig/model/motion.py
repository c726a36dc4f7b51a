"""Prescribed motion of the shaft: the commanded ramp, or a smoothed recording."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.model.kernel.state import Shaft

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ShaftMotion:
    """A piecewise cubic shaft angle.

    `breaks_s` (m + 1,) starts the pieces and ends the last; `coefficients` (m, 4) are angle, speed,
    half the acceleration and a sixth of the jerk at each start. `landings_s` are moments where the
    acceleration jumps, on which a step must end.
    """

    breaks_s: Floats
    coefficients: Floats
    landings_s: Floats

    def angle_rad(self, t_s: Floats) -> Floats:
        """Angle at the times `t_s`, of the same shape."""
        i = np.minimum(
            np.maximum(np.searchsorted(self.breaks_s, t_s) - 1, 0), len(self.coefficients) - 1
        )
        x = t_s - self.breaks_s[i]
        c = self.coefficients[i].T
        return np.asarray(c[0] + x * (c[1] + x * (c[2] + x * c[3])))

    @property
    def start_rad(self) -> float:
        """The angle at t = 0."""
        # As `angle_rad`, with Python's numbers: arrays of one element take five times as long.
        i = min(max(int(self.breaks_s.searchsorted(0.0)) - 1, 0), len(self.coefficients) - 1)
        x = 0.0 - float(self.breaks_s[i])
        (c0, c1, c2, c3) = self.coefficients[i].tolist()
        return float(c0 + x * (c1 + x * (c2 + x * c3)))

    def later(self, by_s: float) -> "ShaftMotion":
        """The same motion, delayed by `by_s`."""
        return replace(self, breaks_s=self.breaks_s + by_s, landings_s=self.landings_s + by_s)

    def standing_since(self, begin_s: float) -> "ShaftMotion":
        """The same motion from t = 0 on; from `begin_s` (below 0) until 0 the shaft rests at its
        angle at 0.
        """
        first = int(self.breaks_s[:-1].searchsorted(0.0))
        if first == len(self.coefficients) or self.breaks_s[first] > 0.0:
            # No piece begins at 0: the motion is defined before 0 already.
            return self
        later = self.coefficients[first:]
        return ShaftMotion(
            np.concatenate([[begin_s], self.breaks_s[first:]]),
            np.concatenate([[[later[0, 0], 0.0, 0.0, 0.0]], later]),
            self.landings_s,
        )

    def shaft(self) -> Shaft:
        """The same for the compiled chain: a shaft that follows this motion exactly, whatever
        the load.
        """
        return Shaft(
            self.breaks_s, self.coefficients, self.landings_s, False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        )


def ramp_to_speed(
    start_angle_rad: float, speed_rad_s: float, ramp_s: float, end_s: float
) -> ShaftMotion:
    """A shaft that rests until t = 0, accelerates evenly to `speed_rad_s` within `ramp_s`, and
    turns on at constant speed to `end_s`.
    """
    ramped_rad = start_angle_rad + 0.5 * speed_rad_s * ramp_s
    return ShaftMotion(
        breaks_s=np.array([-1.0, 0.0, ramp_s, max(end_s, 2.0 * ramp_s)]),
        coefficients=np.array(
            [
                [start_angle_rad, 0.0, 0.0, 0.0],
                [start_angle_rad, 0.0, 0.5 * speed_rad_s / ramp_s, 0.0],
                [ramped_rad, speed_rad_s, 0.0, 0.0],
            ]
        ),
        landings_s=np.array([0.0, ramp_s]),
    )


# wide against encoder noise, narrow against a drive that sags over a tenth of a second
KNOT_SPACING_S = 0.02


def follow(t_s: Floats, angle_rad: Floats) -> ShaftMotion:
    """A recorded shaft angle as least-squares cubic spline, so that encoder noise does not become
    acceleration.

    `t_s` (m,) ascending, `angle_rad` (m,). Features shorter than two knots (40 ms) are averaged
    out. The knots next to t = 0 stand closer, because the ramp begins there.
    """
    from scipy.interpolate import PPoly, make_lsq_spline  # noqa: PLC0415  (0.4 s that a plain prediction need not pay)

    count = max(int((t_s[-1] - t_s[0]) / KNOT_SPACING_S), 2)
    inner = np.linspace(t_s[0], t_s[-1], count + 1)[1:-1]
    inner = np.unique(
        np.concatenate([inner[np.abs(inner) > 0.5 * KNOT_SPACING_S], [-0.005, 0.0, 0.005]])
    )
    inner = inner[(inner > t_s[0]) & (inner < t_s[-1])]
    # A cubic spline repeats its end knots four times.
    knots = np.concatenate([np.full(4, t_s[0]), inner, np.full(4, t_s[-1])])
    piecewise = PPoly.from_spline(make_lsq_spline(t_s, angle_rad, knots, k=3))
    # The repeated knots give pieces without length.
    keep = np.diff(piecewise.x) > 0
    return ShaftMotion(
        breaks_s=np.concatenate([piecewise.x[:-1][keep], piecewise.x[-1:]]),
        coefficients=np.ascontiguousarray(piecewise.c[::-1, keep].T),
        landings_s=np.array([0.0]),
    )
