"""Residual map of a diagnosis: where model and recordings differ by signal, phase and condition,
relative to the expected difference.
"""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

from markupsafe import Markup

from rfca_rig.analysis.phases import PHASES
from rfca_rig.diagnosis.result import Diagnosis, MapCell
from rfca_rig.reports.diagnosis.tables import SIGMA
from rfca_rig.reports.elements import EMPTY, css_class, html, join
from rfca_rig.reports.text import (
    decimals,
    format_decimals,
    format_significant,
    signal_words,
    words_and_unit,
)

# Borders of the colours, in standard deviations of the expected difference.
EDGES = (2.0, 3.0, 5.0, 10.0)
BAND_WORDS = tuple(
    f"{words} {SIGMA}" for words in ("below 2", "2 to 3", "3 to 5", "5 to 10", "above 10")
)
ORDER = (*PHASES, "loading", "unloading")

# Columns with a number in each that fit across a sheet of paper.
MOST_COLUMNS = 18
# And across a phone.
PHONE_COLUMNS = 6
# A grid with more places than this per condition would be mostly empty, and is not used.
SPARSE = 1.5


@dataclass(frozen=True)
class Grid:
    """Labels of rows and columns, each perhaps a single empty label; `at` maps a (row, column)
    to its condition where there is one.
    """

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
    grids = _cross_grids(distinct)
    # Without a unit in common, labels are too long to stand side by side.
    if _without_unit(distinct)[0]:
        grids = [beside, *grids]
    fitting = [grid for grid in grids if times * len(grid.columns) <= MOST_COLUMNS]
    # A list of all conditions below each other always fits.
    if len(distinct) > 1:
        return min(fitting, key=lambda grid: len(grid.rows), default=below)
    return below


def _cross_grids(conditions: Sequence[str]) -> list[Grid]:
    """Height by speed and speed by height, from the two parts of the labels; empty where many
    places would be empty.
    """
    parts = [label.split(", ", 1) for label in conditions]
    if any(len(part) != 2 for part in parts):
        return []
    first = _in_order([part[0] for part in parts])
    second = _in_order([part[1] for part in parts])
    if len(first) * len(second) > SPARSE * len(conditions):
        return []
    at = {(part[0], part[1]): label for part, label in zip(parts, conditions, strict=True)}
    return [
        Grid(first, second, at),
        Grid(second, first, {(b, a): label for (a, b), label in at.items()}),
    ]


def _in_order(labels: Sequence[str]) -> tuple[str, ...]:
    return tuple(sorted(dict.fromkeys(labels), key=_number_first))


def _number_first(label: str) -> tuple[float, str]:
    try:
        return float(label.partition(" ")[0]), label
    except ValueError:
        return float("inf"), label


@dataclass(frozen=True)
class Shade:
    """One cell as shown: `band` is the index of its colour, `located` frames it. Empty text
    where nothing was recorded.
    """

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
    """Map of signals of one experiment, with both in its `name`: each phase spans `columns`, each
    signal its rows.

    `corner` is the unit of the columns.
    """

    name: str
    corner: str
    phases: tuple[str, ...]
    columns: tuple[str, ...]
    signals: tuple[tuple[str, tuple[MapRow, ...]], ...]
    labelled: bool


def maps_of(diagnosis: Diagnosis) -> list[Map]:
    """Maps of each experiment: one for all signals that have the same phases, so that none has
    empty columns.
    """
    located = frozenset(
        (p.signal, p.experiment, p.phase, condition)
        for p in diagnosis.located
        for condition in p.conditions
    )
    phases: dict[tuple[str, str], dict[str, None]] = {}
    for cell in diagnosis.cells:
        phases.setdefault((cell.experiment, cell.signal), {})[cell.phase] = None
    groups: dict[tuple[str, tuple[str, ...]], list[str]] = {}
    for (experiment, signal), signal_phases in phases.items():
        groups.setdefault((experiment, tuple(sorted(signal_phases, key=_place_on_map))), []).append(
            signal
        )
    maps = []
    for (experiment, _), signals in groups.items():
        cells = [
            cell
            for cell in diagnosis.cells
            if cell.experiment == experiment and cell.signal in signals
        ]
        maps.append(_map(experiment, cells, located))
    return maps


def band(sigmas: float) -> int:
    """Index of the colour: the number of EDGES reached."""
    if isfinite(sigmas):
        return bisect_right(EDGES, sigmas)
    return 0


def _map(
    experiment: str, cells: Sequence[MapCell], located: frozenset[tuple[str, str, str, str]]
) -> Map:
    phases = sorted(dict.fromkeys(cell.phase for cell in cells), key=_place_on_map)
    if len({(cell.condition, cell.phase) for cell in cells}) == len(
        {cell.condition for cell in cells}
    ):
        # Each condition is one phase, and its label names it: columns for other phases would be
        # empty.
        phases = [""]
    grid = condition_grid([cell.condition for cell in cells], len(phases))
    unit, columns = _without_unit(grid.columns)
    signals = dict.fromkeys(cell.signal for cell in cells)
    rows = []
    for signal in signals:
        words_with_unit = ", ".join(filter(None, (signal_words(signal), words_and_unit(signal)[1])))
        of_signal = [cell for cell in cells if cell.signal == signal]
        rows.append((words_with_unit, _rows(of_signal, phases, grid, located)))
    name = f"{experiment}: {', '.join(signal_words(signal) for signal in signals)}"
    return Map(name, unit, tuple(phases), columns, tuple(rows), any(grid.rows))


