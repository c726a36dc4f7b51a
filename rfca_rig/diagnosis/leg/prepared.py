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
    DetectedStrokes,
    DynamicCondition,
    StrokeBins,
    bin_strokes,
    detect_strokes,
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
    detected
        The strokes behind each of `flaps`.
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
    detected: tuple[DetectedStrokes, ...] = ()

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


def prepare_leg(recordings: Sequence[Recording]) -> PreparedLeg:
    """Cut the recordings into conditions, with the nominal rig and its nuisance parameters.

    Raises BadInput where the recordings have different nominal models.
    """
    first = recordings[0]
    refuse_other_nominal(recordings, "diagnose them one by one")
    rig = nominal_model(first.nominal)
    noise_std = first.nominal["sensor"].get("noise_std") or {}
    conditions = group_by_condition(
        stroke for recording in recordings for stroke in recording.strokes
    )
    detected = [detect_strokes(condition) for condition in conditions]
    remarks = tuple(
        f"left out: {strokes.reason}" for strokes in detected if isinstance(strokes, Undetermined)
    )
    usable = tuple(strokes for strokes in detected if not isinstance(strokes, Undetermined))
    known_to = {key: float(value) for key, value in first.known_to.items() if value is not None}
    before_s = _before_start_s(strokes.condition for strokes in usable)
    coordinates = Parameterization(nuisances_of(rig, known_to, before_s))
    stages = [stage for recording in recordings for stage in recording.static]
    tables = make_stage_tables(stages, noise_std, FIRST_GUESS)
    if tables:
        # The approach of static stages is not recorded. The first guess is made at the prior means;
        # the search improves it.
        moves = infer_approach(tables, coordinates.supposed, np.zeros(coordinates.size))
        tables = tuple(replace(table, moves=moves) for table in tables)
    # Whether the shaft follows its command must be known before the final turn of each condition is
    # chosen.
    probed = _bin_all(usable, noise_std, {})
    shafts = _make_shafts(usable, probed, rig)
    as_commanded = all(tracks_command(shaft, rig.drive.ramp_s) for shaft in shafts)
    return PreparedLeg(
        title="; ".join(recording.title for recording in recordings),
        rig=rig,
        known_to=known_to,
        noise_std=noise_std,
        flaps=_turn_all(usable, probed, shafts, as_commanded, rig),
        shafts=shafts,
        tables=tables,
        as_commanded=as_commanded,
        coordinates=coordinates,
        remarks=remarks,
        strokes_made=_strokes_made(recordings),
        before_s=before_s,
        detected=usable,
    )


def align_leg(leg: PreparedLeg, alignment: Alignment) -> PreparedLeg:
    """The same recordings with what they have in common with others."""
    probed = _bin_all(leg.detected, leg.noise_std, alignment.bins)
    shafts = _make_shafts(leg.detected, probed, leg.rig)
    nuisances = nuisances_of(leg.rig, leg.known_to, alignment.before_s)
    return replace(
        leg,
        flaps=_turn_all(leg.detected, probed, shafts, alignment.as_commanded, leg.rig),
        shafts=shafts,
        tables=tuple(replace(table, moves=alignment.moves) for table in leg.tables),
        as_commanded=alignment.as_commanded,
        coordinates=Parameterization(nuisances),
        before_s=alignment.before_s,
    )


def _bin_all(
    detected: Sequence[DetectedStrokes],
    noise_std: Mapping[str, float | None],
    bins: Mapping[str, StrokeBins],
) -> list[DynamicCondition]:
    """All conditions as observations: in these bins by label, or else in their own; the shaft turns
    as commanded.
    """
    flaps = []
    for strokes in detected:
        condition = strokes.condition
        chosen = bins.get(condition.label) or strokes.choose_bins()
        flaps.append(bin_strokes(strokes, chosen, noise_std, make_turn(condition, False)))
    return flaps


def _make_shafts(
    detected: Sequence[DetectedStrokes], flaps: Sequence[DynamicCondition], rig: RigModel
) -> tuple[ShaftCondition, ...]:
    """The motion of the shaft in each condition in which it was recorded, as long as its flap."""
    shafts = []
    for strokes, flap in zip(detected, flaps, strict=True):
        end_s = float(flap.t_s[-1])
        shaft = make_shaft_condition(strokes.condition, end_s, rig.drive.ramp_s)
        if shaft is not None:
            shafts.append(shaft)
    return tuple(shafts)


def _turn_all(
    detected: Sequence[DetectedStrokes],
    flaps: Sequence[DynamicCondition],
    shafts: Sequence[ShaftCondition],
    as_commanded: bool,
    rig: RigModel,
) -> tuple[DynamicCondition, ...]:
    """The conditions with the turn that is simulated: as commanded with the drive's delay, or as
    recorded.
    """
    # A drive cannot be early: a negative delay is noise.
    late = {shaft.label: max(estimate_delay_s(shaft, rig.drive.ramp_s), 0.0) for shaft in shafts}
    turned = []
    for strokes, flap in zip(detected, flaps, strict=True):
        turn = make_turn(strokes.condition, not as_commanded, late.get(flap.label, 0.0))
        turned.append(replace(flap, turn=turn))
    return tuple(turned)


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
