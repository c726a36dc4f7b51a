"""The devices a run works with, real or twins, and the clock they share."""

from dataclasses import dataclass

from rfca_rig.clock import Clock
from rfca_rig.drivers.roles import ForceSensor, Rack, ShaftMotor


@dataclass(frozen=True)
class Bench:
    """One rig, ready to be driven. `is_real` says whether anything can be hurt."""

    motor: ShaftMotor
    sensor: ForceSensor
    rack: Rack
    clock: Clock
    is_real: bool
