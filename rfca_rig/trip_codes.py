"""The codes of what stops the motion by itself. `docs/trips.md` has a paragraph for each: what it means, and what to do."""

from enum import StrEnum


class Trip(StrEnum):
    """The letter names the family: load, following, sensor, drive, bus, computer."""

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
    DRIVE_ERROR = "D-01"
    DRIVE_SILENT = "D-02"
    ENCODER_SILENT = "D-03"
    DRIVE_HOT = "D-04"
    BUS = "B-01"
    LATE = "C-01"
    RECORDER_BEHIND = "C-02"
