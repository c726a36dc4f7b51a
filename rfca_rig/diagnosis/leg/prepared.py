"""Recordings of a leg as conditions, with everything that does not depend on the hypothesis."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rfca_rig.analysis.phases import Undetermined
from rfca_rig.analysis.repeats import Condition, group_by_condition
from rfca_rig.description.model_file import nominal_model
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.leg.shaft_observations import (
    ShaftCondition,
    estimate_delay_s,
    make_shaft_condition,
    tracks_command,
)
from rfca_rig.diagnosis.leg.simulator import infer_approach, make_leg_dataset, nuisances_of
from rfca_rig.diagnosis.leg.stages import HOLD_S, StageTable, make_stage_tables
from rfca_rig.diagnosis.leg.strokes import (
    DynamicCondition,
    StrokeBins,
    make_dynamic_condition,
    make_turn,
)
from rfca_rig.diagnosis.simulator import Dataset
from rfca_rig.model.parameters import RigModel
from rfca_rig.model.static_stages import StageMoves
from rfca_rig.recording.model import Recording, Stroke, collect_strokes_before, refuse_other_nominal


@dataclass(frozen=True)
class PreparedLeg:
    """Recordings as conditions, and the nominal model with its standard uncertainties.

    Parameters
    ----------
    title
        Titles of the recordings.
    rig
        The nominal model.
    known_to
        Standard uncertainties by key of [known_to].
    noise_std
        Stated sensor noise by signal; None where it is to be estimated.
    flaps, shafts
        Conditions of the strokes, and of the motion of the shaft where it was recorded.
    tables
        Conditions of the static stages.
    as_commanded
        Whether every shaft followed its command, at once or with a delay.
    coordinates
        The nuisance parameters.
    remarks
        Conditions that cannot be used, with the reason.
    strokes_made
        How many strokes the leg has made in all; None where their order is not known.
    before_s
        Time before the start of a stroke that all recordings cover.
    """

    title: str
    rig: RigModel
    known_to: Mapping[str, float]
    noise_std: Mapping[str, float | None]
    flaps: tuple[DynamicCondition, ...]
    shafts: tuple[ShaftCondition, ...]
    tables: tuple[StageTable, ...]
    as_commanded: bool
    coordinates: Parameterization
    remarks: tuple[str, ...]
    strokes_made: int | None = None
    before_s: float = 0.0

    @property
    def dataset(self) -> Dataset:
        """The forces of strokes and stages; the motion of the shaft is a dataset of its own.

        Raises BadInput where no condition can be used.
        """
        return make_leg_dataset([*self.flaps, *self.tables], self.as_commanded)


@dataclass(frozen=True)
class Alignment:
    """What recordings have in common that are compared row by row.

    Parameters
    ----------
    bins
        Of the strokes, by the label of their condition.
    as_commanded
        Whether every shaft followed its command.
    before_s
        Time before the start of a stroke that all recordings cover.
    moves
        How the stages are approached.
    """

    bins: Mapping[str, StrokeBins]
    as_commanded: bool
    before_s: float
    moves: StageMoves


FIRST_GUESS = StageMoves(1.0, 0.005, HOLD_S)


def prepare_leg(recordings: Sequence[Recording], alignment: Alignment | None = None) -> PreparedLeg:
    """Cut the recordings into conditions, with the nominal rig and its nuisance parameters.

    Parameters
    ----------
    recordings
        Recordings of one leg.
    alignment
        What they have in common with others; None where they stand alone.

    Raises
    ------
    BadInput
        Where the recordings have different nominal models.
    """
    first = recordings[0]
    refuse_other_nominal(recordings, "diagnose them one by one")
    rig = nominal_model(first.nominal)
    noise_std = first.nominal["sensor"].get("noise_std") or {}
    bins: Mapping[str, StrokeBins] = {} if alignment is None else alignment.bins
    conditions = group_recordings(recordings)
    # Two passes: whether the shaft follows its command must be known before the final turn of each
    # condition is chosen.
    probed = [
        make_dynamic_condition(
            condition, noise_std, make_turn(condition, False), bins.get(condition.label)
        )
        for condition in conditions
    ]
    remarks = tuple(f"left out: {flap.reason}" for flap in probed if isinstance(flap, Undetermined))
    usable = [
        (c, f) for c, f in zip(conditions, probed, strict=True) if not isinstance(f, Undetermined)
    ]
    shafts = tuple(
        s
        for c, f in usable
        if (s := make_shaft_condition(c, float(f.t_s[-1]), rig.drive.ramp_s)) is not None
    )
    if alignment is None:
        as_commanded = all(tracks_command(shaft, rig.drive.ramp_s) for shaft in shafts)
        before_s = _before_start_s(condition for condition, _ in usable)
    else:
        as_commanded = alignment.as_commanded
        before_s = alignment.before_s
    # A drive cannot be early: a negative delay is noise.
    late = {shaft.label: max(estimate_delay_s(shaft, rig.drive.ramp_s), 0.0) for shaft in shafts}
    flaps = tuple(
        replace(flap, turn=make_turn(condition, not as_commanded, late.get(flap.label, 0.0)))
        for condition, flap in usable
    )
    known_to = {key: float(value) for key, value in first.known_to.items() if value is not None}
    coordinates = Parameterization(nuisances_of(rig, known_to, before_s))
    stages = [stage for recording in recordings for stage in recording.static]
    tables = make_stage_tables(stages, noise_std, FIRST_GUESS)
    if tables:
        # The approach of static stages is not recorded. The first guess is made at the prior means;
        # the search improves it.
        if alignment is None:
            moves = infer_approach(tables, coordinates.supposed, np.zeros(coordinates.size))
        else:
            moves = alignment.moves
        tables = tuple(replace(table, moves=moves) for table in tables)
    title = "; ".join(recording.title for recording in recordings)
    return PreparedLeg(
        title,
        rig,
        known_to,
        noise_std,
        flaps,
        shafts,
        tables,
        as_commanded,
        coordinates,
        remarks,
        _strokes_made(recordings),
        before_s,
    )


def group_recordings(recordings: Sequence[Recording]) -> tuple[Condition, ...]:
    """The strokes of all recordings by condition."""
    return group_by_condition(stroke for recording in recordings for stroke in recording.strokes)


def _strokes_made(recordings: Sequence[Recording]) -> int | None:
    """How many strokes were made up to the last one; None where the order of strokes and stages is
    not known.

    Each recording counts its own strokes, so the order of two recordings is not known.
    """
    if len(recordings) != 1 or not recordings[0].strokes:
        return None
    (recording,) = recordings
    before = collect_strokes_before((*recording.strokes, *recording.static))
    strokes = len(recording.strokes)
    if before:
        return max([*(count + 1 for count in before[:strokes]), *before[strokes:]])
    return None


def _before_start_s(conditions: Iterable[Condition]) -> float:
    """Time before the start that all recordings cover, to the millisecond; 0 where one begins
    with the motion.
    """
    begins = [_first_s(stroke) for condition in conditions for stroke in condition.strokes]
    # Rounded down, so that every recording covers the whole interval.
    if begins:
        return max(0.0, float(np.floor(-1e3 * max(begins)) / 1e3))
    return 0.0


def _first_s(stroke: Stroke) -> float:
    return min(float(stream.t_s[0]) for stream in stroke.streams.values())
