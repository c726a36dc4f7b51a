"""The verdicts on forces and shaft put together, with all figures that a reader wants to see beside them."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.decision.decide import Decision
from rfca_rig.diagnosis.decision.detection_limits import find_detection_limits
from rfca_rig.diagnosis.decision.wording import describe, describe_unexplained
from rfca_rig.diagnosis.experiment_design.next_experiment import next_experiment
from rfca_rig.diagnosis.figures import before_and_after, held_out, overlays, valley_errors
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis, ModelSelectionResult
from rfca_rig.diagnosis.inference.screening import projection_of
from rfca_rig.diagnosis.leg.shaft_observations import late_s, turns_as_commanded
from rfca_rig.diagnosis.residual_force.free_form import free_form, place_of
from rfca_rig.diagnosis.residual_force.mismatch_map import locate_mismatch, lone_channel
from rfca_rig.diagnosis.result import (
    Diagnosis,
    Gate,
    Grade,
    Located,
    MovedPrior,
    NamedEffect,
    NotSeen,
    Overlay,
    Rival,
    StatedFamily,
    StatedPlace,
    Value,
    Verdict,
)
from rfca_rig.errors import SimulationFailed
from rfca_rig.model.effect import Effect
from rfca_rig.model.parameters import PresentEffect
from rfca_rig.protocol.plan import Limits

if TYPE_CHECKING:
    from rfca_rig.diagnosis.diagnose import Findings, PreparedData

Floats = NDArray[np.float64]

FEWEST_CONDITIONS = 3
SHOWS = 3.0  # standard deviations
MOVED = 2.0  # prior standard deviations: one nuisance in twenty does so by chance


def build_result(body: "PreparedData", verdicts: "Findings", effects: Sequence[Effect], limits: Limits | None) -> Diagnosis:
    """The whole answer; `limits` are those of the rig that the next experiment is for, where one is known."""
    leg, decision = verdicts.leg, verdicts.leg_decision
    verdict, grade = _verdict(body, verdicts), _grade(body, verdicts)
    is_stated = grade in ("identified", "mostly")
    effects_stated = tuple(effect for d in _decisions(verdicts) for effect in d.stated) if is_stated else ()
    cells, places = locate_mismatch(leg.evidence.rows, leg.believed, leg.judge)
    if verdicts.drive is not None:
        drive_cells, drive_places = locate_mismatch(verdicts.drive.evidence.rows, verdicts.drive.believed, verdicts.drive.judge)
        cells, places = (*cells, *drive_cells), (*drive_places, *places)
    explanation = decision.explanation if grade not in ("nothing missing", "not enough data") else leg.nothing
    accepted = explanation if is_stated else leg.nothing
    found_effects = tuple(effect for d in _decisions(verdicts) for effect in present_effects(d.explanation)) if is_stated else ()
    supposed = accepted.fitted.coordinates.supposed(accepted.judgement.posterior.mean)
    drive_effects = tuple(e for e in found_effects if e.id not in accepted.ids)
    drive = verdicts.drive.believed.coordinates.space.centre.rig.drive if drive_effects and verdicts.drive else supposed.rig.drive
    after = replace(supposed, rig=replace(supposed.rig, drive=drive, effects=(*supposed.rig.effects, *drive_effects)))
    statements = [d.statement for d in _decisions(verdicts) if d.statement is not None]
    family = next((s.family for s in statements if s.family is not None), None)
    place, free_text = _free_form(grade, verdicts)
    return Diagnosis(
        title=body.title,
        verdict=verdict,
        sentence=sentence(grade, effects_stated, family, verdicts, body),
        located=places,
        cells=cells,
        effects=effects_stated,
        gates=_gates(verdict, verdicts),
        rivals=_joint_rivals(verdicts),
        not_seen=_not_seen(verdicts, explanation, effects, body),
        fit=before_and_after(leg, explanation),
        held_out=held_out(leg, explanation),
        valley=valley_errors(body.flaps, leg.believed.coordinates.supposed(leg.believed.x), after, bool(drive_effects)),
        unexplained=(*_unexplained(grade, verdicts), *free_text),
        remarks=(*body.remarks, *_remarks(body, leg), *_late(body, verdicts)),
        next_experiment=next_experiment(body, verdicts, _enough(body), limits),
        believed_values=nuisance_values(explanation),
        overlays=(*overlays(leg, explanation), *_of_drive(verdicts)),
        settings=_settings(body, leg, effects),
        found_effects=found_effects,
        found_rig=after.rig,
        grade=grade,
        probability=_probability(grade, effects_stated, family, verdicts),
        family=family,
        place=place,
        explained_share=min((s.explained_share for s in statements), default=None),
        remaining=_remaining(leg, explanation) if grade in ("mostly", "family", "unexplained") else (),
        moved_priors=moved_priors(explanation),
        support=tuple(asdict(one) for d in _decisions(verdicts) for one in d.supported),
    )


def present_effects(hypothesis: Hypothesis) -> tuple[PresentEffect, ...]:
    """The effects of a hypothesis with the values found."""
    coordinates, mean = hypothesis.fitted.coordinates, hypothesis.judgement.posterior.mean
    return tuple(choice.present(mean[coordinates.part(number)]) for number, choice in enumerate(coordinates.choices))


def _decisions(verdicts: "Findings") -> tuple[Decision, ...]:
    return (verdicts.leg_decision,) if verdicts.drive_decision is None else (verdicts.leg_decision, verdicts.drive_decision)


def _verdict(body: "PreparedData", verdicts: "Findings") -> Verdict:
    """An identified effect in either is one, if nothing that has none is left in the other."""
    each = [decision.verdict for decision in _decisions(verdicts)]
    if all(verdict == "nothing missing" for verdict in each):
        return "nothing missing" if _enough(body) else "not enough data"
    if not _enough(body):
        return "not enough data"
    return "unexplained" if "unexplained" in each else "named"


def _grade(body: "PreparedData", verdicts: "Findings") -> Grade:
    """The forces and the shaft's own motion together: the weakest of what is stated, "mostly" where one of them stays unexplained."""
    if not _enough(body):
        return "not enough data"
    each = [decision.grade for decision in _decisions(verdicts)]
    if all(grade == "nothing missing" for grade in each):
        return "nothing missing"
    if all(grade in ("identified", "nothing missing") for grade in each):
        return "identified"
    if any(decision.stated for decision in _decisions(verdicts)):
        return "mostly"
    return "family" if "family" in each else "unexplained"


