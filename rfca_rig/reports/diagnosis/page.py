"""diagnosis.html: one self-contained page, as a list of its sections."""

from collections.abc import Mapping, Sequence
from math import isfinite, log10
from typing import Any

from markupsafe import Markup

from rfca_rig.diagnosis.residual_force.law import describe_law
from rfca_rig.diagnosis.result import (
    Diagnosis,
    Located,
    NotSeen,
    Rival,
    name_parts,
)
from rfca_rig.reports.diagnosis.omitted_physics import omitted_physics, other_families
from rfca_rig.reports.diagnosis.opening import opening
from rfca_rig.reports.diagnosis.pictures import Picture, draw_forest, draw_law, pictures_of
from rfca_rig.reports.diagnosis.residual_map import BAND_WORDS, map_as_html, maps_of
from rfca_rig.reports.diagnosis.tables import (
    SIGMA,
    STDS_90,
    acceptance_table,
    before_after_table,
    compare_with_usual_error,
    describe_effect,
    describe_moved_prior,
    entries,
    format_p_value,
    format_probability,
    format_with_interval_90,
    hypothesis,
    nuisance_unit,
    sizes,
    with_typography,
)
from rfca_rig.reports.elements import (
    EMPTY,
    aside,
    bare_figure,
    bullets,
    code,
    csv_links,
    division,
    folded,
    html,
    join,
    legend,
    legend_box,
    legend_line,
    link,
    pairs,
    panels,
    paragraph,
    subheading,
)
from rfca_rig.reports.html_table import (
    NUMBER,
    UNIT,
    WORDS,
    HtmlCell,
    HtmlColumn,
    as_html,
    card_table,
)
from rfca_rig.reports.page_units import convert_diagnosis
from rfca_rig.reports.provenance import PageContext
from rfca_rig.reports.sections import PageSection
from rfca_rig.reports.templates import render_page
from rfca_rig.reports.text import (
    NOTHING,
    count_noun,
    format_significant,
    keep_units_together,
    signal_words,
    words_and_unit,
)

NOTHING_LEFT = {
    "identified": "Nothing beyond noise, scatter and the model\u2019s usual error.",
    "nothing missing": "Nothing beyond noise, scatter and the model\u2019s usual error.",
    "unexplained": "The whole difference shown above.",
}
# Axes of forest plots: prior standard deviations, and decades of probability.
FOREST_STDS = (-4.0, 4.0)
LEAST_DECADE = -6.0
# Of the alternative hypotheses, the page lists so many at most, and none below this probability.
SHOWN_RIVALS = 7
NEGLIGIBLE = 0.001

ACCEPTANCE_TESTS = (
    HtmlColumn("Test"),
    HtmlColumn("Required", WORDS),
    HtmlColumn("Observed", WORDS),
    HtmlColumn("Result"),
)
HYPOTHESES = (
    HtmlColumn("Before the data", NUMBER),
    HtmlColumn("Probability", NUMBER),
    HtmlColumn("Prior (grey), posterior (dot); decades to 1", card=""),
    HtmlColumn("Log evidence", NUMBER),
    HtmlColumn("Model error", NUMBER),
)
NUISANCES = (
    HtmlColumn("Parameter"),
    HtmlColumn("Prior", NUMBER),
    HtmlColumn("Posterior", NUMBER),
    HtmlColumn("Unit", UNIT, card=""),
    HtmlColumn("Prior (grey bar), posterior (dot)", card=""),
)
KEY_OF_PRIOR = HtmlColumn("Key of the prior", "across")


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
    sections = [
        _residual_map(diagnosis),
        _located(diagnosis),
        omitted_physics(diagnosis),
        *other_families(diagnosis),
        _remaining(diagnosis),
        _measured_law(diagnosis),
        _moved_priors(diagnosis),
        _before_and_after(diagnosis),
        _acceptance_tests(diagnosis),
        _hypotheses(diagnosis),
        _nuisance_parameters(diagnosis),
        _excluded(diagnosis),
        _not_tested(diagnosis),
        _unexplained(diagnosis),
        _next_experiment(diagnosis),
        _remarks(diagnosis),
    ]
    return render_page(
        f"{diagnosis.title}: {diagnosis.grade}",
        opening(diagnosis, context),
        sections,
        context.origin,
        files,
        sheets=("verdict.css", "diagnosis.css"),
        closing=_settings(diagnosis),
    )


