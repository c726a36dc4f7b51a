"""Rim points of a red disc, and the disc's outline: where the red falls to half, and the nearly round ellipse through these points.

A mark's centre is computed from its rim, never from its centre of mass. A glint, uneven light or a partial cover move the centre of
mass, but not the rim that is still visible. The fit is robust against hidden and glaring parts.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

STEP_PX = 0.25
SMOOTHING_PX = 0.7
# Length of the rays, in radii.
REACH = 1.75
# Spacing of the rays along the rim, and limits of their number.
RAY_EVERY_PX = 1.5
MIN_RAYS, MAX_RAYS = 40, 160
# Distance from the rim within which something light distorts it, in pixels and in radii; the larger one counts.
GLARE_REACH_PX, GLARE_REACH = 2.5, 0.3
# Low enough that glints over most of a disc do not raise it.
OWN_WHITE_PERCENTILE = 30.0
# Share of the contrast; anything lighter than disc or surroundings by more than this is a glint.
GLARE = 0.2
# The ring in which a disc's red is measured, in radii.
CORE = (0.15, 0.7)
# Share of the core that must be free of glints for a fit of uneven light.
EVEN_SHARE = 0.6
# Largest angle between the gradient at a rim point and its ray.
SQUARE_WITHIN_RAD = float(np.radians(18.0))
DIRECTION_SMOOTHING_PX = 1.0
# Share of the rays over which the level of the surroundings is taken, on either side of a ray.
NEIGHBOUR_SHARE = 0.06
# The ring in which a mark's surroundings are black, in radii.
SPILL_FROM, SPILL_TO = 1.35, 1.65
# The ring in which the level just inside each part of the rim is taken, in radii: inside of the blur, outside of most glints.
NEAR_RIM = (0.55, 0.8)
# Share of the disc's contrast that a part of it has at least; what is darker is something before the disc, or a gap.
FAINTEST_PART = 0.3
# Redness between a disc and another red thing, as a share of the disc's, from which they touch.
TOUCHING_SHARE = 0.4

ATTEMPTS = 80
# Distance from a circle, in radii, within which a point belongs to it.
CIRCLE_BAND = 0.07
# Iterations of the reweighted least squares.
ROUNDS = 8
# Tuning constant of Tukey's biweight, in standard deviations.
TUKEY = 4.0
# A perfect rim would otherwise give the weights a width of zero.
MIN_SCATTER_PX = 0.03
# Smoothing and blur correlate the errors of neighbouring rim points: so many count as one.
NEIGHBOURS_SHARE_NOISE = 3.0
# Orders of the rim's slow deviations, and the share of the rim that must be seen to tell them apart.
WAVE_ORDERS, WAVES_SEEN = (3, 4, 5, 6), 0.8


@dataclass(frozen=True)
class Rays:
    """A picture sampled along rays from a centre (2,): directions (rays, 2), radii_px (steps,), counts (rays, steps)."""

    middle_px: Floats
    directions: Floats
    radii_px: Floats
    counts: Floats


@dataclass(frozen=True)
class Levels:
    """Redness just inside the rim along each ray, `inside` (rays,), and just outside it, `outside` (rays,)."""

    inside: Floats
    outside: Floats

    @property
    def contrast(self) -> float:
        """The step at the rim, in counts."""
        return float(np.median(self.inside - self.outside))

    def between(self, share: float) -> Floats:
        """Level along each ray (rays,) at this share of the way from outside to inside; NaN where no disc is."""
        return self.outside + share * (self.inside - self.outside)


@dataclass(frozen=True)
class RimPoints:
    """Rim points `px` (n, 2), with the index of the ray (n,) and of the step along it (n,) of each."""

    px: Floats
    ray: NDArray[np.int64]
    step: NDArray[np.int64]


def cast_rays(picture: NDArray[np.float32], middle_px: Floats, radius_px: float) -> Rays:
    """Sample a picture (height, width) along rays from `middle_px` (2,), long enough for a disc of this radius.

    The picture continues black beyond its border.
    """
    count = int(np.clip(2 * np.pi * radius_px / RAY_EVERY_PX, MIN_RAYS, MAX_RAYS))
    turn = np.arange(count) * (2 * np.pi / count)
    directions = np.column_stack([np.cos(turn), np.sin(turn)])
    radii = np.arange(0.0, REACH * radius_px + 3.0, STEP_PX)
    places = (middle_px + directions[:, None, :] * radii[None, :, None]).astype(np.float32)
    sampled = cv2.remap(picture, places[..., 0], places[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0.0)
    return Rays(middle_px, directions, radii, sampled.astype(np.float64))


def measure_levels(rays: Rays, white: Rays, radius_px: float) -> Levels:
    """Red levels inside and outside, without glints; inside, a plane follows uneven light across the mark.

    Outside, the level follows the surroundings: sheen on a shell, or the edge of the shell, changes them along the rim. `white` are the
    same rays in the picture's whiteness.
    """
    beyond = rays.counts[:, _between(rays, SPILL_FROM * radius_px, SPILL_TO * radius_px)]
    outside = float(np.median(beyond))
    ring = _between(rays, *(share * radius_px for share in CORE))
    core, lightness = rays.counts[:, ring], white.counts[:, ring]
    # A high percentile: covered parts of the core do not lower it.
    contrast = float(np.percentile(core, 85.0)) - outside
    around = _median_of_neighbours(np.median(beyond, axis=1))
    # Where the surroundings are nearly as red as the disc, another red thing is there: no level of the surroundings.
    around = np.where(around > outside + 0.5 * contrast, outside, around)
    plain = (core > outside + 0.5 * contrast) & (lightness < disc_whiteness(white, radius_px) + GLARE * contrast)
    if not plain.any():
        return Levels(np.full(len(core), outside), around)
    typical = float(np.median(core[plain]))
    # Too little of the core is free of glints for a plane: one level for all rays.
    if plain.mean() < EVEN_SHARE:
        return Levels(np.full(len(core), typical), around)
    at = rays.directions[:, None, :] * rays.radii_px[ring][None, :, None]
    return Levels(typical + rays.directions @ _slope(at[plain], core[plain] - typical) * radius_px, around)


def follow_rim(level: Levels, rays: Rays, radius_px: float) -> Levels:
    """The same levels outside, and inside those just within the rim, ray by ray: they follow a shadow's edge, a plane does not.

    NaN inside where hardly anything red is.
    """
    near = _median_of_neighbours(np.median(rays.counts[:, _between(rays, *(share * radius_px for share in NEAR_RIM))], axis=1))
    return Levels(np.where(near - level.outside < FAINTEST_PART * level.contrast, np.nan, near), level.outside)


def _median_of_neighbours(values: Floats) -> Floats:
    """Median (rays,) over the rays on either side of each."""
    reach = max(1, round(NEIGHBOUR_SHARE * len(values)))
    neighbours = (np.arange(len(values))[:, None] + np.arange(-reach, reach + 1)) % len(values)
    return np.asarray(np.median(values[neighbours], axis=1))


def disc_whiteness(white: Rays, radius_px: float) -> float:
    """Whiteness of a disc without glints."""
    return float(np.percentile(white.counts[:, _between(white, *(share * radius_px for share in CORE))], OWN_WHITE_PERCENTILE))


def _between(rays: Rays, low_px: float, high_px: float) -> Flags:
    return np.asarray((rays.radii_px >= low_px) & (rays.radii_px <= high_px))


def _slope(at_px: Floats, above: Floats) -> Floats:
    """Gradient (2,) of the counts per px, without outliers."""
    # 1.4826 makes the median of absolute values a standard deviation of normal noise.
    plain = np.abs(above) < 3.0 * 1.4826 * np.median(np.abs(above)) + 1e-6
    slope, *_ = np.linalg.lstsq(at_px[plain], above[plain], rcond=None)
    return np.asarray(slope)


def rim_points(rays: Rays, at: Floats) -> RimPoints:
    """All points where the red falls through the level `at` (rays,), going outwards, interpolated linearly; none where it is NaN."""
    above = rays.counts >= at[:, None]
    ray, step = np.nonzero(above[:, :-1] & ~above[:, 1:])
    before, after = rays.counts[ray, step], rays.counts[ray, step + 1]
    radius = rays.radii_px[step] + STEP_PX * (before - at[ray]) / (before - after)
    return RimPoints(rays.middle_px + rays.directions[ray] * radius[:, None], ray, step)


def measure_glare(points: RimPoints, white: Rays, radius_px: float) -> tuple[Floats, float]:
    """By how many counts the lightest thing near each rim point is lighter than disc and surroundings (n,), and the noise of that.

    Something light distorts the rim, or is mistaken for it. `white` must be smoothed so much that noise is not taken for a glint.
    """
    beyond = white.counts[:, _between(white, SPILL_FROM * radius_px, SPILL_TO * radius_px)]
    around = float(np.median(beyond))
    # 1.4826 makes the median of absolute values a standard deviation of normal noise.
    noise = 1.4826 * float(np.median(np.abs(beyond - _median_of_neighbours(np.median(beyond, axis=1))[:, None])))
    reach = round(max(GLARE_REACH_PX, GLARE_REACH * radius_px) / STEP_PX)
    near = np.clip(points.step[:, None] + np.arange(-reach, reach), 0, white.counts.shape[1] - 1)
    # The neighbouring rays count too: a glint between two rays is not missed.
    lightest = [white.counts[(points.ray[:, None] + turn) % len(white.counts), near].max(axis=1) for turn in (-1, 0, 1)]
    return np.max(lightest, axis=0) - max(around, disc_whiteness(white, radius_px)), noise


def slopes_of(red: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Slopes of a picture (height, width) along x and y, smoothed, as `is_oblique` needs them."""
    soft = cv2.GaussianBlur(red, (0, 0), DIRECTION_SMOOTHING_PX)
    return np.asarray(cv2.Sobel(soft, cv2.CV_32F, 1, 0)), np.asarray(cv2.Sobel(soft, cv2.CV_32F, 0, 1))


