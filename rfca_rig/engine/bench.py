"""The devices a run works with, real or twins, and the clock they share."""

from dataclasses import dataclass

from rfca_rig.clock import Clock
from rfca_rig.drivers.roles import ForceSensor, Photographer, Rack, ShaftMotor


@dataclass(frozen=True)
class Bench:
    """One rig, ready to be driven. `is_real` says whether anything can be hurt; `camera` is None where none is needed or there."""

    motor: ShaftMotor
    sensor: ForceSensor
    rack: Rack
    clock: Clock
    is_real: bool
    camera: Photographer | None = None
