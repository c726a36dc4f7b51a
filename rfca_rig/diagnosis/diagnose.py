"""`diagnose`: a problem in, the whole answer out, whatever the kind of the rig."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rfca_rig.diagnosis.budget import UNLIMITED, TimeBudget
from rfca_rig.diagnosis.config import describe_exclusions
from rfca_rig.diagnosis.inference.model_selection import Progress
from rfca_rig.diagnosis.problem import DecidedSearch, FileWriter, Problem
from rfca_rig.diagnosis.result import Diagnosis
from rfca_rig.executors.cores import single_threaded_blas
from rfca_rig.protocol.plan import Limits


@dataclass(frozen=True)
class Answer:
    """The answer of a diagnosis.

    Parameters
    ----------
    diagnosis
        The answer as plain values.
    writers
        Write the files with which a user goes on: the model with what is stated, the next
        experiment, the measured law.
    searches
        The searches that it rests on, by what was searched.
    """

    diagnosis: Diagnosis
    writers: tuple[FileWriter, ...]
    searches: Mapping[str, DecidedSearch]

    def write_files(self, folder: Path) -> list[str]:
        """Write these files into `folder`, which exists, and remove those of an earlier answer that
        this one lacks. Returns lines for the user. Raises RigError where the disk refuses.
        """
        return [line for write in self.writers for line in write(folder)]


@single_threaded_blas()
def diagnose(
    problem: Problem,
    progress: Progress,
    without: Collection[str] = (),
    law_at: str = "",
    limits: Limits | None = None,
    budget: TimeBudget = UNLIMITED,
) -> Answer:
    """The diagnosis of recordings of one rig.

    Parameters
    ----------
    problem
        The recordings, as `opening.open_problem` opens them.
    progress
        Called with the current step and the share that is done.
    without
        Ids of effects that are not looked for.
    law_at
        Place where a law is measured too, if not empty.
    limits
        Of the rig that the next experiment is for; None where they are not known.
    budget
        Time for the search; when it is spent, the answer is the best so far.

    Raises
    ------
    BadInput
        Where the recordings cannot be used together, or not at all.
    SimulationFailed
        Where the nominal model cannot be simulated.
    """
    progress("reading", 0.0)
    # Names given by the user are checked before the long search.
    problem.check_effects("--without", without)
    if law_at:
        problem.check_place(law_at)
    solution = problem.solve(without, progress, budget)
    progress("summing up", 0.97)
    stated = solution.describe()
    experiment = solution.propose_experiment(limits)
    if law_at:
        progress(f"measuring the law at {law_at}", 0.98)
    # Without a place its writer removes the law of an earlier diagnosis.
    law = solution.measure_law(law_at)
    diagnosis = replace(
        stated,
        recordings=problem.recordings,
        remarks=(*stated.remarks, *describe_exclusions(without)),
        next_experiment=experiment.stated,
        stated_law=law.stated,
    )

    def write_model(folder: Path) -> Sequence[str]:
        return solution.write_model(folder, diagnosis)

    writers = (write_model, law.write_files, experiment.write_files)
    return Answer(diagnosis, writers, solution.searches)
