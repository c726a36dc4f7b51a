"""Columns of one recording on one time base, for any kind of file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rfca_rig.campaign.layout import TIME_UNITS, TimeSection
from rfca_rig.errors import BadInput

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ColumnRequest:
    """The columns that experiment.toml names.

    Parameters
    ----------
    time
        The column of the time, and its unit.
    holds
        Content of each other column, in words, by the column's name. The first is that of the first
        signal.
    longest_gap_s
        The longest time between two samples that interpolation may bridge.
    databases
        Of a CAN log: the files that define its messages.
    bus
        Of a CAN log: the only bus whose frames count; None for all.
    episode
        Of a file with several episodes: the number of that which is read; None for a file with one.
    """

    time: TimeSection
    holds: Mapping[str, str]
    longest_gap_s: float
    databases: Sequence[Path] = ()
    bus: str | None = None
    episode: int | None = None

    @property
    def with_time(self) -> dict[str, str]:
        """Content of each column, that of the time first."""
        return {self.time.column: "the time", **self.holds}

    def time_of(self, values: Mapping[str, Floats]) -> Floats:
        """Times (m,) in s, from the values (m,) of all columns."""
        return np.asarray(TIME_UNITS[self.time.unit] * values[self.time.column])


@dataclass(frozen=True)
class RecordedColumns:
    """The requested columns.

    Parameters
    ----------
    path
        The recording.
    t_s
        (m,) times in s.
    values
        (m,) finite numbers by the column's name, in the column's unit.
    first_line
        The line of the first sample in a text file, None for other files.
    units
        The unit that the file itself states, by the column's name.
    notes
        What was read otherwise than it stands there, a sentence each.
    """

    path: Path
    t_s: Floats
    values: Mapping[str, Floats]
    first_line: int | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def fault(self, row: int, problem: str) -> BadInput:
        """The error for sample `row`, from 0."""
        # Text files are named by line, others by sample: a user looks there.
        if self.first_line is None:
            return BadInput(f"{self.path}: sample {row + 1}: {problem}")
        return BadInput(f"{self.path}:{row + self.first_line}: {problem}")


@dataclass(frozen=True)
class ColumnList:
    """All columns that a recording offers, for a draft of experiment.toml.

    Parameters
    ----------
    values
        The numbers (m,) of each column by its name, None where not all of them are finite.
    times
        Columns that may be the time.
    no_time
        Text for a recording in which none may be.
    time_unit
        The unit of the time, None where only the user knows it.
    notes
        Lines about the recording as a whole.
    episodes
        Numbers of the episodes that share a file; empty for other files.
    labels
        What a column is called elsewhere, by its name.
    """

    values: Mapping[str, Floats | None]
    times: tuple[str, ...]
    no_time: str = "none of the columns rises throughout"
    time_unit: str | None = None
    notes: tuple[str, ...] = ()
    episodes: tuple[int, ...] = ()
    labels: Mapping[str, str] = field(default_factory=dict)


def finite_or_none(column: Floats) -> Floats | None:
    """The column (m,); None where it holds something that is no finite number."""
    if np.isfinite(column).all():
        return column
    return None


def find_rising(values: Mapping[str, Floats | None]) -> tuple[str, ...]:
    """Names of the columns (m,) whose values rise from each sample to the next."""
    return tuple(
        name
        for name, column in values.items()
        if column is not None and (np.diff(column) > 0.0).all()
    )
