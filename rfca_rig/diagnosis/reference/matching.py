"""Rows of the reference that belong to the same command and time as rows of the recordings.

What a command is called does not matter: a motion matches where it takes the same course.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.data import Observations

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]

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


def find_matches(wanted: Observations, reference: Observations) -> tuple[Match, ...]:
    """The recordings of the reference that have rows of the same signals and times as `wanted`
    (m rows), and values at most MAX_DISTANCE from them; none where there are none.
    """
    matches = []
    recording = reference.recording
    for number in range(int(recording.max()) + 1):
        candidates = np.flatnonzero(recording == number)
        rows = _find_rows(wanted, reference, candidates)
        if rows is None:
            continue
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


def _find_rows(
    wanted: Observations, reference: Observations, candidates: Integers
) -> Integers | None:
    """The candidate (m,) of the same signal at the time of each wanted row; None where a row has
    none.
    """
    found = np.empty(len(wanted.measured), dtype=np.intp)
    for signal in np.unique(wanted.signal):
        of_wanted = np.flatnonzero(wanted.signal == signal)
        of_signal = candidates[reference.signal[candidates] == signal]
        if len(of_signal) < 2:
            return None
        of_signal = of_signal[np.argsort(reference.t_s[of_signal])]
        t_s = reference.t_s[of_signal]
        after = np.clip(np.searchsorted(t_s, wanted.t_s[of_wanted]), 1, len(t_s) - 1)
        is_before = wanted.t_s[of_wanted] - t_s[after - 1] < t_s[after] - wanted.t_s[of_wanted]
        nearest = np.where(is_before, after - 1, after)
        # Half a bin apart, the residuals of steep motions already differ.
        tolerance_s = 0.5 * float(np.median(np.diff(t_s)))
        if np.abs(t_s[nearest] - wanted.t_s[of_wanted]).max() > tolerance_s:
            return None
        found[of_wanted] = of_signal[nearest]
    return found


def find_repeats(reference: Observations) -> tuple[tuple[Match, ...], ...]:
    """The recordings of each command in the reference that was recorded more than once.

    The rows of each repeat are those of the first recording of the command, as far as all of its
    repeats have them.
    """
    recording = reference.recording
    groups = []
    grouped: set[int] = set()
    for number in range(int(recording.max()) + 1):
        if number in grouped:
            continue
        group = _find_group(reference, np.flatnonzero(recording == number), grouped)
        grouped |= {match.recording for match in group}
        if len(group) > 1:
            groups.append(group)
    return tuple(groups)


def _find_group(reference: Observations, rows: Integers, others: set[int]) -> tuple[Match, ...]:
    """The recordings that match most conditions of a recording with these rows (k,), itself
    among them; `others` belong to other groups.
    """
    by_condition = []
    counts: Counter[int] = Counter()
    for condition in np.unique(reference.condition[rows]):
        of_condition = rows[reference.condition[rows] == condition]
        matches = {
            match.recording: match
            for match in find_matches(reference.take(of_condition), reference)
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
