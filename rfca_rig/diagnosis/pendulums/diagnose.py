"""`diagnose_pendulum`: recordings of a pendulum in, the same kind of answer out as for a leg."""

from collections.abc import Collection
from dataclasses import replace

from rfca_rig.analysis.swings import SwingProblem, swings_of
from rfca_rig.campaign.pendulum import PendulumCampaign
from rfca_rig.crew.cores import algebra_on_one_thread
from rfca_rig.diagnosis.candidate_effects import describe_exclusions
from rfca_rig.diagnosis.decision.decide import decide
from rfca_rig.diagnosis.inference.hypotheses import ModelSelectionResult
from rfca_rig.diagnosis.inference.model_selection import Progress, search_models
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.pendulums.candidates import candidates_of, own_effects
from rfca_rig.diagnosis.pendulums.nuisances import space_of_pendulum
from rfca_rig.diagnosis.pendulums.result import build_pendulum_result
from rfca_rig.diagnosis.pendulums.windows import BIN_S, WINDOW_S, pendulum_dataset, stretches_of
from rfca_rig.diagnosis.residual_force.stated_law import OF_PENDULUM, check_place, measure_stated_law
from rfca_rig.diagnosis.result import Diagnosis
from rfca_rig.model.effect import Effect


@algebra_on_one_thread()
def diagnose_pendulum(campaign: PendulumCampaign, progress: Progress, without: Collection[str] = (), law_at: str = "") -> Diagnosis:
    """The diagnosis of a pendulum's recordings.

    Raises BadInput where they are too short, SimulationFailed where the model cannot be computed as believed. `progress` is told what is
    being done and the share that is done; the effects of the ids in `without` are not looked for. With `law_at`, the law at that place is
    measured too.
    """
    if law_at:
        check_place(law_at, OF_PENDULUM[:1] if len(campaign.pendulum.links) == 1 else OF_PENDULUM)
    progress("reading", 0.0)
    problem = swings_of(campaign, WINDOW_S, BIN_S)
    found, effects = search_pendulum(problem, progress, without)
    progress("summing up", 0.97)
    decision = decide(found)
    diagnosis = build_pendulum_result(campaign, found, decision, effects)
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
    return search_models(pendulum_dataset(stretches_of(problem)), coordinates, effects, progress), effects
