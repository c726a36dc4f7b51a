"""`diagnose_mechanism`: recordings and a model file in, the same kind of answer out as for a leg."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

from rfca_rig.campaign.experiment import Experiment
from rfca_rig.diagnosis.candidate_effects import describe_exclusions
from rfca_rig.diagnosis.config import DEFAULT_SEARCH, FEWEST_CONDITIONS
from rfca_rig.diagnosis.data.dataset import make_dataset
from rfca_rig.diagnosis.data.windows import WINDOWS_OF_CONDITION
from rfca_rig.diagnosis.decision.decide import decide
from rfca_rig.diagnosis.experiment_design.mechanism_experiment import Excitation, propose_motion
from rfca_rig.diagnosis.inference.model_selection import Progress, search_models
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.mechanisms.check import refuse_misread_columns
from rfca_rig.diagnosis.mechanisms.joint_law import MeasuredJointLaw, measure_joint_law, parse_place
from rfca_rig.diagnosis.mechanisms.problem import make_problem
from rfca_rig.diagnosis.mechanisms.windows import MOTION_EXPERIMENT
from rfca_rig.diagnosis.result import Diagnosis
from rfca_rig.diagnosis.result_builder import build_result, not_enough_data
from rfca_rig.executors.cores import single_threaded_blas
from rfca_rig.mechanism.load import load_mechanism
from rfca_rig.mechanism.plant import Plant
from rfca_rig.model.effect import Effect

# Twelve single effects are enough for a leg. Of a hopper whose force was 15 % too small the right one promised only the fourteenth most,
# since a motion with contacts is not linear in it; what was fitted instead were three effects that do the same together.
SEARCH = replace(DEFAULT_SEARCH, singles_coarse=18)


@dataclass(frozen=True)
class MechanismDiagnosis:
    """The answer about a mechanism.

    Parameters
    ----------
    diagnosis
        The answer in the common form.
    plant
        The mechanism with the stated effects; effects and nuisance parameters are at their posterior means.
    excitation
        The motion to record next; None where no motion is proposed.
    law
        The law that was measured on request.
    stated
        Formulas, sources and values of the stated effects, in lines.
    """

    diagnosis: Diagnosis
    plant: Plant
    excitation: Excitation | None
    law: MeasuredJointLaw | None
    stated: tuple[str, ...]


@single_threaded_blas()
def diagnose_mechanism(
    experiment: Experiment, progress: Progress, without: Collection[str] = (), law_at: str = "", as_is: bool = False
) -> MechanismDiagnosis:
    """The diagnosis of recordings of a mechanism.

    Parameters
    ----------
    experiment
        The recordings and the model file.
    progress
        Called with the current step and the share that is done.
    without
        Ids of effects that are not looked for.
    law_at
        Where a law is measured too, as of `parse_place`, if not empty.
    as_is
        Take columns that probably have another sign or unit than stated, too.

    Raises
    ------
    BadInput
        Where recordings and model do not fit together, a column is probably misread, or the recordings are too short.
    SimulationFailed
        Where the nominal model cannot be simulated.
    """
    progress("reading", 0.0)
    mechanism = load_mechanism(experiment.model)
    if not as_is:
        refuse_misread_columns(experiment, mechanism)
    problem = make_problem(experiment, mechanism)
    # Names given by the user are checked before the long search.
    problem.check_effects("--without", without)
    place = parse_place(law_at, problem.simulator.mechanism) if law_at else None
    simulator = problem.simulator
    effects = [effect for effect in simulator.effects.values() if effect.id not in without]
    dataset = make_dataset(problem.conditions, simulator)
    found = search_models(dataset, Parameterization(problem.space), effects, progress, SEARCH)
    progress("summing up", 0.97)
    decision = decide(found)
    enough = len(problem.conditions) >= FEWEST_CONDITIONS
    if not enough:
        length_s = WINDOWS_OF_CONDITION * experiment.window_s
        decision = not_enough_data(found, f"{len(problem.conditions)} stretches of {length_s:g} s, {FEWEST_CONDITIONS} are needed")
    result = build_result(experiment.title, found, decision, effects, MOTION_EXPERIMENT)
    settings = {
        "window_s": experiment.window_s,
        "bin_s": experiment.bin_s,
        "step_s": simulator.step_s,
        "integrator": "implicit" if simulator.mechanism.is_implicit else "RK4",
    }
    # Effects enter the model only if they are stated.
    stated = decision.explanation if result.found_effects else found.nothing
    plant = simulator.plant(stated.fitted.coordinates.supposed(stated.marginal.posterior.mean))
    thinning = f"{problem.windows} of {problem.recorded_windows} recorded windows were used, evenly spread; windows.at_most uses more"
    next_motion = propose_motion(problem, found, decision, enough)
    law = None
    if place is not None:
        progress(f"measuring the law at {law_at}", 0.98)
        law = measure_joint_law(problem, found, decision.explanation, place)
    thinned = (thinning,) if problem.windows < problem.recorded_windows else ()
    result = replace(
        result,
        remarks=(*result.remarks, *describe_exclusions(without), *thinned),
        stated_law=None if law is None else law.stated,
        settings={**result.settings, **settings, "windows": problem.windows},
        next_experiment=None if next_motion is None else next_motion.proposal,
    )
    excitation = None if next_motion is None else next_motion.excitation
    return MechanismDiagnosis(result, plant, excitation, law, _describe_effects(result, simulator.effects))


def _describe_effects(result: Diagnosis, effects: Mapping[str, Effect]) -> tuple[str, ...]:
    """The stated effects with formulas, sources and values."""
    lines = []
    for named in result.effects:
        effect = effects[named.id]
        lines += [f"{named.id}: {named.left_out}", f"    law: {effect.law}", f"    source: {effect.source}"]
        lines += [f"    {name} = {value.value:.4g} +- {value.std:.2g}" for name, value in {**named.parameters, **named.shape}.items()]
    return tuple(lines)
