"""Every error a user can meet. One line each: what, where, the limit, what to do next.

RigError                    exit code 1: the work could not be done
├── BadInput                exit code 2: a file, an option or a plan is not usable; nothing was changed
├── DeviceError             exit code 1: a motor or sensor did not do what was asked
├── SimulationFailed        exit code 1: the model could not be computed for these values
├── DiskFull                exit code 1: the disk takes no more; what was acknowledged before is safe
├── Tripped                 exit code 3: a limit stopped the motion
├── WornOut                 exit code 4: the leg's stiffness drifted beyond what the protocol allows
└── Stopped                 exit code 130: the operator stopped the run
"""

from rfca_rig.trip_codes import Trip

TRIP = "TRIP "  # what a trip's text begins with, by which it is known again in a recording


class RigError(Exception):
    """Base of all errors that are reported to a user in one line."""

    exit_code = 1


class BadInput(RigError):
    """Something the user wrote cannot be used. Names the file, line and column where there are any."""

    exit_code = 2


class DeviceError(RigError):
    """A device did not answer, refused, or reported an error of its own."""


class SimulationFailed(RigError):
    """The integrator gave up; the message says when in the stroke, and with which values."""


class DiskFull(RigError):
    """The disk takes no more. A run that meets it has its motor off; what was recorded until then is kept."""


class Tripped(RigError):
    """Something measured passed its limit. The motor is off; what was recorded until then is kept."""

    exit_code = 3

    def __init__(self, code: Trip, what: str) -> None:
        """The text of the error begins with the code, under which `docs/trips.md` tells more."""
        super().__init__(f"{TRIP}{code}: {what}")
        self.code = code


class WornOut(RigError):
    """A fatigue run came to its end: the leg is no longer as stiff as it was. The motor is off; what was recorded is kept."""

    exit_code = 4


class Stopped(RigError):
    """The operator asked for a stop. The motor is off; what was recorded until then is kept."""

    exit_code = 130