def is_oblique(points: RimPoints, middle_px: Floats, slopes: tuple[NDArray[np.float32], NDArray[np.float32]]) -> Flags:
    """Flags (n,) of rim points whose gradient is oblique to their radius: the edge of a cover, or one that is blurred into the rim.

    `middle_px` is (2,), `slopes` (height, width) each are those of the picture.
    """
    if not len(points.px):
        return np.zeros(0, np.bool_)
    x, y = (points.px[:, i].astype(np.float32) for i in (0, 1))
    fall = -np.column_stack([cv2.remap(slope, x, y, cv2.INTER_LINEAR).ravel() for slope in slopes]).astype(np.float64)
    outwards = points.px - middle_px
    cosine = (fall * outwards).sum(axis=1) / np.maximum(np.linalg.norm(fall, axis=1) * np.linalg.norm(outwards, axis=1), 1e-9)
    return np.asarray(cosine < np.cos(SQUARE_WITHIN_RAD))


def color_bleed_share(redness: Rays, radius_px: float) -> float:
    """Share of the rays that stay red from the rim to well outside; more than a few mean that the disc touches another red thing."""
    own = float(np.median(redness.counts[:, _between(redness, *(share * radius_px for share in CORE))]))
    # The lowest value on the way: behind a dark gap, another red thing leaves the rim alone.
    beyond = redness.counts[:, _between(redness, radius_px, SPILL_FROM * radius_px)].min(axis=1)
    return float((beyond > TOUCHING_SHARE * own).mean())


