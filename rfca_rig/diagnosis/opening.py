"""`open_problem`: recordings of any kind at some paths as a problem of the diagnosis."""

from collections.abc import Sequence
from pathlib import Path

from rfca_rig.campaign.opening import (
    experiment_among,
    open_experiment,
    open_recordings,
    open_with_nominal_model,
)
from rfca_rig.diagnosis.leg.problem import LegProblem
from rfca_rig.diagnosis.mechanisms.problem import MechanismProblem
from rfca_rig.diagnosis.problem import Problem


def open_problem(
    paths: Sequence[Path],
    as_is: bool = False,
    allow_outside: bool = False,
    model: Path | None = None,
) -> Problem:
    """The recordings at `paths` as a problem.

    Parameters
    ----------
    paths
        Recordings of one leg, or one folder with experiment.toml or pendulum.toml.
    as_is
        Take values that are probably in another unit or of another sign.
    allow_outside
        Take links that lead out of a folder, and files of a model anywhere.
    model
        A model file that takes the place of the nominal model.

    Raises
    ------
    BadInput
        One line where something cannot be used.
    """
    folder = experiment_among(paths)
    if folder is not None:
        return MechanismProblem(open_experiment(folder, allow_outside, model), as_is)
    # Without a model file all recordings need their nominal model.
    if model is None:
        recordings = open_with_nominal_model(paths, as_is, allow_outside)
    else:
        recordings = open_recordings(paths, as_is, allow_outside)
    return LegProblem(tuple(recordings), tuple(paths))
