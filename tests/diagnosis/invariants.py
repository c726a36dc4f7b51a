"""What no answer may say, because its own numbers deny it.

`list_contradictions` compares the parts of a Diagnosis with each other. It needs neither the
recordings nor the truth, so it holds for every answer that any test makes.
"""

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping

from rfca_rig.diagnosis.config import IDENTIFIED_PROBABILITY
from rfca_rig.diagnosis.result import BeforeAfter, Diagnosis, Rival, describe_probability
from rfca_rig.model.catalogue import catalogue
from rfca_rig.model.declarations.changes import VALUE_OF_CHANGE
from rfca_rig.reports.diagnosis.left_out import measure_misfits

NAMED_GRADES = ("identified", "mostly")
STATED_GRADES = (*NAMED_GRADES, "family")
UNKNOWN = "unknown"
# the words of rfca-diagnosis/1; every other grade is its own verdict
VERDICTS = {"identified": "named", "mostly": "unexplained", "family": "unexplained"}
# more probable than everything else together
HALF = 0.5
# of a set in the table, from which its effects may be there
MAX_EXCLUDED_PROBABILITY = 0.01
# share by which the held-out rms of all signals may rise: what linear prediction errs by
MAX_RISE = 0.05
# of probabilities that are the same quantity, computed once
SAME_PROBABILITY = 1e-6
# Nominal values of a mechanism whose error acts exactly like an effect. Its effects are made for
# each mechanism, so that the catalogue does not list them. Offsets of prescribed joints have no
# fixed name, and are not compared.
SAME_AS_IN_MECHANISMS = {
    "contact_stiffness": "contact_stiffness_relative",
    "contact_damping": "contact_damping_relative",
    "contact_friction": "contact_friction_relative",
}
PERCENTAGE = re.compile(r"([<>]?) ?(\d+(?:\.(\d+))?) ?%")
SET_WITH_PERCENTAGE = re.compile(r"([a-z]\w*(?: with [a-z]\w*)*) \(([<>]? ?\d+(?:\.\d+)? ?%)\)")
EXPLAINED_PERCENTAGE = re.compile(r"explains (-?\d+(?:\.\d+)?) ?% of the misfit")
# a clause ends with a comma, a semicolon, a colon, or a full stop that is no decimal point
END_OF_CLAUSE = re.compile(r"[;,:]|\.(?!\d)")


def list_contradictions(diagnosis: Diagnosis) -> list[str]:
    """The contradictions between parts of an answer, in one sentence each."""
    checks = (
        _check_table,
        _check_grade,
        _check_criteria,
        _check_other_families,
        _check_nothing,
        _check_stated_set,
        _check_not_stated,
        _check_exclusions,
        _check_held_out,
        _check_left_out,
        _check_probability,
        _check_sentence,
        _check_nuisances,
    )
    contradictions = []
    for check in checks:
        contradictions.extend(check(diagnosis))
    return contradictions


def probability_of_set(diagnosis: Diagnosis, ids: tuple[str, ...]) -> float:
    """Probability of a set of effects in the table, 0 where the table does not list it."""
    wanted = sorted(ids)
    return sum(row.probability for row in diagnosis.rivals if sorted(row.ids) == wanted)


def _check_table(diagnosis: Diagnosis) -> Iterator[str]:
    """The table is a distribution over sets, each of which stands in one row."""
    total = sum(row.probability for row in diagnosis.rivals)
    if total > 1.0 + SAME_PROBABILITY:
        yield f"The probabilities of the table sum to {total:.4f}."
    for row in diagnosis.rivals:
        if not 0.0 <= row.probability <= 1.0 + SAME_PROBABILITY:
            yield f"The table gives {_name(row)} a probability of {row.probability:.4g}."
    rows = Counter(tuple(sorted(row.ids)) for row in diagnosis.rivals)
    for ids, count in rows.items():
        if count > 1:
            yield f"The table lists the set {_name_ids(ids)} {count} times."


def _check_grade(diagnosis: Diagnosis) -> Iterator[str]:
    """What is stated suits the grade, the verdict, the criteria and the model that is written."""
    grade = diagnosis.grade
    stated = {effect.id for effect in diagnosis.effects}
    written = {effect.id for effect in diagnosis.found_effects}
    expected = VERDICTS.get(grade, grade)
    if diagnosis.verdict != expected:
        yield f"The grade is {grade!r}, but the verdict is {diagnosis.verdict!r}."
    if grade in NAMED_GRADES and not stated:
        yield f"The grade is {grade!r}, but no effect is stated."
    if grade not in NAMED_GRADES and stated:
        yield f"The grade is {grade!r}, but {_join(stated)} is stated."
    if grade == "family" and diagnosis.family is None:
        yield "The grade is 'family', but no family is stated."
    if grade not in STATED_GRADES and diagnosis.family is not None:
        yield f"The grade is {grade!r}, but the family {diagnosis.family.id} is stated."
    # A value that has changed stands in the model as that value.
    lacking = stated - written - VALUE_OF_CHANGE.keys()
    if lacking:
        yield f"The effects {_join(lacking)} are stated, but the fitted model lacks them."
    if grade not in STATED_GRADES and written:
        yield f"The grade is {grade!r}, but the fitted model has {_join(written)}."


