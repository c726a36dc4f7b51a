"""Link and hinge angles from identified marks, with their standard deviations.

Angles, the shaft's position and the link lengths are fitted together by least squares, so that any plan of marks can be used. Lengths
have a weak prior: directions between marks determine the angles, and a slightly wrong length must not change them. An angle that the
marks do not determine, or only to worse than 0.3 degrees, is None. It is never computed from lengths, which would leave two solutions.

The standard deviations are those of detecting the marks. They do not include the camera's calibration or the placement of the marks.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.vision.camera_model import CameraModel
from rfca_rig.vision.identify import SHAFT_STD_M, IdentifiedMarks
from rfca_rig.vision.leg_marks import MarkPlan, PlannedMark, mark_positions

Floats = NDArray[np.float64]

# Ten times what lengths are known to: they regularise and do not determine angles.
WEAK_LENGTH_STD_M = 2.0e-3
# Keeps the equations regular where no mark determines an angle.
ANGLE_PRIOR_STD_RAD = float(np.radians(60.0))
# Angles with a larger standard deviation are reported as None.
MAX_REPORTED_STD_RAD = float(np.radians(0.3))
STEPS = 40


@dataclass(frozen=True)
class HingeAngles:
    """Absolute link angles and relative hinge angles in rad; the first hinge angle is the shaft's. None where it is not determined.

    Standard deviations accordingly. Covariances (links, links) rad2 are NaN in rows and columns of undetermined angles.
    """

    link_rad: tuple[float | None, ...]
    link_std_rad: tuple[float | None, ...]
    link_covariance_rad2: Floats
    hinge_rad: tuple[float | None, ...]
    hinge_std_rad: tuple[float | None, ...]
    hinge_covariance_rad2: Floats


@dataclass(frozen=True)
class _Seen:
    """Indices of the seen marks in the plan, their positions (n, 2) m, and the whitening (n, 2, 2) 1/m of their errors."""

    planned: list[int]
    places_m: Floats
    whitening: Floats


def hinge_angles(
    identified: IdentifiedMarks,
    camera: CameraModel,
    plan: MarkPlan,
    link_lengths_m: Sequence[float],
    *,
    shaft_std_m: float = SHAFT_STD_M,
) -> HingeAngles:
    """The leg's angles, as far as the identified marks determine them.

    Parameters
    ----------
    identified : Identified
        The marks.
    camera : CameraModel
        The camera.
    plan : MarkPlan
        Positions of the marks on the leg.
    link_lengths_m : sequence of n floats
        From the shaft outwards.
    shaft_std_m : float
        Standard deviation of the shaft axis in the camera's calibration.

    Returns
    -------
    HingeAngles
        None for angles that are not determined.
    """
    lengths = np.asarray(link_lengths_m, dtype=np.float64)
    seen = _whiten(identified, camera, plan)
    if not seen.planned:
        return _nothing(len(lengths))
    angles, covariance = _solve(seen, plan, lengths, shaft_std_m)
    bends = np.eye(len(lengths)) - np.eye(len(lengths), k=-1)
    links = _determined(angles, covariance)
    hinges = _determined(bends @ angles, bends @ covariance @ bends.T)
    return HingeAngles(*links, *hinges)


def _whiten(identified: IdentifiedMarks, camera: CameraModel, plan: MarkPlan) -> _Seen:
    planned = [i for i, mark in enumerate(identified.marks) if mark is not None]
    marks = [mark for mark in identified.marks if mark is not None]
    px = np.array([mark.px for mark in marks]).reshape(-1, 2)
    std = np.array([mark.std_px for mark in marks]).reshape(-1, 2)
    # Errors in px are independent along x and y: errors in the plane are whitened by mapping them to pixels and dividing there.
    whitening = camera.project_jacobian(camera.on_plane(px)) / std[..., None]
    return _Seen(planned, camera.discs_on_plane(px, plan.diameter_m), whitening)


def _nothing(links: int) -> HingeAngles:
    nothing, unknown = (None,) * links, np.full((links, links), np.nan)
    return HingeAngles(nothing, nothing, unknown, nothing, nothing, unknown)


def _solve(seen: _Seen, plan: MarkPlan, lengths_m: Floats, shaft_std_m: float) -> tuple[Floats, Floats]:
    """Link angles (links,) and their covariance, by Gauss-Newton with the priors as further rows.

    The shaft's position (2,) and each link's stretch (links,) are fitted with them.
    """
    links = len(lengths_m)
    nominal = np.concatenate([_start(seen, plan, lengths_m), np.zeros(2), np.ones(links)])
    known = np.zeros((2 * links + 2, 2 * links + 2))
    # The prior of the angles is on those between neighbouring links: the start angles are the most probable ones.
    known[:links, :links] = (np.eye(links) - np.eye(links, k=-1)) / ANGLE_PRIOR_STD_RAD
    known[links:, links:] = np.diag([1 / shaft_std_m] * 2 + list(lengths_m / WEAK_LENGTH_STD_M))
    values = nominal.copy()
    for _ in range(STEPS):
        residual, jacobian = _residuals(values, seen, plan, lengths_m)
        rows = np.concatenate([jacobian, known])
        step, *_ = np.linalg.lstsq(rows, np.concatenate([residual, known @ (nominal - values)]), rcond=None)
        values = values + step
        if np.abs(step).max() < 1e-12:
            break
    _, jacobian = _residuals(values, seen, plan, lengths_m)
    covariance = np.linalg.inv(jacobian.T @ jacobian + known.T @ known)
    return values[:links], np.asarray(covariance[:links, :links])


def _residuals(values: Floats, seen: _Seen, plan: MarkPlan, lengths_m: Floats) -> tuple[Floats, Floats]:
    """Whitened residuals (2 n,) of the seen marks, and the whitened Jacobian (2 n, values) of the leg's marks."""
    links = len(lengths_m)
    angles, shaft, stretch = values[:links], values[links : links + 2], values[links + 2 :]
    stretched = replace(plan, marks=tuple(replace(mark, along_m=mark.along_m * stretch[mark.link - 1]) for mark in plan.marks))
    residual = seen.places_m - shaft - mark_positions(angles, lengths_m * stretch, stretched)[seen.planned]
    jacobian = np.array([_mark_jacobian(plan.marks[index], angles, stretch, lengths_m) for index in seen.planned])
    return (seen.whitening @ residual[..., None]).ravel(), (seen.whitening @ jacobian).reshape(-1, len(values))


