"""Selects the figures of a sweep: lines over one quantity, maps over two, scatter plots for sampled cases."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from math import prod

import numpy as np
from numpy.typing import NDArray

from rfca_rig.sweep.plan import Axis, SweepPlan
from rfca_rig.sweep.quantities import Value
from rfca_rig.sweep.result import SweepResult

Floats = NDArray[np.float64]

# Lines of one figure that can still be told apart; more become a map.
MOST_LINES = 6
# Values along the shorter side from which on a grid is drawn as a map.
FEWEST_OF_A_MAP = 5
# Figures of one output at most.
MOST_FACETS = 6


@dataclass(frozen=True)
class View:
    """One view of a grid: `x` is the horizontal axis, `second` gives lines or the vertical axis, the others are fixed at `facet`."""

    x: Axis
    second: Axis | None
    is_map: bool
    facet: tuple[tuple[str, Value], ...]

    def values(self, result: SweepResult, header: str) -> Floats:
        """Values (k, n) of an output, k along `second` (1 without), n along `x`; NaN for failed cases."""
        plan = result.plan
        grid = result.output(header).reshape([len(axis.values) for axis in plan.axes])
        fixed = dict(self.facet)
        # A number removes an axis of the grid, a slice keeps it.
        picked = tuple(axis.values.index(fixed[axis.name]) if axis.name in fixed else slice(None) for axis in plan.axes)
        left = [axis.name for axis in plan.axes if axis.name not in fixed]
        order = [left.index(axis.name) for axis in (self.second, self.x) if axis is not None]
        return np.atleast_2d(np.transpose(grid[picked], order))


def is_named(axis: Axis) -> bool:
    """Whether its values are words."""
    return isinstance(axis.values[0], str)


def views(plan: SweepPlan) -> tuple[list[View], int]:
    """The views of a grid, at most MOST_FACETS, and their number without that limit. A sweep with samples has none."""
    if plan.samples is not None or not plan.axes:
        return [], 0
    # The horizontal axis is the one with the most numbers, so that a line has many points.
    x = max(plan.axes, key=lambda axis: (_is_a_line(axis), is_named(axis), len(axis.values)))
    others = sorted((axis for axis in plan.axes if axis is not x), key=lambda axis: -len(axis.values))
    second = others[0] if others else None
    rest = [axis for axis in plan.axes if axis not in (x, second)]
    facets = list(product(*([(axis.name, value) for value in axis.values] for axis in rest)))
    return [View(x, second, _as_map(x, second), facet) for facet in facets[:MOST_FACETS]], len(facets)


def _is_a_line(axis: Axis) -> bool:
    """Whether an axis gives a line: two points do not, and words are then easier to read along the bottom."""
    return not is_named(axis) and len(axis.values) > 2


def _as_map(x: Axis, second: Axis | None) -> bool:
    if second is None or is_named(second) or is_named(x):
        return False
    return min(len(x.values), len(second.values)) >= FEWEST_OF_A_MAP or len(second.values) > MOST_LINES


@dataclass(frozen=True)
class SampleGroup:
    """Sampled cases of one combination of the grid's values, as a slice of all cases."""

    at: tuple[tuple[str, Value], ...]
    cases: slice


def sample_groups(plan: SweepPlan) -> Iterator[SampleGroup]:
    """Sampled cases for each combination of the grid, in order; none without samples."""
    if plan.samples is None:
        return
    n = plan.samples.n
    names: Sequence[str] = [axis.name for axis in plan.axes]
    for place in range(prod(len(axis.values) for axis in plan.axes)):
        yield SampleGroup(tuple(zip(names, plan.point(place * n), strict=False)), slice(place * n, (place + 1) * n))
