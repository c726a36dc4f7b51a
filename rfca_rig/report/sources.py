"""The recordings of a report, each with the model it is held against and a name that no other has."""

from collections.abc import Sequence
from dataclasses import dataclass

from rfca_rig.analysis.compare import ComparedCondition, compare_condition
from rfca_rig.analysis.matched_simulation import Shaft
from rfca_rig.analysis.peak_force import PeakForceRow, peak_row_of
from rfca_rig.analysis.repeats import conditions_of
from rfca_rig.analysis.table2 import Table2Row, row_of
from rfca_rig.description.nominal_model import nominal_model
from rfca_rig.model.parameters import RigModel
from rfca_rig.progress import Watcher, counted, unwatched
from rfca_rig.recording.model import Recording


@dataclass(frozen=True)
class GivenModel:
    """A model that a report was asked to hold all recordings against, and the name of its file."""

    file: str
    rig: RigModel


@dataclass(frozen=True)
class ComparedSource:
    """One recording compared condition by condition; `rows` and `peaks` go with `compared`, one for one.

    `rig` is None where nothing was believed and there is no stroke to hold a model against.
    """

    name: str
    recording: Recording
    rig: RigModel | None
    compared: tuple[ComparedCondition, ...]

    @property
    def rows(self) -> tuple[Table2Row, ...]:
        return tuple(row_of(compared, self.name) for compared in self.compared)

    @property
    def peaks(self) -> tuple[PeakForceRow, ...]:
        return tuple(peak_row_of(compared, self.name) for compared in self.compared)


def compare_sources(
    recordings: Sequence[Recording], shaft: Shaft, given: GivenModel | None = None, watcher: Watcher = unwatched
) -> tuple[ComparedSource, ...]:
    """Each recording against the `given` model, or, where none is given, against the model it was believed to follow.

    Raises BadInput where the nominal values make no model, SimulationFailed.
    """
    names = _distinct([recording.title for recording in recordings])
    conditions = [len(conditions_of(recording.strokes)) for recording in recordings]
    return tuple(
        _compared(name, recording, shaft, given, _part(watcher, sum(conditions[:number]), sum(conditions)))
        for number, (name, recording) in enumerate(zip(names, recordings, strict=True))
    )


def _part(watcher: Watcher, before: int, of: int) -> Watcher:
    """For one recording, of the conditions of all."""
    return lambda done, _: watcher(before + done, of)


def _compared(name: str, recording: Recording, shaft: Shaft, given: GivenModel | None, watcher: Watcher) -> ComparedSource:
    if given is None and not recording.strokes and not recording.nominal:
        return ComparedSource(name, recording, None, ())
    rig = nominal_model(recording.nominal) if given is None else given.rig
    conditions = counted(conditions_of(recording.strokes), watcher)
    return ComparedSource(name, recording, rig, tuple(compare_condition(rig, condition, shaft) for condition in conditions))


def _distinct(titles: Sequence[str]) -> list[str]:
    """Equal titles are numbered in their order."""
    return [f"{title} ({titles[: i + 1].count(title)})" if titles.count(title) > 1 else title for i, title in enumerate(titles)]
