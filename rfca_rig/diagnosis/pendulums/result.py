"""The verdict on a pendulum with the figures beside it. What only a leg has, as valleys, stays empty."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict

import numpy as np

from rfca_rig.analysis.swings import TORQUE_ERROR
from rfca_rig.campaign.pendulum import PendulumCampaign
from rfca_rig.diagnosis.decision.decide import Decision
from rfca_rig.diagnosis.decision.detection_limits import find_detection_limits
from rfca_rig.diagnosis.decision.wording import describe, describe_unexplained
from rfca_rig.diagnosis.experiment_design.pendulum_experiment import next_swing
from rfca_rig.diagnosis.figures import before_and_after, held_out_under, overlays
from rfca_rig.diagnosis.inference.hypotheses import PRIOR_NOTHING, PRIOR_ONE, PRIOR_TWO, PRIOR_UNKNOWN, Hypothesis, ModelSelectionResult
from rfca_rig.diagnosis.inference.screening import projection_of
from rfca_rig.diagnosis.likelihood.marginal_likelihood import USUAL_ERROR
from rfca_rig.diagnosis.pendulums.windows import BIN_S, SWINGS, WINDOW_S
from rfca_rig.diagnosis.residual_force.mismatch_map import locate_mismatch
from rfca_rig.diagnosis.result import BeforeAfter, Diagnosis, Grade, NotSeen, Value, Verdict
from rfca_rig.diagnosis.result_builder import moved_priors, present_effects
from rfca_rig.model.effect import Effect

FEWEST_STRETCHES = 3


def build_result(campaign: PendulumCampaign, found: ModelSelectionResult, decision: Decision, effects: Sequence[Effect]) -> Diagnosis:
    """The whole answer."""
    enough = len(found.evidence.parts) >= FEWEST_STRETCHES
    verdict: Verdict = decision.verdict if enough else "not enough data"
    grade: Grade = decision.grade if enough else "not enough data"
    is_stated = grade in ("identified", "mostly")
    explanation = decision.explanation if enough else found.nothing
    accepted = explanation if is_stated else found.nothing
    cells, places = locate_mismatch(found.evidence.rows, found.believed, found.judge)
    supposed = accepted.fitted.coordinates.supposed(accepted.judgement.posterior.mean)
    effects_stated = decision.stated if is_stated else ()
    statement = decision.statement if enough else None
    return Diagnosis(
        title=campaign.title,
        verdict=verdict,
        sentence=_sentence(grade, decision, len(found.evidence.parts)),
        located=places,
        cells=cells,
        effects=effects_stated,
        gates=decision.gates,
        rivals=decision.rivals[:12],
        not_seen=_not_seen(found, explanation, decision.suspects, effects),
        fit=before_and_after(found, explanation, SWINGS),
        held_out=_held_out(found, explanation),
        valley={},
        unexplained=(*_unexplained(grade, decision), *_closest(verdict, found, decision)),
        remarks=(),
        next_experiment=next_swing(campaign, found, decision, enough),
        believed_values=_values(explanation),
        overlays=overlays(found, explanation, SWINGS),
        settings=_settings(campaign, found, effects),
        found_effects=present_effects(accepted),
        found_rig=supposed.rig,
        grade=grade,
        probability=_probability(grade, decision),
        family=statement.family if statement else None,
        explained_share=statement.explained_share if statement else None,
        moved_priors=moved_priors(explanation),
        support=tuple(asdict(one) for one in decision.supported),
    )


def _sentence(grade: Grade, decision: Decision, stretches: int) -> str:
    if grade == "not enough data":
        return f"Not enough data for a verdict: {stretches} stretches of two seconds, {FEWEST_STRETCHES} are needed."
    if grade == "unexplained":
        return describe_unexplained(decision.suspected.ids if decision.suspected else ())
    statement = decision.statement
    return describe(grade, decision.stated, statement.family if statement else None, statement.explained_share if statement else 1.0)


def _probability(grade: Grade, decision: Decision) -> float | None:
    if grade == "identified":
        return min(effect.probability for effect in decision.effects)
    if decision.statement is not None and grade != "not enough data":
        return decision.statement.probability
    return {"nothing missing": decision.probability_nothing, "unexplained": 1.0 - decision.probability_nothing}.get(grade)


def _unexplained(grade: Grade, decision: Decision) -> tuple[str, ...]:
    if grade in ("identified", "nothing missing"):
        return ()
    closest = (f"closest is {' with '.join(decision.suspected.ids)}, not claimed",) if decision.suspected else ()
    return (*closest, *(f"{gate.name}: {gate.found}" for gate in decision.gates if not gate.passed))


def _closest(verdict: Verdict, found: ModelSelectionResult, decision: Decision) -> tuple[str, ...]:
    """What the suspected effects would do for data that they were not fitted to, though they are not claimed."""
    if verdict != "unexplained" or decision.suspected is None:
        return ()
    figures = ", ".join(f"{name} {f.before:.2g} to {f.after:.2g}" for name, f in _held_out(found, decision.suspected).items())
    return (f"with {' and '.join(decision.suspected.ids)} in the model, rms on held-out stretches falls: {figures}",) if figures else ()


def _not_seen(
    found: ModelSelectionResult, accepted: Hypothesis, suspects: Collection[str], effects: Sequence[Effect]
) -> tuple[NotSeen, ...]:
    fitted = accepted.fitted
    measured = found.evidence.rows.measured
    projection = projection_of(fitted, measured, found.judge.level(fitted.linear(measured)))
    others = [effect for effect in effects if effect.id not in suspects]
    return find_detection_limits(others, found.trials, projection, fitted.coordinates.supposed(fitted.x).rig)


def _held_out(found: ModelSelectionResult, accepted: Hypothesis) -> Mapping[str, BeforeAfter]:
    """Rms on stretches left out in turn, without and with the effect, each under the discrepancy of its own hypothesis."""
    return held_out_under(found, accepted, [hypothesis.judgement.whitening for hypothesis in (found.nothing, accepted)], SWINGS)


def _values(accepted: Hypothesis) -> Mapping[str, Value]:
    """By how much the believed values are off."""
    space, posterior = accepted.fitted.coordinates.space, accepted.judgement.posterior
    std = np.sqrt(np.diag(posterior.covariance))[: len(space.std)] * space.std
    at = space.at(posterior.mean[: len(space.std)])
    return {parameter.name: Value(parameter.read(at), float(s)) for parameter, s in zip(space.parameters, std, strict=True)}


def _settings(campaign: PendulumCampaign, found: ModelSelectionResult, effects: Sequence[Effect]) -> Mapping[str, object]:
    usual = campaign.known_to.get("torque_error_relative", TORQUE_ERROR)
    return {
        "model_error_assumed": f"half-normal, torques wrong by {100.0 * usual:g} %",
        "model_error_found": float(found.nothing.judgement.error) * usual / USUAL_ERROR,
        "window_s": WINDOW_S,
        "bin_s": BIN_S,
        "conditions": len(found.evidence.parts),
        "rows": len(found.evidence.rows.measured),
        "effects_tried": [effect.id for effect in effects],
        "prior": {"nothing missing": PRIOR_NOTHING, "unknown": PRIOR_UNKNOWN, "one effect": PRIOR_ONE, "two effects": PRIOR_TWO},
    }
