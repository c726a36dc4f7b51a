"""Smallest and largest possible distance between two marks of the leg, over all its poses."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from rfca_rig.vision.leg_marks import MarkPlan, PlannedMark, mark_positions

Floats = NDArray[np.float64]

# Range of squared distance up to which one mark ties another; two marks with one missing between them have three times as much.
LOOSE_M2 = 3e-4
# Grid points per hinge, by the number of hinges between two marks. Odd numbers include the straight hinge, coarser grids limit the work.
POSITIONS_PER_HINGE = {0: 1, 1: 9, 2: 9, 3: 5, 4: 5}
MOST_HINGES = max(POSITIONS_PER_HINGE)


@dataclass(frozen=True)
class ChainBounds:
    """nearest_m and farthest_m (marks + 1, marks + 1); the first index is the smaller one, 0 is the shaft axis, 1 the first mark."""

    nearest_m: Floats
    farthest_m: Floats

    def is_tied(self, a: int, b: int) -> bool:
        """Whether one of the two marks restricts the other to a small part of the plane, in which chance hardly puts a red thing."""
        return float(self.farthest_m[a, b] ** 2 - self.nearest_m[a, b] ** 2) < LOOSE_M2

    def excess_m(self, a: int, b: int, distance_m: float) -> float:
        """By how much a distance in metres is outside the possible range; negative where it is too small, 0 inside."""
        return max(0.0, distance_m - float(self.farthest_m[a, b])) + min(0.0, distance_m - float(self.nearest_m[a, b]))


def chain_bounds(plan: MarkPlan, link_lengths_m: Sequence[float], hinge_range_rad: float) -> ChainBounds:
    """Bounds for all pairs of marks of a leg whose hinges turn by at most the range either way."""
    points = (PlannedMark(1, 0.0), *plan.marks)
    nearest, farthest = np.zeros((len(points), len(points))), np.zeros((len(points), len(points)))
    for a in range(len(points)):
        for b in range(a + 1, len(points)):
            nearest[a, b], farthest[a, b] = _pair_m(points[a], points[b], np.asarray(link_lengths_m, np.float64), hinge_range_rad)
    return ChainBounds(nearest, farthest)


def _pair_m(a: PlannedMark, b: PlannedMark, lengths_m: Floats, hinge_range_rad: float) -> tuple[float, float]:
    """Smallest and largest distance of two marks over a grid of poses; with many hinges between them the smallest is taken as 0."""
    # A mark on a hinge axis is not moved by the turn of its own hinge.
    on_hinge = b.along_m == 0.0 and b.across_m == 0.0
    hinges = max(0, b.link - a.link - int(on_hinge))
    count = POSITIONS_PER_HINGE.get(hinges, 3)
    grid = np.linspace(-hinge_range_rad, hinge_range_rad, count) if count > 1 else np.zeros(1)
    poses = np.array(list(product(grid, repeat=hinges))).reshape(len(grid) ** hinges, hinges)
    angles = np.zeros((len(poses), len(lengths_m)))
    angles[:, a.link : a.link + hinges] = np.cumsum(poses, axis=1)
    places = mark_positions(angles, lengths_m, MarkPlan((a, b)))
    distances = np.linalg.norm(places[:, 1] - places[:, 0], axis=-1)
    return (float(distances.min()) if hinges <= MOST_HINGES else 0.0), float(distances.max())
