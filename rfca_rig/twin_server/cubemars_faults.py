"""Faults inside a CubeMars / T-Motor AK drive. It has no heartbeat and no watchdog of its own, so there are no faults of these."""

from collections.abc import Callable, Mapping

import numpy as np

from rfca_rig.twin_server.drive_faults import drive_events
from rfca_rig.twin_server.faults import DRIVE_FAULTS, Fault
from rfca_rig.twins.cubemars_mit import CubemarsMitTwin
from rfca_rig.twins.cubemars_servo import CubemarsServoTwin

JUMP_RAD = 0.5 * np.pi
# Error codes of the drive.
TOO_HOT, ENCODER, STALLED = 1, 5, 7
CUBEMARS_FAULTS = (
    Fault("encoder-jump", "the encoder slips: the drive's position reads a quarter of a turn more from now on", once=True),
    Fault("over-temperature", "the drive stops with error 1, motor too hot", once=True),
    Fault("encoder-lost", "the drive stops with error 5, encoder fault", once=True),
    Fault("stalled", "the drive stops with error 7, motor stalled", once=True),
    Fault("refuses", "every later attempt to enable the drive ends in error 1", once=True),
    *DRIVE_FAULTS,
)


def cubemars_events(motor: CubemarsMitTwin | CubemarsServoTwin) -> Mapping[str, Callable[[], None]]:
    """One-time events inside the drive, by the name of the fault."""
    return {
        "encoder-jump": lambda: motor.leap(JUMP_RAD),
        "over-temperature": lambda: motor.fail(TOO_HOT),
        "encoder-lost": lambda: motor.fail(ENCODER),
        "stalled": lambda: motor.fail(STALLED),
        "refuses": lambda: motor.refuse_with(TOO_HOT),
        **drive_events(motor),
    }
