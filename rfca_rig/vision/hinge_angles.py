"""Link and hinge angles from identified marks, with what is known of their errors.

Angles, the shaft's place and the link lengths are solved for together by least squares, so that a general plan of marks is as good as one
with marks at the hinges only. Lengths enter weakly: directions between marks tell angles, and a length that is a little wrong must not
bend them. An angle the marks do not tell by themselves, or only to worse than 0.3 degrees, is None; it is never put together from
lengths, which would leave two answers.
The standard deviations are those of finding the marks, not of the camera's calibration or of how well the marks were put on.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.vision.camera_model import CameraModel
from rfca_rig.vision.identify import SHAFT_STD_M, Identified
from rfca_rig.vision.leg_marks import MarkPlan, PlannedMark, mark_positions

Floats = NDArray[np.float64]

WEAK_LENGTH_STD_M = 2.0e-3
ANGLE_PRIOR_STD_RAD = float(np.radians(60.0))
TELLABLE_STD_RAD = float(np.radians(0.3))
STEPS = 40


@dataclass(frozen=True)
class HingeAngles:
    """Absolute link angles and relative hinge angles, rad; first hinge angle is the shaft's. None for what cannot be told.

    Standard deviations accordingly; covariances (links, links) rad2, not a number in rows and columns of what is None.
    """

    link_rad: tuple[float | None, ...]
    link_std_rad: tuple[float | None, ...]
    link_covariance_rad2: Floats
    hinge_rad: tuple[float | None, ...]
    hinge_std_rad: tuple[float | None, ...]
    hinge_covariance_rad2: Floats


@dataclass(frozen=True)
class _Seen:
    """Numbers of the seen marks in the plan, their places (n, 2) m, and the whitening (n, 2, 2) 1/m of their errors."""

    planned: list[int]
    places_m: Floats
    whitening: Floats


def hinge_angles(
    identified: Identified,
    camera: CameraModel,
    plan: MarkPlan,
    link_lengths_m: Sequence[float],
    *,
    shaft_std_m: float = SHAFT_STD_M,
) -> HingeAngles:
    """The leg's angles as far as the identified marks tell them; `shaft_std_m` as in `identify`."""
    lengths = np.asarray(link_lengths_m, dtype=np.float64)
    seen = _seen(identified, camera, plan)
    if not seen.planned:
        return _nothing(len(lengths))
    angles, covariance = _solved(seen, plan, lengths, shaft_std_m)
    bends = np.eye(len(lengths)) - np.eye(len(lengths), k=-1)
    links = _tellable(angles, covariance)
    hinges = _tellable(bends @ angles, bends @ covariance @ bends.T)
    return HingeAngles(*links, *hinges)


def _seen(identified: Identified, camera: CameraModel, plan: MarkPlan) -> _Seen:
    planned = [i for i, mark in enumerate(identified.marks) if mark is not None]
    marks = [mark for mark in identified.marks if mark is not None]
    px = np.array([mark.px for mark in marks]).reshape(-1, 2)
    std = np.array([mark.std_px for mark in marks]).reshape(-1, 2)
    # px errors are independent along x and y: dividing by them after going back to pixels whitens errors in the plane
    whitening = camera.project_jacobian(camera.on_plane(px)) / std[..., None]
    return _Seen(planned, camera.discs_on_plane(px, plan.diameter_m), whitening)


def _nothing(links: int) -> HingeAngles:
    nothing, unknown = (None,) * links, np.full((links, links), np.nan)
    return HingeAngles(nothing, nothing, unknown, nothing, nothing, unknown)


