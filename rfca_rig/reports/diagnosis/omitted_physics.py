"""Section of diagnosis.html on what the model lacks: the effects with their parameters; where none
is stated, their family, or the place where something acts.
"""

from collections.abc import Sequence
from math import isfinite, log10

from markupsafe import Markup

from rfca_rig.diagnosis.result import (
    Diagnosis,
    NamedEffect,
    StatedFamily,
    StatedPlace,
    Value,
    name_parts,
)
from rfca_rig.reports.diagnosis.pictures import draw_forest
from rfca_rig.reports.diagnosis.tables import (
    STDS_90,
    describe_effect,
    format_probability,
    format_with_interval_90,
    with_typography,
)
from rfca_rig.reports.elements import (
    EMPTY,
    code,
    division,
    html,
    join,
    paragraph,
    subheading,
)
from rfca_rig.reports.html_table import NUMBER, UNIT, HtmlCell, HtmlColumn, card_table
from rfca_rig.reports.page_units import page_name
from rfca_rig.reports.sections import PageSection
from rfca_rig.reports.text import format_significant, words_and_unit

EFFECT_PARAMETERS = (
    HtmlColumn("Parameter"),
    HtmlColumn("Value, ± half of a 90 % interval", NUMBER, card="Value"),
    HtmlColumn("Unit", UNIT, card=""),
    HtmlColumn("Plausible range", card="Plausible"),
    HtmlColumn("Prior (grey bar), posterior (dot)", card=""),
)


def omitted_physics(diagnosis: Diagnosis) -> PageSection | None:
    """The effects; where none is stated, their family, or the place where something acts."""
    if diagnosis.effects:
        return _effects(diagnosis)
    if diagnosis.grade == "family" and diagnosis.family is not None:
        return _family(diagnosis, diagnosis.family)
    if diagnosis.place is not None:
        return _place(diagnosis.place)
    return None


def _effects(diagnosis: Diagnosis) -> PageSection:
    is_identified = diagnosis.grade == "identified"
    contents = [_effect(effect, is_identified) for effect in diagnosis.effects]
    if diagnosis.explained_share is not None:
        parts = name_parts("conditions", diagnosis.is_of_stretches)
        share = (
            f"Share of the removable misfit on held-out {parts} that is explained: "
            f"{_explained_share(diagnosis.explained_share)}."
        )
        contents.insert(0, paragraph(share))
    if is_identified:
        return PageSection("What the model lacks", contents)
    return PageSection("What the model mostly lacks", contents)


def _explained_share(share: float) -> str:
    return f"{100.0 * share:.0f}\u00a0%"


def _effect(effect: NamedEffect, is_identified: bool) -> Markup:
    probability = format_probability(effect.probability)
    contents = [subheading(html("{} {}, {}", effect.left_out, code(effect.id), probability))]
    if effect.wording:
        contents.append(paragraph(with_typography(effect.wording)))
    if effect.parameters:
        rows = [_parameter(effect, name, value) for name, value in effect.parameters.items()]
        contents.append(card_table(f"parameters of {effect.id}", EFFECT_PARAMETERS, rows))
    if effect.cannot_tell_from:
        others = _alternatives(effect.cannot_tell_from)
        contents.append(paragraph(html("These data cannot tell it from {}.", others)))
    elif is_identified:
        contents.append(paragraph("Nothing else in the catalogue explains these data as well."))
    return division("effect", *contents)


def _alternatives(ids: Sequence[str]) -> Markup:
    """Effects with what they stand for, as in "a, b or c"."""
    names = []
    for effect_id in ids:
        name = code(effect_id)
        if description := describe_effect(effect_id):
            name += html(" ({})", description)
        names.append(name)
    *first, last = names
    if first:
        return html("{} or {}", join(", ", first), last)
    return last


def _parameter(effect: NamedEffect, name: str, value: Value) -> tuple[str | HtmlCell, ...]:
    """Cells of a parameter, with its plausible range as the prior where it has one."""
    words, unit = words_and_unit(name)
    shown_value = format_with_interval_90(value)
    hover = f"{words}: {shown_value} {unit}"
    plausible = _plausible_range(effect, name)
    range_words = ""
    forest = EMPTY
    if isfinite(value.value) and plausible is None:
        forest = _forest_from_zero(value, hover)
    elif isfinite(value.value) and plausible is not None:
        lowest, highest = map(format_significant, plausible)
        range_words = f"{lowest} to {highest}"
        forest = _forest_in_range(value, plausible, f"{hover}, plausible {range_words} {unit}")
    return (HtmlCell(words, unit=unit), shown_value, unit, range_words, forest)


def _plausible_range(effect: NamedEffect, name: str) -> tuple[float, float] | None:
    """Ends of the parameter's plausible range in the unit of the page, None where it has none."""
    for parameter, (lowest, highest) in effect.plausible.items():
        shown_name, factor = page_name(parameter)
        if shown_name == name:
            return factor * lowest, factor * highest
    return None


def _half_90(value: Value) -> float:
    if not isfinite(value.std):
        return 0.0
    return STDS_90 * value.std


def _forest_from_zero(value: Value, hover: str) -> Markup:
    """Without a plausible range the axis shows how far the value is from zero."""
    half = _half_90(value)
    interval = (value.value - half, value.value, value.value + half)
    reach = (min(0.0, 1.1 * interval[0]), max(0.0, 1.1 * interval[2]))
    if reach[0] < reach[1]:
        return Markup(draw_forest(None, interval, reach, hover, 0.0))
    return EMPTY


def _forest_in_range(value: Value, plausible: tuple[float, float], hover: str) -> Markup:
    half = _half_90(value)
    lowest, highest = plausible
    ends = [lowest, highest, value.value - half, value.value, value.value + half]
    # A range over more than a decade is drawn on a logarithmic axis.
    if min(ends) > 0.0 and highest > 10.0 * lowest:
        ends = [log10(end) for end in ends]
    low, high, *posterior = ends
    prior = (low, 0.5 * (low + high), high)
    interval = (posterior[0], posterior[1], posterior[2])
    return Markup(draw_forest(prior, interval, (min(ends), max(ends)), hover))


def _family(diagnosis: Diagnosis, family: StatedFamily) -> PageSection:
    text = html("{} ({}). {}", family.words, family.place, _members(family))
    if diagnosis.explained_share is not None:
        parts = name_parts("conditions", diagnosis.is_of_stretches)
        share = _explained_share(diagnosis.explained_share)
        pattern = "{} The best of their laws explains {} of the removable misfit on held-out {}."
        text = html(pattern, text, share, parts)
    if diagnosis.is_since_reference:
        title = "What kind of effect has changed"
    else:
        title = "What kind of effect is missing"
    return PageSection(title, [paragraph(text)])


def _members(family: StatedFamily) -> Markup:
    return html("Of its members, these were tried: {}.", join(", ", map(code, family.members)))


def _place(place: StatedPlace) -> PageSection:
    probability = format_probability(place.probability)
    return PageSection("Where it acts", [paragraph(f"{place.id} ({probability}): {place.words}.")])


def other_families(diagnosis: Diagnosis) -> list[PageSection]:
    """Families beside the stated effects, a section for each."""
    sections = []
    for family in diagnosis.other_families:
        probability = format_probability(family.probability)
        title = f"Beside it, only the family is clear: {family.words}, {probability}"
        text = html("It acts at: {}. {}", family.place, _members(family))
        sections.append(PageSection(title, [paragraph(text)], level=3))
    return sections
