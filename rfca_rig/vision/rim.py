"""Rim points of a red disc, and the disc's outline: where the red falls to half, and the nearly
round ellipse through these points.

A mark's centre is computed from its rim, never from its centre of mass. A glint, uneven light or a
partial cover move the centre of mass, but not the rim that is still visible. The fit is robust
against hidden and glaring parts.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]

STEP_PX = 0.25
SMOOTHING_PX = 0.7
# Length of the rays, in radii.
REACH = 1.75
# Spacing of the rays along the rim, and limits of their number.
RAY_EVERY_PX = 1.5
MIN_RAYS = 40
MAX_RAYS = 160
# Distance from the rim within which something light distorts it, in pixels and in radii; the larger
# one counts.
GLARE_REACH_PX = 2.5
GLARE_REACH = 0.3
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
SPILL_FROM = 1.35
SPILL_TO = 1.65
# The ring in which the level just inside each part of the rim is taken, in radii: inside of the
# blur, outside of most glints.
NEAR_RIM = (0.55, 0.8)
# Share of the disc's contrast that a part of it has at least; what is darker is something before
# the disc, or a gap.
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
# Orders of the rim's slow deviations, and the share of the rim that must be seen to tell them
# apart.
WAVE_ORDERS = (3, 4, 5, 6)
WAVES_SEEN = 0.8


@dataclass(frozen=True)
class Rays:
    """Pictures sampled along rays from a centre each, `middle_px` (views, 2).

    All views have the same directions (rays, 2) and radii_px (steps,); counts are (views, rays,
    steps).
    """

    middle_px: Floats
    directions: Floats
    radii_px: Floats
    counts: Floats

    def steps_between(self, low_px: float, high_px: float) -> slice:
        """The steps at these distances from the centre."""
        return slice(
            int(np.searchsorted(self.radii_px, low_px, "left")),
            int(np.searchsorted(self.radii_px, high_px, "right")),
        )

    def between(self, low_px: float, high_px: float) -> Floats:
        """Counts (views, rays, some steps) at these distances from the centre."""
        return self.counts[:, :, self.steps_between(low_px, high_px)]


@dataclass(frozen=True)
class Levels:
    """Redness just inside the rim along each ray, `inside` (views, rays), and just outside it,
    `outside` (views, rays).
    """

    inside: Floats
    outside: Floats

    @property
    def contrast(self) -> Floats:
        """The step at the rim (views,), in counts."""
        return median(self.inside - self.outside)


@dataclass(frozen=True)
class Whiteness:
    """Rays in a picture of the whiteness, and from them, by view: that of the disc, of its
    surroundings, and the noise of the latter.

    `lightest` (views, rays, steps) is the largest value of a ray and the two beside it: a glint
    between two rays is not missed.
    """

    core: Floats
    lightest: Floats
    disc: Floats
    around: Floats
    noise: Floats


@dataclass(frozen=True)
class RimPoints:
    """Rim points `px` (n, 2) of several rims: the rim of each (n,), in ascending order, the
    index of its ray (n,) and of the step (n,).
    """

    px: Floats
    rim: Indices
    ray: Indices
    step: Indices


def median(values: Floats) -> Floats:
    """Median (...) over the last axis of (..., n). For small arrays, `np.median` takes several
    times as long.
    """
    half = values.shape[-1] // 2
    if values.shape[-1] % 2:
        return np.asarray(np.partition(values, half)[..., half])
    ordered = np.partition(values, (half - 1, half))
    return np.asarray(0.5 * (ordered[..., half - 1] + ordered[..., half]))


def percentile(values: Floats, percent: float) -> Floats:
    """Percentile (...) over the last axis of (..., n), by linear interpolation as in
    `np.percentile`.
    """
    at = (values.shape[-1] - 1) * (percent / 100.0)
    low = int(at)
    high = min(low + 1, values.shape[-1] - 1)
    share = at - low
    ordered = np.partition(values, (low, high))
    return np.asarray(ordered[..., low] + share * (ordered[..., high] - ordered[..., low]))


def cast_rays(
    pictures: Sequence[NDArray[np.float32]], middles_px: Floats, radius_px: float
) -> Rays:
    """Sample pictures (height, width) along rays from a centre each (views, 2), long enough for a
    disc of this radius.

    The pictures continue black beyond their border.
    """
    directions, radii, steps_px = _make_ray_grid(radius_px)
    places = (middles_px[:, None, None, :] + steps_px).astype(np.float32)
    x = np.ascontiguousarray(places[..., 0])
    y = np.ascontiguousarray(places[..., 1])
    counts = np.empty(x.shape)
    for view, picture in enumerate(pictures):
        counts[view] = cv2.remap(
            picture,
            x[view],
            y[view],
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=0.0,
        )
    return Rays(middles_px, directions, radii, counts)


@lru_cache(maxsize=64)
def _make_ray_grid(radius_px: float) -> tuple[Floats, Floats, Floats]:
    """Directions (rays, 2), radii (steps,) and offsets from the centre (rays, steps, 2) of the
    rays for a disc of this radius.
    """
    count = int(np.clip(2 * np.pi * radius_px / RAY_EVERY_PX, MIN_RAYS, MAX_RAYS))
    turn = np.arange(count) * (2 * np.pi / count)
    directions = np.column_stack([np.cos(turn), np.sin(turn)])
    radii = np.arange(0.0, REACH * radius_px + 3.0, STEP_PX)
    return directions, radii, directions[:, None, :] * radii[None, :, None]


def measure_whiteness(white: Rays, radius_px: float) -> Whiteness:
    """Of rays in pictures of the whiteness. They must be smoothed so much that noise is not
    taken for a glint.
    """
    core = white.between(*(share * radius_px for share in CORE))
    beyond = white.between(SPILL_FROM * radius_px, SPILL_TO * radius_px)
    flat = (len(core), -1)
    # 1.4826 makes the median of absolute values a standard deviation of normal noise.
    noise = 1.4826 * median(
        np.abs(beyond - _median_of_neighbours(median(beyond))[..., None]).reshape(flat)
    )
    # The neighbouring rays count too.
    lightest = np.maximum(
        white.counts,
        np.maximum(np.roll(white.counts, 1, axis=1), np.roll(white.counts, -1, axis=1)),
    )
    return Whiteness(
        core,
        lightest,
        percentile(core.reshape(flat), OWN_WHITE_PERCENTILE),
        median(beyond.reshape(flat)),
        noise,
    )


def measure_levels(rays: Rays, white: Whiteness, radius_px: float) -> Levels:
    """Red levels inside and outside, without glints; inside, a plane follows uneven light across
    the mark.

    Outside, the level follows the surroundings: sheen on a shell, or the edge of the shell, changes
    them along the rim. `white` are the same rays in the pictures' whiteness; where it has one view,
    it serves all views of `rays`.
    """
    beyond = rays.between(SPILL_FROM * radius_px, SPILL_TO * radius_px)
    core = rays.between(*(share * radius_px for share in CORE))
    flat = (len(core), -1)
    outside = median(beyond.reshape(flat))
    # A high percentile: covered parts of the core do not lower it.
    contrast = percentile(core.reshape(flat), 85.0) - outside
    around = _median_of_neighbours(median(beyond))
    # Where the surroundings are nearly as red as the disc, another red thing is there: no level of
    # the surroundings.
    half = outside + 0.5 * contrast
    around = np.where(around > half[:, None], outside[:, None], around)
    plain = (core > half[:, None, None]) & (
        white.core < (white.disc + GLARE * contrast)[:, None, None]
    )
    ring = rays.steps_between(*(share * radius_px for share in CORE))
    at = (rays.directions[:, None, :] * rays.radii_px[None, ring, None]).reshape(-1, 2)
    inside = np.empty_like(around)
    for view, (mask, counts) in enumerate(
        zip(plain.reshape(flat), core.reshape(flat), strict=True)
    ):
        kept = counts[mask]
        if not len(kept):
            inside[view] = outside[view]
            continue
        inside[view] = typical = float(median(kept))
        # Where too little of the core is free of glints for a plane: one level for all rays.
        if len(kept) >= EVEN_SHARE * len(counts):
            inside[view] += rays.directions @ _slope(at[mask], kept - typical) * radius_px
    return Levels(inside, around)


def follow_rim(level: Levels, rays: Rays, radius_px: float) -> Levels:
    """The same levels outside, and inside those just within the rim, ray by ray: they follow a
    shadow's edge, a plane does not.

    NaN inside where hardly anything red is.
    """
    near = _median_of_neighbours(median(rays.between(*(share * radius_px for share in NEAR_RIM))))
    return Levels(
        np.where(near - level.outside < FAINTEST_PART * level.contrast[:, None], np.nan, near),
        level.outside,
    )


def _median_of_neighbours(values: Floats) -> Floats:
    """Median (views, rays) over the rays on either side of each."""
    return median(values[:, _list_neighbours(values.shape[1])])


@lru_cache(maxsize=64)
def _list_neighbours(rays: int) -> Indices:
    """Indices (rays, n) of each ray and those on either side of it."""
    reach = max(1, round(NEIGHBOUR_SHARE * rays))
    return np.asarray((np.arange(rays)[:, None] + np.arange(-reach, reach + 1)) % rays)


def _slope(at_px: Floats, above: Floats) -> Floats:
    """Gradient (2,) of the counts per px, without outliers."""
    # 1.4826 makes the median of absolute values a standard deviation of normal noise.
    plain = np.abs(above) < 3.0 * 1.4826 * median(np.abs(above)) + 1e-6
    at = at_px * plain[:, None]
    # Two unknowns on rays all around: the normal equations are well conditioned. A single ray
    # leaves one direction open.
    gram: Floats = at.T @ at_px
    (xx, xy), (_, yy) = gram.tolist()
    determinant = xx * yy - xy * xy
    if determinant > 1e-9 * xx * yy:
        x, y = (at.T @ above).tolist()
        return np.array([(yy * x - xy * y) / determinant, (xx * y - xy * x) / determinant])
    return np.asarray(np.linalg.pinv(gram, hermitian=True) @ (at.T @ above))


def rim_points(rays: Rays, views: Indices, at: Floats) -> RimPoints:
    """All points where the red falls through a level, going outwards, interpolated linearly.

    Parameters
    ----------
    rays : Rays
        The pictures.
    views : (rims,) array
        The view of each rim.
    at : (rims, rays) array
        The level of each rim along each ray; there are no points where it is NaN.

    Returns
    -------
    RimPoints
        The points of all rims.
    """
    above = rays.counts[views] >= at[:, :, None]
    rim, ray, step = np.nonzero(above[:, :, :-1] & ~above[:, :, 1:])
    view = views[rim]
    before = rays.counts[view, ray, step]
    after = rays.counts[view, ray, step + 1]
    radius = rays.radii_px[step] + STEP_PX * (before - at[rim, ray]) / (before - after)
    return RimPoints(rays.middle_px[view] + rays.directions[ray] * radius[:, None], rim, ray, step)


def measure_glare(points: RimPoints, views: Indices, white: Whiteness, radius_px: float) -> Floats:
    """By how many counts the lightest thing near each rim point is lighter than disc and
    surroundings (n,).

    Something light distorts the rim, or is mistaken for it. `views` (rims,) are those of the rims
    in `white`.
    """
    reach = round(max(GLARE_REACH_PX, GLARE_REACH * radius_px) / STEP_PX)
    near = np.clip(points.step[:, None] + np.arange(-reach, reach), 0, white.lightest.shape[2] - 1)
    view = views[points.rim]
    return np.asarray(
        white.lightest[view[:, None], points.ray[:, None], near].max(axis=1)
        - np.maximum(white.around, white.disc)[view]
    )


def slopes_of(red: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Slopes of a picture (height, width) along x and y, smoothed, as `is_oblique` needs them."""
    soft = cv2.GaussianBlur(red, (0, 0), DIRECTION_SMOOTHING_PX)
    return np.asarray(cv2.Sobel(soft, cv2.CV_32F, 1, 0)), np.asarray(
        cv2.Sobel(soft, cv2.CV_32F, 0, 1)
    )


