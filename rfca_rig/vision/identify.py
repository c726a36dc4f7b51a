"""Identifies the marks by the chain: known link lengths, order from the shaft outwards, and the range of the hinges.

Nothing is guessed: a mark that another, about equally good assignment places elsewhere or not at all is reported and omitted.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.vision.assignment import Candidates, ChainBounds, MarkAssignment, Tolerances, assignments_within, chain_bounds
from rfca_rig.vision.camera_model import CameraModel
from rfca_rig.vision.leg_marks import MarkPlan
from rfca_rig.vision.marks import Mark, RejectedPatch

Floats = NDArray[np.float64]

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
# A red patch without a measured centre may be this far from where the lengths allow the mark: half a mark.
REJECTED_WITHIN_M = 0.004

Kind = Literal["missing", "dropped", "misplaced", "extra", "ambiguous", "refused"]


@dataclass(frozen=True)
class MarkDoubt:
    """One deviation from the planned marks. `planned` is the mark's index in the plan, None for a mark that is not in it."""

    kind: Kind
    planned: int | None
    words: str


@dataclass(frozen=True)
class IdentifiedMarks:
    """The found mark for each planned one, None where it is not determined; marks that are not the leg's (`extra`); and all doubts."""

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
        raise BadInput(f"marks: the plan names link {plan.marks[-1].link}, the leg has {len(link_lengths_m)} links")
    candidates = _candidates(marks, camera, plan)
    bounds = chain_bounds(plan, link_lengths_m, hinge_range_rad)
    found, finished = assignments_within(MARGIN, candidates, bounds, Tolerances(length_std_m, shaft_std_m))
    if not finished:
        return _refuse(marks, plan, f"{len(marks)} red marks can be put together in too many ways; clear the picture of red things")
    best = found[0]
    seen = sum(mark >= 0 for mark in best.chosen)
    if seen < MIN_SEEN * len(plan.marks):
        return _refuse(marks, plan, f"only {seen} of {len(plan.marks)} marks fit the chain of known lengths; look at the overlay picture")
    doubtful = _find_doubtful(best, found)
    # Later entries replace earlier ones, so an ambiguity outranks the other reasons.
    reasons = dict.fromkeys(_find_odd_sized(best, candidates, marks), "the red mark there differs in size from the others")
    reasons |= dict.fromkeys(_find_loose(best, doubtful, bounds), "a red mark is there, but too loosely tied to the marks before it")
    reasons |= dict.fromkeys(doubtful, "two readings of the photo fit about equally well")
    nearly = _describe_near_misses(best, candidates, bounds, plan)
    return _report(marks, best, reasons, plan, nearly, _describe_rejected(best, candidates, bounds, rejected, camera))


def _candidates(marks: Sequence[Mark], camera: CameraModel, plan: MarkPlan) -> Candidates:
    if not marks:
        return Candidates(np.zeros((0, 2)), np.zeros(0), np.zeros(0))
    px = np.array([mark.px for mark in marks])
    places = camera.discs_on_plane(px, plan.diameter_m)
    # Metres per pixel: the root of the area that a pixel covers in the plane.
    scale = np.sqrt(np.abs(np.linalg.det(camera.on_plane_jacobian(px))))
    std = scale * np.array([float(mark.std_px.max()) for mark in marks])
    log_size = np.log([mark.diameter_px for mark in marks] / camera.disc_diameter_px(places, plan.diameter_m))
    return Candidates(places, std, log_size)


def _refuse(marks: Sequence[Mark], plan: MarkPlan, words: str) -> IdentifiedMarks:
    return IdentifiedMarks((None,) * len(plan.marks), tuple(marks), (MarkDoubt("refused", None, words),))


def _find_doubtful(best: MarkAssignment, all_ones: Sequence[MarkAssignment]) -> frozenset[int]:
    """Planned marks that differ in some other assignment within the margin."""
    return frozenset(i for other in all_ones for i, (a, b) in enumerate(zip(best.chosen, other.chosen, strict=True)) if a != b)


def _find_loose(best: MarkAssignment, doubtful: frozenset[int], bounds: ChainBounds) -> list[int]:
    """Marks of runs that no known length ties to the shaft, unless a run is too long to occur by chance."""
    # Index -1 is the shaft axis; the bounds count from it, hence + 1 below.
    identified_ones = [i for i, found in enumerate(best.chosen) if found >= 0 and i not in doubtful]
    runs: list[list[int]] = [[-1]]
    for i in identified_ones:
        tied = bounds.is_tied(runs[-1][-1] + 1, i + 1)
        runs = [*runs[:-1], [*runs[-1], i]] if tied else [*runs, [i]]
    return [i for run in runs[1:] if len(run) < MIN_RUN for i in run]


