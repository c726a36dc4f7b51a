"""diagnosis.html: one self-contained page, with the map of residuals.

Residual map of a diagnosis: where model and recordings differ by signal, phase and condition, relative to the expected difference.
"""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

from rfca_rig.analysis.fitting.parameters import PARAMETERS
from rfca_rig.analysis.phases import PHASES
from rfca_rig.diagnosis.residual_force.law import StatedLaw
from rfca_rig.diagnosis.result import Diagnosis, Located, MapCell, NamedEffect, NotSeen, Rival, Value
from rfca_rig.reports.diagnosis.pictures import draw_law, pictures_of
from rfca_rig.reports.diagnosis.tables import (
    SIGMA,
    before_after_table,
    decimals,
    describe_effect,
    describe_law,
    describe_moved_prior,
    entries,
    format_decimals,
    format_p_value,
    format_probability,
    format_significant,
    format_with_interval_90,
    hypothesis,
    sizes,
)
from rfca_rig.reports.provenance import Origin
from rfca_rig.reports.templates import template
from rfca_rig.reports.text import NOTHING, count_noun, keep_units_together, name_with_unit, words_and_unit

# Borders of the colours, in standard deviations of the expected difference.
EDGES = (2.0, 3.0, 5.0, 10.0)
BAND_WORDS = tuple(f"{words} {SIGMA}" for words in ("below 2", "2 to 3", "3 to 5", "5 to 10", "above 10"))
ORDER = (*PHASES, "loading", "unloading")

# Columns with a number in each that fit across a sheet of paper.
MOST_COLUMNS = 18
# A grid with more places than this per condition would be mostly empty, and is not used.
SPARSE = 1.5

GRADE_WORDS = {
    "identified": ("One law holds to the usual model error in all conditions.", "probability that this is it"),
    "mostly": ("These effects are the dominant omission. Their laws are only approximately right.", "probability that they are missing"),
    "family": ("The data tell what kind of effect is missing, not which law it follows.", "probability of this family"),
    "nothing missing": ("The model predicts held-out conditions to its usual error.", "probability that nothing is missing"),
    "unexplained": ("Model and recordings differ, and no entry of the catalogue accounts for it.", "probability that something is missing"),
    "not enough data": ("These recordings do not allow an answer.", ""),
}
NOTHING_LEFT = {
    "identified": "Nothing beyond noise, scatter and the model\u2019s usual error.",
    "nothing missing": "Nothing beyond noise, scatter and the model\u2019s usual error.",
    "unexplained": "The whole difference shown above.",
}
MEMORY = "The force differs between a rising and a falling argument: no single curve is right, and the band holds both dotted branches."
# Of the alternative hypotheses, the page lists so many at most, and none below this probability.
SHOWN_RIVALS = 7
NEGLIGIBLE = 0.001


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
    phases = sorted(dict.fromkeys(cell.phase for cell in cells), key=_place_on_map)
    grid = condition_grid([cell.condition for cell in cells], len(phases))
    unit, columns = _without_unit(grid.columns)
    signals = dict.fromkeys(cell.signal for cell in cells)
    rows = tuple((name_with_unit(s), _rows([cell for cell in cells if cell.signal == s], phases, grid, located)) for s in signals)
    return Map(experiment, unit, tuple(phases), columns, rows, any(grid.rows))


def _place_on_map(phase: str) -> tuple[int, str]:
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


def page(diagnosis: Diagnosis, origin: Origin, files: Sequence[str] = ()) -> str:
    """The page as HTML.

    Parameters
    ----------
    diagnosis
        The result to show.
    origin
        Command, recordings and version for the foot of the page.
    files
        Names of the files beside the page, which it links.
    """
    probability = diagnosis.probability
    shown_rivals, other_rivals = _rivals(diagnosis.rivals)
    return template("diagnosis.html").render(
        sheets=("verdict.css", "diagnosis.css"),
        origin=origin,
        files=files,
        title=diagnosis.title,
        grade=diagnosis.grade,
        grade_meaning=GRADE_WORDS[diagnosis.grade][0],
        probability_of=GRADE_WORDS[diagnosis.grade][1],
        sentence=_text(diagnosis.sentence),
        probability=None if probability is None else format_probability(probability),
        maps=maps_of(diagnosis),
        band_words=BAND_WORDS,
        located=[_place(place, diagnosis) for place in diagnosis.located],
        effects=[_effect(effect) for effect in diagnosis.effects],
        identified=diagnosis.grade == "identified",
        family=diagnosis.family,
        place=diagnosis.place,
        place_probability=format_probability(diagnosis.place.probability) if diagnosis.place else "",
        explained_share=None if diagnosis.explained_share is None else f"{100.0 * diagnosis.explained_share:.0f}\u00a0%",
        remaining=[_place(place, diagnosis) for place in diagnosis.remaining],
        law=None if diagnosis.stated_law is None else _law(diagnosis.stated_law),
        moved_priors=[describe_moved_prior(one) for one in diagnosis.moved_priors],
        before_after=before_after_table(diagnosis),
        pictures=pictures_of(diagnosis.overlays),
        criteria=[{"name": one.name, "passed": one.passed, "found": _text(one.found)} for one in diagnosis.criteria],
        rivals=shown_rivals,
        other_rivals=other_rivals,
        ruled_out=[_not_seen(one) for one in diagnosis.not_seen if one.would_have_seen is not None],
        not_tested=[_not_seen(one) for one in diagnosis.not_seen if one.would_have_seen is None],
        nothing_unexplained=NOTHING_LEFT.get(diagnosis.grade, ""),
        unexplained=[_text(text) for text in diagnosis.unexplained],
        next_experiment=entries(diagnosis.next_experiment or {}),
        remarks=[_text(text) for text in diagnosis.remarks],
        nominal=[_nuisance(name, value, diagnosis.priors.get(name)) for name, value in diagnosis.believed_values.items()],
        settings=entries(diagnosis.settings),
    )