def is_oblique(
    points_px: Floats, middle_px: Floats, slopes: tuple[NDArray[np.float32], NDArray[np.float32]]
) -> Flags:
    """Flags (n,) of rim points (n, 2) whose gradient is oblique to their radius: the edge of a
    cover, or one that is blurred into the rim.

    `middle_px` is (2,), `slopes` (height, width) each are those of the picture.
    """
    if not len(points_px):
        return np.zeros(0, np.bool_)
    # One by one: OpenCV rounds places in pictures of several channels to a 32nd of a pixel.
    x, y = points_px.T.astype(np.float32)
    fall_x, fall_y = (
        -cv2.remap(slope, x, y, cv2.INTER_LINEAR).ravel().astype(np.float64) for slope in slopes
    )
    out_x, out_y = (points_px - middle_px).T
    sizes = np.sqrt(fall_x * fall_x + fall_y * fall_y) * np.sqrt(out_x * out_x + out_y * out_y)
    return np.asarray(
        (fall_x * out_x + fall_y * out_y) / np.maximum(sizes, 1e-9) < np.cos(SQUARE_WITHIN_RAD)
    )


def color_bleed_share(redness: Rays, radius_px: float) -> float:
    """Share of the rays, of the first view, that stay red from the rim to well outside.

    More than a few mean that the disc touches another red thing.
    """
    level = float(median(redness.between(*(share * radius_px for share in CORE))[0].ravel()))
    # The lowest value on the way: behind a dark gap, another red thing leaves the rim alone.
    beyond = redness.between(radius_px, SPILL_FROM * radius_px)[0].min(axis=1)
    return float((beyond > TOUCHING_SHARE * level).mean())


