"""Signs and units of columns that are probably wrong, because speeds or torques fit far better with
others.

A speed column should be the derivative of its position column. Inertia, weight and drive of the
nominal model balance in every recorded state. Physics that the model lacks, for example friction,
disturbs that balance less than a wrong sign or unit does.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.samples import sample_std
from rfca_rig.campaign.experiment import Experiment, MechanismRun
from rfca_rig.campaign.layout import (
    ANGLE_SPEED_UNITS,
    ANGLE_UNITS,
    COMMAND_UNITS,
    LENGTH_UNITS,
    SPEED_UNITS,
    TIME_UNITS,
    CommandSection,
    ExperimentFile,
    SignalSection,
)
from rfca_rig.mechanism.inverse_dynamics import States, balance_torques
from rfca_rig.mechanism.load import Mechanism

Floats = NDArray[np.float64]

FOLLOWS = 0.9  # correlation from which a ratio of two columns means something
# mean square of a motion over that of its noise, below which columns are not compared
WELL_ABOVE_NOISE = 4.0
FEWEST_BINS = 10  # of a recording, also where its time is in another unit than stated
OFF = 0.1  # share by which a ratio may differ from 1: speeds are filtered, and clocks are uneven


@dataclass(frozen=True)
class SpeedRatio:
    """Factor of a speed on the derivative of its position, as stated, and the correlation of the
    two.

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
    """Ratio of each speed signal that has a position, by its place; omitted where the angle
    wraps, or noise hides the motion.
    """
    ratios = {}
    for speed, position in pair_speeds(experiment):
        if any(find_wraps(experiment, run, position).size for run in experiment.runs):
            continue
        ratio = _compare(experiment, speed, position)
        if ratio is not None:
            ratios[speed] = ratio
    return ratios


def pair_speeds(experiment: Experiment) -> list[tuple[int, int]]:
    """Places of each speed signal and of the position signal of its joint."""
    positions = {
        signal.name: place
        for place, signal in enumerate(experiment.signals)
        if signal.quantity == "position"
    }
    return [
        (place, positions[signal.name])
        for place, signal in enumerate(experiment.signals)
        if signal.quantity == "speed" and signal.name in positions
    ]


def _compare(experiment: Experiment, speed: int, position: int) -> SpeedRatio | None:
    """Ratio of a speed to the derivative of a position, from mean squares without the part of
    the noise.
    """
    sums = np.sum(
        [_travels(run, speed, position, experiment.bin_s) for run in experiment.runs], axis=0
    )
    of_position, of_speed, product, noise_of_position, noise_of_speed = sums
    if (
        of_position <= WELL_ABOVE_NOISE * noise_of_position
        or of_speed <= WELL_ABOVE_NOISE * noise_of_speed
    ):
        return None
    # The ratio of rms values, not a regression: noise in the position would bias a slope.
    ratio = np.sign(product) * np.sqrt(
        (of_speed - noise_of_speed) / (of_position - noise_of_position)
    )
    return SpeedRatio(
        speed, position, float(ratio), float(product / np.sqrt(of_position * of_speed))
    )


