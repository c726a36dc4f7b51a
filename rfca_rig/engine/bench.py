"""The devices a run works with, real or twins, and the clock they share."""

from dataclasses import dataclass

from rfca_rig.clock import Clock
from rfca_rig.drivers.roles import ForceSensor, Photographer, Rack, ShaftMotor


@dataclass(frozen=True)
class Bench:
    """One rig, ready to run. `is_real` is False for twins; `camera` is None where the run needs none or the rig has none."""

    motor: ShaftMotor
    sensor: ForceSensor
    rack: Rack
    clock: Clock
    is_real: bool
    camera: Photographer | None = None