def _enough(body: "PreparedData") -> bool:
    return len(body.flaps) >= FEWEST_CONDITIONS


def sentence(grade: Grade, stated: Sequence[NamedEffect], family: StatedFamily | None, verdicts: "Findings", body: "PreparedData") -> str:
    """The answer in one or two sentences."""
    if grade == "not enough data":
        return f"Not enough data for a verdict: {len(body.flaps)} usable conditions, {FEWEST_CONDITIONS} are needed."
    if grade == "unexplained":
        suspects = [d.suspected for d in _decisions(verdicts) if d.suspected is not None]
        return describe_unexplained(suspects[0].ids if suspects else ())
    shares = [d.statement.explained_share for d in _decisions(verdicts) if d.statement is not None]
    left = any(d.grade == "unexplained" for d in _decisions(verdicts))
    return describe(grade, stated, family, min(shares, default=1.0)) + (" Something else remains unexplained." if left else "")


def _probability(grade: Grade, stated: Sequence[NamedEffect], family: StatedFamily | None, verdicts: "Findings") -> float | None:
    """The calibrated probability of what is stated; for nothing missing and unexplained that of the hypotheses' comparison."""
    if grade in ("identified", "mostly"):
        return min(effect.probability for effect in stated)
    if grade == "family" and family is not None:
        return family.probability
    if grade == "not enough data":
        return None
    nothing = float(np.prod([decision.probability_nothing for decision in _decisions(verdicts)]))
    return nothing if grade == "nothing missing" else 1.0 - nothing


def _remaining(leg: ModelSelectionResult, explanation: Hypothesis) -> tuple[Located, ...]:
    """Where recordings and explanation still differ, worst first."""
    fitted = explanation.fitted
    return locate_mismatch(leg.evidence.rows, replace(fitted, predicted=explanation.rows), leg.judge)[1]


def _of_drive(verdicts: "Findings") -> tuple[Overlay, ...]:
    if verdicts.drive is None or verdicts.drive_decision is None:
        return ()
    return overlays(verdicts.drive, verdicts.drive_decision.explanation)


def _gates(verdict: Verdict, verdicts: "Findings") -> tuple[Gate, ...]:
    """Those of what decided: of what was named, or of what came closest where something has no name."""
    decisions = _decisions(verdicts)
    deciding = [decision for decision in decisions if decision.verdict == verdict]
    return tuple(gate for decision in deciding or decisions for gate in decision.gates)


def _joint_rivals(verdicts: "Findings") -> tuple[Rival, ...]:
    """Those of the forces; where the shaft has its own, both together, as if independent."""
    if verdicts.drive_decision is None:
        return verdicts.leg_decision.rivals[:12]
    pairs = [(a, b) for a in verdicts.leg_decision.rivals[:6] for b in verdicts.drive_decision.rivals]
    joint = [
        Rival((*a.ids, *b.ids), a.probability * b.probability, a.log_evidence + b.log_evidence, max(a.model_error, b.model_error))
        for a, b in pairs
    ]
    return tuple(sorted(joint, key=lambda rival: -rival.probability)[:12])