def _mark_jacobian(mark: PlannedMark, angles: Floats, stretch: Floats, lengths_m: Floats) -> Floats:
    """Jacobian (2, values) of a mark's position by angles, shaft position and stretches."""
    along = np.where(np.arange(len(lengths_m)) < mark.link - 1, lengths_m, 0.0)
    across = np.zeros_like(along)
    along[mark.link - 1], across[mark.link - 1] = mark.along_m, mark.across_m
    cos, sin = np.cos(angles), np.sin(angles)
    by_angle = np.stack([-along * stretch * sin - across * cos, -along * stretch * cos + across * sin])
    return np.concatenate([by_angle, np.eye(2), np.stack([along * cos, -along * sin])], axis=1)


def _start(seen: _Seen, plan: MarkPlan, lengths_m: Floats) -> Floats:
    """Start values of the link angles (links,): each link points from its hinge to the next seen mark outwards."""
    angles: list[float] = []
    hinge = np.zeros(2)
    for link in range(1, len(lengths_m) + 1):
        target = next((n for n, i in enumerate(seen.planned) if _beyond(plan, i, link)), None)
        angle = angles[-1] if angles else 0.0
        if target is not None:
            mark = plan.marks[seen.planned[target]]
            # A mark beside the link's axis is seen at an angle to it.
            bearing = np.arctan2(mark.across_m, mark.along_m) if mark.link == link else 0.0
            towards = seen.places_m[target] - hinge
            turn = float(np.arctan2(-towards[1], towards[0])) - bearing - angle
            # Wrapped to half a turn either way, so that angles stay continuous along the chain.
            angle += float(np.arctan2(np.sin(turn), np.cos(turn)))
        angles.append(angle)
        hinge = hinge + lengths_m[link - 1] * np.array([np.cos(angle), -np.sin(angle)])
    return np.array(angles)


def _beyond(plan: MarkPlan, index: int, link: int) -> bool:
    mark = plan.marks[index]
    return mark.link > link or (mark.link == link and mark.along_m > 0.0)


def _determined(angles_rad: Floats, covariance: Floats) -> tuple[tuple[float | None, ...], tuple[float | None, ...], Floats]:
    std = np.sqrt(np.diag(covariance))
    determined = std <= MAX_REPORTED_STD_RAD
    shown = np.where(determined[:, None] & determined[None, :], covariance, np.nan)
    angles = tuple(float(angle) if ok else None for angle, ok in zip(angles_rad, determined, strict=True))
    return angles, tuple(float(value) if ok else None for value, ok in zip(std, determined, strict=True)), shown
