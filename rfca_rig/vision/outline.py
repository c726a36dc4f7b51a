"""Fits the outline of a disc to its rim points: a nearly round ellipse, robust against hidden and glaring parts."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

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
