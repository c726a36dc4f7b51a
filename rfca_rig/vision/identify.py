"""Identifies the marks by the chain: known link lengths, order from the shaft outwards, and the
range of the hinges.

Nothing is guessed: a mark that another, about equally good assignment places elsewhere or not at
all is reported and omitted.
"""

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.vision.camera_model import CameraModel
from rfca_rig.vision.leg_marks import MarkPlan, PlannedMark, mark_positions
from rfca_rig.vision.marks import Mark, RejectedPatch

Floats = NDArray[np.float64]

# Range of squared distance up to which one mark ties another; two marks with one missing between
# them have three times as much.
LOOSE_M2 = 3e-4
# Grid points per hinge, by the number of hinges between two marks. Odd numbers include the straight
# hinge, coarser grids limit the work.
POSITIONS_PER_HINGE = {0: 1, 1: 9, 2: 9, 3: 5, 4: 5}
MOST_HINGES = max(POSITIONS_PER_HINGE)

# A distance that is impossible by more than this is not between two marks of the leg.
MAX_SIGMAS = 4.5
# Squared misfit up to which a found mark is preferred to a missing one.
MISSING_COST = 25.0
# Standard deviation of the logarithm of a diameter: focus and exposure change it, for all marks
# alike.
SIZE_STD = 0.12
MAX_SIZE_SIGMAS = 3.0
# Number of earlier marks that each mark is compared with.
LOOK_BACK = 3
# Limit of the search, for photos full of red things.
MAX_STEPS = 60_000

# Whole legs bend by 50 degrees between the shaft and the ground, so one hinge stays well inside.
HINGE_RANGE_RAD = float(np.radians(45.0))
LENGTH_STD_M = 0.2e-3
SHAFT_STD_M = 1.0e-3
# Squared misfit by which the best assignment must be better than every other.
MARGIN = 12.0
# Largest deviation of the logarithm of a mark's diameter from the median of the leg's marks.
MAX_SIZE_DEVIATION = 0.08
# Number of marks from which a run without a tie to the shaft is accepted.
MIN_RUN = 2
# Share of the planned marks. With fewer, unrelated red things form chains by chance.
MIN_SEEN = 0.5
# A red thing this near to where a missing mark may be is reported as misplaced.
MISPLACED_WITHIN_M = 0.02
# A red patch without a measured centre may be this far from where the lengths allow the mark: half
# a mark.
REJECTED_WITHIN_M = 0.004

Kind = Literal["missing", "dropped", "misplaced", "extra", "ambiguous", "refused"]


@dataclass(frozen=True)
class ChainBounds:
    """nearest_m and farthest_m (marks + 1, marks + 1); the first index is the smaller one, 0 is
    the shaft axis, 1 the first mark.
    """

    nearest_m: Floats
    farthest_m: Floats

    def is_tied(self, a: int, b: int) -> bool:
        """Whether one of the two marks restricts the other to a small part of the plane, in
        which chance hardly puts a red thing.
        """
        return float(self.farthest_m[a, b] ** 2 - self.nearest_m[a, b] ** 2) < LOOSE_M2

    def excess_m(self, a: int, b: int, distance_m: float) -> float:
        """By how much a distance in metres is outside the possible range; negative where it is
        too small, 0 inside.
        """
        return max(0.0, distance_m - float(self.farthest_m[a, b])) + min(
            0.0, distance_m - float(self.nearest_m[a, b])
        )


def chain_bounds(
    plan: MarkPlan, link_lengths_m: Sequence[float], hinge_range_rad: float
) -> ChainBounds:
    """Bounds for all pairs of marks of a leg whose hinges turn by at most the range either way."""
    points = (PlannedMark(1, 0.0), *plan.marks)
    nearest = np.zeros((len(points), len(points)))
    farthest = np.zeros((len(points), len(points)))
    for a in range(len(points)):
        for b in range(a + 1, len(points)):
            nearest[a, b], farthest[a, b] = _pair_m(
                points[a], points[b], np.asarray(link_lengths_m, np.float64), hinge_range_rad
            )
    return ChainBounds(nearest, farthest)


def _pair_m(
    a: PlannedMark, b: PlannedMark, lengths_m: Floats, hinge_range_rad: float
) -> tuple[float, float]:
    """Smallest and largest distance of two marks over a grid of poses; with many hinges between
    them the smallest is taken as 0.
    """
    # A mark on a hinge axis is not moved by the turn of its own hinge.
    on_hinge = b.along_m == 0.0 and b.across_m == 0.0
    hinges = max(0, b.link - a.link - int(on_hinge))
    count = POSITIONS_PER_HINGE.get(hinges, 3)
    if count > 1:
        grid = np.linspace(-hinge_range_rad, hinge_range_rad, count)
    else:
        grid = np.zeros(1)
    poses = np.array(list(product(grid, repeat=hinges))).reshape(len(grid) ** hinges, hinges)
    angles = np.zeros((len(poses), len(lengths_m)))
    angles[:, a.link : a.link + hinges] = np.cumsum(poses, axis=1)
    places = mark_positions(angles, lengths_m, MarkPlan((a, b)))
    distances = np.linalg.norm(places[:, 1] - places[:, 0], axis=-1)
    smallest = 0.0
    if hinges <= MOST_HINGES:
        smallest = float(distances.min())
    return smallest, float(distances.max())


