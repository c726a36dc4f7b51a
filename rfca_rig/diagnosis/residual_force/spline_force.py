"""A stroke under a force that follows no law: any course over time, superposed from short bumps.

A bump is a cubic B-spline. The bumps of one stroke are `spacing_s` apart from its beginning to its
end and add up to one. So their sizes are the force itself, smoothed. The first bump also acts
before the start, where the leg rests under it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.diagnosis.leg.strokes import STROKE_TOLERANCE, DynamicCondition
from rfca_rig.model.catalogue import set_up
from rfca_rig.model.kernel.laws import HINGE, LawUse
from rfca_rig.model.motion import ShaftMotion
from rfca_rig.model.setup import Setup, with_law
from rfca_rig.model.stroke import SimulatedStroke, simulate_setup

Floats = NDArray[np.float64]
Change = Callable[[Setup], Setup]

SPACING_S = 0.025  # a third of the slowest vibration of the paper's leg on the ground
# Each bump costs one simulation per hinge, so a long stroke has wider bumps instead of more.
MOST_BUMPS = 48
AT_REST_S = 1e3  # the model finds the rest pose with a very long elapsed time

BEGINS, CENTRE, SPACING, HELD, SIZE = range(5)


@dataclass(frozen=True)
class SplineBasis:
    """`count` bumps over one stroke, the first `spacing_s` after its start."""

    spacing_s: float
    count: int

    @property
    def centres_s(self) -> Floats:
        """Middle of each bump, (count,)."""
        return self.spacing_s * np.arange(1, self.count + 1, dtype=np.float64)

    def at(self, t_s: Floats) -> Floats:
        """All bumps of size 1 at times (n,), as columns (n, count)."""
        x = (t_s[:, None] - self.centres_s) / self.spacing_s
        bumps = _bump(x)
        # The first bump stands for all bumps before it as well, so that the sum stays one up to the
        # start.
        first = x[:, 0]
        bumps[:, 0] = np.where(
            first < -1.0, 1.0, _bump(first) + _bump(first + 1.0) + _bump(first + 2.0)
        )
        return bumps


def make_basis(flap: DynamicCondition) -> SplineBasis:
    """The bumps that cover a condition's rows."""
    end_s = float(flap.t_s[-1])
    spacing_s = max(SPACING_S, end_s / MOST_BUMPS)
    return SplineBasis(spacing_s, int(np.ceil(end_s / spacing_s)))


def _bump(x: Floats) -> Floats:
    """Cubic B-spline at distances x (in spacings) from its centre, of the shape of x; zero
    beyond 2.
    """
    y = np.abs(x)
    return np.where(
        y < 1.0, 2.0 / 3.0 - y * y * (1.0 - 0.5 * y), np.maximum(2.0 - y, 0.0) ** 3 / 6.0
    )


def torque(  # a law takes what its place offers, needed or not
    phi: float,  # noqa: ARG001
    rate: float,  # noqa: ARG001
    elapsed: float,
    k0: float,  # noqa: ARG001
    k2: float,  # noqa: ARG001
    memory: Any,
    parameter: Any,
) -> tuple[float, float, float]:
    """Torque of one bump over time in a hinge; the derivatives by angle and rate are 0."""
    t = parameter[BEGINS] + memory[0] + (elapsed if elapsed < AT_REST_S else 0.0)
    x = (t - parameter[CENTRE]) / parameter[SPACING]
    weight = 0.0
    for j in range(3 if parameter[HELD] > 0.0 else 1):
        y = abs(x + j)
        if y < 1.0:
            weight += 2.0 / 3.0 - y * y * (1.0 - 0.5 * y)
        elif y < 2.0:
            weight += (2.0 - y) ** 3 / 6.0
    if parameter[HELD] > 0.0 and x < -1.0:
        weight = 1.0
    return weight * parameter[SIZE], 0.0, 0.0


