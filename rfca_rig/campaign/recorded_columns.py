"""Columns of one recording on one time base, for any kind of file."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rfca_rig.campaign.layout import TIME_UNITS, TimeSection
from rfca_rig.campaign.units import read_suffix
from rfca_rig.errors import BadInput

Floats = NDArray[np.float64]

# A unit as rad/s or 1/min at the end of a name.
_PER_TIME = re.compile(r"\w*/(s2?|sec|min)[\])}]*$")
# Name of the time at which the recorder of a bag received a message.
LOG_TIME = "log time"


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
        return fault_in_sample(self.path, self.first_line, row, problem)


@dataclass(frozen=True)
class ColumnTable:
    """All columns of one recording, of any kind of file, which are read when they are asked for.

    Parameters
    ----------
    path
        The recording.
    names
        Names of the columns.
    reader
        What `read` calls.
    extras
        Columns of numbers that may be kept beside those that are asked for by name.
    counts
        Columns of whole numbers.
    units
        The unit that the file itself states, by the column's name.
    header
        Where the file has the names, for messages.
    first_line
        The line of the first sample in a text file, None for other files.
    notes
        What was read otherwise than it stands there, a sentence each.
    """

    path: Path
    names: tuple[str, ...]
    reader: Callable[[Sequence[str], Sequence[str]], Floats]
    extras: tuple[str, ...]
    counts: tuple[str, ...]
    units: Mapping[str, str]
    header: str
    first_line: int | None = None
    notes: tuple[str, ...] = ()

    def read(self, names: Sequence[str], gaps: Sequence[str] = ()) -> Floats:
        """Finite numbers (m, k) of these columns, of which the first is the time. Those of `gaps`
        may hold NaN where there is no value. Raises BadInput.
        """
        return self.reader(names, gaps)

    def label(self, name: str) -> str:
        """The name of a column without the groups that hold it in a file of arrays."""
        if self.first_line is not None:
            return name
        # The slash of a unit, or in front of one, is no group's.
        of_unit = _PER_TIME.search(name)
        end = len(name)
        if of_unit is not None:
            end = of_unit.start()
        slash = name.rfind("/", 0, end)
        while slash > 0 and read_suffix(name[slash + 1 :]):
            slash = name.rfind("/", 0, slash)
        return name[slash + 1 :]

    def fault(self, row: int, problem: str) -> BadInput:
        """The error for sample `row`, from 0."""
        return fault_in_sample(self.path, self.first_line, row, problem)


def fault_in_sample(path: Path, first_line: int | None, row: int, problem: str) -> BadInput:
    """The error for sample `row`, from 0, of a recording. Text files are named by line, others by
    sample: a user looks there.
    """
    if first_line is None:
        return BadInput(f"{path}: sample {row + 1}: {problem}")
    return BadInput(f"{path}:{row + first_line}: {problem}")


@dataclass(frozen=True)
class ColumnList:
    """All columns that a recording offers, for a draft.

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
    units
        The unit that the file itself states, by the column's name.
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
    units: Mapping[str, str] = field(default_factory=dict)
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
