"""Drops samples that are no numbers before anything is computed from them: a lab's own driver
may hand out such.
"""

from collections.abc import Callable
from dataclasses import fields, replace
from math import inf, isfinite
from typing import TYPE_CHECKING, Generic, TypeVar

import numpy as np

from rfca_rig.drivers.reading_check import ReadingCheck, Signal
from rfca_rig.drivers.roles import ForceSamples, MotorStatus, ShaftSamples

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Block = TypeVar("Block", bound="DataclassInstance")


def sum_shaft(shaft: ShaftSamples) -> float:
    """A sum that is finite only if all numbers of the drive are.

    Times are left out: they are compared by the limits of age and of jumps, which a time that is no
    number passes.
    """
    # Lists, because a tick brings a few reports, for which numpy takes longer.
    total: float = (
        sum(shaft.angle_rad.tolist())
        + sum(shaft.speed_rad_s.tolist())
        + sum(shaft.torque_Nm.tolist())
    )
    return total


def sum_force(force: ForceSamples) -> float:
    """The same for a force sensor; counts that are integers, as they should be, are always
    finite.
    """
    if force.counts.dtype.kind == "i":
        return 0.0
    return float(force.counts.sum())


class SampleCheck(Generic[Block]):
    """Checks the samples of one device at every tick. `bad` counts those that were dropped, by
    the name of their column.
    """

    def __init__(self, device: str, sum_of: Callable[[Block], float], *columns: str) -> None:
        """`sum_of` is the fast check of a block; `columns` are the names of the columns (m,) or
        (m, n) that it sums.
        """
        self._sum_of = sum_of
        self._columns = columns
        self._check = ReadingCheck(device)
        self._is_clean = True
        self.bad = self._check.bad

    def accept(self, block: Block) -> Block:
        """The block without the samples that have a value that is not finite.

        Raises BadReading at the third such sample in a row.
        """
        # The usual case. After a bad sample every row is looked at, until one is good: three in a
        # row may lie in several blocks.
        if self._is_clean and isfinite(self._sum_of(block)):
            return block
        return self._drop_bad(block)

    def _drop_bad(self, block: Block) -> Block:
        columns = {name: getattr(block, name) for name in self._columns}
        is_good = np.ones(len(columns[self._columns[0]]), np.bool_)
        for row in range(len(is_good)):
            for name, values in columns.items():
                value = float(np.sum(values[row]))
                if not isfinite(value):
                    is_good[row] = self._is_clean = False
                    self._check.refuse(Signal(name, "", -inf, inf), value)
                    break
            else:
                self._is_clean = self._check.accept()
        kind = type(block)
        return kind(*(getattr(block, column.name)[is_good] for column in fields(kind)))


class StatusCheck:
    """Checks the numbers in the status of a drive at every tick. `bad` counts those that were no
    numbers, by name.
    """

    def __init__(self) -> None:
        self._check = ReadingCheck("the drive")
        self._is_clean = True
        self._last = MotorStatus("unknown", None, 0.0)
        self.bad = self._check.bad

    def accept(self, status: MotorStatus) -> MotorStatus:
        """The status, or the last one with all numbers. Raises BadReading at the third in a row
        that lacks one.
        """
        temperature_C = 0.0 if status.temperature_C is None else status.temperature_C
        if isfinite(status.silent_s + status.torque_age_s + temperature_C):
            if not self._is_clean:
                self._is_clean = self._check.accept()
            self._last = status
            return status
        self._is_clean = False
        numbers = {
            "silent_s": status.silent_s,
            "torque_age_s": status.torque_age_s,
            "temperature_C": temperature_C,
        }
        name = next(name for name, value in numbers.items() if not isfinite(value))
        self._check.refuse(Signal(name, "", -inf, inf), numbers[name])
        return replace(self._last, state=status.state, fault=status.fault)
