"""The answer about a leg: forces and shaft together, with valleys, place, remarks and the next
experiment.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.analysis.matched_simulation import DURATION_FACTOR, GRID_S
from rfca_rig.analysis.phases import Undetermined, Valley, find_valley
from rfca_rig.diagnosis.config import FEWEST_CONDITIONS
from rfca_rig.diagnosis.decision.decide import Decision, join_decisions
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis, ModelSelectionResult
from rfca_rig.diagnosis.leg.findings import LegFindings
from rfca_rig.diagnosis.leg.prepared import PreparedLeg
from rfca_rig.diagnosis.leg.shaft_observations import estimate_delay_s, turns_as_commanded
from rfca_rig.diagnosis.leg.simulator import COMMAND_DELAY
from rfca_rig.diagnosis.leg.strokes import STROKE_TOLERANCE, DynamicCondition
from rfca_rig.diagnosis.problem import DecidedSearch
from rfca_rig.diagnosis.residual_force.free_form import estimate_free_force, state_place
from rfca_rig.diagnosis.residual_force.mismatch_map import locate_mismatch, lone_channel
from rfca_rig.diagnosis.result import BeforeAfter, Diagnosis, StatedPlace
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
from rfca_rig.model.stroke import simulate_stroke

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
    after = replace(
        decision.explanation.fitted.coordinates.supposed(
            decision.explanation.marginal.posterior.mean
        ),
        rig=result.found_rig,
    )
    has_drive = any(effect.id not in decision.explanation.ids for effect in result.found_effects)
    return replace(
        result,
        valley=valley_errors(
            prepared.flaps, search.nominal.coordinates.supposed(search.nominal.x), after, has_drive
        ),
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
    rig = result.found_rig
    if effects:
        # The search for the drive also chose how a compliant drive starts, so its whole drive is
        # taken over.
        rig = replace(
            rig,
            drive=search.nominal.coordinates.space.centre.rig.drive,
            effects=(*rig.effects, *effects),
        )
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
        found_rig=rig,
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


def valley_errors(
    flaps: Sequence[DynamicCondition], nominal: ModelPoint, after: ModelPoint, drive_found: bool
) -> Mapping[str, BeforeAfter]:
    """Mean error of the valley in time and force, in percent, as in Table II of the paper.

    The nominal shaft moves as commanded. If a drive effect was found, the accepted model simulates
    the motion of the shaft itself. Otherwise it follows the turn of each condition.
    """
    valleys = [
        (flap.valley, _valley(flap, nominal, True), _valley(flap, after, drive_found))
        for flap in flaps
        if not isinstance(flap.valley, Undetermined)
    ]
    complete = [
        (m, b, a)
        for m, b, a in valleys
        if isinstance(m, Valley) and isinstance(b, Valley) and isinstance(a, Valley)
    ]
    if not complete:
        return {}
    return {
        "valley_time_error_pct": BeforeAfter(
            _error([(b.time_s, m.time_s) for m, b, _ in complete]),
            _error([(a.time_s, m.time_s) for m, _, a in complete]),
        ),
        "valley_force_error_pct": BeforeAfter(
            _error([(b.fz_N, m.fz_N) for m, b, _ in complete]),
            _error([(a.fz_N, m.fz_N) for m, _, a in complete]),
        ),
    }


def _valley(flap: DynamicCondition, supposed: ModelPoint, commanded: bool) -> Valley | Undetermined:
    t_s = GRID_S * np.arange(
        0, int(DURATION_FACTOR * flap.phases.valley_s / GRID_S), dtype=np.float64
    )
    if commanded:
        turn = replace(flap.turn, recorded=None)
    else:
        turn = flap.turn
    if supposed.rig.effects and commanded:
        turn = replace(turn, start_rad=None)  # a drive at fault leaves its start by itself
    try:
        motion = turn.motion(supposed, float(t_s[-1]))
        known = t_s <= motion.breaks_s[-1]  # a recorded turn says nothing of the time after it
        stroke = simulate_stroke(
            supposed.rig,
            flap.height_m + supposed.height_offset_m,
            motion,
            t_s[known],
            STROKE_TOLERANCE,
            flap.strokes_before,
        )
    except SimulationFailed as error:
        # Without an answer of the model there is no valley to compare; the condition does not
        # count.
        return Undetermined(str(error))
    return find_valley(stroke.t_s, stroke.fz_N)


def _error(pairs: Sequence[tuple[float, float]]) -> float:
    return float(
        np.mean(
            [100.0 * abs(simulated - measured) / abs(measured) for simulated, measured in pairs]
        )
    )
