"""Strokes grouped by condition, and mean and spread of their values."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from rfca_rig.recording.model import Stroke, collect_strokes_before

# Standard deviations on either side of a normal distribution that hold 95 %.
STDS_OF_95 = 1.96


@dataclass(frozen=True)
class Condition:
    """One height and one commanded speed, with its strokes in the order of their repeats."""

    height_m: float
    speed_rad_s: float
    strokes: tuple[Stroke, ...]

    @property
    def label(self) -> str:
        """As in "215 mm, 2.433 rad/s"."""
        return f"{1e3 * self.height_m:g} mm, {self.speed_rad_s:g} rad/s"

    @property
    def strokes_before(self) -> tuple[int, ...]:
        """How many strokes the leg had made before each of these; () where that is not known for
        all of them.
        """
        return collect_strokes_before(self.strokes)


@dataclass(frozen=True)
class Spread:
    """Mean and sample standard deviation (n - 1) of `count` values; None where there are too
    few.
    """

    mean: float | None
    std: float | None
    count: int


def group_by_condition(strokes: Iterable[Stroke]) -> tuple[Condition, ...]:
    """Group strokes by height and commanded speed, sorted by both.

    Heights that agree after rounding to 0.1 mm, and speeds to 0.001 rad/s, form one condition.
    """
    groups: dict[tuple[float, float], list[Stroke]] = {}
    for stroke in strokes:
        # Rounding makes equal what differs in the last digits alone.
        groups.setdefault((round(stroke.height_m, 4), round(stroke.speed_rad_s, 3)), []).append(
            stroke
        )
    return tuple(
        Condition(height_m, speed_rad_s, tuple(sorted(group, key=lambda s: s.repeat)))
        for (height_m, speed_rad_s), group in sorted(groups.items())
    )


def compute_spread(values: Sequence[float]) -> Spread:
    """Mean and sample standard deviation of repeats."""
    mean = None
    if values:
        mean = float(np.mean(values))
    std = None
    if len(values) > 1:
        std = float(np.std(values, ddof=1))
    return Spread(mean, std, len(values))
