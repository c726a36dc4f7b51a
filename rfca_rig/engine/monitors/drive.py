"""Checks of the drive's own status: heartbeat, error, temperature."""

from rfca_rig.drivers.roles import MotorStatus
from rfca_rig.errors import Tripped
from rfca_rig.protocol.plan import Limits
from rfca_rig.trip_codes import Trip


def check_drive(status: MotorStatus, limits: Limits) -> None:
    """Checks the age of the last heartbeat, error and state, and the temperature where the drive reports one.

    A driver with the same limit reports silence as a fault too.
    """
    # Silence first: everything else that is known of a silent drive is old.
    if status.silent_s > limits.drive_silent_s:
        raise Tripped(
            Trip.DRIVE_SILENT,
            f"drive silent for {1e3 * status.silent_s:.0f} ms, limit {1e3 * limits.drive_silent_s:.0f} ms; check bus and power",
        )
    if status.fault is not None:
        raise Tripped(Trip.DRIVE_ERROR, f"drive: {status.fault}")
    if status.temperature_C is not None and status.temperature_C > limits.temperature_C:
        raise Tripped(
            Trip.DRIVE_HOT,
            f"drive or motor at {status.temperature_C:.0f} degC, limit {limits.temperature_C:g} degC; let it cool, then go slower "
            "or rest longer between strokes",
        )