@dataclass(frozen=True)
class Shape:
    """Prior shape of a mark: radius in px, and first-order ellipse terms (cos 2t, sin 2t) relative to it.

    `radius_std` (relative) and `bend_std` are the standard deviations between the marks of one photo.
    """

    radius_px: float
    bend: tuple[float, float] = (0.0, 0.0)
    radius_std: float = 0.15
    bend_std: float = 0.04


@dataclass(frozen=True)
class MarkOutline:
    """Centre (2,) px with its covariance (2, 2) px2, radius px, bend (2,), and the share of the rim that lies on the outline.

    `waves_px` is the root mean square amplitude of the Fourier terms of WAVE_ORDERS of the rim's deviations from the outline; NaN where
    too little of the rim is seen.
    """

    middle_px: Floats
    covariance_px2: Floats
    radius_px: float
    bend: tuple[float, float]
    seen: float
    waves_px: float


def likely_circle(points: Floats, radius_px: float, spread: float, random: np.random.Generator) -> Floats | None:
    """Centre and radius (3,) px of the circle, of about `radius_px`, through most of the points (n, 2); None where there is none.

    RANSAC with ATTEMPTS triples; `spread` is the allowed relative deviation of the radius.
    """
    if len(points) < 6:
        return None
    triples = points[np.array([random.choice(len(points), 3, replace=False) for _ in range(ATTEMPTS)])]
    circles = _circles_through(triples)
    size = circles[:, 2]
    circles = circles[np.isfinite(size) & (size > radius_px / (1 + spread)) & (size < radius_px * (1 + spread))]
    if not len(circles):
        return None
    miss = np.abs(np.linalg.norm(points[None] - circles[:, None, :2], axis=-1) - circles[:, 2:])
    return np.asarray(circles[np.argmax((miss < CIRCLE_BAND * radius_px).sum(axis=1))])