def _nuisance(name: str, value: Value, prior: Value | None) -> tuple[str, str, str, str]:
    """A nuisance parameter: words, unit, value after the fit, value before it."""
    words, unit = words_and_unit(name)
    # Parameters of the fit state their unit, which their names need not carry.
    if name in PARAMETERS:
        unit = PARAMETERS[name].unit
    return words, unit, format_with_interval_90(value), "" if prior is None else format_with_interval_90(prior)


def _text(text: str) -> str:
    return keep_units_together(text).replace("->", "\u2192")


def _place(place: Located, diagnosis: Diagnosis) -> dict[str, str]:
    return {
        "signal": words_and_unit(place.signal)[0],
        "experiment": place.experiment,
        "phase": place.phase,
        "size": keep_units_together(f"{format_significant(place.size)} {place.unit}"),
        "sigmas": format_significant(place.sigmas, 2),
        "p_value": format_p_value(place.p_value),
        "conditions": _conditions(place, diagnosis),
    }


def _conditions(place: Located, diagnosis: Diagnosis) -> str:
    """Conditions of a place: "all 12" where every condition shows it, else their labels."""
    every = {cell.condition for cell in diagnosis.cells if (cell.signal, cell.experiment) == (place.signal, place.experiment)}
    if len(place.conditions) > 1 and every == set(place.conditions):
        return f"all {len(every)}"
    return keep_units_together("; ".join(place.conditions)) or NOTHING


def _effect(effect: NamedEffect) -> dict[str, Any]:
    return {
        "id": effect.id,
        "left_out": effect.left_out,
        "probability": format_probability(effect.probability),
        "wording": _text(effect.wording),
        "parameters": [(*words_and_unit(name), format_with_interval_90(value)) for name, value in effect.parameters.items()],
        "cannot_tell_from": [{"id": other, "left_out": describe_effect(other)} for other in effect.cannot_tell_from],
    }


def _law(stated: StatedLaw) -> dict[str, Any]:
    law = stated.law
    memory = law.memory is not None and law.memory.has_memory
    return {
        "picture": draw_law(law, stated.curve),
        "place": law.place,
        "sentence": f"The residual law was {describe_law(stated)}.",
        "memory": "The force differs between a rising and a falling argument, see the dotted branches: no single curve is right."
        if memory
        else "",
    }


def _rivals(rivals: Sequence[Rival]) -> tuple[list[dict[str, Any]], str]:
    """The most probable hypotheses, and in words how many others there are with which total probability.

    "Nothing missing" and "something unlisted" are always among the former: a reader looks for them.
    """
    ranked = sorted(rivals, key=lambda rival: -rival.probability)
    best_evidence = max((rival.log_evidence for rival in ranked), default=0.0)
    listed = [r for place, r in enumerate(ranked) if r.ids in ((), ("unknown",)) or (place < SHOWN_RIVALS and r.probability >= NEGLIGIBLE)]
    rest = [rival.probability for rival in ranked if rival not in listed]
    others = f"{count_noun(len(rest), 'other')}, together {format_probability(sum(rest))}" if rest else ""
    return [_rival(rival, best_evidence) for rival in listed], others


def _rival(rival: Rival, best_evidence: float) -> dict[str, Any]:
    return {
        "name": hypothesis(rival.ids),
        "probability": format_probability(rival.probability),
        "bar": round(100.0 * rival.probability, 1),
        "behind": format_significant(rival.log_evidence - best_evidence) if rival.log_evidence < best_evidence else "0",
        "model_error": f"{format_significant(100.0 * rival.model_error, 2)} %",
    }


def _not_seen(one: NotSeen) -> dict[str, str]:
    detectable: Mapping[str, float] = one.would_have_seen or {}
    return {"id": one.id, "left_out": describe_effect(one.id), "size": sizes(detectable)}
