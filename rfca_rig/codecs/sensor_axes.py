"""Mounting of a force sensor: which axis of the device each axis of the rig is; pure.

The rig's axes: y along the ground, to where the leg reaches; z down; x = y times z, away from
somebody who sees the leg reach to the right. Forces are those of the leg on the sensor: a push down
on the leg reads positive fz.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Counts = TypeVar("Counts", NDArray[np.int32], NDArray[np.float64])

NAMES = ("x", "y", "z")
# Trace of a rotation matrix, which gives the angle.
_DEGREES_BY_TRACE = {3: 0, 1: 90, 0: 120, -1: 180}


@dataclass(frozen=True)
class SensorAxes:
    """Axes of the device along the rig's x, y and z, as ("x", "-z", "y"): there the rig's y is the
    device's negative z. Forces and moments turn alike.
    """

    names: tuple[str, str, str] = NAMES

    @cached_property
    def matrix(self) -> NDArray[np.int32]:
        """(3, 3): a vector in the rig's axes is this matrix times the vector in the device's."""
        matrix = np.zeros((3, 3), np.int32)
        for row, name in enumerate(self.names):
            matrix[row, NAMES.index(name[-1])] = 1
            if name.startswith("-"):
                matrix[row] *= -1
        return matrix

    @property
    def is_identity(self) -> bool:
        return self.names == NAMES

    @property
    def is_permutation(self) -> bool:
        """Whether each axis of the device is named once."""
        return sorted(name[-1] for name in self.names) == [*NAMES]

    @property
    def is_right_handed(self) -> bool:
        """Whether a sensor can be mounted so. The others are mirrored."""
        return round(float(np.linalg.det(self.matrix))) == 1

    def to_rig(self, wrench: Counts) -> Counts:
        """Forces and moments (m, 6) in the rig's axes, from those in the device's.

        Counts stay whole numbers in another order and with other signs, so that no bit is lost.
        """
        return _turn(wrench, self.matrix)

    def to_device(self, wrench: Counts) -> Counts:
        """The inverse of `to_rig`: forces and moments (m, 6) in the device's axes."""
        return _turn(wrench, self.matrix.T)

    def describe(self) -> str:
        """The mounting in words."""
        if not self.is_right_handed:
            return "a mirrored, left-handed frame"
        turned = f"turned by {_DEGREES_BY_TRACE[int(np.trace(self.matrix))]} degrees"
        if self.is_identity:
            return "as the rig's axes"
        # An axis that stays is the one about which the sensor is turned.
        kept = [name for name in NAMES if self.names[NAMES.index(name)] == name]
        if kept:
            turned += f" about its {kept[0]} axis"
        if self.names[2] == "-z":
            turned += ", upside down"
        return turned

    def __str__(self) -> str:
        return "[" + ", ".join(f'"{name}"' for name in self.names) + "]"


def _turn(wrench: Counts, matrix: NDArray[np.int32]) -> Counts:
    order = np.abs(matrix).argmax(axis=1)
    signs = matrix.sum(axis=1)
    columns = np.concatenate([order, order + 3])
    turned: Counts = wrench[:, columns] * np.tile(signs, 2).astype(wrench.dtype)
    return turned
