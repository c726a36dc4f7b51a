"""What a sweep's page shows, and in which words: figures, names, values and equations, and sensitivities.

Selects the figures of a sweep: lines over one quantity, maps over two, scatter plots for sampled cases.

Sensitivities of a sweep: first-order Sobol index of each output for each sampled quantity, for the page and sweep.json.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from math import prod

import numpy as np
from numpy.typing import NDArray

from rfca_rig.reports.table import Table, TableColumn, TableRow
from rfca_rig.reports.text import MINUS, words_and_unit
from rfca_rig.sweep.plan import Axis, FirstOrder, SweepPlan, first_order, shares
from rfca_rig.sweep.quantities import Value
from rfca_rig.sweep.result import SweepResult

Floats = NDArray[np.float64]

# Lines of one figure that can still be distinguished; more become a map.
MOST_LINES = 6
# Values along the shorter side from which on a grid is drawn as a map.
FEWEST_OF_A_MAP = 5
# Figures of one output at most.
MOST_FACETS = 6

DIGITS = 4
# Replaced in this order: longer spellings come before their parts ("phi_i" before "phi").
SIGNS = {
    "integral of ": "∫ ",
    "tau w": "τ ω",
    "tau": "τ",
    "dphi_i": "dφᵢ",
    "phi_i": "φᵢ",
    "phi": "φ",
    "sum ": "Σ ",
    "N_k": "Nₖ",
    "F_k": "Fₖ",
    "^2": "²",
    " - ": f" {MINUS} ",
}

# Combinations of the grid's values for which sensitivities are computed.
MOST_GROUPS = 6


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
    # The horizontal axis is the one with the most numbers, so that a line has many points. Two points give no line, and words are then
    # easier to read along the bottom.
    x = max(plan.axes, key=lambda axis: (not is_named(axis) and len(axis.values) > 2, is_named(axis), len(axis.values)))
    others = sorted((axis for axis in plan.axes if axis is not x), key=lambda axis: -len(axis.values))
    second = others[0] if others else None
    rest = [axis for axis in plan.axes if axis not in (x, second)]
    facets = list(product(*([(axis.name, value) for value in axis.values] for axis in rest)))
    return [View(x, second, _as_map(x, second), facet) for facet in facets[:MOST_FACETS]], len(facets)


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


def name_and_unit(name: str) -> tuple[str, str]:
    """Words and unit: strip.thickness_mm is "strip thickness" in mm, static_torque_Nm@60deg is "static torque at 60°" in N m."""
    plain, at, angle = name.partition("@")
    of, dot, last = plain.rpartition(".")
    words, unit = words_and_unit(last)
    text = f"{of.replace('_', ' ')} {words}" if dot else words
    return (f"{text} at {angle.removesuffix('deg')}°" if at else text), unit


def axis_label(name: str) -> str:
    """Label of an axis, as in "height (mm)"."""
    words, unit = name_and_unit(name)
    return f"{words} ({unit})" if unit else words


def with_unit(name: str, value: Value) -> str:
    """Name with value and unit, as in "height 215 mm", "strip material CFSP"."""
    words, unit = name_and_unit(name)
    return f"{words} {value_text(value)}{f' {unit}' if unit else ''}"


def value_text(value: Value) -> str:
    """A value with four digits and a typographic minus sign."""
    return value if isinstance(value, str) else f"{value:.{DIGITS}g}".replace("-", MINUS)


def formula(text: str) -> str:
    """An equation in mathematical signs, for a page."""
    for typed, sign in SIGNS.items():
        text = text.replace(typed, sign)
    return f"{MINUS}{text[1:]}" if text.startswith("-") else text


@dataclass(frozen=True)
class OutputSensitivity:
    """Sensitivity of one output to one quantity, for one combination of the grid's values; `found` is None where it is undetermined."""

    at: tuple[tuple[str, Value], ...]
    output: str
    name: str
    found: FirstOrder | None


def compute_sensitivities(result: SweepResult) -> list[OutputSensitivity]:
    """All sensitivities, by combination, output and quantity. The seed of the bootstrap is that of the samples."""
    return list(_compute_sensitivities(result))


def _compute_sensitivities(result: SweepResult) -> Iterator[OutputSensitivity]:
    samples = result.plan.samples
    if samples is None:
        return
    share = shares(samples)
    for group in list(sample_groups(result.plan))[:MOST_GROUPS]:
        for asked in result.plan.outputs:
            values = result.output(asked.header)[group.cases]
            for place, name in enumerate(samples.names):
                # A generator of its own for each quantity, so that the order of computation does not matter.
                rng = np.random.default_rng((samples.seed, place))
                yield OutputSensitivity(group.at, asked.header, name, first_order(share[:, place], values, rng))


def sensitivities_table(found: list[OutputSensitivity]) -> Table:
    """A row for each output, a column for each quantity, and the sum of its indices; what it lacks of 1 is due to interactions."""
    names = list(dict.fromkeys(each.name for each in found))
    columns = [TableColumn("at", role="group"), TableColumn("output")]
    for name in names:
        columns += [TableColumn(name, name_and_unit(name)[0], half=f"{name} std"), TableColumn(f"{name} std", role="kept")]
    columns.append(TableColumn("sum", "together", digits=2))
    rows = []
    for at, output in dict.fromkeys((each.at, each.output) for each in found):
        values: dict[str, str | float | None] = {"at": ", ".join(with_unit(*each) for each in at), "output": name_and_unit(output)[0]}
        of_row = [each for each in found if (each.at, each.output) == (at, output)]
        for each in of_row:
            values[each.name] = each.found.index if each.found else None
            values[f"{each.name} std"] = each.found.std if each.found else None
        values["sum"] = sum(each.found.index for each in of_row if each.found) if all(each.found for each in of_row) else None
        rows.append(TableRow(values))
    return Table(
        "sensitivities",
        "Share of an output's variance that one quantity explains alone (first-order Sobol index ± one standard error); what is missing "
        "from 1 together is due to interactions.",
        tuple(columns),
        tuple(rows),
    )
