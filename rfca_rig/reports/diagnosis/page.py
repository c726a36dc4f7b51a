"""diagnosis.html: one self-contained page, with the map of residuals.

Residual map of a diagnosis: where model and recordings differ by signal, phase and condition,
relative to the expected difference.
"""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from math import isfinite, log10
from typing import Any

from rfca_rig.analysis.phases import PHASES
from rfca_rig.diagnosis.residual_force.law import StatedLaw
from rfca_rig.diagnosis.result import (
    Diagnosis,
    Located,
    MapCell,
    NamedEffect,
    NotSeen,
    Rival,
    Value,
    name_parts,
)
from rfca_rig.model.catalogue import catalogue
from rfca_rig.reports.diagnosis.pictures import draw_forest, draw_law, draw_residual, pictures_of
from rfca_rig.reports.diagnosis.tables import (
    SIGMA,
    STDS_90,
    acceptance_table,
    all_misfits,
    before_after_table,
    compare_with_usual_error,
    describe_effect,
    describe_law,
    describe_moved_prior,
    entries,
    format_p_value,
    format_probability,
    format_with_interval_90,
    hypothesis,
    nuisance_unit,
    sizes,
)
from rfca_rig.reports.page_units import convert_diagnosis, page_name
from rfca_rig.reports.provenance import PROGRAM, PageContext
from rfca_rig.reports.templates import template
from rfca_rig.reports.text import (
    NOTHING,
    count_noun,
    decimals,
    format_decimals,
    format_significant,
    keep_units_together,
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

GRADE_WORDS = {
    "identified": (
        "One law holds to the usual model error in all conditions.",
        "probability that this is it",
    ),
    "mostly": (
        "These effects are the dominant omission. Their laws are only approximately right.",
        "probability that they are missing",
    ),
    "family": (
        "The data tell what kind of effect is missing, not which law it follows.",
        "probability of this family",
    ),
    "nothing missing": (
        "The model predicts held-out conditions to its usual error.",
        "probability that nothing is missing",
    ),
    "unexplained": (
        "Model and recordings differ, and no entry of the catalogue accounts for it.",
        "probability that something is missing",
    ),
    "not enough data": ("These recordings do not allow an answer.", ""),
}
NOTHING_LEFT = {
    "identified": "Nothing beyond noise, scatter and the model\u2019s usual error.",
    "nothing missing": "Nothing beyond noise, scatter and the model\u2019s usual error.",
    "unexplained": "The whole difference shown above.",
}
NEXT_STEPS = {
    "identified": (
        "Add the effect to your model: the fitted model file beside this page has it. Check "
        "it on a condition not used here."
    ),
    "mostly": (
        "Use the fitted model file beside this page as a first correction; what remains is "
        "listed below."
    ),
    "family": "Do not add a law yet: these data do not tell which one.",
    "nothing missing": "Keep the model. Effects above the detection limits below are excluded.",
    "unexplained": (
        "Do not correct the model yet. Inspect the rig where the difference was located."
    ),
    "not enough data": "Record more: at least three conditions, each with repeats.",
}
# Axes of forest plots: prior standard deviations, and decades of probability.
FOREST_STDS = (-4.0, 4.0)
LEAST_DECADE = -6.0
# Of the alternative hypotheses, the page lists so many at most, and none below this probability.
SHOWN_RIVALS = 7
NEGLIGIBLE = 0.001


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
    # Without a unit in common, labels are too long to stand side by side.
    grids = [*([beside] if _without_unit(distinct)[0] else []), *_cross_grids(distinct)]
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
    first, second = (_in_order([part[side] for part in parts]) for side in (0, 1))
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
    return ORDER.index(phase) if phase in ORDER else len(ORDER), phase


def _rows(
    cells: Sequence[MapCell],
    phases: Sequence[str],
    grid: Grid,
    located: frozenset[tuple[str, str, str, str]],
) -> tuple[MapRow, ...]:
    by_place = {
        (cell.phase if len(phases) > 1 else phases[0], cell.condition): cell for cell in cells
    }
    across = [(phase, column) for phase in phases for column in grid.columns]
    largest = max((abs(cell.size) for cell in cells if isfinite(cell.size)), default=0.0)
    # One number of decimals for all cells of a signal, so that they can be compared at a glance.
    places = max(0, decimals(largest, 3 if largest >= 1.0 else 2))
    return tuple(
        MapRow(
            row,
            tuple(
                _shade(by_place.get((phase, grid.at.get((row, column), ""))), places, located)
                for phase, column in across
            ),
        )
        for row in grid.rows
    )


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


def page(diagnosis: Diagnosis, context: PageContext, files: Sequence[str] = ()) -> str:
    """The page as HTML.

    Parameters
    ----------
    diagnosis
        The result to show.
    context
        Origin of the page, and links to others.
    files
        Names of the files beside the page, which it links.
    """
    diagnosis = convert_diagnosis(diagnosis)
    probability = diagnosis.probability
    shown_rivals, other_rivals = _rivals(diagnosis.rivals)
    differing = {place.signal for place in (*diagnosis.located, *diagnosis.remaining)}
    pictures = pictures_of(diagnosis.overlays, differing)
    next_step, next_command = describe_next_step(diagnosis)
    proposal: Mapping[str, Any] = diagnosis.next_experiment or {}
    why = str(proposal.get("why", ""))
    # Each pair of hypotheses with the log evidence that the experiment is expected to give.
    pairs = [
        f"{rival} from {other}: {format_significant(log, 2)}"
        for rival, other, log in proposal.get("separates", ())
    ]
    if pairs:
        separates = {"separates by log evidence": pairs}
    else:
        separates = {}
    return template("diagnosis.html").render(
        sheets=("verdict.css", "diagnosis.css"),
        origin=context.origin,
        links=context.links,
        files=files,
        title=diagnosis.title,
        grade=diagnosis.grade,
        grade_meaning=name_parts(GRADE_WORDS[diagnosis.grade][0], diagnosis.is_of_stretches),
        part=name_parts("condition", diagnosis.is_of_stretches),
        parts_words=name_parts("conditions", diagnosis.is_of_stretches),
        probability_of=GRADE_WORDS[diagnosis.grade][1],
        sentence=_text(diagnosis.sentence),
        evidence=_text(describe_evidence(diagnosis)),
        next_step=next_step,
        next_command=next_command,
        residual=draw_residual(diagnosis),
        probability=None if probability is None else format_probability(probability),
        maps=maps_of(diagnosis),
        phone_columns=PHONE_COLUMNS,
        band_words=BAND_WORDS,
        located=[_place(place, diagnosis) for place in diagnosis.located],
        effects=[_effect(effect) for effect in diagnosis.effects],
        identified=diagnosis.grade == "identified",
        family=diagnosis.family,
        other_families=[
            asdict(family) | {"probability": format_probability(family.probability)}
            for family in diagnosis.other_families
        ],
        place=diagnosis.place,
        place_probability=format_probability(diagnosis.place.probability)
        if diagnosis.place
        else "",
        explained_share=None
        if diagnosis.explained_share is None
        else f"{100.0 * diagnosis.explained_share:.0f}\u00a0%",
        remaining=[_place(place, diagnosis) for place in diagnosis.remaining],
        law=None if diagnosis.stated_law is None else _law(diagnosis.stated_law),
        moved_priors=[describe_moved_prior(moved_prior) for moved_prior in diagnosis.moved_priors],
        before_after=before_after_table(diagnosis),
        pictures=[picture for picture in pictures if not picture.summary],
        folded=[picture for picture in pictures if picture.summary],
        acceptance=acceptance_table(diagnosis),
        rivals=shown_rivals,
        other_rivals=other_rivals,
        ruled_out=[
            _not_seen(effect) for effect in diagnosis.not_seen if effect.would_have_seen is not None
        ],
        not_tested=[
            _not_seen(effect) for effect in diagnosis.not_seen if effect.would_have_seen is None
        ],
        unexplained_title="Why it is not identified"
        if diagnosis.grade in ("mostly", "family")
        else "Still unexplained",
        nothing_unexplained=NOTHING_LEFT.get(diagnosis.grade, ""),
        unexplained=[_text(text) for text in diagnosis.unexplained],
        next_protocol=proposal.get("protocol"),
        next_reason=_text(f"{why[:1].upper()}{why[1:]}"),
        next_values=entries(
            {
                name: value
                for name, value in proposal.items()
                if name not in ("why", "protocol", "separates")
            }
            | separates
        ),
        remarks=[_text(text) for text in diagnosis.remarks],
        nominal=_nuisances(diagnosis),
        settings=entries(diagnosis.settings),
    )


def describe_evidence(diagnosis: Diagnosis) -> str:
    """Where the mismatch was located, and what the stated effects do to it, in one sentence; ""
    where nothing was located.
    """
    if not diagnosis.located:
        return ""
    place = max(diagnosis.located, key=lambda located: located.sigmas)
    sentence = (
        f"It shows in {signal_words(place.signal)}, {place.phase}: "
        f"{format_significant(place.size)} {place.unit} rms, "
        f"{format_significant(place.sigmas, 2)} times what noise, scatter and the usual "
        "model error can do"
    )
    misfit = all_misfits(diagnosis).get(f"rms_{place.signal}")
    if misfit is None or not diagnosis.effects or not isfinite(misfit.after):
        return f"{sentence}."
    change = (
        f"{format_significant(misfit.before, 2)} to {format_significant(misfit.after, 2)} "
        f"{place.unit}"
    )
    return f"{sentence}. With the effect, the signal's misfit falls from {change} rms."


def describe_next_step(diagnosis: Diagnosis) -> tuple[str, str]:
    """What to do with the answer in words, and the command for it, "" where none does it."""
    proposal = diagnosis.next_experiment
    step = NEXT_STEPS[diagnosis.grade]
    if diagnosis.is_of_stretches:
        step = step.replace("a condition not used", "a recording not used")
        step = step.replace("three conditions, each with repeats", "three stretches of recordings")
    if proposal is None:
        return step, ""
    if proposal.get("protocol") is None:
        return f"{step} Then do the experiment at the end of this page.", ""
    command = f"{PROGRAM} {proposal.get('kind')} run --protocol next-experiment.toml"
    return f"{step} Then record the proposed experiment:", command


def _nuisances(diagnosis: Diagnosis) -> list[dict[str, str]]:
    """Nuisance parameters in prior standard deviations from their priors, as a forest plot, with
    values in their units.
    """
    nuisances = []
    for name, value in diagnosis.believed_values.items():
        words, unit = words_and_unit(name)
        unit = nuisance_unit(diagnosis, name) or unit
        prior = diagnosis.priors.get(name)
        key = diagnosis.nuisance_keys.get(name, "")
        texts = {
            "name": words,
            "unit": unit,
            "value": format_with_interval_90(value),
            "prior": "",
            "key": key,
            "forest": "",
        }
        if prior is not None and prior.std > 0.0 and isfinite(value.value):
            z = (value.value - prior.value) / prior.std
            half = STDS_90 * value.std / prior.std
            half = half if isfinite(half) else 0.0
            texts["prior"] = format_with_interval_90(prior)
            shown_text = f"{words}: {texts['value']} {unit}, prior {texts['prior']} {unit}"
            texts["forest"] = draw_forest(
                (-STDS_90, 0.0, STDS_90), (z - half, z, z + half), FOREST_STDS, shown_text, 0.0
            )
        nuisances.append(texts)
    return nuisances


def _text(text: str) -> str:
    return keep_units_together(text).replace("->", "\u2192")


def _place(place: Located, diagnosis: Diagnosis) -> dict[str, str]:
    return {
        "signal": signal_words(place.signal),
        "experiment": place.experiment,
        "phase": place.phase,
        "size": keep_units_together(f"{format_significant(place.size)} {place.unit}"),
        "sigmas": format_significant(place.sigmas, 2),
        "p_value": format_p_value(place.p_value),
        "usual": compare_with_usual_error(place),
        "conditions": _conditions(place, diagnosis),
    }


def _conditions(place: Located, diagnosis: Diagnosis) -> str:
    """Conditions of a place: "all 12" where every condition with that phase shows it, else their
    labels.
    """
    of_place = (place.signal, place.experiment, place.phase)
    conditions = {
        cell.condition
        for cell in diagnosis.cells
        if (cell.signal, cell.experiment, cell.phase) == of_place
    }
    if len(place.conditions) > 1 and conditions == set(place.conditions):
        return f"all {len(conditions)}"
    return keep_units_together("; ".join(place.conditions)) or NOTHING


def _effect(effect: NamedEffect) -> dict[str, Any]:
    return {
        "id": effect.id,
        "left_out": effect.left_out,
        "probability": format_probability(effect.probability),
        "wording": _text(effect.wording),
        "parameters": [
            _parameter(effect.id, name, value) for name, value in effect.parameters.items()
        ],
        "cannot_tell_from": [
            {"id": other, "left_out": describe_effect(other)} for other in effect.cannot_tell_from
        ],
    }


def _parameter(effect_id: str, name: str, value: Value) -> dict[str, str]:
    """A parameter with its plausible range as the prior, where the catalogue has one."""
    words, unit = words_and_unit(name)
    texts = {
        "name": words,
        "unit": unit,
        "value": format_with_interval_90(value),
        "range": "",
        "forest": "",
    }
    known = catalogue().get(effect_id)
    if known:
        plausible = next(
            (parameter for parameter in known.parameters if page_name(parameter.name)[0] == name),
            None,
        )
    else:
        plausible = None
    if not isfinite(value.value):
        return texts
    half = STDS_90 * value.std if isfinite(value.std) else 0.0
    if plausible is None:
        # Without a plausible range the axis shows how far the value is from zero.
        interval = (value.value - half, value.value, value.value + half)
        reach = (min(0.0, 1.1 * interval[0]), max(0.0, 1.1 * interval[2]))
        if reach[0] < reach[1]:
            texts["forest"] = draw_forest(
                None, interval, reach, f"{words}: {texts['value']} {unit}", 0.0
            )
        return texts
    factor = page_name(plausible.name)[1]
    lowest = factor * plausible.low
    highest = factor * plausible.high
    ends = [lowest, highest, value.value - half, value.value, value.value + half]
    texts["range"] = f"{format_significant(lowest)} to {format_significant(highest)}"
    shown_text = f"{words}: {texts['value']} {unit}, plausible {texts['range']} {unit}"
    # A range over more than a decade is drawn on a logarithmic axis.
    if min(ends) > 0.0 and highest > 10.0 * lowest:
        ends = [log10(end) for end in ends]
    low, high, *posterior = ends
    axis = (min(ends), max(ends))
    texts["forest"] = draw_forest(
        (low, 0.5 * (low + high), high),
        (posterior[0], posterior[1], posterior[2]),
        axis,
        shown_text,
    )
    return texts


def _law(stated: StatedLaw) -> dict[str, Any]:
    law = stated.law
    memory = law.memory is not None and law.memory.has_memory
    return {
        "picture": draw_law(law, stated.curve),
        "place": law.place,
        "sentence": f"The residual law was {describe_law(stated)}.",
        "memory": (
            "The force differs between a rising and a falling argument, see the dotted "
            "branches: no single curve is right."
        )
        if memory
        else "",
    }


def _rivals(rivals: Sequence[Rival]) -> tuple[list[dict[str, Any]], str]:
    """The most probable hypotheses, and in words how many others there are with which total
    probability.

    "Nothing missing" and "something unlisted" are always among the former: a reader looks for them.
    """
    ranked = sorted(rivals, key=lambda rival: -rival.probability)
    best_evidence = max((rival.log_evidence for rival in ranked), default=0.0)
    listed = [
        r
        for rank, r in enumerate(ranked)
        if r.ids in ((), ("unknown",)) or (rank < SHOWN_RIVALS and r.probability >= NEGLIGIBLE)
    ]
    rest = [rival.probability for rival in ranked if rival not in listed]
    if rest:
        others = f"{count_noun(len(rest), 'other')}, together {format_probability(sum(rest))}"
    else:
        others = ""
    return [_rival(rival, best_evidence) for rival in listed], others


def _rival(rival: Rival, best_evidence: float) -> dict[str, Any]:
    name = hypothesis(rival.ids)
    probability = format_probability(rival.probability)
    prior = "" if rival.prior is None else format_probability(rival.prior)
    # Decades of probability: those of rivals differ by orders of magnitude.
    at, before = (
        max(log10(max(p, 1e-300)), LEAST_DECADE) for p in (rival.probability, rival.prior or 1.0)
    )
    shown_text = f"{name}: {probability}" + (f", before the data {prior}" if prior else "")
    bar = None if rival.prior is None else (before, before, before)
    return {
        "name": name,
        "probability": probability,
        "prior": prior or NOTHING,
        "forest": draw_forest(bar, (at, at, at), (LEAST_DECADE, 0.0), shown_text),
        "behind": format_significant(rival.log_evidence - best_evidence)
        if rival.log_evidence < best_evidence
        else "0",
        "model_error": f"{format_significant(100.0 * rival.model_error, 2)}\u00a0%",
    }


def _not_seen(effect: NotSeen) -> dict[str, str]:
    detectable: Mapping[str, float] = effect.would_have_seen or {}
    return {"id": effect.id, "left_out": describe_effect(effect.id), "size": sizes(detectable)}
