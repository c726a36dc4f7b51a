"""Refuses numbers of a device that are impossible: not finite, or beyond what their signal can
mean.
"""

from collections import Counter
from dataclasses import dataclass
from math import isfinite, isnan, nan

from rfca_rig.errors import BadReading

# A bad report is a disturbance; a device that sends three in a row cannot guard anything.
MAX_BAD_IN_A_ROW = 3


@dataclass(frozen=True)
class Signal:
    """A number that a device reports, and the range outside which it cannot be true."""

    name: str
    unit: str
    low: float
    high: float


# Wide on purpose: they separate numbers from garbage. What a rig may do is in the limits of its
# file. 100 000 turns of the shaft, after which a run ends, behind a gear of 100.
POSITION = Signal("position", "turns", -1e7, 1e7)
# 60 000 revolutions per minute.
SPEED = Signal("speed", "turns/s", -1e3, 1e3)
TORQUE = Signal("torque", "N m", -1e3, 1e3)
CURRENT = Signal("current", "A", -1e3, 1e3)
TEMPERATURE = Signal("temperature", "degC", -100.0, 400.0)


class ReadingCheck:
    """Checks the numbers of one kind of report. `bad` counts the reports that were refused, by
    the name of the signal.
    """

    def __init__(self, device: str, *signals: Signal) -> None:
        """`device` is the subject of the message: "the drive", "the force sensor"."""
        self._device = device
        self._signals = signals
        self._ranges = [(signal.low, signal.high) for signal in signals]
        self._bad_in_a_row = 0
        self.bad: Counter[str] = Counter()

    def accept(self, *values: float) -> bool:
        """Whether all numbers of a report, in the order of the signals, are possible; the caller
        drops it otherwise.

        Raises BadReading at the third bad report in a row.
        """
        index = 0
        # Plain, because it runs for every report.
        for low, high in self._ranges:
            # A comparison with NaN is false, so this way round NaN is refused too.
            if not low <= values[index] <= high:
                self.refuse(self._signals[index], values[index])
                return False
            index += 1  # noqa: SIM113
        self._bad_in_a_row = 0
        return True

    def refuse(self, signal: Signal, value: float) -> None:
        """Counts a report whose `signal` has an impossible value. Raises BadReading at the third
        in a row.
        """
        self.bad[signal.name] += 1
        self._bad_in_a_row += 1
        if self._bad_in_a_row >= MAX_BAD_IN_A_ROW:
            if isfinite(signal.high):
                possible = f"possible are {signal.low:g} to {signal.high:g}"
            else:
                possible = "it must be a number"
            value_text = f"{value:g} {signal.unit}".rstrip()
            raise BadReading(
                f"{self._device} reports {signal.name} {value_text}, {self._bad_in_a_row} "
                f"bad reports in a row; {possible}: "
                "check what measures it, then the wiring"
            )


class OptionalReading:
    """A number that a device may not have, as the temperature of a motor without a thermistor: NaN
    until its first value.

    Once it had a value, it must always have one. `value` is the last possible one.
    """

    def __init__(self, device: str, signal: Signal) -> None:
        self.check = ReadingCheck(device, signal)
        self.value = nan

    def take(self, value: float) -> None:
        """Takes in a report. Raises BadReading at the third bad one in a row."""
        if isnan(value) and isnan(self.value):
            return
        if self.check.accept(value):
            self.value = value


def describe_bad(*counts: Counter[str]) -> str:
    """How many reports were refused, by signal: "2 of position, 1 of torque"; "none" without
    any.
    """
    total: Counter[str] = sum(counts, Counter())
    return ", ".join(f"{count} of {name}" for name, count in sorted(total.items())) or "none"