def _find_odd_sized(best: MarkAssignment, candidates: Candidates, marks: Sequence[Mark]) -> list[int]:
    """Whole marks that differ in size from the leg's others: focus and exposure change the size of all marks alike."""
    seen = [(i, found) for i, found in enumerate(best.chosen) if found >= 0]
    usual = float(np.median([candidates.log_size[found] for _, found in seen]))
    return [i for i, found in seen if marks[found].whole and abs(candidates.log_size[found] - usual) > MAX_SIZE_DEVIATION]


def _report(
    marks: Sequence[Mark],
    best: MarkAssignment,
    reasons: dict[int, str],
    plan: MarkPlan,
    nearly: dict[int, str],
    dropped: dict[int, str],
) -> IdentifiedMarks:
    chosen = tuple(marks[found] if found >= 0 and i not in reasons else None for i, found in enumerate(best.chosen))
    doubts = [MarkDoubt("ambiguous", i, f"{plan.name(i)}: {words}") for i, words in sorted(reasons.items())]
    for i, found in enumerate(best.chosen):
        if found < 0 and i not in reasons:
            kind: Kind = "dropped" if i in dropped else "misplaced" if i in nearly else "missing"
            doubts.append(MarkDoubt(kind, i, f"{plan.name(i)}: {dropped.get(i) or nearly.get(i) or 'not seen'}"))
    extra = tuple(mark for number, mark in enumerate(marks) if number not in best.chosen)
    doubts += [MarkDoubt("extra", None, f"red mark at ({mark.px[0]:.0f}, {mark.px[1]:.0f}) px is none of the leg's") for mark in extra]
    return IdentifiedMarks(chosen, extra, tuple(doubts))


def _describe_near_misses(best: MarkAssignment, candidates: Candidates, bounds: ChainBounds, plan: MarkPlan) -> dict[int, str]:
    """For missing marks, the distance of the nearest unused red mark from the places that the neighbour allows, in words."""
    unused = [n for n in range(len(candidates.places_m)) if n not in best.chosen]
    reports = {}
    for i in (i for i, found in enumerate(best.chosen) if found < 0):
        before = max((j for j in range(i) if best.chosen[j] >= 0), default=None)
        start = np.zeros(2) if before is None else candidates.places_m[best.chosen[before]]
        pair = (0 if before is None else before + 1, i + 1)
        misses = [bounds.excess_m(*pair, float(np.linalg.norm(candidates.places_m[n] - start))) for n in unused]
        if misses and min(map(abs, misses)) < MISPLACED_WITHIN_M:
            miss = min(misses, key=abs)
            origin = "the shaft axis" if before is None else f"the {plan.name(before)}"
            side = "farther from" if miss >= 0 else "nearer to"
            off = (
                f"{abs(miss) * 1e3:.1f} mm {side} {origin} than the lengths allow"
                if miss
                else "where other marks or its size speak against it"
            )
            reports[i] = f"a red mark is there, but {off}"
    return reports


def _describe_rejected(
    best: MarkAssignment, candidates: Candidates, bounds: ChainBounds, rejected: Sequence[RejectedPatch], camera: CameraModel
) -> dict[int, str]:
    """For missing marks, why the red patch at a place that both neighbours allow was not measured, in words."""
    places = camera.on_plane(np.array([patch.px for patch in rejected])) if rejected else np.zeros((0, 2))
    reports = {}
    for i in (i for i, found in enumerate(best.chosen) if found < 0):
        before = max((j for j in range(i) if best.chosen[j] >= 0), default=None)
        after = min((j for j in range(i + 1, len(best.chosen)) if best.chosen[j] >= 0), default=None)
        ties = [(0, np.zeros(2))] if before is None else [(before + 1, candidates.places_m[best.chosen[before]])]
        ties += [] if after is None else [(after + 1, candidates.places_m[best.chosen[after]])]
        for patch, place in zip(rejected, places, strict=True):
            off = [bounds.excess_m(min(other, i + 1), max(other, i + 1), float(np.linalg.norm(place - there))) for other, there in ties]
            if max(map(abs, off)) < REJECTED_WITHIN_M:
                reports[i] = f"found at ({patch.px[0]:.0f}, {patch.px[1]:.0f}) px, but not used: {patch.reason}"
    return reports
