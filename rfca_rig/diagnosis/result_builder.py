"""Assemble the answer from a decision: the part that is common to all kinds of rig, also in
sentences.

With the figures before and after: residuals of the fit and on held-out conditions, and curves to
draw.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.config import (
    MOST_RIVALS,
    MOVED_PRIOR_STD,
    NOTHING_PROBABILITY,
    PRIOR_NOTHING,
    PRIOR_ONE,
    PRIOR_TWO,
    PRIOR_UNKNOWN,
    VISIBLE_PROBABILITY,
)
from rfca_rig.diagnosis.data import Label, Observations, rms
from rfca_rig.diagnosis.decision.decision import HELD_OUT, STATED_GRADES, Decision
from rfca_rig.diagnosis.decision.sizes import find_detection_limits, power_to_exclude
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis, ModelSelectionResult
from rfca_rig.diagnosis.inference.screening import make_projection
from rfca_rig.diagnosis.residual_force.mismatch_map import locate_mismatch
from rfca_rig.diagnosis.result import (
    TIME_WAS_UP,
    BeforeAfter,
    Criterion,
    Diagnosis,
    Located,
    MovedPrior,
    NotSeen,
    Rival,
    SignalOverlay,
    Value,
    describe_probability,
    name_parts,
)
from rfca_rig.model.catalogue import list_effects_like
from rfca_rig.model.declarations.changes import VALUE_OF_CHANGE
from rfca_rig.model.effect import Effect
from rfca_rig.model.parameters import PresentEffect

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Wording:
    """How an answer says what it states.

    Parameters
    ----------
    lacks, mostly, family
        Before the stated effects or family, by grade.
    nothing
        Where nothing is missing.
    something
        What is there where nothing can be stated.
    visible
        The difference that is within the usual model error.
    doubtful
        Where nothing is more probable than all sets, though the difference is larger than usual.
    """

    lacks: str
    mostly: str
    family: str
    nothing: str
    something: str
    visible: str
    doubtful: str


OF_MODEL = Wording(
    lacks="The model lacks:",
    mostly="Mostly missing:",
    family="Of the cause only the family is clear:",
    nothing="Nothing is missing that these recordings would show.",
    something="Something is missing",
    visible="The difference is within the usual model error, but visible:",
    doubtful="More probably than not nothing is missing, though the recordings differ from the "
    "model by more than usual",
)


def describe(decision: Decision, words: Wording = OF_MODEL) -> str:
    """What is stated, in one or two sentences."""
    stated = " and ".join(f"{effect.left_out} ({effect.id})" for effect in decision.effects)
    explains = (
        f"explains {100.0 * decision.explained_share:.0f} % of the misfit that can be removed "
        "on held-out conditions"
    )
    if decision.relieved_strain:
        explains = f"takes the place of an implausible value ({decision.relieved_strain})"
    beside = "".join(
        (
            f" Beside it, only the family is clear: {family.words} "
            f"({describe_probability(family.probability)})."
        )
        for family in decision.other_families
    )
    if decision.grade == "identified":
        others = sorted({other for effect in decision.effects for other in effect.cannot_tell_from})
        if others:
            tail = f"; these data cannot tell it from {', '.join(others)}"
        else:
            tail = ""
        return f"{words.lacks} {stated}{tail}.{beside}"
    if decision.grade == "mostly":
        is_exact = all(
            criterion.passed for criterion in decision.criteria if criterion.name == HELD_OUT
        )
        if is_exact:
            caution = "other causes are possible"
        else:
            caution = "the law is only approximate"
        return f"{words.mostly} {stated}. It {explains}; {caution}.{beside}"
    if decision.grade == "family" and decision.family is not None:
        best = " with ".join(decision.explanation.ids)
        return (
            f"{words.family} {decision.family.words}. The best law of "
            f"it, {best}, {explains}.{beside}"
        )
    if decision.grade == "not enough data":
        return f"Not enough data for a verdict: {decision.criteria[0].found}."
    if decision.grade == "nothing missing":
        return words.nothing
    return describe_open(decision, words)


def describe_open(decision: Decision, words: Wording) -> str:
    """What is known where nothing is stated, and something may be missing."""
    if decision.is_unfinished:
        if decision.closest is None:
            return "The time was up before any effect was tried."
        best = " with ".join(decision.closest.ids)
        return (
            f"The time was up before every effect was tried. So far, {best} explains most, which "
            "is not stated."
        )
    if decision.alternatives and decision.within_usual:
        return f"{words.visible} {describe_alternatives(decision.alternatives)}."
    if decision.probability < 1.0 - NOTHING_PROBABILITY:
        visible = [row for row in decision.alternatives if row.probability > VISIBLE_PROBABILITY]
        if visible:
            return f"{words.doubtful}: {describe_alternatives(visible)}."
        return f"{words.doubtful}."
    is_explained = any(
        criterion.passed for criterion in decision.criteria if criterion.name == HELD_OUT
    )
    if decision.alternatives and is_explained:
        return (
            f"{words.something}, and no cause is sure enough to be stated: "
            f"{describe_alternatives(decision.alternatives)}."
        )
    if decision.closest:
        closest = (
            f" The closest entry is {' with '.join(decision.closest.ids)}, which is not stated."
        )
    else:
        closest = ""
    return f"{words.something} that no entry of the catalogue explains.{closest}"


def describe_alternatives(sets: Sequence[Rival]) -> str:
    """Sets of effects of a table with their probabilities, and the probability of all together."""
    listed = ", ".join(
        f"{' with '.join(row.ids)} ({describe_probability(row.probability)})" for row in sets
    )
    if len(sets) == 1:
        return listed
    return f"one of {listed}; together {describe_probability(sum(row.probability for row in sets))}"


def describe_refusal(decision: Decision) -> tuple[str, ...]:
    """What came closest and why it is not identified, one line each; none where nothing is left
    to explain.
    """
    if decision.grade in ("identified", "nothing missing", "not enough data"):
        return ()
    closest = (
        (f"closest is {' with '.join(decision.closest.ids)}, not claimed",)
        if decision.closest
        else ()
    )
    return (
        *closest,
        *(
            f"{criterion.name}: {criterion.found}"
            for criterion in decision.criteria
            if not criterion.passed
        ),
    )


def build_result(
    title: str,
    found: ModelSelectionResult,
    decision: Decision,
    effects: Sequence[Effect],
    experiment: str,
) -> Diagnosis:
    """The answer about one set of observations.

    Parameters
    ----------
    title
        What was diagnosed.
    found, decision
        The search and its decision.
    effects
        The effects that were looked for.
    experiment
        The experiment whose figures are shown.
    """
    explanation = decision.explanation
    # no effect is added to the model while only its family is clear
    if decision.effects or not explanation.ids:
        used = explanation
    else:
        used = found.nothing
    cells, places = locate_mismatch(found.dataset.rows, found.nominal, found.likelihood)
    is_open = decision.grade in ("mostly", "family", "unexplained")
    # Where recordings and explanation still differ, worst first.
    remaining: tuple[Located, ...] = ()
    if is_open:
        _, remaining = locate_mismatch(
            found.dataset.rows,
            replace(explanation.fitted, predicted=explanation.rows),
            found.likelihood,
        )
    is_stated = decision.grade in STATED_GRADES
    not_tested = tuple(
        NotSeen(effect.id, None) for effect in effects if effect.id not in decision.suspects
    )
    return Diagnosis(
        title=title,
        verdict=decision.verdict,
        sentence=name_parts(
            describe(decision), any(label.recording for label in found.dataset.rows.labels)
        ),
        located=places,
        cells=cells,
        effects=decision.effects,
        criteria=decision.criteria,
        rivals=decision.list_rivals(MOST_RIVALS),
        not_seen=_find_not_seen(found, explanation, decision.suspects, effects)
        if decision.predicts_as_usual
        else not_tested,
        fit=compare_residuals(found, explanation, experiment),
        held_out=compare_held_out(found, explanation, experiment),
        valley={},
        unexplained=describe_refusal(decision),
        remarks=_describe_end(found),
        next_experiment=None,
        believed_values=nuisance_values(explanation),
        priors=nuisance_priors(explanation),
        nuisance_units=nuisance_units(explanation),
        nuisance_keys=nuisance_keys(explanation),
        overlays=make_overlays(found, explanation, experiment),
        settings=_settings(found, effects),
        found_effects=present_effects(used),
        found_rig=used.fitted.coordinates.supposed(_possible_mean(used)).rig,
        grade=decision.grade,
        probability=None if decision.grade == "not enough data" else decision.probability,
        family=decision.family,
        other_families=decision.other_families,
        not_stated=decision.not_stated,
        # what takes the place of an implausible value removes no more misfit than that did
        explained_share=decision.explained_share
        if is_stated and not decision.relieved_strain
        else None,
        remaining=remaining,
        moved_priors=list_moved_priors(explanation),
        support=tuple(asdict(support) for support in decision.supported),
    )


def _describe_end(found: ModelSelectionResult) -> tuple[str, ...]:
    """A remark where the search ended before its end."""
    if not found.ended_in:
        return ()
    if found.tried_each_effect:
        rest = "larger sets of effects may explain more"
    else:
        rest = "not every effect was tried, so that none is stated"
    return (f"{TIME_WAS_UP} in the stage {found.ended_in!r}: {rest}; give more --minutes",)


def not_enough_data(found: ModelSelectionResult, why: str) -> Decision:
    """The decision where the recordings are too few for one."""
    return Decision(
        "not enough data", found.nothing, criteria=(Criterion("conditions", False, why),)
    )


def present_effects(hypothesis: Hypothesis) -> tuple[PresentEffect, ...]:
    """The effects of a hypothesis with the values found. A value that has changed is no effect of
    the rig: it is among the rig's own values.
    """
    coordinates = hypothesis.fitted.coordinates
    mean = hypothesis.marginal.posterior.mean
    return tuple(
        choice.present(mean[coordinates.part(number)])
        for number, choice in enumerate(coordinates.choices)
        if choice.effect.id not in VALUE_OF_CHANGE
    )


def _find_not_seen(
    search: ModelSelectionResult,
    explanation: Hypothesis,
    suspects: Collection[str],
    effects: Sequence[Effect],
) -> tuple[NotSeen, ...]:
    """Detection limits on the subset of the conditions that was screened; all conditions would
    exclude a little more.

    Remaining misfit could hide an effect. It counts as discrepancy, at least the usual one. So
    could a nuisance parameter that has moved far: it may have taken the place of the effect, so
    that its prior does not hold here. What acts much as it does is not excluded at all, because the
    fit may have found one of two optima. Nor is an effect that is the same as a nuisance parameter.
    """
    fit = explanation.fitted
    rows = search.in_coarse
    fitted = replace(fit, predicted=fit.predicted[rows], jacobian=fit.jacobian[rows])
    measured = search.dataset.rows.measured[rows]
    moved = np.flatnonzero(
        np.abs(explanation.marginal.posterior.mean[: fit.coordinates.nuisances]) > MOVED_PRIOR_STD
    )
    # The probes were simulated on the subset only.
    projection = make_projection(
        fitted, measured, search.coarse.level(fitted.linear(measured)), moved.tolist()
    )
    names = fit.coordinates.space.names
    same = {effect.id for effect in effects if effect.same_as in names}
    imitated = same | list_effects_like([names[index] for index in moved])
    others = [effect for effect in effects if effect.id not in imitated.union(suspects)]
    needed = power_to_exclude(len(others))

    def power_of(signature: Floats) -> float:
        return projection.speaks_against(signature, needed)

    return find_detection_limits(
        others, search.probes, power_of, search.nominal.coordinates.space.centre.rig, needed
    )


def list_moved_priors(hypothesis: Hypothesis) -> tuple[MovedPrior, ...]:
    """Nuisance parameters beyond MOVED_PRIOR_STD prior standard deviations, farthest first."""
    space = hypothesis.fitted.coordinates.space
    posterior = hypothesis.marginal.posterior
    priors = nuisance_priors(hypothesis)
    values = nuisance_values(hypothesis)
    # In the posterior the effects follow the nuisance parameters.
    shifts = space.prior_shifts(posterior.mean[: len(space.std)])
    moved = [
        MovedPrior(p.name, p.unit, priors[p.name], values[p.name], float(shift))
        for p, shift in zip(space.parameters, shifts, strict=True)
        if abs(shift) > MOVED_PRIOR_STD
    ]
    return tuple(sorted(moved, key=lambda prior: -abs(prior.deviations)))


def nuisance_priors(hypothesis: Hypothesis) -> Mapping[str, Value]:
    """Prior means and standard deviations of the nuisance parameters, in their units."""
    space = hypothesis.fitted.coordinates.space
    return {
        name: Value(float(v), float(s))
        for name, v, s in zip(space.names, space.centres, space.prior_std, strict=True)
    }


def nuisance_units(hypothesis: Hypothesis) -> Mapping[str, str]:
    """Units of the nuisance parameters."""
    return {
        parameter.name: parameter.unit
        for parameter in hypothesis.fitted.coordinates.space.parameters
    }


def nuisance_keys(hypothesis: Hypothesis) -> Mapping[str, str]:
    """Keys of [known_to] that state the priors of the nuisance parameters."""
    return {
        parameter.name: parameter.known_to
        for parameter in hypothesis.fitted.coordinates.space.parameters
        if parameter.known_to
    }


def _possible_mean(hypothesis: Hypothesis) -> Floats:
    """Posterior mean (p,) with every nuisance parameter raised to its lowest possible value."""
    space = hypothesis.fitted.coordinates.space
    mean = hypothesis.marginal.posterior.mean
    count = len(space.std)
    return np.concatenate([space.clip(mean[:count]), mean[count:]])


def nuisance_values(hypothesis: Hypothesis) -> Mapping[str, Value]:
    """Posterior means and standard deviations of the nuisance parameters, in their units."""
    space = hypothesis.fitted.coordinates.space
    posterior = hypothesis.marginal.posterior
    count = len(space.std)
    x = _possible_mean(hypothesis)[:count]
    std = space.std_in_units(x, posterior.covariance[:count, :count])
    return {
        name: Value(float(v), float(s))
        for name, v, s in zip(space.names, space.values(x), std, strict=True)
    }


def _settings(search: ModelSelectionResult, effects: Sequence[Effect]) -> Mapping[str, object]:
    return {
        "model_error_assumed": "half-normal, 1 % of the signal",
        "model_error_found": float(search.nothing.marginal.error),
        "unfinished": not search.tried_each_effect,
        "conditions": len(search.dataset.parts),
        "rows": len(search.dataset.rows.measured),
        "effects_tried": [effect.id for effect in effects],
        "prior": {
            "nothing missing": PRIOR_NOTHING,
            "unknown": PRIOR_UNKNOWN,
            "one effect": PRIOR_ONE,
            "two effects": PRIOR_TWO,
        },
    }


Integers = NDArray[np.intp]


def compare_residuals(
    found: ModelSelectionResult, accepted: Hypothesis, experiment: str
) -> Mapping[str, BeforeAfter]:
    """Rms residuals of the nominal and of the accepted model, per signal, with the part that
    noise and scatter explain.
    """
    measured = found.dataset.rows.measured
    return _by_signal(
        found, "rms", measured - found.nominal.predicted, measured - accepted.rows, experiment
    )


def compare_held_out(
    found: ModelSelectionResult, accepted: Hypothesis, experiment: str
) -> Mapping[str, BeforeAfter]:
    """The same on held-out conditions, all unknowns fitted to the others; each hypothesis has
    its own most probable discrepancy scale.
    """
    rows = found.dataset.rows
    conditions = sorted({int(c) for c in rows.condition[rows.experiment == experiment]})
    # A single condition cannot be predicted from others.
    if len(conditions) < 2:
        return {}
    linears = [hypothesis.fitted.linear(rows.measured) for hypothesis in (found.nothing, accepted)]
    before, after = (
        found.likelihood.compute_held_out_residuals(linear, rows.condition, conditions)
        for linear in linears
    )
    return _by_signal(found, "held_out_rms", before, after, experiment)


def _by_signal(
    search: ModelSelectionResult, name: str, before: Floats, after: Floats, experiment: str
) -> dict[str, BeforeAfter]:
    rows = search.dataset.rows
    floor = search.floor_std
    of_signal = {
        str(signal): (rows.signal == signal) & (rows.experiment == experiment)
        for signal in np.unique(rows.signal)
    }
    return {
        f"{name}_{s}": BeforeAfter(rms(before[h]), rms(after[h]), rms(floor[h]))
        for s, h in of_signal.items()
        if h.any()
    }


def group_by_recording(
    rows: Observations, experiment: str = ""
) -> dict[tuple[str, str], tuple[list[Label], Integers]]:
    """Blocks of rows that are drawn as one curve: those of one signal in one recording, or in a
    condition that is not part of one.

    Returns
    -------
    dict
        By name of the recording or condition, and signal: the labels of the blocks, and the indices
        of their rows. Rows of several blocks are in order of time.
    """
    groups: dict[tuple[str, str], list[int]] = {}
    for number, label in enumerate(rows.labels):
        if experiment in ("", label.experiment):
            groups.setdefault((label.recording or label.condition, label.signal), []).append(number)
    curves = {}
    for key, numbers in groups.items():
        indices = np.flatnonzero(np.isin(rows.label, numbers))
        if len(numbers) > 1:
            indices = indices[np.argsort(rows.t_s[indices], kind="stable")]
        if indices.size:
            curves[key] = ([rows.labels[number] for number in numbers], indices)
    return curves


def make_overlays(
    found: ModelSelectionResult, accepted: Hypothesis, experiment: str = ""
) -> tuple[SignalOverlay, ...]:
    """Measured means (m,) with both models, recording by recording and signal by signal; of all
    experiments without a name of one.
    """
    rows = found.dataset.rows
    nominal = found.nominal.predicted
    overlays = []
    for (name, signal), (labels, indices) in group_by_recording(rows, experiment).items():
        starts_s: list[float] = []
        for label in labels:
            starts_s += label.starts_s
        overlay = SignalOverlay(
            name,
            signal,
            rows.t_s[indices],
            rows.measured[indices],
            nominal[indices],
            accepted.rows[indices],
            np.array(starts_s),
            rows.phase[indices],
            tuple(label.condition for label in labels),
        )
        overlays.append(overlay)
    return tuple(overlays)
