"""diagnosis.html: one self-contained page."""

from collections.abc import Mapping, Sequence
from typing import Any

from rfca_rig.analysis.fitting.parameters import PARAMETERS
from rfca_rig.diagnosis.residual_force.law import StatedLaw
from rfca_rig.diagnosis.result import Diagnosis, Located, NamedEffect, NotSeen, Rival, Value
from rfca_rig.report.diagnosis_map import BAND_WORDS, maps_of
from rfca_rig.report.diagnosis_pictures import pictures_of
from rfca_rig.report.diagnosis_tables import before_after_table
from rfca_rig.report.diagnosis_wording import (
    describe_effect,
    describe_moved_prior,
    entries,
    format_p_value,
    format_probability,
    format_significant,
    format_with_interval_90,
    hypothesis,
    sizes,
)
from rfca_rig.report.law_files import describe_law
from rfca_rig.report.law_picture import draw_law
from rfca_rig.report.named_units import words_and_unit
from rfca_rig.report.provenance import Origin
from rfca_rig.report.templates import template
from rfca_rig.report.text import NOTHING, count_noun, keep_units_together

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
