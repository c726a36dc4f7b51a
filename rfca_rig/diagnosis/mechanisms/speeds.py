"""Check whether a speed column is the derivative of its position column, with the lines for experiment.toml that fix it."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.swings import sample_std
from rfca_rig.campaign.experiment import Experiment, MechanismRun
from rfca_rig.campaign.experiment_layout import (
    ANGLE_SPEED_UNITS,
    ANGLE_UNITS,
    LENGTH_UNITS,
    SPEED_UNITS,
    TIME_UNITS,
    CommandSection,
    ExperimentFile,
    SignalSection,
)

Floats = NDArray[np.float64]

FOLLOWS = 0.9  # correlation from which a ratio of two columns means something
WELL_ABOVE_NOISE = 4.0  # mean square of a motion over that of its noise, below which columns are not compared
FEWEST_BINS = 10  # of a recording, also where its time is in another unit than stated
OFF = 0.1  # share by which a ratio may differ from 1: speeds are filtered, and clocks are uneven


@dataclass(frozen=True)
class SpeedRatio:
    """Factor of a speed on the derivative of its position, as stated, and the correlation of the two.

    `speed` and `position` are the places of the signals.
    """

    speed: int
    position: int
    ratio: float
    correlation: float

    @property
    def agrees(self) -> bool:
        """Whether the speed is the derivative."""
        return self.correlation > FOLLOWS and is_one(self.ratio)


def find_wraps(experiment: Experiment, run: MechanismRun, place: int) -> NDArray[np.intp]:
    """Samples (w,) of an angle signal after which it jumps by more than half a turn."""
    signal = experiment.signals[place]
    if signal.quantity != "position" or signal.unit != "rad":
        return np.empty(0, dtype=np.intp)
    return np.flatnonzero(np.abs(np.diff(run.signals[:, place])) > np.pi)


def compare_speeds(experiment: Experiment) -> dict[int, SpeedRatio]:
    """Ratio of each speed signal that has a position, by its place; omitted where the angle wraps, or noise hides the motion."""
    positions = {
        signal.name: place
        for place, signal in enumerate(experiment.signals)
        if signal.quantity == "position" and not any(find_wraps(experiment, run, place).size for run in experiment.runs)
    }
    pairs = [(k, positions[s.name]) for k, s in enumerate(experiment.signals) if s.quantity == "speed" and s.name in positions]
    found = [_compare(experiment, speed, position) for speed, position in pairs]
    return {one.speed: one for one in found if one is not None}


def _compare(experiment: Experiment, speed: int, position: int) -> SpeedRatio | None:
    """Ratio of a speed to the derivative of a position, from mean squares without the part of the noise."""
    sums = np.sum([_travels(run, speed, position, experiment.bin_s) for run in experiment.runs], axis=0)
    of_position, of_speed, product, noise_of_position, noise_of_speed = sums
    if of_position <= WELL_ABOVE_NOISE * noise_of_position or of_speed <= WELL_ABOVE_NOISE * noise_of_speed:
        return None
    # The ratio of rms values, not a regression: noise in the position would bias a slope.
    ratio = np.sign(product) * np.sqrt((of_speed - noise_of_speed) / (of_position - noise_of_position))
    return SpeedRatio(speed, position, float(ratio), float(product / np.sqrt(of_position * of_speed)))


def _travels(run: MechanismRun, speed: int, position: int, bin_s: float) -> Floats:
    """Sums over the bins of a run, (5,): the squares of the travel by position and by speed, their product, and the squares of their noise.

    Bins count samples, so that a time in another unit shows as a ratio.
    """
    columns, steps_s = run.signals[:, [position, speed]], np.diff(run.t_s)
    usual_s = float(np.median(steps_s))
    span = int(np.clip(round(bin_s / usual_s), 1, len(columns) // FEWEST_BINS))
    # The speed is integrated by the trapezoidal rule: differentiating the position would amplify its noise.
    integral = np.append(0.0, np.cumsum(0.5 * steps_s * (columns[1:, 1] + columns[:-1, 1])))
    by_position, by_speed = np.diff(columns[::span, 0]), np.diff(integral[::span])
    noise = sample_std(columns)
    count = len(by_position)
    return np.array(
        [
            # Noise of a travel: two positions in a difference, or `span` speeds in an integral.
            by_position @ by_position,
            by_speed @ by_speed,
            by_position @ by_speed,
            2.0 * count * noise[0] ** 2,
            count * span * (usual_s * noise[1]) ** 2,
        ]
    )


def is_one(ratio: float) -> bool:
    """Whether a ratio is 1, as far as filters and clocks allow."""
    return abs(ratio - 1.0) < OFF


def list_fixes(described: ExperimentFile, found: SpeedRatio, ratio: float, position_is_right: bool) -> list[str]:
    """Lines for experiment.toml that would make a ratio 1; empty where no unit and no sign does it.

    Parameters
    ----------
    described
        The description.
    found
        Which signals are compared.
    ratio
        How many times the derivative the speed is, after other corrections.
    position_is_right
        Whether the sign of the position is known to be right.
    """
    speed, position = described.signals[found.speed], described.signals[found.position]
    if is_one(-ratio):
        reversed_signals = [(found.speed, speed)] if position_is_right else [(found.speed, speed), (found.position, position)]
        return [f"sign = {-one.sign} in {name_of('signals', place, one)}" for place, one in reversed_signals]
    times = [f'unit = "{unit}" in [time]' for unit in _near(TIME_UNITS, TIME_UNITS[described.time.unit] / ratio)]
    return [*_units(speed, found.speed, 1.0 / ratio), *_units(position, found.position, ratio), *times]


def _units(signal: SignalSection, place: int, factor: float) -> Iterator[str]:
    """Units of a signal that are `factor` times the stated one; for counts the number per turn."""
    name = name_of("signals", place, signal)
    if signal.counts_per_turn is not None:
        yield f"counts_per_turn = about {float(f'{signal.counts_per_turn / factor:.3g}'):g} in {name}"
        return
    families = (ANGLE_SPEED_UNITS, SPEED_UNITS) if signal.quantity == "speed" else (ANGLE_UNITS, LENGTH_UNITS)
    for family in families:
        if signal.unit in family:
            yield from (f'unit = "{unit}" in {name}' for unit in _near(family, family[signal.unit] * factor))


def _near(units: dict[str, float], factor: float) -> list[str]:
    return [unit for unit, of_unit in units.items() if abs(factor / of_unit - 1.0) < OFF]


def name_of(table: str, place: int, section: SignalSection | CommandSection) -> str:
    """Name of a section, for example "signals[2] (q2)"."""
    return f"{table}[{place + 1}] ({section.column})"
