"""What `rfca-rig setup motor` asks of a make of drive: which settings the drive keeps, what they
are now, what the rig file needs, and how they are written, here or in the maker's own tool.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from math import isnan


@dataclass(frozen=True)
class Setting:
    """One value that a drive keeps.

    Parameters
    ----------
    name
        In the maker's words, as its tool and its manual have it.
    purpose
        What it does on a rig, in a few words.
    wanted
        The value that a rig file needs; None where any value will do.
    actual
        The value in the drive; None where this wire does not tell it.
    unit
        Of both values; "" for a plain number.
    can_write
        Whether it can be written over this wire.
    """

    name: str
    purpose: str
    wanted: float | None
    actual: float | None
    unit: str = ""
    can_write: bool = True

    @property
    def is_wrong(self) -> bool:
        """Whether the drive is known to have another value than the rig file needs."""
        if self.wanted is None or self.actual is None:
            return False
        # NaN is what some drives have for "none".
        if isnan(self.wanted) or isnan(self.actual):
            return isnan(self.wanted) != isnan(self.actual)
        # Drives keep numbers of 32 bits.
        return abs(self.actual - self.wanted) > 1e-6 * max(abs(self.wanted), 1.0)


class DriveSetup(ABC):
    """The settings of one drive, on an open bus. Nothing moves, and the motor is off."""

    @abstractmethod
    def read(self) -> tuple[Setting, ...]:
        """All settings that matter, with what the drive has now. Raises DeviceError."""

    @abstractmethod
    def write(self, settings: Sequence[Setting]) -> None:
        """Write the wanted value of each of these. Raises DeviceError where the drive refuses."""

    @abstractmethod
    def save(self) -> None:
        """Keep what was written beyond a power-down. Raises DeviceError."""

    @abstractmethod
    def list_lines(self, settings: Sequence[Setting]) -> tuple[str, ...]:
        """Lines for the maker's own tool that write the wanted values and save them."""