def _circles_through(triples: Floats) -> Floats:
    """Circles (m, 3) as x, y, radius through triples of points (m, 3, 2); not finite for three points in a line."""
    first = triples[:, 0]
    edges = triples[:, 1:] - first[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        determinant = 2.0 * (edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0])
        squares = (edges**2).sum(axis=-1)
        x = (edges[:, 1, 1] * squares[:, 0] - edges[:, 0, 1] * squares[:, 1]) / determinant
        y = (edges[:, 0, 0] * squares[:, 1] - edges[:, 1, 0] * squares[:, 0]) / determinant
    return np.column_stack([first[:, 0] + x, first[:, 1] + y, np.hypot(x, y)])


def fit_outline(points: Floats, start_px: Floats, shape: Shape, rays: int) -> MarkOutline | None:
    """Fit an outline to rim points by reweighted least squares with Tukey's biweight.

    Parameters
    ----------
    points : (n, 2) array
        Rim points in px; those that are off the outline lose their weight.
    start_px : (2,) array
        First centre.
    shape : Shape
        Prior of radius and bend, so that half a rim still gives a centre.
    rays : int
        Number of rays, for the visible share of the rim.

    Returns
    -------
    MarkOutline or None
        None where fewer than six points lie on the outline.
    """
    values = np.array([*start_px, shape.radius_px, *shape.bend])
    nominal = values.copy()
    known = np.array([0.0, 0.0, 1 / (shape.radius_std * shape.radius_px) ** 2, 1 / shape.bend_std**2, 1 / shape.bend_std**2])
    scatter = CIRCLE_BAND * shape.radius_px
    for _ in range(ROUNDS):
        residual, jacobian = _residuals(points, values)
        weights = np.clip(1.0 - (residual / (TUKEY * scatter)) ** 2, 0.0, None) ** 2
        if (weights > 0.2).sum() < 6:
            return None
        # 1.4826 makes the median of absolute values a standard deviation of normal noise.
        scatter = max(MIN_SCATTER_PX, 1.4826 * float(np.median(np.abs(residual[weights > 0.2]))))
        information = (jacobian.T * weights) @ jacobian / scatter**2 / NEIGHBOURS_SHARE_NOISE + np.diag(known)
        pull = (jacobian.T * weights) @ residual / scatter**2 / NEIGHBOURS_SHARE_NOISE + known * (nominal - values)
        values = values + np.linalg.solve(information, pull)
    seen = min(1.0, float((weights > 0.2).sum()) / rays)
    covariance = np.asarray(np.linalg.inv(information)[:2, :2], np.float64)
    # An error of the centre is the Fourier term of order 1 of the rim, which the fit hides; what disturbs a rim has higher orders as well.
    residual, _ = _residuals(points, values)
    on_rim = np.abs(residual) < TUKEY * scatter
    turn = np.arctan2(points[on_rim, 1] - values[1], points[on_rim, 0] - values[0])
    terms = np.column_stack([wave(order * turn) for order in WAVE_ORDERS for wave in (np.cos, np.sin)])
    waves = float(np.sqrt(np.mean(np.linalg.lstsq(terms, residual[on_rim], rcond=None)[0] ** 2))) if seen > WAVES_SEEN else np.nan
    return MarkOutline(values[:2], covariance, float(values[2]), (float(values[3]), float(values[4])), seen, waves)


def _residuals(points: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Distances (n,) px of the points outside the outline, and the outline's Jacobian (n, 5) by its five values."""
    from_middle = points - values[:2]
    distance = np.maximum(np.hypot(from_middle[:, 0], from_middle[:, 1]), 1e-9)
    cos, sin = from_middle[:, 0] / distance, from_middle[:, 1] / distance
    double_cos, double_sin = cos * cos - sin * sin, 2 * cos * sin
    relative = 1.0 + values[3] * double_cos + values[4] * double_sin
    # The bend's small change of the direction is neglected, as the outline is nearly round.
    jacobian = np.column_stack([cos, sin, relative, values[2] * double_cos, values[2] * double_sin])
    return distance - values[2] * relative, jacobian
