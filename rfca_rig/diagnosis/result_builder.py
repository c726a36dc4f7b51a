"""The verdicts on forces and shaft put together, with all figures that a reader wants to see beside them."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.data.shaft_observations import late_s, turns_as_commanded
from rfca_rig.diagnosis.decision.decide import Decision
from rfca_rig.diagnosis.decision.detection_limits import find_detection_limits
from rfca_rig.diagnosis.experiment_design.next_experiment import next_experiment
from rfca_rig.diagnosis.figures import before_and_after, held_out, overlays, valley_errors
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis, ModelSelectionResult
from rfca_rig.diagnosis.inference.screening import projection_of
from rfca_rig.diagnosis.residual_force.free_form import free_form
from rfca_rig.diagnosis.residual_force.mismatch_map import locate_mismatch, lone_channel
from rfca_rig.diagnosis.result import Diagnosis, Gate, NamedEffect, NotSeen, Overlay, Rival, Value, Verdict
from rfca_rig.errors import SimulationFailed
from rfca_rig.model.effect import Effect
from rfca_rig.model.parameters import PresentEffect
from rfca_rig.protocol.plan import Limits

if TYPE_CHECKING:
    from rfca_rig.diagnosis.diagnose import Findings, PreparedData

Floats = NDArray[np.float64]

FEWEST_CONDITIONS = 3
SHOWS = 3.0  # standard deviations


def build_result(body: "PreparedData", verdicts: "Findings", effects: Sequence[Effect], limits: Limits | None) -> Diagnosis:
    """The whole answer; `limits` are those of the rig that the next experiment is for, where one is known."""
    leg, decision = verdicts.leg, verdicts.leg_decision
    verdict = _verdict(body, verdicts)
    named = _effects(verdict, verdicts)
    cells, places = locate_mismatch(leg.evidence.rows, leg.believed, leg.judge)
    if verdicts.drive is not None:
        drive_cells, drive_places = locate_mismatch(verdicts.drive.evidence.rows, verdicts.drive.believed, verdicts.drive.judge)
        cells, places = (*cells, *drive_cells), (*drive_places, *places)
    accepted = decision.accepted if verdict == "named" else leg.nothing
    found_effects = tuple(effect for h in _accepted(verdict, verdicts) for effect in present_effects(h))
    supposed = accepted.fitted.coordinates.supposed(accepted.judgement.posterior.mean)
    drive_effects = tuple(e for e in found_effects if e.id not in accepted.ids)
    drive = verdicts.drive.believed.coordinates.space.centre.rig.drive if drive_effects and verdicts.drive else supposed.rig.drive
    after = replace(supposed, rig=replace(supposed.rig, drive=drive, effects=(*supposed.rig.effects, *drive_effects)))
    return Diagnosis(
        title=body.title,
        verdict=verdict,
        sentence=_sentence(verdict, named, verdicts, body),
        located=places,
        cells=cells,
        effects=named,
        gates=_gates(verdict, verdicts),
        rivals=_joint_rivals(verdicts),
        not_seen=_not_seen(verdicts, accepted, effects, body),
        fit=before_and_after(leg, accepted),
        held_out=held_out(leg, accepted),
        valley=valley_errors(body.flaps, leg.believed.coordinates.supposed(leg.believed.x), after, bool(drive_effects)),
        unexplained=(*_unexplained(verdict, verdicts), *_free_form(verdicts)),
        remarks=(*body.remarks, *_remarks(body, leg), *_late(body, verdicts)),
        next_experiment=next_experiment(body, verdicts, _enough(body), limits),
        believed_values=nuisance_values(accepted),
        overlays=(*overlays(leg, accepted), *_of_drive(verdict, verdicts)),
        settings=_settings(body, leg, effects),
        found_effects=found_effects,
        found_rig=after.rig,
    )


def present_effects(hypothesis: Hypothesis) -> tuple[PresentEffect, ...]:
    """The effects of a hypothesis with the values found."""
    coordinates, mean = hypothesis.fitted.coordinates, hypothesis.judgement.posterior.mean
    return tuple(choice.present(mean[coordinates.part(number)]) for number, choice in enumerate(coordinates.choices))


def _decisions(verdicts: "Findings") -> tuple[Decision, ...]:
    return (verdicts.leg_decision,) if verdicts.drive_decision is None else (verdicts.leg_decision, verdicts.drive_decision)


def _accepted(verdict: Verdict, verdicts: "Findings") -> tuple[Hypothesis, ...]:
    return tuple(d.accepted for d in _decisions(verdicts) if d.verdict == "named") if verdict == "named" else ()


def _verdict(body: "PreparedData", verdicts: "Findings") -> Verdict:
    """A name in either is a name, if nothing that has none is left in the other."""
    each = [decision.verdict for decision in _decisions(verdicts)]
    if all(verdict == "nothing missing" for verdict in each):
        return "nothing missing" if _enough(body) else "not enough data"
    if not _enough(body):
        return "not enough data"
    return "unexplained" if "unexplained" in each else "named"


def _enough(body: "PreparedData") -> bool:
    return len(body.flaps) >= FEWEST_CONDITIONS


def _effects(verdict: Verdict, verdicts: "Findings") -> tuple[NamedEffect, ...]:
    return tuple(effect for d in _decisions(verdicts) for effect in d.effects) if verdict == "named" else ()


def _sentence(verdict: Verdict, named: Sequence[NamedEffect], verdicts: "Findings", body: "PreparedData") -> str:
    if verdict == "named":
        what = " and ".join(f"{effect.left_out} ({effect.id})" for effect in named)
        others = sorted({other for effect in named for other in effect.cannot_tell_from})
        tail = f"; these data cannot tell it from {', '.join(others)}" if others else ""
        return f"The model lacks: {what}{tail}."
    if verdict == "nothing missing":
        return "Nothing is missing that these recordings would show."
    if verdict == "not enough data":
        return f"Not enough data for a verdict: {len(body.flaps)} usable conditions, {FEWEST_CONDITIONS} are needed."
    suspects = [d.suspected for d in _decisions(verdicts) if d.suspected is not None]
    like = f" It behaves partly like {' with '.join(suspects[0].ids)}, which is not claimed." if suspects else ""
    return f"Something is missing that no entry of the catalogue explains.{like}{_explained_apart(verdicts)}"


def _explained_apart(verdicts: "Findings") -> str:
    """What has a name in the forces or in the shaft's own motion, where the other has something without one."""
    of_which = zip(("the forces show", "the shaft itself does"), _decisions(verdicts), strict=False)
    named = [(what, effect) for what, decision in of_which for effect in decision.effects]
    return "".join(f" What {what} is explained by: {effect.left_out} ({effect.id})." for what, effect in named)


