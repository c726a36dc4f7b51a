"""Nominal values of a pendulum fitted to its recordings, with no effect in the model."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

from rfca_rig.analysis.swings import SwingProblem, apply_nuisances, make_swing_problem
from rfca_rig.campaign.pendulum import PendulumCampaign
from rfca_rig.diagnosis.inference.model_selection import Progress, search_models
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.pendulums.windows import BIN_S, WINDOW_S, cut_stretches, make_pendulum_dataset, space_of_pendulum, to_pendulum_input
from rfca_rig.diagnosis.window_fit import WindowFit, summarize
from rfca_rig.errors import BadInput
from rfca_rig.executors.cores import single_threaded_blas
from rfca_rig.model.pendulum import Pendulum

PENDULUM_FIT = "rfca-pendulum-fit/1"


@dataclass(frozen=True)
class PendulumFit:
    """The fit, and the pendulum with fitted nominal values."""

    fit: WindowFit
    pendulum: Pendulum


@single_threaded_blas()
def fit_pendulum(campaign: PendulumCampaign, progress: Progress, names: Collection[str] = ()) -> PendulumFit:
    """The nominal values of [known_to] fitted to all runs, each with its stated uncertainty as prior.

    Parameters
    ----------
    campaign
        The recordings and the nominal pendulum.
    progress
        Called with what is being done and the share that is done.
    names
        What to fit, for example "link1.mass_relative"; all that [known_to] lists if empty.

    Raises
    ------
    BadInput
        Where nothing is to be fitted, a name is unknown, or no run is long enough.
    SimulationFailed
        Where the nominal pendulum cannot be simulated.
    """
    problem = _with_nuisances(make_swing_problem(campaign, WINDOW_S, BIN_S), names)
    stretches = cut_stretches(problem)
    space = space_of_pendulum(problem.pendulum, problem.nuisances)
    found = search_models(make_pendulum_dataset(stretches), Parameterization(space), [], progress)
    fit = summarize(found, found.nothing)
    shifts = dict(to_pendulum_input(space.at(found.nothing.marginal.posterior.mean)).off)
    return PendulumFit(fit, apply_nuisances(problem.pendulum, shifts))


def _with_nuisances(problem: SwingProblem, names: Collection[str]) -> SwingProblem:
    known = {nuisance.name: nuisance for nuisance in problem.nuisances}
    if not known:
        raise BadInput("nothing to fit: [known_to] lists no value that these runs depend on; add for example mass_relative = 0.05")
    for name in names:
        # A misspelt name must not silently leave a value out of the fit.
        if name not in known:
            raise BadInput(f"--parameters: {name!r} is none of {', '.join(known)}, which [known_to] lists and these runs depend on")
    return replace(problem, nuisances=tuple(one for one in problem.nuisances if not names or one.name in names))


def update_known_to(campaign: PendulumCampaign, fit: WindowFit) -> Mapping[str, float]:
    """[known_to] after the fit; what was not fitted stays as stated.

    One key holds for several links, so the largest of their standard deviations is kept.
    """
    found = dict(campaign.known_to)
    # A shift is named LINK.KEY, and [known_to] has one value per KEY.
    for key in {shift.name.partition(".")[2] for shift in fit.shifts}:
        found[key] = max(shift.std for shift in fit.shifts if shift.name.partition(".")[2] == key)
    return found
