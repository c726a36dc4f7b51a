"""The rim of a red disc: where along rays from its middle the red falls to half, and the outline through those points.

A mark's middle is taken from its rim, never from its mass: a glint on it, light that falls off across it and a cover over a part of it
move the centre of mass, while the rim that is still seen stays where it is.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

STEP_PX = 0.25
SMOOTHING_PX = 0.7
REACH = 1.75  # rays are followed to so many radii
RAY_EVERY_PX = 1.5
FEWEST_RAYS, MOST_RAYS = 40, 160
GLARE_REACH_PX, GLARE_REACH = 2.5, 0.3  # so far from the rim, the second in radii, something light spoils it
OWN_WHITE_PERCENTILE = 30.0
GLARE = 0.2  # of the contrast: whatever is so much lighter than disc or surroundings is a glint
CORE = (0.15, 0.7)  # of the radius
EVEN_SHARE = 0.6  # of the core must be plain for the fall of light over it to be told
SQUARE_WITHIN_RAD = float(np.radians(18.0))
DIRECTION_SMOOTHING_PX = 1.0
SPILL_FROM, SPILL_TO = 1.35, 1.65  # there a mark's surroundings are black


@dataclass(frozen=True)
class Rays:
    """What a picture shows along rays from a middle: directions (rays, 2), radii_px (steps,), counts (rays, steps)."""

    middle_px: Floats
    directions: Floats
    radii_px: Floats
    counts: Floats


@dataclass(frozen=True)
class Levels:
    """Redness just inside the rim along each ray (rays,), and outside of the disc."""

    inside: Floats
    outside: float

    @property
    def contrast(self) -> float:
        """The step at the rim, in counts."""
        return float(np.median(self.inside)) - self.outside

    @property
    def half(self) -> Floats:
        """Where between the two the rim is (rays,)."""
        return 0.5 * (self.inside + self.outside)


@dataclass(frozen=True)
class RimPoints:
    """Places px (n, 2) on rays, with the ray (n,) and the step along it (n,) of each."""

    px: Floats
    ray: NDArray[np.int64]
    step: NDArray[np.int64]


def cast(picture: NDArray[np.float32], middle_px: Floats, radius_px: float) -> Rays:
    """Rays over a picture (height, width), long enough for a disc of the radius; the picture goes on black beyond its border."""
    count = int(np.clip(2 * np.pi * radius_px / RAY_EVERY_PX, FEWEST_RAYS, MOST_RAYS))
    turn = np.arange(count) * (2 * np.pi / count)
    directions = np.column_stack([np.cos(turn), np.sin(turn)])
    radii = np.arange(0.0, REACH * radius_px + 3.0, STEP_PX)
    places = (middle_px + directions[:, None, :] * radii[None, :, None]).astype(np.float32)
    sampled = cv2.remap(picture, places[..., 0], places[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0.0)
    return Rays(middle_px, directions, radii, sampled.astype(np.float64))


def levels(rays: Rays, white: Rays, radius_px: float) -> Levels:
    """Red inside and outside, each by its median; inside, light that falls off across a mark is followed by a plane, glints left out.

    `white` are the same rays over the picture's whiteness.
    """
    outside = float(np.median(rays.counts[:, _between(rays, SPILL_FROM * radius_px, SPILL_TO * radius_px)]))
    ring = _between(rays, *(share * radius_px for share in CORE))
    core, lightness = rays.counts[:, ring], white.counts[:, ring]
    contrast = float(np.percentile(core, 85.0)) - outside
    plain = (core > outside + 0.5 * contrast) & (lightness < own_white(white, radius_px) + GLARE * contrast)
    if not plain.any():
        return Levels(np.full(len(core), outside), outside)
    typical = float(np.median(core[plain]))
    if plain.mean() < EVEN_SHARE:
        return Levels(np.full(len(core), typical), outside)
    at = rays.directions[:, None, :] * rays.radii_px[ring][None, :, None]
    return Levels(typical + rays.directions @ _slope(at[plain], core[plain] - typical) * radius_px, outside)


def own_white(white: Rays, radius_px: float) -> float:
    """The whiteness of a disc where no glint is on it."""
    return float(np.percentile(white.counts[:, _between(white, *(share * radius_px for share in CORE))], OWN_WHITE_PERCENTILE))


def _between(rays: Rays, low_px: float, high_px: float) -> Flags:
    return np.asarray((rays.radii_px >= low_px) & (rays.radii_px <= high_px))


def _slope(at_px: Floats, above: Floats) -> Floats:
    """How counts grow (2,) per px, what stands out left out."""
    plain = np.abs(above) < 3.0 * 1.4826 * np.median(np.abs(above)) + 1e-6
    slope, *_ = np.linalg.lstsq(at_px[plain], above[plain], rcond=None)
    return np.asarray(slope)


def rim_points(rays: Rays, half: Floats) -> RimPoints:
    """All places where the red falls through half, going outwards."""
    above = rays.counts >= half[:, None]
    ray, step = np.nonzero(above[:, :-1] & ~above[:, 1:])
    before, after = rays.counts[ray, step], rays.counts[ray, step + 1]
    radius = rays.radii_px[step] + STEP_PX * (before - half[ray]) / (before - after)
    return RimPoints(rays.middle_px + rays.directions[ray] * radius[:, None], ray, step)


def beside_glare(points: RimPoints, white: Rays, radius_px: float, threshold_counts: float) -> Flags:
    """Which rim points (n,) have something lighter near them than disc and surroundings are: it bends the rim, or is taken for it."""
    around = float(np.median(white.counts[:, _between(white, SPILL_FROM * radius_px, SPILL_TO * radius_px)]))
    reach = round(max(GLARE_REACH_PX, GLARE_REACH * radius_px) / STEP_PX)
    near = np.clip(points.step[:, None] + np.arange(-reach, reach), 0, white.counts.shape[1] - 1)
    lightest = [white.counts[(points.ray[:, None] + turn) % len(white.counts), near].max(axis=1) for turn in (-1, 0, 1)]
    return np.asarray(np.max(lightest, axis=0) > max(around, own_white(white, radius_px)) + threshold_counts)


def turned_away(points: RimPoints, middle_px: Floats, red: NDArray[np.float32]) -> Flags:
    """Which rim points (n,) are not square to their radius: there a cover's edge runs over the disc, or is blurred into the rim."""
    if not len(points.px):
        return np.zeros(0, np.bool_)
    soft = cv2.GaussianBlur(red, (0, 0), DIRECTION_SMOOTHING_PX)
    x, y = (points.px[:, i].astype(np.float32) for i in (0, 1))
    slopes = [cv2.remap(cv2.Sobel(soft, cv2.CV_32F, *order), x, y, cv2.INTER_LINEAR).ravel() for order in ((1, 0), (0, 1))]
    fall = -np.column_stack(slopes).astype(np.float64)
    outwards = points.px - middle_px
    cosine = (fall * outwards).sum(axis=1) / np.maximum(np.linalg.norm(fall, axis=1) * np.linalg.norm(outwards, axis=1), 1e-9)
    return np.asarray(cosine < np.cos(SQUARE_WITHIN_RAD))


def spill(redness: Rays, radius_px: float) -> float:
    """Share of the rays that are still red well outside of the rim: more than a few, and the disc touches another red thing."""
    own = float(np.median(redness.counts[:, _between(redness, *(share * radius_px for share in CORE))]))
    beyond = redness.counts[:, _between(redness, SPILL_FROM * radius_px, SPILL_TO * radius_px)]
    return float((np.median(beyond, axis=1) > 0.5 * own).mean())
