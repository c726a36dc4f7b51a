"""What the searches in the recordings of a leg have found."""

from dataclasses import dataclass

from rfca_rig.diagnosis.problem import DecidedSearch


@dataclass(frozen=True)
class LegFindings:
    """Results in the forces, and in the motion of the shaft; None there where that was not
    recorded, or follows the command.
    """

    forces: DecidedSearch
    shaft: DecidedSearch | None = None
