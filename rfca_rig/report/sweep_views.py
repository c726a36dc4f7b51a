"""Which pictures show a sweep: lines over one quantity, maps over two, points where cases were drawn."""

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

MOST_LINES = 6
FEWEST_OF_A_MAP = 5
MOST_FACETS = 6


@dataclass(frozen=True)
class View:
    """One way to see a grid: `x` along, `second` as lines or as the other side of a map, the rest held at `facet`."""

    x: Axis
    second: Axis | None
    is_map: bool
    facet: tuple[tuple[str, Value], ...]

    def values(self, result: SweepResult, header: str) -> Floats:
        """(second or 1, x) of an output."""
        plan = result.plan
        grid = result.output(header).reshape([len(axis.values) for axis in plan.axes])
        held = dict(self.facet)
        picked = tuple(axis.values.index(held[axis.name]) if axis.name in held else slice(None) for axis in plan.axes)
        left = [axis.name for axis in plan.axes if axis.name not in held]
        order = [left.index(axis.name) for axis in (self.second, self.x) if axis is not None]
        return np.atleast_2d(np.transpose(grid[picked], order))


def is_named(axis: Axis) -> bool:
    """Whether its values are words."""
    return isinstance(axis.values[0], str)


def views(plan: SweepPlan) -> tuple[list[View], int]:
    """The views of a grid, and how many there would have been without a limit. A sweep with samples has none."""
    if plan.samples is not None or not plan.axes:
        return [], 0
    x = max(plan.axes, key=lambda axis: (_is_a_line(axis), is_named(axis), len(axis.values)))
    others = sorted((axis for axis in plan.axes if axis is not x), key=lambda axis: -len(axis.values))
    second = others[0] if others else None
    rest = [axis for axis in plan.axes if axis not in (x, second)]
    facets = list(product(*([(axis.name, value) for value in axis.values] for axis in rest)))
    return [View(x, second, _as_map(x, second), facet) for facet in facets[:MOST_FACETS]], len(facets)


def _is_a_line(axis: Axis) -> bool:
    """Two points are none: words are better to see along the bottom then."""
    return not is_named(axis) and len(axis.values) > 2


def _as_map(x: Axis, second: Axis | None) -> bool:
    if second is None or is_named(second) or is_named(x):
        return False
    return min(len(x.values), len(second.values)) >= FEWEST_OF_A_MAP or len(second.values) > MOST_LINES


@dataclass(frozen=True)
class Drawn:
    """The cases of one combination of the grid's values beside samples: their slice of all cases."""

    at: tuple[tuple[str, Value], ...]
    cases: slice


def drawn_groups(plan: SweepPlan) -> Iterator[Drawn]:
    """One for each combination of the grid, in order; none without samples."""
    if plan.samples is None:
        return
    n = plan.samples.n
    names: Sequence[str] = [axis.name for axis in plan.axes]
    for place in range(prod(len(axis.values) for axis in plan.axes)):
        yield Drawn(tuple(zip(names, plan.point(place * n), strict=False)), slice(place * n, (place + 1) * n))
