"""Conditions laid out as a small grid: heights by speeds where there are all of them, else one below or beside the other."""

from collections.abc import Sequence
from dataclasses import dataclass

MOST_COLUMNS = 18  # that fit across a sheet of paper with a number in each
SPARSE = 1.5  # a grid with more places than this per condition is no grid


@dataclass(frozen=True)
class Grid:
    """Labels of rows and of columns, each perhaps one empty label; `at` gives the place's condition where there is one."""

    rows: tuple[str, ...]
    columns: tuple[str, ...]
    at: dict[tuple[str, str], str]


def condition_grid(conditions: Sequence[str], times: int) -> Grid:
    """The grid with the fewest rows that, set `times` side by side, is not too broad. Labels are as "215 mm, 2.433 rad/s"."""
    distinct = tuple(dict.fromkeys(conditions))
    beside = Grid(("",), distinct, {("", label): label for label in distinct})
    below = Grid(distinct, ("",), {(label, ""): label for label in distinct})
    grids = [beside, *_crossed(distinct)]
    fitting = [grid for grid in grids if times * len(grid.columns) <= MOST_COLUMNS]
    return min(fitting, key=lambda grid: len(grid.rows), default=below) if len(distinct) > 1 else below


def _crossed(conditions: Sequence[str]) -> list[Grid]:
    """First by second part of the labels, and the other way round; nothing where that leaves many places empty."""
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
