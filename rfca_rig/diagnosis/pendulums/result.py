"""The answer about a pendulum: the common one, with its held-out stretches and its next swing. What only a leg has stays empty."""

from collections.abc import Sequence
from dataclasses import replace

from rfca_rig.analysis.swings import TORQUE_ERROR
from rfca_rig.campaign.pendulum import PendulumCampaign
from rfca_rig.diagnosis.config import USUAL_ERROR
from rfca_rig.diagnosis.decision.decide import Decision
from rfca_rig.diagnosis.experiment_design.pendulum_experiment import next_swing
from rfca_rig.diagnosis.figures import held_out
from rfca_rig.diagnosis.inference.hypotheses import ModelSelectionResult
from rfca_rig.diagnosis.pendulums.windows import BIN_S, SWINGS, WINDOW_S
from rfca_rig.diagnosis.result import Diagnosis
from rfca_rig.diagnosis.result_builder import build_result, not_enough_data
from rfca_rig.model.effect import Effect

FEWEST_STRETCHES = 3


def build_pendulum_result(
    campaign: PendulumCampaign, found: ModelSelectionResult, decision: Decision, effects: Sequence[Effect]
) -> Diagnosis:
    """The whole answer."""
    stretches = len(found.evidence.parts)
    enough = stretches >= FEWEST_STRETCHES
    if not enough:
        decision = not_enough_data(found, f"{stretches} stretches of two seconds, {FEWEST_STRETCHES} are needed")
    result = build_result(campaign.title, found, decision, effects, SWINGS)
    usual = campaign.known_to.get("torque_error_relative", TORQUE_ERROR)
    return replace(
        result,
        unexplained=(*result.unexplained, *_closest(found, decision)),
        next_experiment=next_swing(campaign, found, decision, enough),
        settings={
            **result.settings,
            "model_error_assumed": f"half-normal, torques wrong by {100.0 * usual:g} %",
            "model_error_found": float(found.nothing.judgement.error) * usual / USUAL_ERROR,
            "window_s": WINDOW_S,
            "bin_s": BIN_S,
        },
    )


def _closest(found: ModelSelectionResult, decision: Decision) -> tuple[str, ...]:
    """What the closest effects would do for data that they were not fitted to, though they are not claimed."""
    if decision.closest is None or decision.effects:
        return ()
    figures = ", ".join(f"{name} {f.before:.2g} to {f.after:.2g}" for name, f in held_out(found, decision.closest, SWINGS).items())
    return (f"with {' and '.join(decision.closest.ids)} in the model, rms on held-out stretches falls: {figures}",) if figures else ()
