"""What goes wrong inside a drive of any make."""

from collections.abc import Callable, Mapping
from typing import Protocol

from rfca_rig.twins.encoder import Encoder
from rfca_rig.twins.thermal_model import Warmth

FEVER_K_s = 5.0


class Faultable(Protocol):
    """What every motor twin has for that."""

    encoder: Encoder
    warmth: Warmth

    def restart(self) -> None: ...


def drive_events(motor: Faultable) -> Mapping[str, Callable[[], None]]:
    """What happens once, by the name of the fault."""

    def fall_ill() -> None:
        motor.warmth.fever_K_s = FEVER_K_s

    return {
        "drive-restart": motor.restart,
        "drive-hot": fall_ill,
        "temperature-stuck": motor.warmth.stick,
        "encoder-frozen": motor.encoder.freeze,
    }
