"""Signs and units of columns that are probably wrong, because the torques balance far better with others.

Inertia, weight and drive of the nominal model balance in every recorded state. Physics that the model lacks, for example friction, disturbs
that balance less than a wrong sign or unit does.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from rfca_rig.campaign.experiment_layout import (
    ANGLE_UNITS,
    COMMAND_UNITS,
    LENGTH_UNITS,
    CommandSection,
    ExperimentFile,
    SignalSection,
)
from rfca_rig.diagnosis.mechanisms.speeds import SpeedRatio, name_of
from rfca_rig.mechanism.inverse_dynamics import States, balance_torques
from rfca_rig.mechanism.load import Mechanism

Floats = NDArray[np.float64]

FAR_BETTER = 0.5  # of the imbalance: right signs leave 0.1 to 0.2 on three real rigs, a single wrong one 0.36 to 0.8
AS_GOOD = 1.1  # of the imbalance: two readings that the recordings do not tell apart
SAME_DIMENSION = (("N m", "mN m"), ("A", "mA"), ("V", "mV"))
SIGN = "sign"


@dataclass(frozen=True)
class AlternativeReading:
    """A way to read columns other than as stated.

    `words` says what to write instead; `position` (n,) and `command` (u,) are factors on positions and commands.
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
        position, speed, acceleration = (self.position * part for part in (states.position, states.speed, states.acceleration))
        return States(position, speed, acceleration, self.command * states.command)

    def also(self, other: "AlternativeReading") -> "AlternativeReading":
        """Both at once."""
        return AlternativeReading(f"{self.words}, {other.words}", self.position * other.position, self.command * other.command)


@dataclass(frozen=True)
class Correction:
    """A reading with which the torques balance far better, others that are as good, and the imbalance before and after."""

    reading: AlternativeReading
    alternatives: tuple[AlternativeReading, ...]
    before: float
    after: float


def find_corrections(described: ExperimentFile, mechanism: Mechanism, states: States, ratios: Mapping[int, SpeedRatio]) -> list[Correction]:
    """Signs and units that have to be changed for the torques to balance far better, one after the other.

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
    found: list[Correction] = []
    if not len(states.position):
        return found
    readings = _readings(described, mechanism, ratios)
    # Two signs may be wrong together, so that neither change alone helps.
    pairs = [one.also(other) for one, other in combinations([reading for reading in readings if reading.is_sign], 2)]
    before = _imbalance(mechanism, states)
    # At most one correction per reading, so that the loop ends.
    for _ in readings:
        correction = _find_best(readings, mechanism, states, before) or _find_best(pairs, mechanism, states, before)
        if correction is None:
            break
        found.append(correction)
        states, before = correction.reading.apply(states), correction.after
    return found


def _find_best(readings: Sequence[AlternativeReading], mechanism: Mechanism, states: States, before: float) -> Correction | None:
    """The reading that balances best; None where none is far better than the imbalance `before`."""
    scores = [_imbalance(mechanism, reading.apply(states)) for reading in readings]
    after = min(scores, default=np.inf)
    if after >= FAR_BETTER * before:
        return None
    # Readings that balance equally well cannot be distinguished, so all are offered to the user.
    best, *others = [reading for reading, score in zip(readings, scores, strict=True) if score < AS_GOOD * after]
    return Correction(best, tuple(others), before, after)


def _imbalance(mechanism: Mechanism, states: States) -> float:
    return float(np.sqrt(np.mean(balance_torques(mechanism, states).imbalance ** 2)))


def _readings(described: ExperimentFile, mechanism: Mechanism, ratios: Mapping[int, SpeedRatio]) -> list[AlternativeReading]:
    """Every joint and every command with the other sign or in another unit, then all joints and all commands together."""
    alike: dict[tuple[str, str], list[AlternativeReading]] = {}
    joints, actuators = np.ones(len(mechanism.joints)), np.ones(len(mechanism.actuators))
    for place, signal in enumerate(described.signals):
        if signal.quantity == "position":
            # A speed that agrees with its position must change with it, or it would disagree afterwards.
            follow = [ratio.speed for ratio in ratios.values() if ratio.position == place and ratio.agrees]
            for change, factor in _changes_of_position(signal):
                words = " and ".join(_write("signals", one, described.signals[one], change) for one in (place, *follow))
                factors = _scale(joints, mechanism.joints.index(signal.joint), factor)
                alike.setdefault(("signals", change), []).append(AlternativeReading(words, factors, actuators))
    for place, command in enumerate(described.commands):
        for change, factor in _changes_of_command(command):
            factors = _scale(actuators, mechanism.actuators.index(command.actuator), factor)
            words = _write("commands", place, command, change)
            alike.setdefault(("commands", change), []).append(AlternativeReading(words, joints, factors))
    single = [reading for readings in alike.values() for reading in readings]
    # The same mistake may be in all columns.
    return [*single, *(reduce(AlternativeReading.also, readings) for readings in alike.values() if len(readings) > 1)]


def _scale(ones: Floats, place: int, factor: float) -> Floats:
    """Factors (n,): `factor` at one place, 1 elsewhere."""
    return np.where(np.arange(len(ones)) == place, factor, ones)


def _changes_of_position(signal: SignalSection) -> Iterator[tuple[str, float]]:
    """Possible changes of a position column, and their factor on the values."""
    yield SIGN, -1.0
    for family in (ANGLE_UNITS, LENGTH_UNITS):
        yield from ((unit, factor / family[signal.unit]) for unit, factor in family.items() if signal.unit in set(family) - {unit})


def _changes_of_command(command: CommandSection) -> Iterator[tuple[str, float]]:
    yield SIGN, -1.0
    for family in SAME_DIMENSION:
        yield from ((unit, COMMAND_UNITS[unit] / COMMAND_UNITS[command.unit]) for unit in family if command.unit in set(family) - {unit})


def _write(table: str, place: int, section: SignalSection | CommandSection, change: str) -> str:
    """The line for experiment.toml; the unit of a speed follows that of its position."""
    per_s = "/s" if isinstance(section, SignalSection) and section.quantity == "speed" else ""
    value = f"sign = {-section.sign}" if change == SIGN else f'unit = "{change}{per_s}"'
    return f"{value} in {name_of(table, place, section)}"
