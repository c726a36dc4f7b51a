"""Drops samples that are no numbers before anything is computed from them: a lab's own driver may hand out such."""

from dataclasses import fields, replace
from math import inf, isfinite
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from rfca_rig.drivers.reading_check import ReadingCheck, Signal
from rfca_rig.drivers.roles import MotorStatus

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Block = TypeVar("Block", bound="DataclassInstance")

SHAFT_COLUMNS = ("angle_rad", "speed_rad_s", "torque_Nm", "device_s", "host_s")
FORCE_COLUMNS = ("counts", "device_s")


class SampleCheck:
    """Checks the samples of one device at every tick. `bad` counts those that were dropped, by the name of their column."""

    def __init__(self, device: str, columns: tuple[str, ...]) -> None:
        """`columns` are the names of the columns (m,) or (m, n) that must be finite."""
        self._columns = columns
        self._check = ReadingCheck(device)
        self.bad = self._check.bad

    def accept(self, block: Block) -> Block:
        """The block without the samples that have a value that is not finite.

        Raises BadReading at the third such sample in a row.
        """
        total, samples = 0.0, 0
        for name in self._columns:
            values = getattr(block, name)
            samples = len(values)
            # The usual case: a sum is finite only if all values are, and integers always are. A list, because few numbers are
            # summed faster than an array.
            if values.dtype.kind == "f":
                total += sum(values.ravel().tolist())
        if not isfinite(total):
            return self._drop_bad(block)
        if samples:
            self._check.accept()
        return block

    def _drop_bad(self, block: Block) -> Block:
        columns = {name: getattr(block, name) for name in self._columns}
        is_good = np.ones(len(columns[self._columns[0]]), np.bool_)
        for row in range(len(is_good)):
            for name, values in columns.items():
                value = float(np.sum(values[row]))
                if not isfinite(value):
                    is_good[row] = False
                    self._check.refuse(Signal(name, "", -inf, inf), value)
                    break
            else:
                self._check.accept()
        kind = type(block)
        return kind(*(getattr(block, column.name)[is_good] for column in fields(kind)))


class StatusCheck:
    """Checks the numbers in the status of a drive at every tick. `bad` counts those that were no numbers, by name."""

    def __init__(self) -> None:
        self._check = ReadingCheck("the drive")
        self._last = MotorStatus("unknown", None, 0.0)
        self.bad = self._check.bad

    def accept(self, status: MotorStatus) -> MotorStatus:
        """The status, or the last one with all numbers. Raises BadReading at the third in a row that lacks one."""
        temperature_C = 0.0 if status.temperature_C is None else status.temperature_C
        if isfinite(status.silent_s + status.torque_age_s + temperature_C):
            self._check.accept()
            self._last = status
            return status
        numbers = {"silent_s": status.silent_s, "torque_age_s": status.torque_age_s, "temperature_C": temperature_C}
        name = next(name for name, value in numbers.items() if not isfinite(value))
        self._check.refuse(Signal(name, "", -inf, inf), numbers[name])
        return replace(self._last, state=status.state, fault=status.fault)
