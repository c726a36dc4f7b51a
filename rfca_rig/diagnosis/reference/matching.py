"""Rows of the reference that belong to the same command and time as rows of the recordings.

What two rows must have in common beside their time depends on the kind of rig, which names it by
row: a `CommandName`. A motion also has to take the same course.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.data import Observations

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]

# What must agree between two rows that belong together, for each row (m,).
CommandName = Callable[[Observations], NDArray[np.str_]]

# Rms difference of two motions, as a share of the standard deviation of the reference's, up to
# which the model errs alike in them. A position servo sags under a heavier weight: one that takes
# 25 % of the stall torque and is doubled makes a difference of 0.07.
MAX_DISTANCE = 0.25


@dataclass(frozen=True)
class Match:
    """One recording of the reference that has the rows of a condition.

    Parameters
    ----------
    recording
        Its number in the reference.
    rows
        (m,) numbers of the reference's rows, one for each row of the condition.
    distance
        Rms difference of the measured values, as a share of the standard deviation that the signals
        have in the recording.
    """

    recording: int
    rows: Integers
    distance: float


def name_signals(rows: Observations) -> NDArray[np.str_]:
    """The signal of each row (m,): what a command is called does not matter."""
    return rows.signal


def find_matches(
    wanted: Observations, reference: Observations, name_commands: CommandName
) -> tuple[Match, ...]:
    """The recordings of the reference that have rows of the same names and times as `wanted`, and
    values at most MAX_DISTANCE from them; none where there are none.

    `name_commands` names the rows (m,) of any observations.
    """
    wanted_names = name_commands(wanted)
    reference_names = name_commands(reference)
    matches = []
    recording = reference.recording
    for number in range(int(recording.max()) + 1):
        candidates = np.flatnonzero(recording == number)
        times = _NamedTimes(reference_names[candidates], reference.t_s[candidates])
        nearest = _find_nearest(_NamedTimes(wanted_names, wanted.t_s), times)
        if nearest is None:
            continue
        rows = candidates[nearest]
        # Of this recording alone: beside large motions all small ones would look alike.
        change = _measure_change(reference.take(candidates))
        scale = np.array([change[str(signal)] for signal in wanted.signal])
        difference = (wanted.measured - reference.measured[rows]) / scale
        distance = float(np.sqrt(np.mean(difference**2)))
        if distance <= MAX_DISTANCE:
            matches.append(Match(number, rows, distance))
    return tuple(matches)


def _measure_change(rows: Observations) -> dict[str, float]:
    """Standard deviation of each signal."""
    signals = rows.signal
    return {
        str(signal): max(float(np.std(rows.measured[signals == signal])), 1e-300)
        for signal in np.unique(signals)
    }


@dataclass(frozen=True)
class _NamedTimes:
    """Names and times of rows, (m,) each."""

    names: NDArray[np.str_]
    t_s: Floats


def _find_nearest(wanted: _NamedTimes, candidates: _NamedTimes) -> Integers | None:
    """Of each wanted row, the candidate (m,) of the same name at its time; None where a row has
    none.
    """
    found = np.empty(len(wanted.t_s), dtype=np.intp)
    for name in np.unique(wanted.names):
        of_wanted = np.flatnonzero(wanted.names == name)
        of_name = np.flatnonzero(candidates.names == name)
        if len(of_name) < 2:
            return None
        of_name = of_name[np.argsort(candidates.t_s[of_name])]
        t_s = candidates.t_s[of_name]
        after = np.clip(np.searchsorted(t_s, wanted.t_s[of_wanted]), 1, len(t_s) - 1)
        is_before = wanted.t_s[of_wanted] - t_s[after - 1] < t_s[after] - wanted.t_s[of_wanted]
        nearest = np.where(is_before, after - 1, after)
        # Half a bin apart, the residuals of steep motions already differ.
        tolerance_s = 0.5 * float(np.median(np.diff(t_s)))
        if np.abs(t_s[nearest] - wanted.t_s[of_wanted]).max() > tolerance_s:
            return None
        found[of_wanted] = of_name[nearest]
    return found


def find_repeats(
    reference: Observations, name_commands: CommandName
) -> tuple[tuple[Match, ...], ...]:
    """The recordings of each command in the reference that was recorded more than once;
    `name_commands` names the rows (m,) of any observations.

    The rows of each repeat are those of the first recording of the command, as far as all of its
    repeats have them.
    """
    recording = reference.recording
    groups = []
    grouped: set[int] = set()
    for number in range(int(recording.max()) + 1):
        if number in grouped:
            continue
        rows = np.flatnonzero(recording == number)
        group = _find_group(reference, rows, grouped, name_commands)
        grouped |= {match.recording for match in group}
        if len(group) > 1:
            groups.append(group)
    return tuple(groups)


def _find_group(
    reference: Observations, rows: Integers, others: set[int], name_commands: CommandName
) -> tuple[Match, ...]:
    """The recordings that match most conditions of a recording with these rows (k,), itself
    among them; `others` belong to other groups.
    """
    by_condition = []
    counts: Counter[int] = Counter()
    for condition in np.unique(reference.condition[rows]):
        of_condition = rows[reference.condition[rows] == condition]
        matches = {
            match.recording: match
            for match in find_matches(reference.take(of_condition), reference, name_commands)
            if match.recording not in others
        }
        by_condition.append(matches)
        counts.update(matches.keys())
    members = [number for number, count in counts.items() if 2 * count > len(by_condition)]
    # Only conditions that all members have.
    shared = [matches for matches in by_condition if set(members) <= set(matches)]
    if not shared:
        return ()
    return tuple(_join([matches[number] for matches in shared]) for number in members)


def _join(matches: Sequence[Match]) -> Match:
    """The matches of several conditions in one recording as one."""
    return Match(
        matches[0].recording,
        np.concatenate([match.rows for match in matches]),
        float(np.mean([match.distance for match in matches])),
    )