@dataclass(frozen=True)
class Shape:
    """Prior shape of a mark: radius in px, and first-order ellipse terms (cos 2t, sin 2t) relative
    to it.

    `radius_std` (relative) and `bend_std` are the standard deviations between the marks of one
    photo.
    """

    radius_px: float
    bend: tuple[float, float] = (0.0, 0.0)
    radius_std: float = 0.15
    bend_std: float = 0.04


@dataclass(frozen=True)
class MarkOutline:
    """Centre (2,) px with its covariance (2, 2) px2, radius px, bend (2,), and the share of the rim
    that lies on the outline.

    `waves_px` is the root mean square amplitude of the Fourier terms of WAVE_ORDERS of the rim's
    deviations from the outline; NaN where too little of the rim is seen.
    """

    middle_px: Floats
    covariance_px2: Floats
    radius_px: float
    bend: tuple[float, float]
    seen: float
    waves_px: float


def likely_circle(points: Floats, radius_px: float, spread: float) -> Floats | None:
    """Centre and radius (3,) px of the circle, of about `radius_px`, through most of the points (n,
    2); None where there is none.

    RANSAC with ATTEMPTS triples; `spread` is the allowed relative deviation of the radius.
    """
    if len(points) < 6:
        return None
    circles = _circles_through(points[_draw_triples(len(points))])
    size = circles[:, 2]
    circles = circles[
        np.isfinite(size) & (size > radius_px / (1 + spread)) & (size < radius_px * (1 + spread))
    ]
    if not len(circles):
        return None
    away = points[None] - circles[:, None, :2]
    miss = np.abs(np.hypot(away[..., 0], away[..., 1]) - circles[:, 2:])
    return np.asarray(circles[np.argmax((miss < CIRCLE_BAND * radius_px).sum(axis=1))])


