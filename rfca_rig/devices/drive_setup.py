"""What `rfca-rig setup motor` asks of a make of drive: which settings the drive keeps, what they
are now, what the rig file needs, and how they are written, here or in the maker's own tool.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from math import isnan
from pathlib import Path

# Unit of a setting that is switched on (1) or off (0).
ON_OFF = "on/off"
# Drives keep numbers of 32 bits.
RELATIVE_TOLERANCE = 1e-6


@dataclass(frozen=True)
class DriveNeeds:
    """What a rig file asks of any drive, in SI units at the shaft.

    Parameters
    ----------
    speed_rad_s, torque_Nm
        The rig's limits of the shaft's speed and of the moment on the sensor.
    watchdog_s
        Time without a command after which the drive is to remove its torque.
    late_s
        Largest delay of the control loop; a shorter watchdog would end healthy runs.
    maker_file
        A file of the drive's maker that describes this firmware, where the user has one.
    """

    speed_rad_s: float
    torque_Nm: float
    watchdog_s: float
    late_s: float
    maker_file: Path | None = None


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
        Of both values; "" for a plain number, `ON_OFF` for a switch.
    can_write
        Whether it can be written over this wire.
    least, most
        Values from `least` to `most` do as well as `wanted`. Without them only `wanted` does.
    """

    name: str
    purpose: str
    wanted: float | None
    actual: float | None
    unit: str = ""
    can_write: bool = True
    least: float | None = None
    most: float | None = None

    @property
    def is_wrong(self) -> bool:
        """Whether the drive is known to have another value than the rig file needs."""
        if self.wanted is None or self.actual is None:
            return False
        # NaN is what some drives have for "none".
        if isnan(self.wanted) or isnan(self.actual):
            return isnan(self.wanted) != isnan(self.actual)
        tolerance = RELATIVE_TOLERANCE * max(abs(self.wanted), 1.0)
        least = self.wanted if self.least is None else self.least
        most = self.wanted if self.most is None else self.most
        return not least - tolerance <= self.actual <= most + tolerance


class DriveSetup(ABC):
    """The settings of one drive, on an open bus. Nothing moves, and the motor is off."""

    @abstractmethod
    def list_wanted(self) -> tuple[Setting, ...]:
        """All settings that matter, with what the rig file needs. Nothing is sent or read."""

    @abstractmethod
    def read(self) -> tuple[Setting, ...]:
        """The same settings with what the drive has now.

        Raises DeviceError where no drive answers, or a drive whose motor is on.
        """

    def describe(self) -> tuple[str, ...]:
        """What the last `read` found on the bus, in lines: the drive, and other drives."""
        return ()

    @abstractmethod
    def write(self, settings: Sequence[Setting]) -> None:
        """Write the wanted value of each of these. Raises DeviceError where the drive refuses."""

    @abstractmethod
    def save(self) -> None:
        """Keep what was written beyond a power-down. Raises DeviceError."""

    @abstractmethod
    def list_lines(self, settings: Sequence[Setting]) -> tuple[str, ...]:
        """Lines for the maker's own tool that write the wanted values and save them."""
