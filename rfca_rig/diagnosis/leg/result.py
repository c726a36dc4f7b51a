"""The answer about a leg: forces and shaft together, with valleys, place, remarks and the next
experiment.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from rfca_rig.diagnosis.config import FEWEST_CONDITIONS
from rfca_rig.diagnosis.decision.decision import Decision
from rfca_rig.diagnosis.decision.joined import join_decisions
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis, ModelSelectionResult
from rfca_rig.diagnosis.leg.findings import LegFindings, add_drive
from rfca_rig.diagnosis.leg.left_out import predict_left_out
from rfca_rig.diagnosis.leg.prepared import PreparedLeg
from rfca_rig.diagnosis.leg.shaft_observations import estimate_delay_s, turns_as_commanded
from rfca_rig.diagnosis.leg.simulator import COMMAND_DELAY
from rfca_rig.diagnosis.problem import DecidedSearch
from rfca_rig.diagnosis.residual_force.free_form import estimate_free_force, state_place
from rfca_rig.diagnosis.residual_force.mismatch_map import locate_mismatch, lone_channel
from rfca_rig.diagnosis.result import BeforeAfter, Diagnosis, LeftOutCondition, StatedPlace
from rfca_rig.diagnosis.result_builder import (
    build_result,
    list_moved_priors,
    make_overlays,
    not_enough_data,
    nuisance_keys,
    nuisance_priors,
    nuisance_units,
    nuisance_values,
    present_effects,
)
from rfca_rig.errors import SimulationFailed

T = TypeVar("T")

SIGNIFICANT_STDS = 3.0  # standard deviations
DYNAMIC = "dynamic"


def build_leg_result(prepared: PreparedLeg, findings: LegFindings) -> Diagnosis:
    """The whole answer but for the next experiment and a measured law."""
    search = findings.forces.search
    decision = findings.forces.decision
    enough = has_enough_conditions(prepared)
    # Held-out prediction needs at least three conditions; with fewer nothing is decided.
    if not enough:
        decision = not_enough_data(
            search, f"{len(prepared.flaps)} usable conditions, {FEWEST_CONDITIONS} are needed"
        )
    elif findings.shaft is not None:
        decision = join_decisions(decision, findings.shaft.decision)
    result = build_result(prepared.title, search, decision, findings.forces.effects, DYNAMIC)
    if enough and findings.shaft is not None:
        result = _with_shaft(result, decision, findings.forces, findings.shaft)
    place, free_text = _locate_free_force(decision, findings.forces)
    # Held-out prediction needs at least three conditions, too.
    left_out = predict_left_out(prepared, findings) if enough else ()
    return replace(
        result,
        left_out=left_out,
        valley=average_valley_errors(left_out),
        unexplained=(*result.unexplained, *free_text),
        remarks=(
            *result.remarks,
            *prepared.remarks,
            *_remarks(prepared, search),
            *_describe_delay(prepared, findings.shaft),
        ),
        settings={
            **result.settings,
            "conditions": len(prepared.flaps),
            "scatter_between_strokes": dict(search.scatter.std),
            "shaft": "as commanded" if prepared.as_commanded else "as recorded",
        },
        place=place,
    )


def has_enough_conditions(prepared: PreparedLeg) -> bool:
    """Whether there are enough conditions for a verdict."""
    return len(prepared.flaps) >= FEWEST_CONDITIONS


def _with_shaft(
    result: Diagnosis, decision: Decision, forces: DecidedSearch, shaft: DecidedSearch
) -> Diagnosis:
    """The answer with the results in the motion of the shaft: places, curves, and the effects of
    the drive in the model found.
    """
    search = shaft.search
    cells, places = locate_mismatch(search.dataset.rows, search.nominal, search.likelihood)
    if shaft.decision.effects:
        effects = present_effects(shaft.decision.explanation)
    else:
        effects = ()
    is_left = (
        any(finding.decision.grade == "unexplained" for finding in (forces, shaft))
        and decision.grade != "unexplained"
    )
    return replace(
        _with_delay(result, shaft.decision.explanation),
        sentence=result.sentence + (" Something else remains unexplained." if is_left else ""),
        cells=(*result.cells, *cells),
        located=(*places, *result.located),
        overlays=(*result.overlays, *make_overlays(search, shaft.decision.explanation, DYNAMIC)),
        found_effects=(*result.found_effects, *effects),
        found_rig=add_drive(result.found_rig, shaft, effects),
    )


def _with_delay(result: Diagnosis, explanation: Hypothesis) -> Diagnosis:
    """The answer with the delay of the drive among its nuisance parameters.

    The search for the drive also varies ground and height, but within what the forces have left of
    them.
    """

    def add(own: Mapping[str, T], of_drive: Mapping[str, T]) -> Mapping[str, T]:
        return {**own, **{name: value for name, value in of_drive.items() if name == COMMAND_DELAY}}

    return replace(
        result,
        believed_values=add(result.believed_values, nuisance_values(explanation)),
        priors=add(result.priors, nuisance_priors(explanation)),
        nuisance_units=add(result.nuisance_units, nuisance_units(explanation)),
        nuisance_keys=add(result.nuisance_keys, nuisance_keys(explanation)),
        moved_priors=(
            *result.moved_priors,
            *(prior for prior in list_moved_priors(explanation) if prior.name == COMMAND_DELAY),
        ),
    )


def _locate_free_force(
    decision: Decision, forces: DecidedSearch
) -> tuple[StatedPlace | None, tuple[str, ...]]:
    """Place of a free force outside the catalogue, and its empirical law if it has a short one;
    the cause is not known.
    """
    if decision.grade != "unexplained" or forces.decision.grade != "unexplained":
        return None, ()
    try:
        free = estimate_free_force(forces.search)
    except SimulationFailed as error:
        # The rest of the answer is still valid, so the failure becomes a remark.
        return None, (f"no free force could be estimated: {error}",)
    if free is None:
        return (None, ())
    return (state_place(free), (free.text,))


def _remarks(prepared: PreparedLeg, search: ModelSelectionResult) -> tuple[str, ...]:
    alone = lone_channel(search.dataset.rows, search.nothing.fitted, search.likelihood)
    # A force on the leg would show in all channels.
    channel = (
        (f"only {alone} parts: without it nothing is missing, which speaks for the sensor",)
        if alone
        else ()
    )
    shaft = (
        ()
        if prepared.as_commanded
        else (
            "the shaft did not turn as commanded; the forces are compared along its recorded turn",
        )
    )
    return (*channel, *shaft)


def _describe_delay(prepared: PreparedLeg, shaft: DecidedSearch | None) -> tuple[str, ...]:
    """The delay of the drive, where it shows: a gain of the drive that is fitted without the
    delay is wrong.
    """
    if shaft is None:
        if all(turns_as_commanded(condition) for condition in prepared.shafts):
            return ()
        late_ms = 1e3 * float(
            np.mean(
                [
                    estimate_delay_s(condition, prepared.rig.drive.ramp_s)
                    for condition in prepared.shafts
                ]
            )
        )
        return (f"but for being {late_ms:.1f} ms late the drive follows its commands",)
    fitted_ms = nuisance_values(shaft.decision.explanation).get(COMMAND_DELAY)
    if fitted_ms is None:
        return ()
    message = (
        f"the drive follows its commands {fitted_ms.value:.1f} ms late (standard deviation "
        f"{fitted_ms.std:.1f} ms)"
    )
    if fitted_ms.value > SIGNIFICANT_STDS * fitted_ms.std:
        return (message,)
    return ()


def average_valley_errors(left_out: Sequence[LeftOutCondition]) -> Mapping[str, BeforeAfter]:
    """Mean error of the valley in time and force over all conditions, in percent, as in Table II of
    the paper.
    """
    valleys = [condition.valley for condition in left_out if condition.valley is not None]
    if not valleys:
        return {}
    return {
        "valley_time_error_pct": _average([valley.time_error_pct for valley in valleys]),
        "valley_force_error_pct": _average([valley.force_error_pct for valley in valleys]),
    }


def _average(errors: Sequence[BeforeAfter]) -> BeforeAfter:
    return BeforeAfter(
        float(np.mean([error.before for error in errors])),
        float(np.mean([error.after for error in errors])),
    )