@lru_cache(maxsize=256)
def _draw_triples(count: int) -> Indices:
    """ATTEMPTS random triples (ATTEMPTS, 3) of so many points."""
    # A fixed seed: the same photo always gives the same marks.
    random = np.random.default_rng(0)
    return np.array([random.choice(count, 3, replace=False) for _ in range(ATTEMPTS)])


def _circles_through(triples: Floats) -> Floats:
    """Circles (m, 3) as x, y, radius through triples of points (m, 3, 2); not finite for three
    points in a line.
    """
    first = triples[:, 0]
    edges = triples[:, 1:] - first[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        determinant = 2.0 * (edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0])
        squares = (edges**2).sum(axis=-1)
        x = (edges[:, 1, 1] * squares[:, 0] - edges[:, 0, 1] * squares[:, 1]) / determinant
        y = (edges[:, 0, 0] * squares[:, 1] - edges[:, 1, 0] * squares[:, 0]) / determinant
    return np.column_stack([first[:, 0] + x, first[:, 1] + y, np.hypot(x, y)])


def fit_outlines(
    points: Sequence[Floats], starts_px: Floats, shapes: Sequence[Shape], rays: Sequence[int]
) -> list[MarkOutline | None]:
    """Fit outlines to rims by reweighted least squares with Tukey's biweight, all side by side.

    Parameters
    ----------
    points : sequence of (n, 2) arrays
        Points of each rim in px; those that are off the outline lose their weight.
    starts_px : (rims, 2) array
        First centres.
    shapes : sequence of Shape
        Prior of radius and bend, so that half a rim still gives a centre.
    rays : sequence of int
        Number of rays, for the visible share of each rim.

    Returns
    -------
    list of MarkOutline or None
        For each rim; None where fewer than six points lie on the outline.
    """
    outlines: list[MarkOutline | None] = [None] * len(points)
    open_ones = np.flatnonzero([len(rim) >= 6 for rim in points])
    if not len(open_ones):
        return outlines
    # Rims have different numbers of points: the arrays are filled up with points without weight.
    padded = np.zeros((len(points), max(map(len, points)), 2))
    is_point = np.zeros(padded.shape[:2], np.bool_)
    for number, rim in enumerate(points):
        padded[number, : len(rim)] = rim
        is_point[number, : len(rim)] = True
    radius = np.array([shape.radius_px for shape in shapes])
    stds = np.array(
        [[shape.radius_std * shape.radius_px, shape.bend_std, shape.bend_std] for shape in shapes]
    )
    known = np.column_stack([np.zeros((len(points), 2)), 1 / stds**2])
    nominal = np.column_stack([starts_px, radius, [shape.bend for shape in shapes]])
    fit = _Fits(padded, is_point, known, nominal, nominal.copy(), CIRCLE_BAND * radius).select(
        open_ones
    )
    numbers = open_ones
    for _ in range(ROUNDS):
        residual, jacobian = _residuals(fit.points, fit.values)
        weights = (
            np.clip(1.0 - (residual / (TUKEY * fit.scatter[:, None])) ** 2, 0.0, None) ** 2
            * fit.is_point
        )
        is_on = weights > 0.2
        has_enough = is_on.sum(axis=1) >= 6
        if not has_enough.all():
            numbers = numbers[has_enough]
            fit = fit.select(has_enough)
            residual, jacobian, weights, is_on = (
                array[has_enough] for array in (residual, jacobian, weights, is_on)
            )
            if not len(numbers):
                return outlines
        # 1.4826 makes the median of absolute values a standard deviation of normal noise.
        scatter = np.maximum(MIN_SCATTER_PX, 1.4826 * _median_where(np.abs(residual), is_on))
        weighted = (
            jacobian.swapaxes(1, 2)
            * (weights / (scatter**2 * NEIGHBOURS_SHARE_NOISE)[:, None])[:, None, :]
        )
        information = weighted @ jacobian
        information[:, np.arange(5), np.arange(5)] += fit.known
        pull = (weighted @ residual[..., None])[..., 0] + fit.known * (fit.nominal - fit.values)
        values = fit.values + np.linalg.solve(information, pull[..., None])[..., 0]
        fit = replace(fit, values=values, scatter=scatter)
    seen = np.minimum(1.0, is_on.sum(axis=1) / np.array(rays)[numbers])
    covariance = np.linalg.inv(information)[:, :2, :2]
    waves = np.where(seen > WAVES_SEEN, _measure_waves(fit), np.nan)
    for index, number in enumerate(numbers.tolist()):
        x, y, size, *bend = fit.values[index].tolist()
        outlines[number] = MarkOutline(
            np.array([x, y]),
            covariance[index],
            size,
            (bend[0], bend[1]),
            float(seen[index]),
            float(waves[index]),
        )
    return outlines


