"""Faults inside a drive of any make."""

from collections.abc import Callable, Mapping
from typing import Protocol

from rfca_rig.twins.drive_parts import Encoder, MotorThermalModel

# Heating rate of the fault `drive-hot` in K/s.
HEATING_K_s = 5.0


class Faultable(Protocol):
    """What every motor twin provides for these faults."""

    encoder: Encoder
    warmth: MotorThermalModel

    def restart(self) -> None: ...


def drive_events(motor: Faultable) -> Mapping[str, Callable[[], None]]:
    """One-time events inside the drive, by the name of the fault."""

    def start_heating() -> None:
        motor.warmth.fever_K_s = HEATING_K_s

    return {
        "drive-restart": motor.restart,
        "drive-hot": start_heating,
        "temperature-stuck": motor.warmth.stick,
        "encoder-frozen": motor.encoder.freeze,
    }
