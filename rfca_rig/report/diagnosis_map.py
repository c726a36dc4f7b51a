"""Residual map of a diagnosis: where model and recordings differ by signal, phase and condition, relative to the expected difference."""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

from rfca_rig.analysis.phases import PHASES
from rfca_rig.diagnosis.result import Diagnosis, MapCell
from rfca_rig.report.diagnosis_wording import SIGMA, decimals, format_decimals, format_significant
from rfca_rig.report.named_units import name_with_unit

# Borders of the colours, in standard deviations of the expected difference.
EDGES = (2.0, 3.0, 5.0, 10.0)
BAND_WORDS = tuple(f"{words} {SIGMA}" for words in ("below 2", "2 to 3", "3 to 5", "5 to 10", "above 10"))
ORDER = (*PHASES, "loading", "unloading")


# Columns with a number in each that fit across a sheet of paper.
MOST_COLUMNS = 18
# A grid with more places than this per condition would be mostly empty, and is not used.
SPARSE = 1.5


@dataclass(frozen=True)
class Grid:
    """Labels of rows and columns, each perhaps a single empty label; `at` maps a (row, column) to its condition where there is one."""

    rows: tuple[str, ...]
    columns: tuple[str, ...]
    at: dict[tuple[str, str], str]


def condition_grid(conditions: Sequence[str], times: int) -> Grid:
    """The grid with the fewest rows that fits on the page.

    Parameters
    ----------
    conditions
        Labels, as in "215 mm, 2.433 rad/s".
    times
        Number of phases: the grid's columns appear once for each of them.
    """
    distinct = tuple(dict.fromkeys(conditions))
    beside = Grid(("",), distinct, {("", label): label for label in distinct})
    below = Grid(distinct, ("",), {(label, ""): label for label in distinct})
    grids = [beside, *_cross_grids(distinct)]
    fitting = [grid for grid in grids if times * len(grid.columns) <= MOST_COLUMNS]
    # A list of all conditions below each other always fits.
    return min(fitting, key=lambda grid: len(grid.rows), default=below) if len(distinct) > 1 else below


def _cross_grids(conditions: Sequence[str]) -> list[Grid]:
    """Height by speed and speed by height, from the two parts of the labels; empty where many places would be empty."""
    parts = [label.split(", ", 1) for label in conditions]
    if any(len(part) != 2 for part in parts):
        return []
    first, second = (_in_order([part[side] for part in parts]) for side in (0, 1))
    if len(first) * len(second) > SPARSE * len(conditions):
        return []
    at = {(part[0], part[1]): label for part, label in zip(parts, conditions, strict=True)}
    return [Grid(first, second, at), Grid(second, first, {(b, a): label for (a, b), label in at.items()})]


def _in_order(labels: Sequence[str]) -> tuple[str, ...]:
    return tuple(sorted(dict.fromkeys(labels), key=_number_first))


def _number_first(label: str) -> tuple[float, str]:
    try:
        return float(label.partition(" ")[0]), label
    except ValueError:
        return float("inf"), label


@dataclass(frozen=True)
class Shade:
    """One cell as shown: `band` is the index of its colour, `located` frames it. Empty text where nothing was recorded."""

    text: str
    band: int
    sigmas: str
    located: bool


@dataclass(frozen=True)
class MapRow:
    """One row of one signal; `label` is a condition, or the part of it that the rows stand for."""

    label: str
    shades: tuple[Shade, ...]


@dataclass(frozen=True)
class Map:
    """Map of one experiment: each phase spans `columns`, each signal its rows; `corner` is the unit of the columns."""

    experiment: str
    corner: str
    phases: tuple[str, ...]
    columns: tuple[str, ...]
    signals: tuple[tuple[str, tuple[MapRow, ...]], ...]
    labelled: bool


def maps_of(diagnosis: Diagnosis) -> list[Map]:
    """One map for each experiment in the cells."""
    located = frozenset((p.signal, p.experiment, p.phase, condition) for p in diagnosis.located for condition in p.conditions)
    experiments = dict.fromkeys(cell.experiment for cell in diagnosis.cells)
    return [_map(name, [cell for cell in diagnosis.cells if cell.experiment == name], located) for name in experiments]


def band(sigmas: float) -> int:
    """Index of the colour: the number of EDGES reached."""
    return bisect_right(EDGES, sigmas) if isfinite(sigmas) else 0


def _map(experiment: str, cells: Sequence[MapCell], located: frozenset[tuple[str, str, str, str]]) -> Map:
    phases = sorted(dict.fromkeys(cell.phase for cell in cells), key=_place)
    grid = condition_grid([cell.condition for cell in cells], len(phases))
    unit, columns = _without_unit(grid.columns)
    signals = dict.fromkeys(cell.signal for cell in cells)
    rows = tuple((name_with_unit(s), _rows([cell for cell in cells if cell.signal == s], phases, grid, located)) for s in signals)
    return Map(experiment, unit, tuple(phases), columns, rows, any(grid.rows))


def _place(phase: str) -> tuple[int, str]:
    return ORDER.index(phase) if phase in ORDER else len(ORDER), phase


def _rows(cells: Sequence[MapCell], phases: Sequence[str], grid: Grid, located: frozenset[tuple[str, str, str, str]]) -> tuple[MapRow, ...]:
    by_place = {(cell.phase, cell.condition): cell for cell in cells}
    across = [(phase, column) for phase in phases for column in grid.columns]
    largest = max((abs(cell.size) for cell in cells if isfinite(cell.size)), default=0.0)
    # One number of decimals for all cells of a signal, so that they can be compared at a glance.
    places = max(0, decimals(largest, 3 if largest >= 1.0 else 2))
    return tuple(
        MapRow(row, tuple(_shade(by_place.get((phase, grid.at.get((row, column), ""))), places, located) for phase, column in across))
        for row in grid.rows
    )


def _shade(cell: MapCell | None, places: int, located: frozenset[tuple[str, str, str, str]]) -> Shade:
    if cell is None:
        return Shade("", 0, "", False)
    found = (cell.signal, cell.experiment, cell.phase, cell.condition) in located
    return Shade(format_decimals(cell.size, places), band(cell.sigmas), format_significant(cell.sigmas, 2), found)


def _without_unit(columns: tuple[str, ...]) -> tuple[str, tuple[str, ...]]:
    """The unit that all labels share, and the labels without it."""
    units = {label.partition(" ")[2] for label in columns}
    if len(units) != 1 or not (unit := units.pop()) or "," in unit:
        return "", columns
    return unit, tuple(label.partition(" ")[0] for label in columns)