@dataclass(frozen=True)
class _Fits:
    """Outlines that are fitted side by side: points (rims, n, 2), some of which only fill up, and
    five values (rims, 5) each.

    `known` are the reciprocal variances of the `nominal` values, `scatter` (rims,) is that of the
    points in px.
    """

    points: Floats
    is_point: Flags
    known: Floats
    nominal: Floats
    values: Floats
    scatter: Floats

    def select(self, which: Indices | Flags) -> "_Fits":
        """Only these rims."""
        return _Fits(
            self.points[which],
            self.is_point[which],
            self.known[which],
            self.nominal[which],
            self.values[which],
            self.scatter[which],
        )


def _median_where(values: Floats, chosen: Flags) -> Floats:
    """Median (rims,) of the chosen values (rims, n) of each rim; every rim has some."""
    ordered = np.sort(np.where(chosen, values, np.inf), axis=1)
    count = chosen.sum(axis=1)
    rows = np.arange(len(values))
    return np.asarray(0.5 * (ordered[rows, (count - 1) // 2] + ordered[rows, count // 2]))


def _measure_waves(fit: _Fits) -> Floats:
    """Root mean square amplitude (rims,) in px of the Fourier terms of WAVE_ORDERS of the points'
    distances from the outlines.

    An error of the centre is the Fourier term of order 1 of the rim, which the fit hides; what
    disturbs a rim has higher orders as well.
    """
    residual, jacobian = _residuals(fit.points, fit.values)
    on_rim = (np.abs(residual) < TUKEY * fit.scatter[:, None]) & fit.is_point
    # The first two columns are cosine and sine of the direction; its powers have those of the
    # multiples.
    turn = jacobian[..., 0] + 1j * jacobian[..., 1]
    powers = np.cumprod(np.repeat(turn[..., None], max(WAVE_ORDERS), axis=-1), axis=-1)[
        ..., np.array(WAVE_ORDERS) - 1
    ]
    terms = np.concatenate([powers.real, powers.imag], axis=-1)
    masked = (terms * on_rim[..., None]).swapaxes(1, 2)
    gram = np.linalg.pinv(masked @ terms, hermitian=True)
    return np.asarray(
        np.sqrt(np.mean((gram @ (masked @ residual[..., None]))[..., 0] ** 2, axis=1))
    )


def _residuals(points: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Distances (rims, n) px of the points outside their outline, and the outline's Jacobian
    (rims, n, 5) by its five values.
    """
    from_middle = points - values[:, None, :2]
    radius, bend_cos, bend_sin = (values[:, None, column] for column in (2, 3, 4))
    distance = np.maximum(np.hypot(from_middle[..., 0], from_middle[..., 1]), 1e-9)
    cos = from_middle[..., 0] / distance
    sin = from_middle[..., 1] / distance
    double_cos = cos * cos - sin * sin
    double_sin = 2 * cos * sin
    relative = 1.0 + bend_cos * double_cos + bend_sin * double_sin
    # The bend's small change of the direction is neglected, as the outline is nearly round.
    jacobian = np.stack([cos, sin, relative, radius * double_cos, radius * double_sin], axis=-1)
    return distance - radius * relative, jacobian
