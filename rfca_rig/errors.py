"""Every error a user can meet. One line each: what, where, the limit, what to do next.

RigError                    exit code 1: the work could not be done
├── BadInput                exit code 2: a file, option or plan is not usable; nothing was changed
├── DeviceError             exit code 1: a motor or sensor did not do what was asked
│   └── BadReading          a device reports numbers that cannot be true
├── SimulationFailed        exit code 1: the model could not be computed for these values
├── DiskFull                exit code 1: the disk is full; what was acknowledged before is safe
├── NotAccepted             exit code 1: a model is farther from the recordings than was allowed
├── Tripped                 exit code 3: a limit stopped the motion
├── WornOut                 exit code 4: the leg's stiffness drifted beyond what the protocol allows
└── Stopped                 exit code 130: the operator stopped the run
"""

from enum import StrEnum

TRIP = "TRIP "  # what a trip's text begins with, by which it is known again in a recording

# Of a process or thread that the system refuses to start, in one text wherever that happens.
NO_MORE_PROCESSES = (
    "the system allows no further process or thread; end other programs, or raise the limit "
    "(ulimit -u)"
)
# Of a computer on which only IPv6 is set up.
NO_SUCH_ADDRESS = (
    "this computer has no such address; for 127.0.0.1 set up its loopback interface: sudo ip "
    "addr add 127.0.0.1/8 dev lo"
)


class Trip(StrEnum):
    """The codes of what stops the motion by itself; `docs/trips.md` has a paragraph for each.

    The letter names the family: load, following, sensor, drive, bus, computer.
    """

    FORCE = "L-01"
    MOMENT = "L-02"
    FORCE_LASTS = "L-03"
    MOMENT_LASTS = "L-04"
    FULL_SPEED_TOO_MUCH = "L-05"
    OVERSPEED = "F-01"
    FOLLOWING = "F-02"
    JAM = "F-03"
    JUMP = "F-04"
    SENSOR_SILENT = "S-01"
    SENSOR_SATURATED = "S-02"
    SENSOR_ERROR = "S-03"
    SENSOR_FROZEN = "S-04"
    SENSOR_BLIND = "S-05"
    SENSOR_LOST = "S-06"
    SENSOR_READING = "S-07"
    DRIVE_ERROR = "D-01"
    DRIVE_SILENT = "D-02"
    READING_OLD = "D-03"
    DRIVE_HOT = "D-04"
    DRIVE_READING = "D-05"
    BUS = "B-01"
    LATE = "C-01"
    RECORDER_BEHIND = "C-02"


class RigError(Exception):
    """Base of all errors that are reported to a user in one line."""

    exit_code = 1


class BadInput(RigError):
    """Something the user wrote cannot be used. Names the file, line and column where there are
    any.
    """

    exit_code = 2


class DeviceError(RigError):
    """A device did not answer, refused, or reported an error of its own."""


class BadReading(DeviceError):
    """A device reports numbers that cannot be true, several times in a row. Within a run this is
    a trip with a code of its own.
    """


class SimulationFailed(RigError):
    """The integrator gave up; the message says when in the stroke, and with which values."""


class DiskFull(RigError):
    """The disk takes no more. A run that meets it has its motor off; what was recorded until
    then is kept.
    """


class Tripped(RigError):
    """Something measured passed its limit. The motor is off; what was recorded until then is
    kept.
    """

    exit_code = 3

    def __init__(self, code: Trip, what: str) -> None:
        """The text of the error begins with the code, under which `docs/trips.md` tells more."""
        super().__init__(f"{TRIP}{code}: {what}")
        self.code = code


class WornOut(RigError):
    """A fatigue run came to its end: the leg is no longer as stiff as it was. The motor is off;
    what was recorded is kept.
    """

    exit_code = 4


class Changed(RigError):
    """A rig is not as its reference, and was to pass a gate. Nothing has failed."""

    exit_code = 3


class NotAccepted(RigError):
    """A model failed acceptance tests on recordings. The report is written."""


class Stopped(RigError):
    """The operator asked for a stop. The motor is off; what was recorded until then is kept."""

    exit_code = 130


class MalformedFrame(DeviceError):
    """Bytes that do not follow the protocol."""


class NotEncodable(DeviceError):
    """A value outside the range of its field in a frame."""