def _place_on_map(phase: str) -> tuple[int, str]:
    if phase in ORDER:
        return ORDER.index(phase), phase
    return len(ORDER), phase


def _rows(
    cells: Sequence[MapCell],
    phases: Sequence[str],
    grid: Grid,
    located: frozenset[tuple[str, str, str, str]],
) -> tuple[MapRow, ...]:
    cells_by_place = {}
    for cell in cells:
        phase = cell.phase
        if len(phases) == 1:
            phase = phases[0]
        cells_by_place[phase, cell.condition] = cell
    across = [(phase, column) for phase in phases for column in grid.columns]
    largest = max((abs(cell.size) for cell in cells if isfinite(cell.size)), default=0.0)
    # One number of decimals for all cells of a signal, so that they can be compared at a glance.
    digits = 2
    if largest >= 1.0:
        digits = 3
    places = max(0, decimals(largest, digits))
    rows = []
    for row in grid.rows:
        shades = []
        for phase, column in across:
            condition = grid.at.get((row, column), "")
            shades.append(_shade(cells_by_place.get((phase, condition)), places, located))
        rows.append(MapRow(row, tuple(shades)))
    return tuple(rows)


def _shade(
    cell: MapCell | None, places: int, located: frozenset[tuple[str, str, str, str]]
) -> Shade:
    if cell is None:
        return Shade("", 0, "", False)
    is_located = (cell.signal, cell.experiment, cell.phase, cell.condition) in located
    return Shade(
        format_decimals(cell.size, places),
        band(cell.sigmas),
        format_significant(cell.sigmas, 2),
        is_located,
    )


def _without_unit(columns: tuple[str, ...]) -> tuple[str, tuple[str, ...]]:
    """The unit that all labels share, and the labels without it."""
    units = {label.partition(" ")[2] for label in columns}
    if len(units) != 1 or not (unit := units.pop()) or "," in unit:
        return "", columns
    return unit, tuple(label.partition(" ")[0] for label in columns)


def map_as_html(shown: Map, part: str) -> Markup:
    """A map as a table of HTML; `part` is the word for what was recorded, as "condition"."""
    width = len(shown.phases) * len(shown.columns)
    css = "map"
    if width > PHONE_COLUMNS:
        css += " tall"
    return html(
        '<div class="wide" tabindex="0" role="region" aria-label="map of {}">\n'
        '<table class="{}" style="--columns: {}">\n<thead>\n{}\n</thead>\n{}\n</table>\n</div>',
        shown.name,
        css,
        str(len(shown.columns)),
        _heads(shown, part),
        join("\n", [_signal(shown, signal, rows, width) for signal, rows in shown.signals]),
    )


def _heads(shown: Map, part: str) -> Markup:
    """The phases, and below each the columns of the grid, where there is more than one."""
    lines = []
    if shown.phases[0]:
        heads = [html('<th scope="col">{}</th>', part if shown.labelled else "signal")]
        span = str(len(shown.columns))
        for phase in shown.phases:
            pattern = '<th scope="colgroup" class="phase first" colspan="{}">{}</th>'
            heads.append(html(pattern, span, phase))
        lines.append(html("<tr>{}</tr>", join("", heads)))
    if len(shown.columns) > 1:
        heads = [html('<th scope="col">{}</th>', shown.corner or part)]
        for _phase in shown.phases:
            for index, column in enumerate(shown.columns):
                css = css_class("" if index else "first")
                heads.append(html('<th scope="col"{}>{}</th>', css, column))
        lines.append(html("<tr>{}</tr>", join("", heads)))
    return join("\n", lines)


def _signal(shown: Map, signal: str, rows: Sequence[MapRow], width: int) -> Markup:
    lines = []
    if shown.labelled:
        pattern = '<tr><th scope="rowgroup" class="signal" colspan="{}">{}</th></tr>'
        lines.append(html(pattern, str(1 + width), signal))
    for row in rows:
        if shown.labelled:
            css = "part"
            label = row.label
        else:
            css = "signal"
            label = signal
        cells = [_shade_cell(shown, index, shade) for index, shade in enumerate(row.shades)]
        pattern = '<tr><th scope="row" class="{}">{}</th>\n{}</tr>'
        lines.append(html(pattern, css, label, join("", cells)))
    return html("<tbody>\n{}\n</tbody>", join("\n", lines))


def _shade_cell(shown: Map, index: int, shade: Shade) -> Markup:
    phase, column = divmod(index, len(shown.columns))
    css = [f"b{shade.band}"]
    attributes = EMPTY
    if shade.located:
        css.append("found")
    if column == 0:
        css.append("first")
        # A phone shows the phases below each other, each with its name.
        if shown.phases[0]:
            attributes += html(' data-phase="{}"', shown.phases[phase])
    if shade.sigmas:
        attributes += html(' title="{} {}"', shade.sigmas, SIGMA)
    return html("<td{}{}>{}</td>", attributes, css_class(" ".join(css)), shade.text)
