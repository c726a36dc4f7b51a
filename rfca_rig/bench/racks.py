"""Racks: one whose lead screws a person turns, and the twin's."""

from rfca_rig.errors import BadInput
from rfca_rig.twins.world import TwinPlant


class HandRack:
    """Asks a person to set the height, and waits. The engine has disabled the motor before."""

    def set_height(self, height_m: float) -> None:
        """Returns when Enter was pressed. Raises BadInput where the input ended without it."""
        try:
            input(f"REAL motor off. Set the rack to {1e3 * height_m:.1f} mm, clear the leg, then press Enter ")
        except EOFError:
            raise BadInput(
                f"the input ended before the rack was said to stand at {1e3 * height_m:.1f} mm; run it from a terminal, "
                "where a person can press Enter"
            ) from None


class TwinRack:
    """Moves at once."""

    def __init__(self, plant: TwinPlant) -> None:
        self._plant = plant

    def set_height(self, height_m: float) -> None:
        self._plant.set_height(height_m)
