"""What the searches in the recordings of a leg have found."""

from dataclasses import dataclass, replace

from rfca_rig.diagnosis.problem import DecidedSearch
from rfca_rig.model.parameters import PresentEffect, RigModel


@dataclass(frozen=True)
class LegFindings:
    """Results in the forces, and in the motion of the shaft; None there where that was not
    recorded, or follows the command.
    """

    forces: DecidedSearch
    shaft: DecidedSearch | None = None


def add_drive(rig: RigModel, shaft: DecidedSearch, effects: tuple[PresentEffect, ...]) -> RigModel:
    """The rig with these effects, which were found in the motion of the shaft.

    That search also chose how a compliant drive starts, so its whole drive is taken over.
    """
    if not effects:
        return rig
    drive = shaft.search.nominal.coordinates.space.centre.rig.drive
    return replace(rig, drive=drive, effects=(*rig.effects, *effects))
