"""How a run ended: in words for people, and in codes for sorting runs."""

import re
from dataclasses import dataclass

from rfca_rig.errors import RigError, Tripped

DONE = "done"


@dataclass(frozen=True)
class Outcome:
    """`why` in words, the exit status of the command, and a reason code: that of a trip, else the kind of error, or `done`."""

    why: str
    exit_status: int
    reason: str

    @staticmethod
    def of(error: RigError | None) -> "Outcome":
        """None for a run that was completed."""
        if error is None:
            return Outcome(DONE, 0, DONE)
        return Outcome(str(error), error.exit_code, str(error.code) if isinstance(error, Tripped) else _kind(error))


def _kind(error: RigError) -> str:
    """Class name in lower case with hyphens: DiskFull becomes disk-full."""
    return re.sub(r"(?<!^)(?=[A-Z])", "-", type(error).__name__).lower()