@dataclass(frozen=True)
class Candidates:
    """Found marks: places_m (n, 2) in the plane, std_m (n,), and log_size (n,), the logarithm of
    measured over expected diameter.
    """

    places_m: Floats
    std_m: Floats
    log_size: Floats

    def size_cost(self, found: int) -> float:
        """Squared misfit of a mark's size; infinite where it cannot be a mark of the leg."""
        sigmas = float(self.log_size[found]) / SIZE_STD
        if abs(sigmas) > MAX_SIZE_SIGMAS:
            return np.inf
        return sigmas**2


@dataclass(frozen=True)
class Tolerances:
    """Standard deviations of the known lengths, and of the shaft axis in the calibration."""

    length_m: float
    shaft_m: float


@dataclass(frozen=True, order=True)
class MarkAssignment:
    """For each planned mark the number of a found one, or -1 for missing; the cost is the
    squared misfit plus that of missing marks.
    """

    cost: float
    chosen: tuple[int, ...]


def assignments_within(
    margin: float,
    candidates: Candidates,
    bounds: ChainBounds,
    tolerances: Tolerances,
    most: int = MAX_STEPS,
) -> tuple[tuple[MarkAssignment, ...], bool]:
    """All assignments that cost at most `margin` more than the cheapest, and whether the search was
    finished.

    A best-first search over partial assignments, from the shaft outwards. Costs only grow, so
    complete assignments are found in the order of their costs. `most` limits the number of extended
    partial assignments.
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


def _extensions(
    so_far: MarkAssignment, candidates: Candidates, bounds: ChainBounds, tolerances: Tolerances
) -> Iterator[MarkAssignment]:
    yield MarkAssignment(so_far.cost + MISSING_COST, (*so_far.chosen, -1))
    for candidate in range(len(candidates.places_m)):
        looks = candidates.size_cost(candidate)
        if candidate in so_far.chosen or not np.isfinite(looks):
            continue
        misfit = _misfit(so_far.chosen, candidate, candidates, bounds, tolerances)
        if misfit is not None:
            yield MarkAssignment(so_far.cost + misfit + looks, (*so_far.chosen, candidate))


def _misfit(
    chosen: tuple[int, ...],
    candidate: int,
    candidates: Candidates,
    bounds: ChainBounds,
    tolerances: Tolerances,
) -> float | None:
    """Squared misfit of a found mark as the next planned one, to the shaft and the last seen marks;
    None where it is impossible.

    It is twice the negative log likelihood of the distances, above that of a mark without an error
    of its own: a mark of large deviation, as a reflection has, fits anywhere, and pays for it.
    """
    position = candidates.places_m[candidate]
    own_std = float(candidates.std_m[candidate])
    index = len(chosen) + 1
    seen = [(i + 1, mark) for i, mark in enumerate(chosen) if mark >= 0][-LOOK_BACK:]
    references = [(0, np.zeros(2), tolerances.shaft_m)]
    references += [
        (i, candidates.places_m[mark], float(candidates.std_m[mark])) for i, mark in seen
    ]
    total = 0.0
    for other, place, other_std in references:
        excess = bounds.excess_m(other, index, float(np.hypot(*(position - place))))
        without_own = float(np.hypot(other_std, tolerances.length_m))
        std = float(np.hypot(own_std, without_own))
        if abs(excess) > MAX_SIGMAS * std:
            return None
        total += (excess / std) ** 2 + 2.0 * float(np.log(std / without_own))
    return total


@dataclass(frozen=True)
class MarkDoubt:
    """One deviation from the planned marks. `planned` is the mark's index in the plan, None for
    a mark that is not in it.
    """

    kind: Kind
    planned: int | None
    words: str


@dataclass(frozen=True)
class IdentifiedMarks:
    """The found mark for each planned one, None where it is not determined; marks that are not
    the leg's (`extra`); and all doubts.
    """

    marks: tuple[Mark | None, ...]
    extra: tuple[Mark, ...]
    doubts: tuple[MarkDoubt, ...]

    @property
    def is_complete(self) -> bool:
        """Whether every planned mark is identified."""
        return all(mark is not None for mark in self.marks)


def identify(
    marks: Sequence[Mark],
    camera: CameraModel,
    plan: MarkPlan,
    link_lengths_m: Sequence[float],
    *,
    rejected: Sequence[RejectedPatch] = (),
    hinge_range_rad: float = HINGE_RANGE_RAD,
    length_std_m: float = LENGTH_STD_M,
    shaft_std_m: float = SHAFT_STD_M,
) -> IdentifiedMarks:
    """Assign found marks to planned ones.

    Parameters
    ----------
    marks : sequence of Mark
        All red marks of the photo.
    camera : CameraModel
        The calibrated camera.
    plan : MarkPlan
        Where the marks are on the leg.
    link_lengths_m : sequence of n floats
        From the shaft outwards.
    rejected : sequence of RejectedPatch
        Red patches that are no marks, to say of a missing mark why it was not measured.
    hinge_range_rad : float
        Largest angle of a hinge, in either direction.
    length_std_m : float
        Standard deviation of the distance between neighbouring marks as measured on the leg.
    shaft_std_m : float
        Standard deviation of the shaft axis in the camera's calibration.

    Returns
    -------
    Identified
        The assignment; marks that it does not determine are None.

    Raises
    ------
    BadInput
        Where plan and link lengths do not belong together.
    """
    if plan.marks[-1].link > len(link_lengths_m):
        raise BadInput(
            f"marks: the plan names link {plan.marks[-1].link}, the leg has "
            f"{len(link_lengths_m)} links"
        )
    candidates = _candidates(marks, camera, plan)
    bounds = chain_bounds(plan, link_lengths_m, hinge_range_rad)
    assignments, finished = assignments_within(
        MARGIN, candidates, bounds, Tolerances(length_std_m, shaft_std_m)
    )
    if not finished:
        return _refuse(
            marks,
            plan,
            (
                f"{len(marks)} red marks can be put together in too many ways; clear the "
                "picture of red things"
            ),
        )
    best = assignments[0]
    seen = sum(mark >= 0 for mark in best.chosen)
    if seen < MIN_SEEN * len(plan.marks):
        return _refuse(
            marks,
            plan,
            (
                f"only {seen} of {len(plan.marks)} marks fit the chain of known lengths; look "
                "at the overlay picture"
            ),
        )
    # Doubtful are planned marks that differ in some other assignment within the margin.
    doubtful = frozenset(
        i
        for other in assignments
        for i, (a, b) in enumerate(zip(best.chosen, other.chosen, strict=True))
        if a != b
    )
    # Later entries replace earlier ones, so an ambiguity outranks the other reasons.
    reasons = dict.fromkeys(
        _find_odd_sized(best, candidates, marks),
        "the red mark there differs in size from the others",
    )
    reasons |= dict.fromkeys(
        _find_loose(best, doubtful, bounds),
        "a red mark is there, but too loosely tied to the marks before it",
    )
    reasons |= dict.fromkeys(doubtful, "two readings of the photo fit about equally well")
    nearly = _describe_near_misses(best, candidates, bounds, plan)
    return _report(
        marks,
        best,
        reasons,
        plan,
        nearly,
        _describe_rejected(best, candidates, bounds, rejected, camera),
    )


def _candidates(marks: Sequence[Mark], camera: CameraModel, plan: MarkPlan) -> Candidates:
    if not marks:
        return Candidates(np.zeros((0, 2)), np.zeros(0), np.zeros(0))
    px = np.array([mark.px for mark in marks])
    places = camera.discs_on_plane(px, plan.diameter_m)
    # Metres per pixel: the root of the area that a pixel covers in the plane.
    scale = np.sqrt(np.abs(np.linalg.det(camera.on_plane_jacobian(px))))
    std = scale * np.array([float(mark.std_px.max()) for mark in marks])
    log_size = np.log(
        [mark.diameter_px for mark in marks] / camera.disc_diameter_px(places, plan.diameter_m)
    )
    return Candidates(places, std, log_size)


def _refuse(marks: Sequence[Mark], plan: MarkPlan, words: str) -> IdentifiedMarks:
    return IdentifiedMarks(
        (None,) * len(plan.marks), tuple(marks), (MarkDoubt("refused", None, words),)
    )


def _find_loose(best: MarkAssignment, doubtful: frozenset[int], bounds: ChainBounds) -> list[int]:
    """Marks of runs that no known length ties to the shaft, unless a run is too long to occur by
    chance.
    """
    # Index -1 is the shaft axis; the bounds count from it, hence + 1 below.
    identified_ones = [
        i for i, candidate in enumerate(best.chosen) if candidate >= 0 and i not in doubtful
    ]
    runs: list[list[int]] = [[-1]]
    for i in identified_ones:
        if bounds.is_tied(runs[-1][-1] + 1, i + 1):
            runs[-1].append(i)
        else:
            runs.append([i])
    return [i for run in runs[1:] if len(run) < MIN_RUN for i in run]


def _find_odd_sized(
    best: MarkAssignment, candidates: Candidates, marks: Sequence[Mark]
) -> list[int]:
    """Whole marks that differ in size from the leg's others: focus and exposure change the size
    of all marks alike.
    """
    seen = [(i, candidate) for i, candidate in enumerate(best.chosen) if candidate >= 0]
    usual = float(np.median([candidates.log_size[candidate] for _, candidate in seen]))
    return [
        i
        for i, candidate in seen
        if marks[candidate].whole
        and abs(candidates.log_size[candidate] - usual) > MAX_SIZE_DEVIATION
    ]


def _report(
    marks: Sequence[Mark],
    best: MarkAssignment,
    reasons: dict[int, str],
    plan: MarkPlan,
    nearly: dict[int, str],
    dropped: dict[int, str],
) -> IdentifiedMarks:
    chosen = tuple(
        marks[number] if number >= 0 and i not in reasons else None
        for i, number in enumerate(best.chosen)
    )
    doubts = [
        MarkDoubt("ambiguous", i, f"{plan.name(i)}: {words}")
        for i, words in sorted(reasons.items())
    ]
    for i, number in enumerate(best.chosen):
        if number < 0 and i not in reasons:
            kind: Kind
            if i in dropped:
                kind = "dropped"
            elif i in nearly:
                kind = "misplaced"
            else:
                kind = "missing"
            words = dropped.get(i) or nearly.get(i) or "not seen"
            doubts.append(MarkDoubt(kind, i, f"{plan.name(i)}: {words}"))
    extra = tuple(mark for number, mark in enumerate(marks) if number not in best.chosen)
    doubts += [
        MarkDoubt(
            "extra",
            None,
            f"red mark at ({mark.px[0]:.0f}, {mark.px[1]:.0f}) px is none of the leg's",
        )
        for mark in extra
    ]
    return IdentifiedMarks(chosen, extra, tuple(doubts))


def _describe_near_misses(
    best: MarkAssignment, candidates: Candidates, bounds: ChainBounds, plan: MarkPlan
) -> dict[int, str]:
    """For missing marks, the distance of the nearest unused red mark from the places that the
    neighbour allows, in words.
    """
    unused = [n for n in range(len(candidates.places_m)) if n not in best.chosen]
    reports = {}
    for i in (i for i, candidate in enumerate(best.chosen) if candidate < 0):
        before = max((j for j in range(i) if best.chosen[j] >= 0), default=None)
        if before is None:
            neighbour = 0
            start = np.zeros(2)
            origin = "the shaft axis"
        else:
            neighbour = before + 1
            start = candidates.places_m[best.chosen[before]]
            origin = f"the {plan.name(before)}"
        misses = [
            bounds.excess_m(neighbour, i + 1, float(np.linalg.norm(candidates.places_m[n] - start)))
            for n in unused
        ]
        if misses and min(map(abs, misses)) < MISPLACED_WITHIN_M:
            miss = min(misses, key=abs)
            side = "farther from" if miss >= 0 else "nearer to"
            if miss:
                off = f"{abs(miss) * 1e3:.1f} mm {side} {origin} than the lengths allow"
            else:
                off = "where other marks or its size speak against it"
            reports[i] = f"a red mark is there, but {off}"
    return reports


def _describe_rejected(
    best: MarkAssignment,
    candidates: Candidates,
    bounds: ChainBounds,
    rejected: Sequence[RejectedPatch],
    camera: CameraModel,
) -> dict[int, str]:
    """For missing marks, why the red patch at a place that both neighbours allow was not
    measured, in words.
    """
    if rejected:
        places = camera.on_plane(np.array([patch.px for patch in rejected]))
    else:
        places = np.zeros((0, 2))
    reports = {}
    for i in (i for i, candidate in enumerate(best.chosen) if candidate < 0):
        before = max((j for j in range(i) if best.chosen[j] >= 0), default=None)
        after = min(
            (j for j in range(i + 1, len(best.chosen)) if best.chosen[j] >= 0), default=None
        )
        if before is None:
            ties = [(0, np.zeros(2))]
        else:
            ties = [(before + 1, candidates.places_m[best.chosen[before]])]
        if after is not None:
            ties.append((after + 1, candidates.places_m[best.chosen[after]]))
        for patch, place in zip(rejected, places, strict=True):
            off = [
                bounds.excess_m(
                    min(other, i + 1), max(other, i + 1), float(np.linalg.norm(place - neighbour))
                )
                for other, neighbour in ties
            ]
            if max(map(abs, off)) < REJECTED_WITHIN_M:
                reports[i] = (
                    f"found at ({patch.px[0]:.0f}, {patch.px[1]:.0f}) px, but not used: "
                    f"{patch.reason}"
                )
    return reports