def _residual_map(diagnosis: Diagnosis) -> PageSection | None:
    maps = maps_of(diagnosis)
    if not maps:
        return None
    how_to_read = (
        "Numbers: rms difference between the recordings and the nominal model, in the unit of the "
        f"signal. Colour: the same in {SIGMA}, which is what noise, scatter between repeats, the "
        "model\u2019s usual error and the uncertainty of the nuisance parameters can do together. "
        f"A pointer shows {SIGMA}."
    )
    bands = [legend_box(words, f"b{band}") for band, words in enumerate(BAND_WORDS)]
    part = name_parts("condition", diagnosis.is_of_stretches)
    shown = [
        division("", subheading(residual_map.name), map_as_html(residual_map, part))
        for residual_map in maps
    ]
    return PageSection(
        "Where model and recordings differ",
        [
            aside(join(" ", [how_to_read, csv_links("residual-map.csv")])),
            legend(*bands, legend_box("framed and bold: located, more than chance", "found")),
            division("maps", *shown),
        ],
    )


def _located(diagnosis: Diagnosis) -> PageSection | None:
    if not diagnosis.cells and not diagnosis.located:
        return None
    if not diagnosis.located:
        return PageSection("Located", [paragraph("Nowhere more than chance allows.")], level=3)
    columns = (
        *_place_columns(),
        HtmlColumn("Size, rms", NUMBER),
        HtmlColumn(SIGMA, NUMBER),
        HtmlColumn("p", NUMBER),
        _conditions_column(diagnosis),
    )
    rows = [
        (
            *_place_cells(place),
            format_significant(place.sigmas, 2),
            format_p_value(place.p_value),
            _conditions(place, diagnosis),
        )
        for place in diagnosis.located
    ]
    what_is_p = "p is the probability that chance alone does this anywhere on the map."
    return PageSection("Located", [card_table("places", columns, rows), aside(what_is_p)], level=3)


def _place_columns() -> tuple[HtmlColumn, ...]:
    return (HtmlColumn("Signal"), HtmlColumn("Experiment"), HtmlColumn("Phase"))


def _place_cells(place: Located) -> tuple[str, ...]:
    """Where a difference is, and its size."""
    size = keep_units_together(f"{format_significant(place.size)} {place.unit}")
    return (signal_words(place.signal), place.experiment, place.phase, size)


def _conditions_column(diagnosis: Diagnosis) -> HtmlColumn:
    title = name_parts("conditions", diagnosis.is_of_stretches).capitalize()
    return HtmlColumn(title, WORDS)


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


def _remaining(diagnosis: Diagnosis) -> PageSection | None:
    if not diagnosis.remaining:
        return None
    what_is_usual = (
        "Where recordings and the best explanation still differ by more than chance. The usual "
        "error is what noise, scatter between repeats, the model\u2019s usual error and the "
        "uncertainty of the nuisance parameters can do together."
    )
    columns = (
        *_place_columns(),
        HtmlColumn("Remains, rms", NUMBER),
        HtmlColumn("Does it matter?", WORDS, card=""),
        _conditions_column(diagnosis),
    )
    rows = [
        (*_place_cells(place), compare_with_usual_error(place), _conditions(place, diagnosis))
        for place in diagnosis.remaining
    ]
    remaining = card_table("what remains", columns, rows)
    return PageSection("What remains", [aside(what_is_usual), remaining], level=3)


def _measured_law(diagnosis: Diagnosis) -> PageSection | None:
    stated = diagnosis.stated_law
    if stated is None:
        return None
    law = stated.law
    text = f"The residual law was {describe_law(stated)}."
    if law.memory is not None and law.memory.has_memory:
        text += (
            " The force differs between a rising and a falling argument, see the dotted branches: "
            "no single curve is right."
        )
    picture = bare_figure(draw_law(law, stated.curve), "small")
    return PageSection(f"The law at {law.place} as measured", [paragraph(text), picture])


def _moved_priors(diagnosis: Diagnosis) -> PageSection | None:
    if not diagnosis.moved_priors:
        return None
    texts = map(describe_moved_prior, diagnosis.moved_priors)
    return PageSection("Values that had to leave their priors", [bullets(texts)], level=3)


def _before_and_after(diagnosis: Diagnosis) -> PageSection | None:
    misfits = before_after_table(diagnosis)
    differing = {place.signal for place in (*diagnosis.located, *diagnosis.remaining)}
    pictures = pictures_of(diagnosis.overlays, differing)
    if not misfits.rows and not pictures:
        return None
    contents = []
    if misfits.rows:
        contents.append(as_html(misfits))
    if pictures:
        if diagnosis.is_of_stretches:
            measured = "measured"
        else:
            measured = "measured, mean over the repeats"
        contents.append(
            legend(
                legend_line("var(--measured)", 1.4, measured),
                legend_line("var(--other)", 1.8, "before", "6 3"),
                legend_line("var(--simulated)", 4.5, "after"),
            )
        )
        contents += [_curves(picture) for picture in pictures if not picture.summary]
        contents += [
            folded(picture.summary, _curves(picture)) for picture in pictures if picture.summary
        ]
        contents.append(aside(csv_links("signals.csv", "before-after.csv")))
    return PageSection("Before and after", contents)


