"""Enumerates the assignments of found marks to planned ones that the chain allows, lowest cost first."""

import heapq
from collections.abc import Iterator, Sequence
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

# A distance that is impossible by more than this is not between two marks of the leg.
MAX_SIGMAS = 4.5
# Squared misfit up to which a found mark is preferred to a missing one.
MISSING_COST = 25.0
# Standard deviation of the logarithm of a diameter: focus and exposure change it, for all marks alike.
SIZE_STD = 0.12
MAX_SIZE_SIGMAS = 3.0
# Number of earlier marks that each mark is compared with.
LOOK_BACK = 3
# Limit of the search, for photos full of red things.
MAX_STEPS = 60_000


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


@dataclass(frozen=True)
class Candidates:
    """Found marks: places_m (n, 2) in the plane, std_m (n,), and log_size (n,), the logarithm of measured over expected diameter."""

    places_m: Floats
    std_m: Floats
    log_size: Floats

    def size_cost(self, found: int) -> float:
        """Squared misfit of a mark's size; infinite where it cannot be a mark of the leg."""
        sigmas = float(self.log_size[found]) / SIZE_STD
        return np.inf if abs(sigmas) > MAX_SIZE_SIGMAS else sigmas**2


@dataclass(frozen=True)
class Tolerances:
    """Standard deviations of the known lengths, and of the shaft axis in the calibration."""

    length_m: float
    shaft_m: float


@dataclass(frozen=True, order=True)
class MarkAssignment:
    """For each planned mark the number of a found one, or -1 for missing; the cost is the squared misfit plus that of missing marks."""

    cost: float
    chosen: tuple[int, ...]


def assignments_within(
    margin: float, candidates: Candidates, bounds: ChainBounds, tolerances: Tolerances, most: int = MAX_STEPS
) -> tuple[tuple[MarkAssignment, ...], bool]:
    """All assignments that cost at most `margin` more than the cheapest, and whether the search was finished.

    A best-first search over partial assignments, from the shaft outwards. Costs only grow, so complete assignments are found in the order
    of their costs. `most` limits the number of extended partial assignments.
    """
    planned = len(bounds.nearest_m) - 1
    open_ones = [MarkAssignment(0.0, ())]
    done: list[MarkAssignment] = []
    for _ in range(most):
        if not open_ones or (done and open_ones[0].cost > done[0].cost + margin):
            return tuple(done), True
        cheapest = heapq.heappop(open_ones)
        if len(cheapest.chosen) == planned:
            done.append(cheapest)
            continue
        for longer in _extensions(cheapest, candidates, bounds, tolerances):
            heapq.heappush(open_ones, longer)
    return tuple(done), False


def _extensions(so_far: MarkAssignment, candidates: Candidates, bounds: ChainBounds, tolerances: Tolerances) -> Iterator[MarkAssignment]:
    yield MarkAssignment(so_far.cost + MISSING_COST, (*so_far.chosen, -1))
    for found in range(len(candidates.places_m)):
        looks = candidates.size_cost(found)
        if found in so_far.chosen or not np.isfinite(looks):
            continue
        misfit = _misfit(so_far.chosen, found, candidates, bounds, tolerances)
        if misfit is not None:
            yield MarkAssignment(so_far.cost + misfit + looks, (*so_far.chosen, found))


def _misfit(chosen: tuple[int, ...], found: int, candidates: Candidates, bounds: ChainBounds, tolerances: Tolerances) -> float | None:
    """Squared misfit of a found mark as the next planned one, to the shaft and the last seen marks; None where it is impossible."""
    here, own_std = candidates.places_m[found], float(candidates.std_m[found])
    index = len(chosen) + 1
    seen = [(i + 1, mark) for i, mark in enumerate(chosen) if mark >= 0][-LOOK_BACK:]
    references = [(0, np.zeros(2), np.hypot(tolerances.shaft_m, own_std))]
    references += [(i, candidates.places_m[mark], np.hypot(own_std, candidates.std_m[mark])) for i, mark in seen]
    total = 0.0
    for other, place, std in references:
        excess = bounds.excess_m(other, index, float(np.hypot(*(here - place))))
        sigmas = excess / float(np.hypot(std, tolerances.length_m))
        if abs(sigmas) > MAX_SIGMAS:
            return None
        total += sigmas**2
    return total
