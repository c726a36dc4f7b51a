"""The assignments of found marks to planned ones that the chain allows, cheapest first."""

import heapq
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.vision.chain_bounds import ChainBounds

Floats = NDArray[np.float64]

WORST_SIGMAS = 4.5  # a distance further from what is possible is not the leg's
MISSING_COST = 25.0  # so much squared misfit is believed before a mark is held to be missing
SIZE_STD = 0.12  # of the logarithm of a diameter: focus and exposure change it, for all marks alike
WORST_SIZE_SIGMAS = 3.0
LOOK_BACK = 3  # each mark is held against so many before it
MOST_STEPS = 60_000


@dataclass(frozen=True)
class Candidates:
    """Found marks: places_m (n, 2) in the plane, std_m (n,), and log_size (n,): of the diameter against the expected one."""

    places_m: Floats
    std_m: Floats
    log_size: Floats

    def looks_cost(self, found: int) -> float:
        """Squared misfit of a mark's size; infinite where it is none of the leg's."""
        sigmas = float(self.log_size[found]) / SIZE_STD
        return np.inf if abs(sigmas) > WORST_SIZE_SIGMAS else sigmas**2


@dataclass(frozen=True)
class Tolerances:
    """One standard deviation of the known lengths, and of where the calibration has the shaft axis."""

    length_m: float
    shaft_m: float


@dataclass(frozen=True, order=True)
class MarkAssignment:
    """What each planned mark is, as the number of a found one or -1 for missing; cost is squared misfit and what is missing."""

    cost: float
    chosen: tuple[int, ...]


def assignments_within(
    margin: float, candidates: Candidates, bounds: ChainBounds, tolerances: Tolerances, most: int = MOST_STEPS
) -> tuple[tuple[MarkAssignment, ...], bool]:
    """All assignments that cost at most the margin more than the cheapest, and whether the search was finished."""
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
        for longer in _one_longer(cheapest, candidates, bounds, tolerances):
            heapq.heappush(open_ones, longer)
    return tuple(done), False


def _one_longer(so_far: MarkAssignment, candidates: Candidates, bounds: ChainBounds, tolerances: Tolerances) -> Iterator[MarkAssignment]:
    yield MarkAssignment(so_far.cost + MISSING_COST, (*so_far.chosen, -1))
    for found in range(len(candidates.places_m)):
        looks = candidates.looks_cost(found)
        if found in so_far.chosen or not np.isfinite(looks):
            continue
        misfit = _misfit(so_far.chosen, found, candidates, bounds, tolerances)
        if misfit is not None:
            yield MarkAssignment(so_far.cost + misfit + looks, (*so_far.chosen, found))


def _misfit(chosen: tuple[int, ...], found: int, candidates: Candidates, bounds: ChainBounds, tolerances: Tolerances) -> float | None:
    """Squared misfit of a found mark as the next planned one against the shaft and the last seen marks; None where it cannot be it."""
    here, own_std = candidates.places_m[found], float(candidates.std_m[found])
    index = len(chosen) + 1
    seen = [(i + 1, mark) for i, mark in enumerate(chosen) if mark >= 0][-LOOK_BACK:]
    against = [(0, np.zeros(2), np.hypot(tolerances.shaft_m, own_std))]
    against += [(i, candidates.places_m[mark], np.hypot(own_std, candidates.std_m[mark])) for i, mark in seen]
    total = 0.0
    for other, place, std in against:
        excess = bounds.excess_m(other, index, float(np.hypot(*(here - place))))
        sigmas = excess / float(np.hypot(std, tolerances.length_m))
        if abs(sigmas) > WORST_SIGMAS:
            return None
        total += sigmas**2
    return total
