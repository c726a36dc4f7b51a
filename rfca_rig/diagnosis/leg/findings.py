"""What the diagnosis of a leg works on, and what it finds: shared by its steps."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rfca_rig.diagnosis.decision.decide import Decision
from rfca_rig.diagnosis.inference.hypotheses import ModelSelectionResult
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.leg.shaft_observations import ShaftCondition
from rfca_rig.diagnosis.leg.strokes import DynamicCondition
from rfca_rig.model.effect import Effect
from rfca_rig.model.parameters import RigModel


@dataclass(frozen=True)
class PreparedData:
    """Prepared data of a diagnosis: the nominal model with its standard uncertainties, and the
    recordings as conditions.

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
    as_commanded
        Whether every shaft followed its command, at once or with a delay.
    coordinates
        The nuisance parameters.
    remarks
        Conditions that cannot be used, with the reason.
    strokes_made
        How many strokes the leg has made in all; None where their order is not known.
    """

    title: str
    rig: RigModel
    known_to: Mapping[str, float]
    noise_std: Mapping[str, float | None]
    flaps: tuple[DynamicCondition, ...]
    shafts: tuple[ShaftCondition, ...]
    as_commanded: bool
    coordinates: Parameterization
    remarks: tuple[str, ...]
    strokes_made: int | None = None


@dataclass(frozen=True)
class Findings:
    """Results in the forces, and in the motion of the shaft where that was recorded and does not
    follow the command.

    `effects` were looked for in the forces, `drive_effects` in the motion of the shaft.
    """

    effects: Sequence[Effect]
    drive_effects: Sequence[Effect]
    leg: ModelSelectionResult
    leg_decision: Decision
    drive: ModelSelectionResult | None
    drive_decision: Decision | None
