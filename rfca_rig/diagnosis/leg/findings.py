"""What the searches in the recordings of a leg have found."""

from dataclasses import dataclass

from rfca_rig.diagnosis.problem import Finding


@dataclass(frozen=True)
class LegFindings:
    """Results in the forces, and in the motion of the shaft; None there where that was not
    recorded, or follows the command.
    """

    forces: Finding
    shaft: Finding | None = None
