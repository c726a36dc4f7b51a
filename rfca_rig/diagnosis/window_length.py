"""Windows as long as the model allows, recording by recording. Entry point: `search_in_windows`.

What a wrong torque does to a motion grows with the square of the time, and what a wrong start does
grows more slowly. So a long window shows what a short one hides behind the uncertainty of its
start. A window ends where a simulation says nothing any more:

- where the errors of its measured start are no longer small beside the signal, as in chaotic
  motion;
- where the best fit misses the signal by so much that Gauss-Newton steps no longer lead to it, for
  example in the wrong swing.

Lengths double. The best fit on shorter windows is where the fit on longer ones begins (multiple
shooting from short to long). Where errors of the start are too large from the first, lengths are
halved.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from math import ceil
from typing import Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.config import DEFAULT_SEARCH, SearchConfig
from rfca_rig.diagnosis.data import rms
from rfca_rig.diagnosis.inference.hypotheses import ModelSelectionResult
from rfca_rig.diagnosis.inference.map_fit import MapFit, without_scatter
from rfca_rig.diagnosis.inference.model_selection import Progress, search_models
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.simulator import Dataset
from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.model.effect import Effect

Floats = NDArray[np.float64]

# Rms of what errors of the start do, and of what the best fit misses, as shares of the rms change
# of the signals in a recording.
MAX_START_SHARE = 0.25
MAX_MISFIT_SHARE = 0.5
SHORTEST_S = 0.25
LONGEST_S = 2.0
FEWEST_STRETCHES = 4  # conditions that must remain: held-out prediction with fewer says little
LEAST_ROWS = 0.8  # share of the rows on shorter windows that must remain
# sets of effects whose fits go on to longer windows: on short ones a wrong law may be as good as
# the right one
CARRIED = 2
SHARE_OF_SINGLES = 0.2  # of the progress of a diagnosis
# Where the first search is made, as it is shown.
SHORT_WINDOWS = "short windows"
TORQUES = "torques"
LEAST_GROWTH = 1.2  # times the former length, below which another cut is not worth its simulations


class WindowedProblem(Protocol):
    """Recordings cut into windows, which can be cut again."""

    @property
    def chooses_lengths(self) -> bool:
        """Whether the recordings may be cut again, into windows of other lengths."""
        ...

    @property
    def recordings(self) -> tuple[str, ...]:
        """Names of the recordings, as in the labels of the rows."""
        ...

    @property
    def recordings_s(self) -> tuple[float, ...]:
        """The time of each recording that windows can cover."""
        ...

    @property
    def lengths_s(self) -> tuple[float, ...]:
        """Length of the windows of each recording."""
        ...

    @property
    def dataset(self) -> Dataset:
        """The windows as conditions."""
        ...

    @property
    def start_std(self) -> Floats:
        """(m,) standard deviation of the nominal prediction of each row, because the measured
        starts have errors.
        """
        ...

    def cut_again(self, lengths_s: Sequence[float]) -> Self:
        """The same recordings in windows of other lengths, with the same effects and nuisance
        parameters.

        Raises SimulationFailed, and BadInput where no such window can be used.
        """
        ...


P = TypeVar("P", bound=WindowedProblem)


@dataclass(frozen=True)
class WindowErrors:
    """What errors of the measured starts do in the windows of one recording, and what a fit
    misses, as shares of the signals' change.
    """

    start: float
    misfit: float

    @property
    def are_small(self) -> bool:
        """Whether a simulation still says something at the end of a window, and a fit can still
        improve.
        """
        return self.start <= MAX_START_SHARE and self.misfit <= MAX_MISFIT_SHARE


def search_in_windows(
    problem: P,
    coordinates: Parameterization,
    effects: Sequence[Effect],
    progress: Progress,
    config: SearchConfig = DEFAULT_SEARCH,
    torques: Dataset | None = None,
) -> tuple[P, ModelSelectionResult]:
    """The search over hypotheses in windows as long as allowed: the problem with these windows, and
    the result.

    Parameters are those of `search_models`, for the problem in short windows. `torques` is a
    dataset with the same unknowns that is not simulated, where there is one: single effects are
    then searched in it instead of in short windows.
    """
    if not problem.chooses_lengths:
        return problem, search_models(problem.dataset, coordinates, effects, progress, config)
    first = SHORT_WINDOWS if torques is None else TORQUES

    def progress_of_singles(text: str, share: float) -> None:
        progress(f"{first}: {text}", SHARE_OF_SINGLES * share)

    def progress_of_all(text: str, share: float) -> None:
        progress(text, SHARE_OF_SINGLES + (1.0 - SHARE_OF_SINGLES) * share)

    problem = shorten_windows(problem)
    # Single effects explain the motion well enough to tell how far a simulation can go.
    search = search_models(
        problem.dataset if torques is None else torques,
        coordinates,
        effects,
        progress_of_singles,
        replace(config, singles_only=True),
    )
    if config.budget.is_spent:
        stage = f"{first}: {search.ended_in}"
        if torques is not None:
            search = search_models(
                problem.dataset, coordinates, effects, progress_of_all, config, _list_best(search)
            )
        return problem, replace(search, ended_in=stage)
    problem, begun = lengthen_windows(problem, search)
    return problem, search_models(
        problem.dataset, coordinates, effects, progress_of_all, config, begun
    )


def describe_lengths(lengths_s: Sequence[float]) -> list[float]:
    """Shortest and longest of the lengths, to the hundredth of a second; a single value where
    all are alike.
    """
    return sorted({round(min(lengths_s), 2), round(max(lengths_s), 2)})


def shorten_windows(problem: P) -> P:
    """The recordings in windows of half the length, SHORTEST_S at least, as long as errors of the
    start are too large in the present ones.

    The very same problem, where they are not, or where shorter windows cannot be used.
    """
    while True:
        too_long = {
            recording
            for recording, share in measure_start_errors(problem).items()
            if share > MAX_START_SHARE
            and problem.lengths_s[problem.recordings.index(recording)] >= 2.0 * SHORTEST_S
        }
        if not too_long:
            return problem
        named = zip(problem.recordings, problem.lengths_s, strict=True)
        try:
            problem = problem.cut_again(
                [0.5 * length_s if name in too_long else length_s for name, length_s in named]
            )
        except (SimulationFailed, BadInput):
            return problem


def lengthen_windows(problem: P, found: ModelSelectionResult) -> tuple[P, tuple[MapFit, ...]]:
    """The recordings in windows that are as long as allowed, and the best fits on them.

    Parameters
    ----------
    problem
        The recordings in short windows.
    found
        The search on them.

    Returns
    -------
    problem, fits
        The very same problem, and no fits, where no window may be longer.
    """
    begun = _list_best(found)
    used = {label.recording for label in problem.dataset.rows.labels}
    growing = {index for index, name in enumerate(problem.recordings) if name in used}
    fits: tuple[MapFit, ...] = ()
    while growing:
        lengths_s = _double_lengths(problem, growing)
        growing = {index for index in growing if lengths_s[index] > problem.lengths_s[index]}
        if growing:
            longer = _cut_and_fit(problem, lengths_s, fits or begun)
        else:
            longer = None
        if longer is None:
            break
        errors = measure_window_errors(longer[0], longer[1][0])
        growing = {
            index
            for index in growing
            if (error := errors.get(problem.recordings[index])) and error.are_small
        }
        if not growing:
            break
        kept_s = [
            long_s if index in growing else problem.lengths_s[index]
            for index, long_s in enumerate(lengths_s)
        ]
        # Where some recordings keep their former windows, those are fitted beside the longer ones.
        if kept_s != lengths_s:
            longer = _cut_and_fit(problem, kept_s, fits or begun)
        if longer is None:
            break
        problem, fits = longer
    return problem, fits


def _list_best(found: ModelSelectionResult) -> tuple[MapFit, ...]:
    """The fits that go on to other windows: without effects, and the best with some."""
    return tuple(hypothesis.fitted for hypothesis in (found.nothing, *found.named[:CARRIED]))


def _double_lengths(problem: WindowedProblem, growing: Collection[int]) -> list[float]:
    """Lengths of about twice the present ones, LONGEST_S at most, for the recordings that grow;
    each recording is divided evenly.
    """
    lengths_s = list(problem.lengths_s)
    for index in growing:
        recording_s = problem.recordings_s[index]
        doubled_s = recording_s / ceil(recording_s / min(2.0 * lengths_s[index], LONGEST_S))
        if doubled_s > LEAST_GROWTH * lengths_s[index]:
            lengths_s[index] = doubled_s
    return lengths_s


def _cut_and_fit(
    problem: P, lengths_s: Sequence[float], begun: Sequence[MapFit]
) -> tuple[P, tuple[MapFit, ...]] | None:
    """The problem in windows of these lengths, and the fits on them.

    None where that cannot be simulated, leaves few conditions, or loses much of the recordings
    because more windows span a gap.
    """
    try:
        longer = problem.cut_again(lengths_s)
    except (SimulationFailed, BadInput):
        return None
    if len(longer.dataset.parts) < FEWEST_STRETCHES:
        return None
    if len(longer.dataset.rows.measured) < LEAST_ROWS * len(problem.dataset.rows.measured):
        return None
    optimizer = without_scatter(longer.dataset)
    at_former = [optimizer.at(fit.coordinates, fit.x) for fit in begun]
    fits = [optimizer.refine(fit) for fit in at_former if fit is not None]
    if fits:
        return (longer, tuple(sorted(fits, key=optimizer.free_log_evidence, reverse=True)))
    return None


def measure_window_errors(problem: WindowedProblem, fit: MapFit) -> dict[str, WindowErrors]:
    """Errors in the windows of each recording by its name, with this fit; shares as of
    `measure_start_errors`.
    """
    starts = measure_start_errors(problem)
    misfits = _share_of_change(problem.dataset, problem.dataset.rows.measured - fit.predicted)
    return {recording: WindowErrors(starts[recording], misfits[recording]) for recording in starts}


def measure_start_errors(problem: WindowedProblem) -> dict[str, float]:
    """What errors of the measured starts do in the windows of each recording, by its name, as a
    share of the change of the signals.

    A share is the root of the mean over the signals of (rms error / change)^2. The change of a
    signal is its standard deviation over all recordings, so that a recording at rest is not judged
    by its noise.
    """
    return _share_of_change(problem.dataset, problem.start_std)


def _share_of_change(dataset: Dataset, errors: Floats) -> dict[str, float]:
    rows = dataset.rows
    signals = rows.signal
    recordings = np.array([label.recording for label in rows.labels])[rows.label]
    by_recording = {}
    for recording in dict.fromkeys(recordings.tolist()):
        shares = []
        for signal in np.unique(signals):
            mask = (recordings == recording) & (signals == signal)
            change = max(float(np.std(rows.measured[signals == signal])), 1e-300)
            shares.append(rms(errors[mask]) / change)
        by_recording[recording] = float(np.sqrt(np.mean(np.square(shares))))
    return by_recording