def _of_drive(verdict: Verdict, verdicts: "Findings") -> tuple[Overlay, ...]:
    if verdicts.drive is None or verdicts.drive_decision is None:
        return ()
    return overlays(verdicts.drive, verdicts.drive_decision.accepted if verdict == "named" else verdicts.drive.nothing)


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
    projection = projection_of(accepted.fitted, measured, leg.judge.usual)
    others = [effect for effect in effects if effect.id not in accepted.ids]
    return find_detection_limits(others, leg.trials, projection, body.rig)


def _unexplained(verdict: Verdict, verdicts: "Findings") -> tuple[str, ...]:
    if verdict in ("named", "nothing missing"):
        return ()
    suspects = [d.suspected for d in _decisions(verdicts) if d.suspected is not None]
    failed = [f"{gate.name}: {gate.found}" for d in _decisions(verdicts) for gate in d.gates if not gate.passed]
    return (*(f"closest is {' with '.join(s.ids)}, not claimed" for s in suspects), *failed)


def _free_form(verdicts: "Findings") -> tuple[str, ...]:
    """Where a force that nobody listed would have to act, and its law if it has a plain one: empirical, cause not known."""
    if verdicts.leg_decision.verdict != "unexplained":
        return ()
    try:
        free = free_form(verdicts.leg)
    except SimulationFailed as error:
        return (f"no free force could be estimated: {error}",)
    return () if free is None else (free.text,)


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