def advance_time(
    phi: float,  # noqa: ARG001
    rate: float,  # noqa: ARG001
    elapsed: float,
    k0: float,  # noqa: ARG001
    k2: float,  # noqa: ARG001
    memory: Any,
    parameter: Any,  # noqa: ARG001
) -> None:
    """Advance the time of a law by an accepted step."""
    memory[0] += elapsed if elapsed < AT_REST_S else 0.0


def bump_in_hinge(bumps: SplineBasis, number: int, size_Nm: float, hinge: int) -> Change:
    """Bump `number`, from 0, of a torque that resists the turn of a hinge; hinges count from 1."""

    def change(setup: Setup) -> Setup:
        row = (
            setup.begins_s,
            float(bumps.centres_s[number]),
            bumps.spacing_s,
            float(number == 0),
            size_Nm,
        )
        return with_law(setup, LawUse(HINGE, torque, row, advance_time, hinge))

    return change


def bump_in_turn(
    motion: ShaftMotion, bumps: SplineBasis, number: int, size_rad: float
) -> ShaftMotion:
    """The motion with bump `number`, which must not be the first, added to the angle."""
    h = bumps.spacing_s
    centre = float(bumps.centres_s[number])
    corners = centre + h * np.arange(-2.0, 3.0)
    breaks = np.union1d(motion.breaks_s, corners[corners < motion.breaks_s[-1]])
    # Breaks that coincide up to rounding would give pieces of zero length.
    breaks = breaks[np.append(True, np.diff(breaks) > 1e-9)]
    pieces = np.array([_at(motion, begin) for begin in breaks[:-1]])
    added = np.array([_bump_piece((begin - centre) / h) for begin in breaks[:-1]]) / h ** np.arange(
        4
    )
    return ShaftMotion(breaks, pieces + size_rad * added, motion.landings_s)


def _at(motion: ShaftMotion, t: float) -> Floats:
    """Coefficients (4,) of the cubic that begins at t."""
    i = int(
        np.clip(
            np.searchsorted(motion.breaks_s, t + 1e-12, side="right") - 1,
            0,
            len(motion.coefficients) - 1,
        )
    )
    a, b, c, d = motion.coefficients[i]
    x = t - motion.breaks_s[i]
    return np.array(
        [a + x * (b + x * (c + x * d)), b + x * (2.0 * c + 3.0 * d * x), c + 3.0 * d * x, d]
    )


def _bump_piece(x: float) -> Floats:
    """Coefficients (4,) of the cubic of the bump from x on, in powers of the distance from
    there.
    """
    # x lies on the edge of a piece up to rounding; the small shift selects the piece that begins
    # there.
    y = x + 1e-6
    if not -2.0 < y < 2.0:
        return np.zeros(4)
    side = 1.0 if y > 0.0 else -1.0
    if abs(y) > 1.0:
        value = (2.0 - side * x) ** 3 / 6.0
        slope = -0.5 * side * (2.0 - side * x) ** 2
        bend = 0.5 * (2.0 - side * x)
        third = -side / 6.0
    else:
        value = 2.0 / 3.0 - x * x + 0.5 * side * x**3
        slope = -2.0 * x + 1.5 * side * x * x
        bend = -1.0 + 1.5 * side * x
        third = 0.5 * side
    return np.array([value, slope, bend, third])


def simulate_forced_stroke(
    flap: DynamicCondition,
    supposed: ModelPoint,
    changes: tuple[Change, ...],
    motion: ShaftMotion | None = None,
) -> SimulatedStroke:
    """The stroke of the condition with changes of its setup, along `motion` if one is given.

    Raises SimulationFailed where the integrator cannot go on.
    """
    own_motion = flap.turn.motion(supposed, float(flap.t_s[-1])) if motion is None else motion
    setup = set_up(
        supposed.rig, flap.height_m + supposed.height_offset_m, own_motion, flap.strokes_before
    )
    for change in changes:
        setup = change(setup)
    return simulate_setup(setup, flap.t_s, STROKE_TOLERANCE)
