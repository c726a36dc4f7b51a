"""The twin of a camera behind the role that real ones have."""

from rfca_rig.clock import Clock
from rfca_rig.drivers.roles import Photo
from rfca_rig.twins.camera import CameraTwin


class TwinCamera:
    """Implements `Camera`: exposes at once, at the clock's present time."""

    def __init__(self, twin: CameraTwin, clock: Clock) -> None:
        self._twin = twin
        self._clock = clock
        self._taken = 0

    def photo(self) -> Photo:
        self._taken += 1
        return Photo(self._twin.expose(), self._clock.now_s(), f"photo-{self._taken:03d}")

    def close(self) -> None:
        """Nothing is held open."""

    def identity(self) -> dict[str, str]:
        return {"camera": "twin"}
