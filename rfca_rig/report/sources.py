"""Recordings of a report, each with the model it is compared with and a unique name."""

from collections.abc import Sequence
from dataclasses import dataclass

from rfca_rig.analysis.compare import ComparedCondition, Table2Row, compare_condition, make_table2_row
from rfca_rig.analysis.matched_simulation import Shaft
from rfca_rig.analysis.peak_force import PeakForceRow, make_peak_row
from rfca_rig.analysis.repeats import group_by_condition
from rfca_rig.description.nominal_model import nominal_model
from rfca_rig.model.parameters import RigModel
from rfca_rig.progress import ProgressCount, ignore_progress, iterate_with_progress
from rfca_rig.recording.model import Recording


@dataclass(frozen=True)
class GivenModel:
    """A model that all recordings of a report are compared with, and the name of its file."""

    file: str
    rig: RigModel


@dataclass(frozen=True)
class ComparedSource:
    """One recording compared with a model condition by condition; `rows` and `peaks` correspond to `compared` one to one.

    `rig` is None where the recording has no nominal model and no stroke to compare.
    """

    name: str
    recording: Recording
    rig: RigModel | None
    compared: tuple[ComparedCondition, ...]

    @property
    def rows(self) -> tuple[Table2Row, ...]:
        return tuple(make_table2_row(compared, self.name) for compared in self.compared)

    @property
    def peaks(self) -> tuple[PeakForceRow, ...]:
        return tuple(make_peak_row(compared, self.name) for compared in self.compared)


def compare_sources(
    recordings: Sequence[Recording], shaft: Shaft, given: GivenModel | None = None, watcher: ProgressCount = ignore_progress
) -> tuple[ComparedSource, ...]:
    """Compares each recording with the `given` model, or with its own nominal model where none is given.

    Parameters
    ----------
    recordings
        Recordings to compare.
    shaft
        How the simulated shaft turns, see `analysis.matched_simulation`.
    given
        A model for all recordings; None for each recording's own.
    watcher
        Progress callback: number of conditions done, number of conditions.

    Raises
    ------
    BadInput
        Where nominal values do not make a model.
    SimulationFailed
        Where a stroke cannot be simulated.
    """
    names = _number_equal_titles([recording.title for recording in recordings])
    conditions = [len(group_by_condition(recording.strokes)) for recording in recordings]
    return tuple(
        _compare(name, recording, shaft, given, _offset_watcher(watcher, sum(conditions[:number]), sum(conditions)))
        for number, (name, recording) in enumerate(zip(names, recordings, strict=True))
    )


def _offset_watcher(watcher: ProgressCount, before: int, of: int) -> ProgressCount:
    """A watcher for one recording that reports to the one for all conditions; `before` is the number done before."""
    return lambda done, _: watcher(before + done, of)


def _compare(name: str, recording: Recording, shaft: Shaft, given: GivenModel | None, watcher: ProgressCount) -> ComparedSource:
    if given is None and not recording.strokes and not recording.nominal:
        return ComparedSource(name, recording, None, ())
    rig = nominal_model(recording.nominal) if given is None else given.rig
    conditions = iterate_with_progress(group_by_condition(recording.strokes), watcher)
    return ComparedSource(name, recording, rig, tuple(compare_condition(rig, condition, shaft) for condition in conditions))


def _number_equal_titles(titles: Sequence[str]) -> list[str]:
    """Equal titles are numbered in their order."""
    return [f"{title} ({titles[: i + 1].count(title)})" if titles.count(title) > 1 else title for i, title in enumerate(titles)]
