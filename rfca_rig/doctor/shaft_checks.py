"""Where the shaft stands, by the drive and the rig file together: what a person can hold against the leg itself."""

from collections.abc import Iterator
from math import tau

import can
import numpy as np

from rfca_rig.bench.motors import make_motor, open_bus
from rfca_rig.clock import Clock
from rfca_rig.description.rig_file import RigFile
from rfca_rig.doctor.finding import Finding, green, yellow
from rfca_rig.doctor.looking.can_bus import one_line
from rfca_rig.errors import RigError

SHAFT = "shaft"
LISTEN_S = 0.3
POLL_S = 5e-3


def check_shaft(rig: RigFile, clock: Clock) -> Iterator[Finding]:
    """For a drive that is there: reads it as a run would, without enabling it. Nothing where it does not report while it is off."""
    try:
        with open_bus(rig.motor) as bus:
            angles_rad = _heard(rig, bus, clock)
    except (RigError, can.CanError, OSError, ValueError) as error:
        yield yellow(SHAFT, f"not read: {one_line(error)}", "mend what is red first")
        return
    if angles_rad:
        yield green(
            SHAFT, f"at {np.degrees(angles_rad[-1]):.1f} deg{_encoder(rig, angles_rad[-1])}: is it? 0 is horizontal, 90 straight down"
        )


def _heard(rig: RigFile, bus: can.BusABC, clock: Clock) -> list[float]:
    motor, angles_rad = make_motor(rig, bus, clock), list[float]()
    until_s = clock.now_s() + LISTEN_S
    while clock.now_s() < until_s:
        clock.wait_until(clock.now_s() + POLL_S)
        angles_rad += motor.read().angle_rad.tolist()
    return angles_rad


def _encoder(rig: RigFile, angle_rad: float) -> str:
    """What the drive itself says, where the rig file tells its zero in turns."""
    motor = rig.motor
    zero, gear = getattr(motor, "zero_turns", None), getattr(motor, "gear_ratio", None)
    if zero is None or gear is None:
        return ""
    return f", encoder at {zero + motor.direction * gear * angle_rad / tau:.3f} turns"
