"""Faults of a recorded column that show in the column itself: samples that jump away and back, a
register that is read without its sign, a channel that is updated rarely, a sensor at its limit, and
a column that runs behind another one.

All of them were seen in recordings of real servos and encoders. None needs a model.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

# Samples on either side of a sample with which it is compared.
NEIGHBOURS = 4
# A glitch leaves its neighbours by so many times the largest step among them. A ball that bounces
# leaves them by one step; a Gaussian sample, by more than 3 of the largest of 7 steps in 1e-4 of
# all samples, and by more than 6 in none of 1e7.
GLITCH_STEPS = 6.0
# share of its deviation by which a glitch may miss its neighbours when it comes back
COMES_BACK = 0.25

# Bits of the registers in which devices keep counts.
REGISTER_BITS = (8, 16, 24, 32)
# share of a register's range that a jump between a small negative and a positive value has at least
ACROSS = 0.9

# Samples per update from which a channel counts as rare, share of its updates that must come at one
# distance, and steps of the finest resolution that an update usually has. An encoder that turns
# slowly steps by one.
RARE = 8
REGULAR = 0.9
MANY_STEPS = 3.0
FEWEST_UPDATES = 5

# Separate stretches at one extreme value, and samples in each. Within so many samples the column
# must come and go by more than its usual step, and by more than two counts: at the turning point of
# a motion, or at a rest, it moves less.
APPROACH = 3
FEWEST_COUNTS = 50
# share of all steps of a coarse column that are multiples of its count
COARSE_SHARE = 0.9
FEWEST_STRETCHES = 3
FEWEST_AT_LIMIT = 4


def find_glitches(values: Floats) -> Indices:
    """Samples (g,) of a column (m,) that jump away from their neighbours and come back.

    Pairs of wrong samples are found too. A step, a bounce and noise are none.
    """
    count = len(values)
    # An encoder that stands between two counts flips by one, which is its usual step.
    usual_step = _usual_step(values)
    glitches: list[int] = []
    for width in (1, 2):
        for first in _list_jumps(values, GLITCH_STEPS * usual_step, width):
            last = first + width
            around = np.r_[first - NEIGHBOURS : first, last : last + NEIGHBOURS]
            near = values[around[(around >= 0) & (around < count)]]
            # The step from one side to the other is one of an ordinary motion.
            usual = max(np.abs(np.diff(near)).max(), usual_step)
            bridge = 0.5 * (values[first - 1] + values[last])
            away = np.abs(values[first:last] - bridge).min()
            comes_back = abs(values[last] - values[first - 1]) <= COMES_BACK * away
            if comes_back and away > GLITCH_STEPS * usual:
                glitches.extend(range(first, last))
    return np.unique(np.array(glitches, dtype=np.intp))


def _usual_step(values: Floats) -> float:
    """Median of the steps that are not zero; 0 where the column never changes."""
    steps = np.abs(np.diff(values))
    moved = steps[steps > 0.0]
    if moved.size:
        return float(np.median(moved))
    return 0.0


def _find_count(values: Floats) -> float:
    """The step of which all others of a coarse column are multiples; 0 where they are of any
    size.
    """
    steps = np.abs(np.diff(values))
    # Rounding in a file makes steps that are none.
    moved = steps[steps > 0.1 * _usual_step(values)]
    if not moved.size:
        return 0.0
    count = float(np.percentile(moved, 5.0))
    multiples = moved / count
    is_multiple = np.abs(multiples - np.round(multiples)) < 0.05 * np.round(multiples)
    if np.mean(is_multiple) < COARSE_SHARE:
        return 0.0
    return count


def _list_jumps(values: Floats, least: float, width: int) -> Indices:
    """First samples of stretches of `width` samples whose ends both jump by more than `least`."""
    jumps = np.abs(np.diff(values)) > least
    first = np.flatnonzero(jumps[:-width] & jumps[width:]) + 1
    return first[(first >= 2) & (first + width <= len(values) - 2)]


def find_register_range(counts: Floats) -> float | None:
    """Range of the register in which a column of counts (m,) was kept, where it was read without
    its sign: it is never negative, and jumps across most of the range. None elsewhere.
    """
    if counts.min() < 0.0:
        return None
    largest = float(np.abs(np.diff(counts)).max(initial=0.0))
    for bits in REGISTER_BITS:
        size = float(2**bits)
        if ACROSS * size < largest < size and counts.max() < size:
            return size
    return None


def find_update_period(values: Floats) -> int | None:
    """Samples between the updates of a column (m,), where it is updated rarely and at one
    distance; None elsewhere.
    """
    steps = np.diff(values)
    updates = np.flatnonzero(steps)
    if len(updates) <= FEWEST_UPDATES:
        return None
    distances = np.diff(updates)
    period = int(np.median(distances))
    at_period = np.abs(distances - period) <= 1
    sizes = np.abs(steps[updates])
    # An encoder's count changes one by one, however slowly and evenly it turns.
    is_fine = np.median(sizes) >= MANY_STEPS * sizes.min()
    if period >= RARE and np.mean(at_period) >= REGULAR and is_fine:
        return period
    return None


def find_limit(values: Floats) -> tuple[float, int] | None:
    """Extreme value at which a column (m,) is cut off in several separate stretches, and the number
    of samples in them; None where there is none.
    """
    usual = _usual_step(values)
    count = _find_count(values)
    # In a column of few counts every turning point looks like a limit.
    if np.ptp(values) <= FEWEST_COUNTS * count:
        return None
    least = max(usual, 2.5 * count)
    for extreme in (float(values.max()), float(values.min())):
        cut_off = 0
        stretches = 0
        for first, after in _list_stretches(np.flatnonzero(values == extreme)):
            is_inside = first >= APPROACH and after + APPROACH <= len(values)
            if not is_inside or after - first < FEWEST_AT_LIMIT:
                continue
            arrived = abs(extreme - values[first - APPROACH])
            left = abs(extreme - values[after - 1 + APPROACH])
            if min(arrived, left) > least:
                stretches += 1
                cut_off += after - first
        if stretches >= FEWEST_STRETCHES:
            return extreme, cut_off
    return None


def _list_stretches(samples: Indices) -> list[tuple[int, int]]:
    """First sample of each stretch of these samples, and the first one behind it. Noise leaves a
    limit for a sample or two.
    """
    if not samples.size:
        return []
    ends = np.flatnonzero(np.diff(samples) > APPROACH)
    first = samples[np.r_[0, ends + 1]]
    last = samples[np.r_[ends, len(samples) - 1]]
    return [(int(begin), int(end) + 1) for begin, end in zip(first, last, strict=True)]


@dataclass(frozen=True)
class Lag:
    """How much later a column shows what another one shows, and how surely.

    Parameters
    ----------
    lag_s
        Positive where it is late.
    correlation
        Of both at this lag.
    gain
        By how much less of the variance is left than without a lag, as a share.
    """

    lag_s: float
    correlation: float
    gain: float


def estimate_lag(t_s: Floats, late: Floats, early: Floats, longest_s: float) -> Lag:
    """The lag of a column behind another one at which they correlate best.

    Parameters
    ----------
    t_s : (m,) times of the samples, ascending
    late, early : (m,) the columns
    longest_s : largest lag that is tried, in either direction

    Notes
    -----
    Lags are tried in steps of half a sample, the column between its samples being linear; a
    parabola through the three best squares gives the fraction. It needs several reversals of the
    motion.
    """
    step_s = 0.5 * float(np.median(np.diff(t_s)))
    count = max(int(np.ceil(longest_s / step_s)), 1)
    lags_s = step_s * np.arange(-count, count + 1)
    inside = (t_s >= t_s[0] + longest_s) & (t_s <= t_s[-1] - longest_s)
    if np.count_nonzero(inside) < NEIGHBOURS:
        return Lag(0.0, 0.0, 0.0)
    reference = _standardize(late[inside])
    correlations = np.array(
        [
            float(np.mean(reference * _standardize(np.interp(t_s[inside] - lag, t_s, early))))
            for lag in lags_s
        ]
    )
    best = int(np.argmax(np.abs(correlations)))
    at_zero = correlations[count] ** 2
    left = 1.0 - correlations[best] ** 2
    gain = 1.0 - left / max(1.0 - at_zero, np.finfo(float).tiny)
    return Lag(
        float(lags_s[best] + step_s * _vertex(correlations**2, best)),
        float(correlations[best]),
        float(gain),
    )


def _standardize(values: Floats) -> Floats:
    spread = float(values.std())
    if spread == 0.0:
        return np.zeros_like(values)
    return np.asarray((values - values.mean()) / spread)


def _vertex(values: Floats, best: int) -> float:
    """Place of the vertex of the parabola through three neighbours, relative to the middle one."""
    if best in (0, len(values) - 1):
        return 0.0
    before, at, after = values[best - 1 : best + 2]
    curvature = before - 2.0 * at + after
    if curvature == 0.0:
        return 0.0
    return float(0.5 * (before - after) / curvature)
