"""What is diagnosed and fitted: recordings of one rig, with everything that depends on its kind.

`diagnose.diagnose` takes a `Problem`, and so do the commands `diagnose`, `fit` and `report` and the
notebook. `opening.open_problem` makes it from paths. A kind of rig implements two classes beside
its `simulator.Simulator`:

1. `Problem`: which effects may be missing, how the hypotheses are searched, how values are fitted.
2. `Solution`: what the searches say of this kind of rig beyond the common answer, which experiment
   comes next, and the files with which its users go on.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.space import Prior
from rfca_rig.diagnosis.budget import UNLIMITED, TimeBudget
from rfca_rig.diagnosis.config import SearchConfig
from rfca_rig.diagnosis.data import Observations
from rfca_rig.diagnosis.decision.decision import Decision
from rfca_rig.diagnosis.inference.hypotheses import ModelSelectionResult
from rfca_rig.diagnosis.inference.model_selection import Progress
from rfca_rig.diagnosis.residual_force.law import StatedLaw
from rfca_rig.diagnosis.result import Diagnosed, Diagnosis
from rfca_rig.diagnosis.simulator import Dataset
from rfca_rig.errors import BadInput
from rfca_rig.executors.mapping import TaskExecutor
from rfca_rig.model.effect import Effect
from rfca_rig.protocol.plan import Limits

T = TypeVar("T")
Row = Mapping[str, object]

# Writes into a folder what goes with a part of an answer, and removes such files of an earlier
# answer there. Returns lines for the user.
FileWriter = Callable[[Path], Sequence[str]]


@dataclass(frozen=True)
class AnswerPart(Generic[T]):
    """A part of an answer, and the files that go with it."""

    stated: T
    write_files: FileWriter


@dataclass(frozen=True)
class DecidedSearch:
    """The search for these effects in one set of observations, and its decision."""

    effects: Sequence[Effect]
    search: ModelSelectionResult
    decision: Decision


class Fit(Protocol):
    """Fitted values of a nominal model."""

    def plain(self) -> dict[str, Any]:
        """Everything as plain data, for JSON."""
        ...

    def lines(self) -> list[str]:
        """The values as lines for a terminal."""
        ...

    def rows(self) -> tuple[Row, ...]:
        """A row per value, for a table."""
        ...

    def write_model(self, path: Path) -> Sequence[str]:
        """Write the model with the fitted values; returns lines for the user.

        Raises BadInput for a name of another kind of file, RigError where the disk refuses.
        """
        ...


@dataclass(frozen=True)
class FitOptions:
    """What to fit. All but `names` and `effects` are options of a leg's strokes.

    Parameters
    ----------
    names
        Nominal values to fit; all of [known_to] if empty.
    effects
        Ids of the effects that are in the model; of a mechanism.
    shaft
        How the simulated shaft turns: recorded, average, commanded.
    phases, after_touchdown_s
        The part of a stroke that is fitted.
    starts, seed
        Number of points to begin from, and the seed that draws them.
    cluster, executor
        Where several descents run at once, as typed, and what runs them there.
    """

    names: Sequence[str] = ()
    effects: Sequence[str] = ()
    shaft: str = "recorded"
    phases: tuple[str, ...] = ("loading",)
    after_touchdown_s: float = 0.2
    starts: int = 1
    seed: int = 0
    cluster: str | None = None
    executor: TaskExecutor | None = None

    def refuse_leg_options(self) -> None:
        """Raise BadInput for the first option of a leg's strokes that differs from its default."""
        default = FitOptions()
        refuse_leg_options(
            {
                "--shaft": self.shaft != default.shaft,
                "--phases": self.phases != default.phases,
                "--after-touchdown": self.after_touchdown_s != default.after_touchdown_s,
                "--starts": self.starts != default.starts,
                "--cluster": self.cluster is not None,
            }
        )


def refuse_leg_options(given: Mapping[str, bool]) -> None:
    """Raise BadInput for the first given option that only applies to a leg: its user would believe
    that it was applied.
    """
    for option, is_given in given.items():
        if is_given:
            raise BadInput(f"{option}: is an option for recordings of a leg; leave it out here")