def _curves(picture: Picture) -> Markup:
    return panels(picture.signal, picture.panels, picture.caption)


def _acceptance_tests(diagnosis: Diagnosis) -> PageSection | None:
    if not diagnosis.criteria:
        return None
    rows = []
    for row in acceptance_table(diagnosis).rows:
        test, required, observed, result = map(str, row.values.values())
        rows.append((test, required, observed, html('<span class="{}">{}</span>', result, result)))
    tests = card_table("acceptance tests", ACCEPTANCE_TESTS, rows)
    return PageSection("Acceptance tests", [tests])


def _hypotheses(diagnosis: Diagnosis) -> PageSection | None:
    """The most probable hypotheses, and how many others there are with which total probability.

    "Nothing missing" and "something unlisted" are always among the former: a reader looks for them.
    """
    ranked = sorted(diagnosis.rivals, key=lambda rival: -rival.probability)
    if not ranked:
        return None
    listed = [
        rival
        for rank, rival in enumerate(ranked)
        if rival.ids in ((), ("unknown",))
        or (rank < SHOWN_RIVALS and rival.probability >= NEGLIGIBLE)
    ]
    if not listed:
        return None
    best_evidence = max(rival.log_evidence for rival in ranked)
    rows = [_hypothesis(rival, best_evidence) for rival in listed]
    how_to_read = (
        "Log evidence is counted from the best; the model error is what is left over, as a share "
        "of the signals. Each is a whole set of effects; the verdict states only those that pass "
        "the tests above."
    )
    rest = [rival.probability for rival in ranked if rival not in listed]
    if rest:
        others = f"{count_noun(len(rest), 'other')}, together {format_probability(sum(rest))}"
        how_to_read = f"{others}. {how_to_read}"
    name_column = HtmlColumn("Changed" if diagnosis.is_since_reference else "Missing", WORDS)
    return PageSection(
        "Hypotheses",
        [
            card_table("hypotheses", (name_column, *HYPOTHESES), rows),
            *_explain_not_stated(diagnosis),
            aside(join(" ", [how_to_read, csv_links("hypotheses.csv")])),
        ],
    )


def _explain_not_stated(diagnosis: Diagnosis) -> list[Markup]:
    """Beside stated effects: why further effects of the most probable sets are not stated."""
    if not diagnosis.effects or not diagnosis.not_stated:
        return []
    items = [
        html("{} is not stated: {}.", code(effect_id), why)
        for effect_id, why in diagnosis.not_stated.items()
    ]
    return [bullets(items)]


def _hypothesis(rival: Rival, best_evidence: float) -> tuple[str, ...]:
    name = hypothesis(rival.ids)
    probability = format_probability(rival.probability)
    # Decades of probability: those of rivals differ by orders of magnitude.
    at, before = (
        max(log10(max(p, 1e-300)), LEAST_DECADE) for p in (rival.probability, rival.prior or 1.0)
    )
    prior = ""
    prior_bar = None
    hover = f"{name}: {probability}"
    if rival.prior is not None:
        prior = format_probability(rival.prior)
        prior_bar = (before, before, before)
        hover += f", before the data {prior}"
    forest = Markup(draw_forest(prior_bar, (at, at, at), (LEAST_DECADE, 0.0), hover))
    if rival.log_evidence < best_evidence:
        behind = format_significant(rival.log_evidence - best_evidence)
    else:
        behind = "0"
    model_error = f"{format_significant(100.0 * rival.model_error, 2)}\u00a0%"
    return (name, prior or NOTHING, probability, forest, behind, model_error)


def _nuisance_parameters(diagnosis: Diagnosis) -> PageSection | None:
    if not diagnosis.believed_values:
        return None
    keys = [diagnosis.nuisance_keys.get(name, "") for name in diagnosis.believed_values]
    rows = [_nuisance(diagnosis, name) for name in diagnosis.believed_values]
    columns: tuple[HtmlColumn, ...] = NUISANCES
    text = (
        "Before and after the fit, ± half of a 90 % interval. The axis spans ±4 prior standard "
        "deviations."
    )
    if any(keys):
        text += " The keys are those of [known_to] of the rig file, which state the priors."
        columns = (*columns, KEY_OF_PRIOR)
        cells = [code(name) if name else EMPTY for name in keys]
        rows = [(*row, cell) for row, cell in zip(rows, cells, strict=True)]
    return PageSection(
        "Nuisance parameters",
        [
            aside(join(" ", [text, csv_links("believed.csv")])),
            card_table("nuisance parameters", columns, rows),
        ],
    )


