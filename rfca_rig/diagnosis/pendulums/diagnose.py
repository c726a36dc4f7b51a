"""`diagnose_pendulum`: recordings of a pendulum in, the same kind of answer out as for a leg. Fields that only a leg has stay empty."""

from collections.abc import Collection, Sequence
from dataclasses import replace

from rfca_rig.analysis.swings import TORQUE_ERROR, SwingProblem, make_swing_problem
from rfca_rig.campaign.pendulum import PendulumCampaign
from rfca_rig.diagnosis.candidate_effects import describe_exclusions
from rfca_rig.diagnosis.config import FEWEST_CONDITIONS, USUAL_ERROR
from rfca_rig.diagnosis.decision.decide import Decision, decide
from rfca_rig.diagnosis.experiment_design.pendulum_experiment import propose_swing
from rfca_rig.diagnosis.figures import compare_held_out
from rfca_rig.diagnosis.inference.hypotheses import ModelSelectionResult
from rfca_rig.diagnosis.inference.model_selection import Progress, search_models
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.pendulums.candidates import candidates_of, own_effects
from rfca_rig.diagnosis.pendulums.nuisances import space_of_pendulum
from rfca_rig.diagnosis.pendulums.windows import BIN_S, SWING_EXPERIMENT, WINDOW_S, cut_stretches, make_pendulum_dataset
from rfca_rig.diagnosis.residual_force.stated_law import OF_PENDULUM, check_place, measure_stated_law
from rfca_rig.diagnosis.result import Diagnosis
from rfca_rig.diagnosis.result_builder import build_result, not_enough_data
from rfca_rig.executors.cores import single_threaded_blas
from rfca_rig.model.effect import Effect


@single_threaded_blas()
def diagnose_pendulum(campaign: PendulumCampaign, progress: Progress, without: Collection[str] = (), law_at: str = "") -> Diagnosis:
    """The diagnosis of the recordings of a pendulum.

    Parameters
    ----------
    campaign
        The recordings and the nominal pendulum.
    progress
        Called with the current step and the share that is done.
    without
        Ids of effects that are not looked for.
    law_at
        The place where a law is measured too, if not empty.

    Raises
    ------
    BadInput
        Where the recordings are too short.
    SimulationFailed
        Where the nominal model cannot be simulated.
    """
    if law_at:
        # With a single joint, "joints" and "joint1" would be the same law.
        check_place(law_at, OF_PENDULUM[:1] if len(campaign.pendulum.links) == 1 else OF_PENDULUM)
    progress("reading", 0.0)
    found, effects = search_pendulum(make_swing_problem(campaign, WINDOW_S, BIN_S), progress, without)
    progress("summing up", 0.97)
    decision = decide(found)
    diagnosis = _build_result(campaign, found, decision, effects)
    if law_at:
        progress(f"measuring the law at {law_at}", 0.98)
        diagnosis = replace(diagnosis, stated_law=measure_stated_law(found, decision.explanation, law_at))
    _, refused = own_effects(campaign.pendulum)
    not_tried = tuple(f"not looked for: {why}" for effect_id, why in refused.items() if effect_id not in without)
    return replace(diagnosis, remarks=(*diagnosis.remarks, *describe_exclusions(without), *not_tried))


def search_pendulum(problem: SwingProblem, progress: Progress, without: Collection[str] = ()) -> tuple[ModelSelectionResult, list[Effect]]:
    """The search over all effects that a pendulum may lack, and those effects."""
    effects = candidates_of(problem, without)
    coordinates = Parameterization(space_of_pendulum(problem.pendulum, problem.nuisances))
    return search_models(make_pendulum_dataset(cut_stretches(problem)), coordinates, effects, progress), effects


def _build_result(campaign: PendulumCampaign, found: ModelSelectionResult, decision: Decision, effects: Sequence[Effect]) -> Diagnosis:
    """The common answer, with its held-out stretches and its next experiment."""
    stretches = len(found.dataset.parts)
    enough = stretches >= FEWEST_CONDITIONS
    if not enough:
        decision = not_enough_data(found, f"{stretches} stretches of two seconds, {FEWEST_CONDITIONS} are needed")
    result = build_result(campaign.title, found, decision, effects, SWING_EXPERIMENT)
    # The search calls 1 % usual; figures for people refer to the stated torque error.
    usual = campaign.known_to.get("torque_error_relative", TORQUE_ERROR)
    return replace(
        result,
        unexplained=(*result.unexplained, *_describe_closest(found, decision)),
        next_experiment=propose_swing(campaign, found, decision, enough),
        settings={
            **result.settings,
            "model_error_assumed": f"half-normal, torques wrong by {100.0 * usual:g} %",
            "model_error_found": float(found.nothing.marginal.error) * usual / USUAL_ERROR,
            "window_s": WINDOW_S,
            "bin_s": BIN_S,
        },
    )


def _describe_closest(found: ModelSelectionResult, decision: Decision) -> tuple[str, ...]:
    """What the closest effects would improve on held-out stretches, although they are not stated."""
    if decision.closest is None or decision.effects:
        return ()
    figures = ", ".join(
        f"{name} {f.before:.2g} to {f.after:.2g}" for name, f in compare_held_out(found, decision.closest, SWING_EXPERIMENT).items()
    )
    return (f"with {' and '.join(decision.closest.ids)} in the model, rms on held-out stretches falls: {figures}",) if figures else ()