def _check_criteria(diagnosis: Diagnosis) -> Iterator[str]:
    """What is identified passed every criterion."""
    if diagnosis.grade != "identified":
        return
    for criterion in diagnosis.criteria:
        if not criterion.passed:
            yield f"The grade is 'identified', but {criterion.name} failed: {criterion.found}."


def _check_other_families(diagnosis: Diagnosis) -> Iterator[str]:
    """Further families are stated beside a statement only, are as sure, and say something else
    than the stated effects.
    """
    stated = {effect.id for effect in diagnosis.effects}
    for family in diagnosis.other_families:
        if diagnosis.grade not in STATED_GRADES:
            yield f"The grade is {diagnosis.grade!r}, but the family {family.id} is stated."
        if family.probability < IDENTIFIED_PROBABILITY:
            yield (
                f"The family {family.id} is stated with a probability of {family.probability:.4f}."
            )
        if stated & set(family.members):
            yield (
                f"The family {family.id} is stated beside "
                f"{_join(stated & set(family.members))}, which belongs to it."
            )


def _check_nothing(diagnosis: Diagnosis) -> Iterator[str]:
    """The grade and the table agree on whether anything is missing."""
    nothing = probability_of_set(diagnosis, ())
    if diagnosis.grade == "nothing missing" and nothing <= HALF:
        yield f"Nothing is said to be missing, but the table gives nothing {nothing:.2g}."
    if diagnosis.grade in STATED_GRADES and nothing > HALF:
        stated = _describe_statement(diagnosis)
        yield f"{stated} is stated, but the table gives nothing {nothing:.4f}."
    says_doubt = diagnosis.sentence.startswith("More probably than not nothing")
    if diagnosis.grade == "unexplained" and says_doubt != (nothing > HALF):
        says = "Nothing" if says_doubt else "Something"
        yield f"{says} is said to be missing, but the table gives nothing {nothing:.4f}."


def _check_stated_set(diagnosis: Diagnosis) -> Iterator[str]:
    """The stated effects are in a set of the table, and no set without them is probable."""
    stated = {effect.id for effect in diagnosis.effects}
    is_listed = any(stated <= set(row.ids) for row in diagnosis.rivals)
    if diagnosis.grade in NAMED_GRADES and stated and not is_listed:
        yield f"The stated set {_join(stated)} is in no row of the table, nor part of a row."
    if diagnosis.grade not in STATED_GRADES:
        return
    possible = _list_stated(diagnosis)
    for row in diagnosis.rivals:
        has_effects = row.ids and UNKNOWN not in row.ids
        if has_effects and row.probability > HALF and possible.isdisjoint(row.ids):
            yield (
                f"{_describe_statement(diagnosis)} is stated, but the table gives"
                f" {_name(row)}, which has nothing of it, {row.probability:.4f}."
            )


def _check_not_stated(diagnosis: Diagnosis) -> Iterator[str]:
    """In a set that is more probable than all others together, every effect beside stated ones
    has a reason why it is not stated.
    """
    stated = _list_stated(diagnosis)
    for row in diagnosis.rivals:
        is_with_stated = not stated.isdisjoint(row.ids)
        if diagnosis.effects and is_with_stated and row.probability > HALF:
            for effect_id in sorted(set(row.ids) - stated - diagnosis.not_stated.keys()):
                yield f"{effect_id} is in {_name(row)} and is not stated, without a reason."


def _check_exclusions(diagnosis: Diagnosis) -> Iterator[str]:
    """No effect is excluded that is stated, may be there, or may hide in a nominal value."""
    moved = {parameter.name: parameter for parameter in diagnosis.moved_priors}
    same_as = _list_same_as()
    times = Counter(exclusion.id for exclusion in diagnosis.not_seen)
    for effect_id, count in times.items():
        if count > 1:
            yield f"The list of exclusions has {effect_id} {count} times."
    for exclusion in diagnosis.not_seen:
        if exclusion.would_have_seen is None:
            continue
        limits = [f"{name} {value:g}" for name, value in exclusion.would_have_seen.items()]
        excluded = f"{exclusion.id} is excluded from {_join(limits)}"
        for name, value in exclusion.would_have_seen.items():
            # a factor does nothing at 1, any other size at 0
            if value == (1.0 if name.endswith("factor") else 0.0):
                yield f"{excluded}, where it does nothing."
        for objection in _list_objections(diagnosis, exclusion.id):
            yield f"{excluded}, but {objection}."
        parameter = moved.get(same_as.get(exclusion.id, ""))
        if parameter is not None:
            yield (
                f"{excluded}, but {parameter.name}, which acts exactly like it,"
                f" moved by {parameter.deviations:+.1f} prior standard deviations."
            )