def _not_seen(verdicts: "Findings", accepted: Hypothesis, effects: Sequence[Effect], body: "PreparedData") -> tuple[NotSeen, ...]:
    leg = verdicts.leg
    measured = leg.evidence.rows.measured
    # What remains unexplained could hide an effect: it counts as discrepancy of its own size, the usual one at least.
    projection = projection_of(accepted.fitted, measured, leg.judge.level(accepted.fitted.linear(measured)))
    suspects = frozenset().union(*(decision.suspects for decision in _decisions(verdicts)))
    others = [effect for effect in effects if effect.id not in suspects]
    return find_detection_limits(others, leg.trials, projection, body.rig)


def _unexplained(grade: Grade, verdicts: "Findings") -> tuple[str, ...]:
    if grade in ("identified", "nothing missing"):
        return ()
    suspects = [d.suspected for d in _decisions(verdicts) if d.suspected is not None]
    failed = [f"{gate.name}: {gate.found}" for d in _decisions(verdicts) for gate in d.gates if not gate.passed]
    return (*(f"closest is {' with '.join(s.ids)}, not claimed" for s in suspects), *failed)


def _free_form(grade: Grade, verdicts: "Findings") -> tuple[StatedPlace | None, tuple[str, ...]]:
    """Where a force that nobody listed would have to act, and its law if it has a plain one: empirical, cause not known."""
    if grade != "unexplained" or verdicts.leg_decision.grade != "unexplained":
        return None, ()
    try:
        free = free_form(verdicts.leg)
    except SimulationFailed as error:
        return None, (f"no free force could be estimated: {error}",)
    return (None, ()) if free is None else (place_of(free), (free.text,))


def _remarks(body: "PreparedData", leg: ModelSelectionResult) -> tuple[str, ...]:
    alone = lone_channel(leg.evidence.rows, leg.nothing.fitted, leg.judge)
    channel = (f"only {alone} parts: without it nothing is missing, which speaks for the sensor",) if alone else ()
    shaft = () if body.as_commanded else ("the shaft did not turn as commanded; the forces are compared along its recorded turn",)
    return (*channel, *shaft)


def _late(body: "PreparedData", verdicts: "Findings") -> tuple[str, ...]:
    """How late the drive does what it is told, where that shows: a gain that is fitted without it is wrong."""
    if verdicts.drive_decision is None:
        if all(turns_as_commanded(shaft) for shaft in body.shafts):
            return ()
        late_ms = 1e3 * float(np.mean([late_s(shaft, body.rig.drive.ramp_s) for shaft in body.shafts]))
        return (f"but for being {late_ms:.1f} ms late the drive does what it is told",)
    fitted_ms = nuisance_values(verdicts.drive_decision.accepted)["command_delay"]
    said = f"the drive does what it is told {fitted_ms.value:.1f} ms late (standard deviation {fitted_ms.std:.1f} ms)"
    return (said,) if fitted_ms.value > SHOWS * fitted_ms.std else ()


def moved_priors(hypothesis: Hypothesis) -> tuple[MovedPrior, ...]:
    """The nuisance parameters that had to move by more than MOVED prior standard deviations, farthest first."""
    space, posterior = hypothesis.fitted.coordinates.space, hypothesis.judgement.posterior
    centres, stds, values = space.centres, space.prior_std, nuisance_values(hypothesis)
    found = [
        MovedPrior(p.name, p.unit, Value(float(centre), float(std)), values[p.name], float(z))
        for p, centre, std, z in zip(space.parameters, centres, stds, posterior.mean, strict=False)
        if abs(z) > MOVED
    ]
    return tuple(sorted(found, key=lambda one: -abs(one.deviations)))


def nuisance_values(hypothesis: Hypothesis) -> Mapping[str, Value]:
    """The nuisance parameters in their units, with standard deviations."""
    space, posterior = hypothesis.fitted.coordinates.space, hypothesis.judgement.posterior
    x = posterior.mean[: len(space.std)]
    std = space.std_in_units(x, np.sqrt(np.diag(posterior.covariance))[: len(space.std)])
    return {name: Value(float(v), float(s)) for name, v, s in zip(space.names, space.values(x), std, strict=True)}


def _settings(body: "PreparedData", leg: ModelSelectionResult, effects: Sequence[Effect]) -> Mapping[str, object]:
    return {
        "model_error_assumed": "half-normal, 1 % of the signal",
        "model_error_found": float(leg.nothing.judgement.error),
        "scatter_between_strokes": dict(leg.scatter.std),
        "conditions": len(body.flaps),
        "rows": len(leg.evidence.rows.measured),
        "effects_tried": [effect.id for effect in effects],
        "prior": {"nothing missing": 0.5, "unknown": 0.1, "one effect": 0.3, "two effects": 0.1},
        "shaft": "as commanded" if body.as_commanded else "as recorded",
    }