def _travels(run: MechanismRun, speed: int, position: int, bin_s: float) -> Floats:
    """Sums over the bins of a run, (5,): the squares of the travel by position and by speed, their
    product, and the squares of their noise.

    Bins count samples, so that a time in another unit shows as a ratio.
    """
    columns = run.signals[:, [position, speed]]
    steps_s = np.diff(run.t_s)
    usual_s = float(np.median(steps_s))
    span = int(np.clip(round(bin_s / usual_s), 1, len(columns) // FEWEST_BINS))
    # The speed is integrated by the trapezoidal rule: differentiating the position would amplify
    # its noise.
    integral = np.append(0.0, np.cumsum(0.5 * steps_s * (columns[1:, 1] + columns[:-1, 1])))
    by_position = np.diff(columns[::span, 0])
    by_speed = np.diff(integral[::span])
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


def list_fixes(
    described: ExperimentFile, found: SpeedRatio, ratio: float, position_is_right: bool
) -> list[str]:
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
    speed = described.signals[found.speed]
    position = described.signals[found.position]
    if is_one(-ratio):
        if position_is_right:
            reversed_signals = [(found.speed, speed)]
        else:
            reversed_signals = [(found.speed, speed), (found.position, position)]
        return [
            f"sign = {-signal.sign} in {name_of('signals', index, signal)}"
            for index, signal in reversed_signals
        ]
    times = [
        f'unit = "{unit}" in [time]'
        for unit in _near(TIME_UNITS, TIME_UNITS[described.time.unit] / ratio)
    ]
    return [
        *_units(speed, found.speed, 1.0 / ratio),
        *_units(position, found.position, ratio),
        *times,
    ]


def _units(signal: SignalSection, index: int, factor: float) -> Iterator[str]:
    """Units of a signal that are `factor` times the stated one; for counts the number per turn."""
    name = name_of("signals", index, signal)
    if signal.counts_per_turn is not None:
        yield (
            f"counts_per_turn = about {float(f'{signal.counts_per_turn / factor:.3g}'):g} in {name}"
        )
        return
    if signal.quantity == "speed":
        families = (ANGLE_SPEED_UNITS, SPEED_UNITS)
    else:
        families = (ANGLE_UNITS, LENGTH_UNITS)
    for family in families:
        if signal.unit in family:
            yield from (
                f'unit = "{unit}" in {name}' for unit in _near(family, family[signal.unit] * factor)
            )


def _near(units: dict[str, float], factor: float) -> list[str]:
    return [unit for unit, of_unit in units.items() if abs(factor / of_unit - 1.0) < OFF]


def name_of(table: str, place: int, section: SignalSection | CommandSection) -> str:
    """Name of a section, for example "signals[2] (q2)"."""
    return f"{table}[{place + 1}] ({section.column})"


# of the imbalance: right signs leave 0.1 to 0.2 on three real rigs, a single wrong one 0.36 to 0.8
FAR_BETTER = 0.5
AS_GOOD = 1.1  # of the imbalance: two readings that the recordings do not tell apart
SAME_DIMENSION = (("N m", "mN m"), ("A", "mA"), ("V", "mV"))
SIGN = "sign"


@dataclass(frozen=True)
class AlternativeReading:
    """A way to read columns other than as stated.

    `words` says what to write instead; `position` (n,) and `command` (u,) are factors on positions
    and commands.
    """

    words: str
    position: Floats
    command: Floats

    @property
    def is_sign(self) -> bool:
        """Whether it changes signs only."""
        return bool((np.abs(self.position) == 1.0).all() and (np.abs(self.command) == 1.0).all())

    def apply(self, states: States) -> States:
        """The states in this reading."""
        position, speed, acceleration = (
            self.position * part for part in (states.position, states.speed, states.acceleration)
        )
        return States(position, speed, acceleration, self.command * states.command)

    def also(self, other: "AlternativeReading") -> "AlternativeReading":
        """Both at once."""
        return AlternativeReading(
            f"{self.words}, {other.words}",
            self.position * other.position,
            self.command * other.command,
        )


@dataclass(frozen=True)
class Correction:
    """A reading with which the torques balance far better, others that are as good, and the
    imbalance before and after.
    """

    reading: AlternativeReading
    alternatives: tuple[AlternativeReading, ...]
    before: float
    after: float


def find_corrections(
    described: ExperimentFile,
    mechanism: Mechanism,
    states: States,
    ratios: Mapping[int, SpeedRatio],
) -> list[Correction]:
    """Signs and units that have to be changed for the torques to balance far better, one after the
    other.

    Parameters
    ----------
    described
        The description, as stated.
    mechanism
        The nominal mechanism.
    states
        The states as they are read now.
    ratios
        Those of `compare_speeds`: a speed that agrees with its position changes with it.
    """
    corrections: list[Correction] = []
    if not len(states.position):
        return corrections
    readings = _readings(described, mechanism, ratios)
    # Two signs may be wrong together, so that neither change alone helps.
    signs = [reading for reading in readings if reading.is_sign]
    pairs = [first.also(second) for first, second in combinations(signs, 2)]
    before = _imbalance(mechanism, states)
    # At most one correction per reading, so that the loop ends.
    for _ in readings:
        correction = _find_best(readings, mechanism, states, before) or _find_best(
            pairs, mechanism, states, before
        )
        if correction is None:
            break
        corrections.append(correction)
        states = correction.reading.apply(states)
        before = correction.after
    return corrections


def _find_best(
    readings: Sequence[AlternativeReading], mechanism: Mechanism, states: States, before: float
) -> Correction | None:
    """The reading that balances best; None where none is far better than the imbalance `before`."""
    scores = [_imbalance(mechanism, reading.apply(states)) for reading in readings]
    after = min(scores, default=np.inf)
    if after >= FAR_BETTER * before:
        return None
    # Readings that balance equally well cannot be distinguished, so all are offered to the user.
    best, *others = [
        reading for reading, score in zip(readings, scores, strict=True) if score < AS_GOOD * after
    ]
    return Correction(best, tuple(others), before, after)


def _imbalance(mechanism: Mechanism, states: States) -> float:
    return float(np.sqrt(np.mean(balance_torques(mechanism, states).imbalance ** 2)))


def _readings(
    described: ExperimentFile, mechanism: Mechanism, ratios: Mapping[int, SpeedRatio]
) -> list[AlternativeReading]:
    """Every joint and every command with the other sign or in another unit, then all joints and
    all commands together.
    """
    alike: dict[tuple[str, str], list[AlternativeReading]] = {}
    joints = np.ones(len(mechanism.joints))
    actuators = np.ones(len(mechanism.actuators))
    for index, signal in enumerate(described.signals):
        if signal.quantity == "position":
            # A speed that agrees with its position must change with it, or it would disagree
            # afterwards.
            follow = [
                ratio.speed for ratio in ratios.values() if ratio.position == index and ratio.agrees
            ]
            for change, factor in _changes_of_position(signal):
                words = " and ".join(
                    _write("signals", number, described.signals[number], change)
                    for number in (index, *follow)
                )
                factors = _scale(joints, mechanism.joints.index(signal.joint), factor)
                alike.setdefault(("signals", change), []).append(
                    AlternativeReading(words, factors, actuators)
                )
    for index, command in enumerate(described.commands):
        for change, factor in _changes_of_command(command):
            factors = _scale(actuators, mechanism.actuators.index(command.actuator), factor)
            words = _write("commands", index, command, change)
            alike.setdefault(("commands", change), []).append(
                AlternativeReading(words, joints, factors)
            )
    single = [reading for readings in alike.values() for reading in readings]
    # The same mistake may be in all columns.
    return [
        *single,
        *(
            reduce(AlternativeReading.also, readings)
            for readings in alike.values()
            if len(readings) > 1
        ),
    ]


def _scale(ones: Floats, index: int, factor: float) -> Floats:
    """Factors (n,): `factor` at one place, 1 elsewhere."""
    return np.where(np.arange(len(ones)) == index, factor, ones)


def _changes_of_position(signal: SignalSection) -> Iterator[tuple[str, float]]:
    """Possible changes of a position column, and their factor on the values."""
    yield SIGN, -1.0
    for family in (ANGLE_UNITS, LENGTH_UNITS):
        yield from (
            (unit, factor / family[signal.unit])
            for unit, factor in family.items()
            if signal.unit in set(family) - {unit}
        )


def _changes_of_command(command: CommandSection) -> Iterator[tuple[str, float]]:
    yield SIGN, -1.0
    for family in SAME_DIMENSION:
        yield from (
            (unit, COMMAND_UNITS[unit] / COMMAND_UNITS[command.unit])
            for unit in family
            if command.unit in set(family) - {unit}
        )


def _write(table: str, index: int, section: SignalSection | CommandSection, change: str) -> str:
    """The line for experiment.toml; the unit of a speed follows that of its position."""
    if isinstance(section, SignalSection) and section.quantity == "speed":
        per_s = "/s"
    else:
        per_s = ""
    if change == SIGN:
        value = f"sign = {-section.sign}"
    else:
        value = f'unit = "{change}{per_s}"'
    return f"{value} in {name_of(table, index, section)}"