def _list_objections(diagnosis: Diagnosis, effect_id: str) -> Iterator[str]:
    """What the statement and the table say against the exclusion of an effect."""
    stated = {effect.id for effect in diagnosis.effects}
    alternatives = {other for effect in diagnosis.effects for other in effect.cannot_tell_from}
    members = set(diagnosis.family.members) if diagnosis.family is not None else set()
    if effect_id in stated:
        yield "it is stated"
    elif effect_id in alternatives:
        yield "a stated effect cannot be told from it"
    elif effect_id in members:
        yield f"it is a member of the stated family {diagnosis.family.id}"
    for row in diagnosis.rivals:
        if effect_id in row.ids and row.probability > MAX_EXCLUDED_PROBABILITY:
            yield f"the table gives {_name(row)} {row.probability:.4f}"


def _check_held_out(diagnosis: Diagnosis) -> Iterator[str]:
    """What is stated predicts held-out conditions at least as well as the nominal model."""
    if diagnosis.grade not in STATED_GRADES or not diagnosis.held_out:
        return
    figures = list(diagnosis.held_out.values())
    before = _root_mean_square([figure.before / _unit_of(figure) for figure in figures])
    after = _root_mean_square([figure.after / _unit_of(figure) for figure in figures])
    if not after <= (1.0 + MAX_RISE) * before:
        signals = []
        for name, figure in diagnosis.held_out.items():
            signals.append(f"{name} {figure.before:.3g} -> {figure.after:.3g}")
        yield (
            f"{_describe_statement(diagnosis)} is stated, but the held-out rms of all signals rises"
            f" from {before:.3g} to {after:.3g} noise floors: {_join(signals)}."
        )


def _check_left_out(diagnosis: Diagnosis) -> Iterator[str]:
    """With what is stated, left-out conditions are missed by no more at the commanded motion, and
    the errors of their valleys are the averages that are stated.
    """
    misfits = measure_misfits(diagnosis.left_out)
    if diagnosis.grade in STATED_GRADES and misfits:
        before = _root_mean_square(
            [misfit.before / _unit_of(misfit) for misfit in misfits.values()]
        )
        after = _root_mean_square([misfit.after / _unit_of(misfit) for misfit in misfits.values()])
        if not after <= (1.0 + MAX_RISE) * before:
            yield (
                f"{_describe_statement(diagnosis)} is stated, but left-out conditions are missed by"
                f" {after:.3g} instead of {before:.3g} noise floors."
            )
    valleys = [condition.valley for condition in diagnosis.left_out if condition.valley is not None]
    for name, errors in (
        ("valley_time_error_pct", [valley.time_error_pct for valley in valleys]),
        ("valley_force_error_pct", [valley.force_error_pct for valley in valleys]),
    ):
        stated = diagnosis.valley.get(name)
        if errors and stated is not None:
            average = sum(error.after for error in errors) / len(errors)
            if not math.isclose(stated.after, average, rel_tol=1e-6):
                yield f"{name} is {stated.after:.6g}, but its rows have {average:.6g} on average."


def _check_probability(diagnosis: Diagnosis) -> Iterator[str]:
    """The probability of the statement is that of the table, of its effects or of its family."""
    grade = diagnosis.grade
    stated = diagnosis.probability
    share = diagnosis.explained_share
    if share is not None and not share <= 1.0 + SAME_PROBABILITY:
        yield f"The stated effects explain a share of {share:.6g} of the misfit."
    if stated is None:
        return
    if not 0.0 <= stated <= 1.0:
        yield f"The probability of the answer is {stated:.4g}."
    nothing = probability_of_set(diagnosis, ())
    if grade == "nothing missing" and abs(stated - nothing) > SAME_PROBABILITY:
        yield f"Nothing is missing with {stated:.6f}, but the table gives nothing {nothing:.6f}."
    if grade == "unexplained" and abs(stated - (1.0 - nothing)) > SAME_PROBABILITY:
        yield f"Something is missing with {stated:.6f}, but the table gives nothing {nothing:.6f}."
    parts = [(effect.id, effect.probability) for effect in diagnosis.effects]
    if grade == "family" and diagnosis.family is not None:
        parts.append((diagnosis.family.id, diagnosis.family.probability))
    for name, probability in parts:
        # the answer says that all of them are missing
        if stated > probability + SAME_PROBABILITY:
            yield f"The answer has a probability of {stated:.4f}, but {name} has {probability:.4f}."