@dataclass(frozen=True)
class RecordingPair:
    """Recordings and their reference, in windows of one length, both with the nominal model of the
    recordings.

    Parameters
    ----------
    new, reference
        The observations of the recordings, and of the reference.
    space
        The nuisance parameters, with the priors that [known_to] states.
    free
        Names of nuisance parameters that differ from one recording day to the next anyway.
    effects
        The effects that may be missing.
    config
        How widely to search.
    solve
        The solution from a finding in the observations of the recordings.
    clear_proposal
        Removes the files of an experiment that an earlier diagnosis proposed.
    name_commands
        What must agree between two rows that belong together, beside their time.
    is_one_recording
        Whether the conditions of the recordings are parts of one, so that what differs from one
        recording to the next differs in all of them.
    conditions
        How many conditions of the recordings count for a verdict.
    """

    new: Dataset
    reference: Dataset
    space: Prior[Any]
    free: frozenset[str]
    effects: Sequence[Effect]
    config: SearchConfig
    solve: Callable[[DecidedSearch], "Solution"]
    clear_proposal: FileWriter
    name_commands: Callable[[Observations], NDArray[np.str_]]
    is_one_recording: bool
    conditions: int


class Solution(ABC):
    """The decided searches in the recordings of a problem."""

    @property
    @abstractmethod
    def searches(self) -> Mapping[str, DecidedSearch]:
        """The searches by what was searched: `forces` and `shaft` of a leg, `motion` of a
        mechanism.
        """

    @abstractmethod
    def describe(self) -> Diagnosis:
        """The answer, without the next experiment and without a measured law."""

    @abstractmethod
    def write_model(self, folder: Path, diagnosis: Diagnosis) -> Sequence[str]:
        """Write the model with what the diagnosis states; see `FileWriter`."""

    @abstractmethod
    def propose_experiment(self, limits: Limits | None) -> AnswerPart[Mapping[str, Any] | None]:
        """The experiment that separates what is still open; None where nothing would help.

        `limits` are those of the rig that it is for, None where they are not known.
        """

    @abstractmethod
    def measure_law(self, place: str) -> AnswerPart[StatedLaw | None]:
        """The law at a place beside what is stated; none where `place` is empty.

        Raises SimulationFailed where the model has no answer with any law there.
        """


class Problem(ABC):
    """Recordings of one rig, with everything that depends on its kind."""

    @property
    @abstractmethod
    def recordings(self) -> tuple[Diagnosed, ...]:
        """What is diagnosed, each with its identity."""

    @abstractmethod
    def list_effects(self) -> Sequence[Effect]:
        """The effects that these recordings could show, with their plausible ranges.

        Raises BadInput where the recordings cannot be used.
        """

    @abstractmethod
    def check_effects(self, option: str, names: Collection[str]) -> None:
        """Raise BadInput for a name, given with this option, that is no effect of this rig."""

    @abstractmethod
    def check_place(self, place: str) -> None:
        """Raise BadInput for a place where no law can be measured on this rig."""

    @abstractmethod
    def solve(
        self, without: Collection[str], progress: Progress, budget: TimeBudget = UNLIMITED
    ) -> Solution:
        """Search for the effects that the model lacks, all but those of the ids `without`, and
        decide: with what was found so far when the budget is spent.

        Raises BadInput where the recordings cannot be used, SimulationFailed where the nominal
        model cannot be simulated.
        """

    @abstractmethod
    def pair_with(
        self, reference: "Problem", without: Collection[str], progress: Progress
    ) -> RecordingPair:
        """These recordings and a reference in rows that can be compared, for the effects but those
        of the ids `without`.

        Raises BadInput where that cannot be done, SimulationFailed where the nominal model cannot
        be simulated.
        """

    def list_runs(self) -> Sequence[Any]:
        """The recordings (`recording.model.Recording`), where this program can run experiments on
        such a rig. Raises BadInput where it cannot.
        """
        raise BadInput(
            "--close-the-loop runs experiments on a leg's rig; leave it out for a mechanism and "
            "record the proposed motion"
        )

    def with_runs(self, runs: Sequence[Any]) -> "Problem":  # noqa: ARG002
        """The same with further recordings. Raises BadInput as `list_runs`."""
        self.list_runs()
        return self

    @abstractmethod
    def check_fit(self, options: FitOptions, out: Path | None) -> None:
        """Raise BadInput for options, or for a model file `out`, that this rig cannot have."""

    @abstractmethod
    def fit(self, options: FitOptions, progress: Progress) -> Fit:
        """Fit nominal values to all recordings, each with its prior.

        Raises BadInput where the recordings cannot be used or a name is not known, SimulationFailed
        where the nominal model cannot be simulated.
        """