def _solved(seen: _Seen, plan: MarkPlan, lengths_m: Floats, shaft_std_m: float) -> tuple[Floats, Floats]:
    """Link angles (links,) and their covariance. Beside them are solved for: the shaft's place (2,), and each link's stretch (links,)."""
    links = len(lengths_m)
    nominal = np.concatenate([_start(seen, plan, lengths_m), np.zeros(2), np.ones(links)])
    known = np.zeros((2 * links + 2, 2 * links + 2))
    known[:links, :links] = (np.eye(links) - np.eye(links, k=-1)) / ANGLE_PRIOR_STD_RAD
    known[links:, links:] = np.diag([1 / shaft_std_m] * 2 + list(lengths_m / WEAK_LENGTH_STD_M))
    values = nominal.copy()
    for _ in range(STEPS):
        miss, slopes = _misses(values, seen, plan, lengths_m)
        rows = np.concatenate([slopes, known])
        step, *_ = np.linalg.lstsq(rows, np.concatenate([miss, known @ (nominal - values)]), rcond=None)
        values = values + step
        if np.abs(step).max() < 1e-12:
            break
    _, slopes = _misses(values, seen, plan, lengths_m)
    covariance = np.linalg.inv(slopes.T @ slopes + known.T @ known)
    return values[:links], np.asarray(covariance[:links, :links])


def _misses(values: Floats, seen: _Seen, plan: MarkPlan, lengths_m: Floats) -> tuple[Floats, Floats]:
    """Whitened distances (2 n,) of seen marks from the leg, and the leg's whitened slopes (2 n, values) there."""
    links = len(lengths_m)
    angles, shaft, stretch = values[:links], values[links : links + 2], values[links + 2 :]
    stretched = replace(plan, marks=tuple(replace(mark, along_m=mark.along_m * stretch[mark.link - 1]) for mark in plan.marks))
    miss = seen.places_m - shaft - mark_positions(angles, lengths_m * stretch, stretched)[seen.planned]
    slopes = np.array([_slopes(plan.marks[index], angles, stretch, lengths_m) for index in seen.planned])
    return (seen.whitening @ miss[..., None]).ravel(), (seen.whitening @ slopes).reshape(-1, len(values))


def _slopes(mark: PlannedMark, angles: Floats, stretch: Floats, lengths_m: Floats) -> Floats:
    """How a mark's place moves (2, values) with angles, shaft and stretches."""
    along = np.where(np.arange(len(lengths_m)) < mark.link - 1, lengths_m, 0.0)
    across = np.zeros_like(along)
    along[mark.link - 1], across[mark.link - 1] = mark.along_m, mark.across_m
    cos, sin = np.cos(angles), np.sin(angles)
    by_angle = np.stack([-along * stretch * sin - across * cos, -along * stretch * cos + across * sin])
    return np.concatenate([by_angle, np.eye(2), np.stack([along * cos, -along * sin])], axis=1)


def _start(seen: _Seen, plan: MarkPlan, lengths_m: Floats) -> Floats:
    """Link angles (links,) good enough to start from: each link points from its hinge to the next mark outwards that is seen."""
    angles: list[float] = []
    hinge = np.zeros(2)
    for link in range(1, len(lengths_m) + 1):
        target = next((n for n, i in enumerate(seen.planned) if _beyond(plan, i, link)), None)
        angle = angles[-1] if angles else 0.0
        if target is not None:
            mark = plan.marks[seen.planned[target]]
            bearing = np.arctan2(mark.across_m, mark.along_m) if mark.link == link else 0.0
            towards = seen.places_m[target] - hinge
            turn = float(np.arctan2(-towards[1], towards[0])) - bearing - angle
            angle += float(np.arctan2(np.sin(turn), np.cos(turn)))
        angles.append(angle)
        hinge = hinge + lengths_m[link - 1] * np.array([np.cos(angle), -np.sin(angle)])
    return np.array(angles)


def _beyond(plan: MarkPlan, index: int, link: int) -> bool:
    mark = plan.marks[index]
    return mark.link > link or (mark.link == link and mark.along_m > 0.0)


def _tellable(angles_rad: Floats, covariance: Floats) -> tuple[tuple[float | None, ...], tuple[float | None, ...], Floats]:
    std = np.sqrt(np.diag(covariance))
    told = std <= TELLABLE_STD_RAD
    shown = np.where(told[:, None] & told[None, :], covariance, np.nan)
    angles = tuple(float(angle) if ok else None for angle, ok in zip(angles_rad, told, strict=True))
    return angles, tuple(float(value) if ok else None for value, ok in zip(std, told, strict=True)), shown