def _check_sentence(diagnosis: Diagnosis) -> Iterator[str]:
    """A percentage in the sentence of the answer is that of the table or of the explained share."""
    nothing = probability_of_set(diagnosis, ())
    for clause in END_OF_CLAUSE.split(diagnosis.sentence):
        quoted = [match.group() for match in PERCENTAGE.finditer(clause)]
        is_about_nothing = re.search(r"\bnothing\b", clause, re.IGNORECASE) is not None
        if is_about_nothing and quoted and not any(_is_rounded(text, nothing) for text in quoted):
            in_table = describe_probability(nothing)
            quoted_text = f"{_join(quoted)} for nothing"
            yield f"The sentence quotes {quoted_text}, but the table gives {in_table}."
    for match in SET_WITH_PERCENTAGE.finditer(diagnosis.sentence):
        ids = tuple(match.group(1).split(" with "))
        probability = probability_of_set(diagnosis, ids)
        # words in front of a percentage that are no ids of effects
        is_set = any(sorted(row.ids) == sorted(ids) for row in diagnosis.rivals)
        if is_set and not _is_rounded(match.group(2), probability):
            quoted_set = f"{match.group(2)} for {_name_ids(ids)}"
            in_table = describe_probability(probability)
            yield f"The sentence quotes {quoted_set}, but the table gives {in_table}."
    for match in EXPLAINED_PERCENTAGE.finditer(diagnosis.sentence):
        share = diagnosis.explained_share
        # half a percent: the sentence has whole percents
        if share is None or abs(float(match.group(1)) - 100.0 * share) > 0.5 + 1e-6:
            yield (
                f"The sentence says that {match.group(1)} % are explained,"
                f" but the explained share is {'not given' if share is None else f'{share:.4f}'}."
            )


def _check_nuisances(diagnosis: Diagnosis) -> Iterator[str]:
    """A moved nominal value has the same numbers in both tables."""
    for parameter in diagnosis.moved_priors:
        for table, value in (
            (diagnosis.believed_values, parameter.now),
            (diagnosis.priors, parameter.prior),
        ):
            name = parameter.name
            listed = table.get(name)
            if listed is not None and not math.isclose(listed.value, value.value, rel_tol=1e-6):
                moved = f"{name} is {value.value:.6g} among the moved values"
                yield f"{moved}, but {listed.value:.6g} among all nominal values."


def _list_stated(diagnosis: Diagnosis) -> set[str]:
    """The stated effects, what cannot be told from them, and the members of the family."""
    ids = set()
    for effect in diagnosis.effects:
        ids |= {effect.id, *effect.cannot_tell_from}
    if diagnosis.family is not None:
        ids |= set(diagnosis.family.members)
    return ids


def _list_same_as() -> Mapping[str, str]:
    """By effect, the nominal value whose error acts exactly like it."""
    same_as = {effect.id: effect.same_as for effect in catalogue().values() if effect.same_as}
    return {**same_as, **SAME_AS_IN_MECHANISMS}


def _describe_statement(diagnosis: Diagnosis) -> str:
    if diagnosis.effects:
        return _join(effect.id for effect in diagnosis.effects)
    if diagnosis.family is None:
        return "a family"
    return f"the family {diagnosis.family.id}"


def _unit_of(figure: BeforeAfter) -> float:
    """The noise floor of a signal, or its rms before where the floor is not known."""
    return figure.noise_floor or figure.before or 1.0


def _root_mean_square(values: list[float]) -> float:
    return math.sqrt(sum(value**2 for value in values) / len(values))


def _is_rounded(text: str, probability: float) -> bool:
    """Whether a percentage, such as "97 %", "99.9 %" or "< 0.1 %", is this probability."""
    match = PERCENTAGE.search(text)
    if match is None:
        return False
    sign, number, decimals = match.groups()
    percent = 100.0 * probability
    if sign == "<":
        return percent <= float(number)
    half_digit = 0.5 * 10.0 ** -len(decimals or "")
    # "> 99.9 %" begins where 100.0 % would be printed
    if sign == ">":
        return percent >= float(number)
    return abs(percent - float(number)) <= half_digit + 1e-9


def _name(row: Rival) -> str:
    return _name_ids(row.ids)


def _name_ids(ids: tuple[str, ...]) -> str:
    return " with ".join(ids) or "nothing"


def _join(words: Iterable[str]) -> str:
    return ", ".join(sorted(words))
