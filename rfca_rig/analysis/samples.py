"""Samples of a signal: the smoothed state at a moment, means over short bins, and the noise.

A recording is compared with a simulation in windows, which start from the measured, smoothed state.
"""

from dataclasses import dataclass
from math import factorial

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

# Half width of the stretch around a window's start from which its state is estimated, and that of
# the next narrower one that is tried.
SMOOTHING_HALF_WIDTH_S = 0.06
NARROWER = 0.7
# A cubic is too stiff for the second link of a double pendulum.
POLYNOMIAL_DEGREE = 5
NORMAL_PER_MEDIAN = 1.4826
# Commands before and after a window: twice the longest plausible delay, and two of the longest
# plausible lags.
MARGIN_S = 0.1


@dataclass(frozen=True)
class LocalPolynomial:
    """Positions near one moment as a polynomial in the time from that moment, divided by `half_s`.

    `coefficients` (POLYNOMIAL_DEGREE + 1, n) have standard deviations `std` (POLYNOMIAL_DEGREE +
    1,) per unit of noise. `missed` (n,) is the standard deviation of the misfit.
    """

    coefficients: Floats
    std: Floats
    missed: Floats
    half_s: float

    def derivative(self, order: int) -> Floats:
        """Derivative (n,) at the moment itself: position, speed and acceleration for `order` 0,
        1 and 2.
        """
        return np.asarray(factorial(order) * self.coefficients[order] / self.half_s**order)


def local_polynomial(t_s: Floats, position: Floats, at_s: float) -> LocalPolynomial:
    """Least-squares polynomial through the positions (m, n) around `at_s`, for ascending times
    `t_s` (m,).

    The stretch is widened where fewer samples lie in it than the polynomial needs.
    """
    return _fit_polynomial(
        t_s, position, at_s, max(SMOOTHING_HALF_WIDTH_S, _narrowest_half_width(t_s))
    )


def _fit_polynomial(t_s: Floats, position: Floats, at_s: float, half_s: float) -> LocalPolynomial:
    # The tolerance keeps samples at the border in, whatever the rounding of their times.
    near = np.abs(t_s - at_s) <= half_s * (1.0 + 1e-9)
    design = np.vander((t_s[near] - at_s) / half_s, POLYNOMIAL_DEGREE + 1, increasing=True)
    solution = np.linalg.lstsq(design, position[near], rcond=None)[0]
    degrees_of_freedom = max(np.count_nonzero(near) - POLYNOMIAL_DEGREE - 1, 1)
    missed = np.sqrt(np.sum((design @ solution - position[near]) ** 2, axis=0) / degrees_of_freedom)
    # Covariance of the coefficients for noise of standard deviation 1.
    std = np.sqrt(np.diag(np.linalg.pinv(design.T @ design)))
    return LocalPolynomial(np.asarray(solution, dtype=np.float64), std, missed, half_s)


def _narrowest_half_width(t_s: Floats) -> float:
    """Half width in s of a stretch with one sample more than the polynomial has coefficients."""
    return 0.5 * (POLYNOMIAL_DEGREE + 2) * float(np.median(np.diff(t_s)))


def estimate_start(
    t_s: Floats, position: Floats, start_s: float, noise: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Position and speed at `start_s` from a local polynomial, each with its standard deviation:
    four arrays (n,).

    Parameters
    ----------
    t_s : (m,) ascending, in s
    position : (m, n) in rad
    start_s : moment of the estimate, in s
    noise : (n,) standard deviation of one sample, in rad

    Notes
    -----
    The misfit of the polynomial counts as noise too, for instance where dry friction reverses. Of
    several half widths, each joint takes the one with the least standard deviation of the speed:
    the widest one in smooth motion, a narrower one near an impact.
    """
    # A stretch needs twice the samples of the narrowest one; with fewer, the misfit itself is
    # hardly known.
    narrowest_s = _narrowest_half_width(t_s)
    halves_s = [max(SMOOTHING_HALF_WIDTH_S, narrowest_s)]
    while (half_s := NARROWER * halves_s[-1]) >= 2.0 * narrowest_s:
        halves_s.append(half_s)
    fits = [_fit_polynomial(t_s, position, start_s, half_s) for half_s in halves_s]
    # (widths, 2, n): of position and of speed.
    std = np.array(
        [
            fit.std[:2, None] * np.maximum(noise, fit.missed) / np.array([[1.0], [fit.half_s]])
            for fit in fits
        ]
    )
    best = std[:, 1].argmin(axis=0)
    joints = np.arange(position.shape[1])
    positions = np.array([fit.derivative(0) for fit in fits])
    speeds = np.array([fit.derivative(1) for fit in fits])
    return (
        positions[best, joints],
        speeds[best, joints],
        std[best, 0, joints],
        std[best, 1, joints],
    )


def bin_starts(t_s: Floats, bin_s: float) -> Indices:
    """Index of the first sample of each bin, (b,), for sample times (k,) above zero; a sample on
    an edge ends its bin.
    """
    # The small offset puts a sample on a bin's edge into the bin that ends there, in spite of
    # rounding.
    return np.flatnonzero(np.diff(np.ceil(t_s / bin_s - 1e-6), prepend=0.0))


def bin_means(values: Floats, bins: Indices) -> Floats:
    """Means (b, n) of samples (k, n) over bins that begin at indices `bins` (b,)."""
    counts = np.empty((len(bins), 1), dtype=np.intp)
    counts[:-1, 0] = bins[1:] - bins[:-1]
    counts[-1, 0] = len(values) - bins[-1]
    return np.asarray(np.add.reduceat(values, bins) / counts)


def sample_std(values: Floats) -> Floats:
    """Noise of one sample, (n,), of each column of values (m, n).

    The larger of two estimates: from second differences, and from the smallest step of an encoder.
    """
    # A second difference 1, -2, 1 of white noise has sqrt(6) times its deviation, and a smooth
    # motion leaves it small.
    from_neighbours = np.sqrt(np.mean(np.diff(values, 2, axis=0) ** 2, axis=0) / 6.0)
    steps = np.array([smallest_step(column) for column in values.T])
    # A uniform rounding error over one step has the deviation step / sqrt(12). The floor keeps
    # weights finite for simulated data.
    return np.asarray(np.maximum(np.maximum(from_neighbours, steps / np.sqrt(12.0)), 1e-9))


def usual_std(values: Floats, factors: Floats) -> Floats:
    """The same from the median of the second differences, for motions that jump now and then, as
    at impacts; the noise of each sample is by `factors` (m, n) larger than that which is returned.
    """
    differences = np.abs(np.diff(values, 2, axis=0)) / factors[1:-1]
    # Of a normal distribution the median of the magnitude is 1 / NORMAL_PER_MEDIAN deviations.
    from_median = NORMAL_PER_MEDIAN * np.median(differences, axis=0) / np.sqrt(6.0)
    return np.asarray(np.maximum(from_median, 1e-9))


def smallest_step(values: Floats) -> float:
    """The smallest step between neighbouring samples (m,), which is the resolution of an
    encoder; 0 where the value never changes.
    """
    steps = np.abs(np.diff(values))
    moved = steps[steps > 0.0]
    if moved.size:
        return float(moved.min())
    return 0.0