def _nuisance(diagnosis: Diagnosis, name: str) -> tuple[str | HtmlCell, ...]:
    """Cells of a nuisance parameter, drawn in prior standard deviations from its prior."""
    value = diagnosis.believed_values[name]
    words, unit = words_and_unit(name)
    unit = nuisance_unit(diagnosis, name) or unit
    shown_value = format_with_interval_90(value)
    prior = diagnosis.priors.get(name)
    shown_prior = ""
    forest = EMPTY
    if prior is not None and prior.std > 0.0 and isfinite(value.value):
        z = (value.value - prior.value) / prior.std
        half = STDS_90 * value.std / prior.std
        if not isfinite(half):
            half = 0.0
        shown_prior = format_with_interval_90(prior)
        hover = f"{words}: {shown_value} {unit}, prior {shown_prior} {unit}"
        prior_interval = (-STDS_90, 0.0, STDS_90)
        interval = (z - half, z, z + half)
        forest = Markup(draw_forest(prior_interval, interval, FOREST_STDS, hover, 0.0))
    return (HtmlCell(words, unit=unit), shown_prior, shown_value, unit, forest)


def _excluded(diagnosis: Diagnosis) -> PageSection | None:
    excluded = [effect for effect in diagnosis.not_seen if effect.would_have_seen is not None]
    if not excluded:
        return None
    text = (
        "Effects that are larger than this would have been detected, given what remains "
        "unexplained."
    )
    return PageSection("Excluded", [aside(text), bullets(map(_detectable, excluded), "list")])


def _detectable(effect: NotSeen) -> Markup:
    """An effect with the sizes from which it would have been detected."""
    size = sizes(effect.would_have_seen or {})
    text = code(effect.id)
    if size:
        text += html(": {}", size)
    description = describe_effect(effect.id)
    if description:
        text += html("<br><span>{}</span>", description)
    return text


def _not_tested(diagnosis: Diagnosis) -> PageSection | None:
    not_tested = [effect for effect in diagnosis.not_seen if effect.would_have_seen is None]
    if not not_tested:
        return None
    items = []
    for effect in not_tested:
        item = code(effect.id)
        if description := describe_effect(effect.id):
            item += html(" <span>{}</span>", description)
        items.append(item)
    text = "These data exclude no plausible size of these: they may be there or not."
    return PageSection("Not tested", [aside(text), bullets(items, "list")])


def _unexplained(diagnosis: Diagnosis) -> PageSection | None:
    nothing_left = NOTHING_LEFT.get(diagnosis.grade, "")
    if diagnosis.grade in ("mostly", "family"):
        title = "Why it is not identified"
    else:
        title = "Still unexplained"
    if diagnosis.unexplained:
        return PageSection(title, [bullets(map(with_typography, diagnosis.unexplained))])
    if nothing_left:
        return PageSection(title, [paragraph(nothing_left)])
    return None


def _next_experiment(diagnosis: Diagnosis) -> PageSection:
    proposal: Mapping[str, Any] = diagnosis.next_experiment or {}
    values = _proposed_values(proposal)
    if not values:
        return PageSection("Next experiment", [paragraph("None proposed.")])
    why = str(proposal.get("why", ""))
    reason = with_typography(f"{why[:1].upper()}{why[1:]}")
    contents = []
    if reason:
        contents.append(paragraph(f"{reason}."))
    protocol = proposal.get("protocol")
    if protocol:
        contents.append(
            paragraph(html("As a protocol: {}.", link(str(protocol), code(str(protocol)))))
        )
    contents.append(folded("All values of the proposal", pairs(values), is_open=not reason))
    return PageSection("Next experiment", contents)


def _proposed_values(proposal: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Values of the proposal in words. Each pair of hypotheses has the log evidence that the
    experiment is expected to give.
    """
    shown_elsewhere = ("why", "protocol", "separates")
    values = {name: value for name, value in proposal.items() if name not in shown_elsewhere}
    separated = [
        f"{rival} from {other}: {format_significant(log, 2)}"
        for rival, other, log in proposal.get("separates", ())
    ]
    if separated:
        values["separates by log evidence"] = separated
    return entries(values)


def _remarks(diagnosis: Diagnosis) -> PageSection | None:
    if not diagnosis.remarks:
        return None
    return PageSection("Remarks", [bullets(map(with_typography, diagnosis.remarks))])


def _settings(diagnosis: Diagnosis) -> Markup:
    """How the diagnosis was done, for the foot of the page."""
    settings = entries(diagnosis.settings)
    if not settings:
        return EMPTY
    return folded("Settings of the diagnosis", pairs(settings, "small columns"))
