"""`diagnose_pendulum`: recordings of a pendulum in, the same kind of answer out as for a leg."""

from rfca_rig.analysis.swings import SwingProblem, swings_of
from rfca_rig.campaign.pendulum import PendulumCampaign
from rfca_rig.diagnosis.coordinates import Coordinates
from rfca_rig.diagnosis.deciding import decided
from rfca_rig.diagnosis.evidence import evidence_of
from rfca_rig.diagnosis.pendulum_nuisances import space_of_pendulum
from rfca_rig.diagnosis.pendulum_parts import BIN_S, WINDOW_S, stretches_of
from rfca_rig.diagnosis.pendulum_summary import summed_up
from rfca_rig.diagnosis.result import Diagnosis
from rfca_rig.diagnosis.search import Found, Progress, searched
from rfca_rig.model.catalogue import catalogue
from rfca_rig.model.effect import Effect

OF_PENDULUMS = "pendulum-like rigs"
ALSO = ("fluid_drag", "hinge_viscous_damping", "gravity_tilt")


def diagnose_pendulum(campaign: PendulumCampaign, progress: Progress) -> Diagnosis:
    """The diagnosis of a pendulum's recordings.

    Raises BadInput where they are too short, SimulationFailed where the model cannot be computed as believed. `progress` is told what is
    being done and the share that is done.
    """
    progress("reading", 0.0)
    problem = swings_of(campaign, WINDOW_S, BIN_S)
    found, effects = found_in(problem, progress)
    progress("summing up", 0.97)
    return summed_up(campaign, found, decided(found, len(effects)), effects)


def found_in(problem: SwingProblem, progress: Progress) -> tuple[Found, list[Effect]]:
    """The search over all effects that a pendulum may lack, and those effects."""
    coordinates = Coordinates(space_of_pendulum(problem.pendulum, problem.nuisances))
    effects = _candidates(problem)
    return searched(evidence_of(stretches_of(problem)), coordinates, effects, progress), effects


def _candidates(problem: SwingProblem) -> list[Effect]:
    """What a pendulum may lack; without a drive its torque has no scale."""
    idle = () if any(link.driven for link in problem.pendulum.links) else ("torque_scale",)
    known = [effect for effect in catalogue().values() if effect.where == OF_PENDULUMS or effect.id in ALSO]
    return [effect for effect in known if effect.id not in idle]
