"""Recordings of a leg and their reference, cut so that their rows belong together."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.data import Observations, rms
from rfca_rig.diagnosis.leg.prepared import (
    FIRST_GUESS,
    Alignment,
    PreparedLeg,
    align_leg,
    prepare_leg,
)
from rfca_rig.diagnosis.leg.shaft_observations import AS_COMMANDED_RAD, measure_other_turn
from rfca_rig.diagnosis.leg.simulator import LegSimulator
from rfca_rig.diagnosis.leg.strokes import StrokeBins
from rfca_rig.diagnosis.simulator import Dataset, make_dataset
from rfca_rig.errors import BadInput
from rfca_rig.recording.model import Recording

# Of the deviation of a drive from its command: the part that another load may make. On a compliant
# drive, hinges that are 10 % softer make 0.06.
SHARE_OF_DEVIATION = 0.2


@dataclass(frozen=True)
class PairedLeg:
    """Recordings and their reference, with rows that belong together.

    Parameters
    ----------
    new, reference
        The recordings of both, each recording of the reference by itself.
    """

    new: PreparedLeg
    reference: tuple[PreparedLeg, ...]

    def new_dataset(self) -> Dataset:
        """Forces of the recordings. Raises BadInput where no condition can be used."""
        return _make_dataset((self.new,))

    def reference_dataset(self) -> Dataset:
        """Forces of the reference. Raises BadInput where no condition can be used."""
        return _make_dataset(self.reference)


def pair_legs(new: Sequence[Recording], reference: Sequence[Recording]) -> PairedLeg:
    """Both with the nominal model of the new recordings, and with common bins.

    A condition has the bins that suit its new recording, as far as the reference covers them.
    Raises BadInput where recordings cannot be used together.
    """
    first = new[0]
    reference = [
        replace(recording, nominal=first.nominal, known_to=first.known_to)
        for recording in reference
    ]
    prepared = prepare_leg(new)
    earlier = [prepare_leg([recording]) for recording in reference]
    for leg in earlier:
        _refuse_other_turns(prepared, leg)
    alone = (prepared, *earlier)
    # The approach of the stages is a guess, and the same guess in both cancels.
    moves = next((leg.tables[0].moves for leg in reversed(alone) if leg.tables), FIRST_GUESS)
    alignment = Alignment(
        bins=_choose_bins(prepared, earlier),
        as_commanded=all(leg.as_commanded for leg in alone),
        before_s=min(leg.before_s for leg in alone),
        moves=moves,
    )
    aligned = [
        _name_recording(align_leg(leg, alignment), number)
        for number, leg in enumerate(earlier, start=1)
    ]
    return PairedLeg(align_leg(prepared, alignment), tuple(aligned))


def _refuse_other_turns(new: PreparedLeg, reference: PreparedLeg) -> None:
    """Raise BadInput where a shaft turns otherwise than in the reference. Its drive has changed
    then, which forces that are compared along the recorded turn would hide.

    A delay of the whole turn is none of the leg, and a softer leg bends a compliant drive less.
    """
    recorded = {shaft.label: shaft for shaft in reference.shafts}
    for shaft in new.shafts:
        before = recorded.get(shaft.label)
        if before is None:
            continue
        away_rad = measure_other_turn(shaft, before, new.rig.drive.ramp_s)
        usual_rad = max(AS_COMMANDED_RAD, SHARE_OF_DEVIATION * rms(before.deviation_rad))
        if away_rad > usual_rad:
            raise BadInput(
                f"--reference: {shaft.label}: the shaft turns otherwise than in the reference, by "
                f"{1e3 * away_rad:.1f} mrad (rms), limit {1e3 * usual_rad:.1f}; look at the drive, "
                "and diagnose the new recordings alone"
            )


def _choose_bins(new: PreparedLeg, reference: Sequence[PreparedLeg]) -> dict[str, StrokeBins]:
    """The bins of the new recordings, as far as the reference covers them, by label of the
    condition.
    """
    bins = {strokes.condition.label: strokes.choose_bins() for strokes in new.detected}
    for leg in reference:
        for strokes in leg.detected:
            label = strokes.condition.label
            if label in bins:
                bins[label] = bins[label].within(*strokes.covered_s)
    return bins


def _name_recording(leg: PreparedLeg, number: int) -> PreparedLeg:
    """The same conditions as parts of one recording: what differs from one run to the next differs
    in all of them.
    """
    name = f"run {number}"
    return replace(
        leg,
        flaps=tuple(replace(flap, recording=name) for flap in leg.flaps),
        tables=tuple(replace(table, recording=name) for table in leg.tables),
    )


def _make_dataset(legs: Sequence[PreparedLeg]) -> Dataset:
    as_commanded = legs[0].as_commanded
    flaps = [flap for leg in legs for flap in leg.flaps]
    tables = [
        replace(table, stopped_as_commanded=as_commanded) for leg in legs for table in leg.tables
    ]
    if not flaps and not tables:
        raise BadInput(
            f"{legs[0].title}: nothing to compare: no stroke shows a touchdown and a valley, and "
            "there is no static table"
        )
    return make_dataset([*flaps, *tables], LegSimulator(as_commanded, knows_approach=True))


def name_commands(rows: Observations) -> NDArray[np.str_]:
    """What must agree, beside the time, for two rows (m,) to belong together: signal, condition
    and, of a stage, the side from which it is approached.
    """
    conditions = [f"{label.experiment}, {label.condition}" for label in rows.labels]
    side = np.where(rows.experiment == "static", rows.phase, "")
    parts = (rows.signal, np.array(conditions)[rows.label], side)
    return np.array([", ".join(words) for words in zip(*parts, strict=True)])
