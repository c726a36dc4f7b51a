"""Columns that have times of their own, as those of bags and CAN logs, on one time base: the times
of the first signal.

Other columns are interpolated linearly to these times. Times outside the range of any column are
omitted. So are times in a gap of a column, where two of its samples are further apart than a bin.
The cutting of windows then finds the gap.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rfca_rig.campaign.recorded_columns import ColumnRequest, RecordedColumns
from rfca_rig.campaign.table import FEWEST_SAMPLES, MANY_SAME, describe_step_back
from rfca_rig.errors import BadInput

Floats = NDArray[np.float64]

NS_PER_S = 1_000_000_000


@dataclass(frozen=True)
class TimedColumn:
    """A column with times of its own.

    Parameters
    ----------
    name
        Of the column.
    source
        What its samples come in, for messages: a topic of a bag, or a message of a CAN bus.
    times_ns
        (k,) times. Integers, since a float of seconds since 1970 resolves only 0.2 us.
    values
        (k,) in the unit of the column.
    time_hint
        Where else times may be found, for a message about times that do not run forwards; "" for
        nowhere.
    """

    name: str
    source: str
    times_ns: NDArray[np.int64]
    values: Floats
    time_hint: str = ""


@dataclass(frozen=True)
class _Series:
    """Times (k,) from the first sample of the time base, and values (k,); `repeated` says which
    stamps were left out.
    """

    t_s: Floats
    values: Floats
    repeated: str = ""


def join_columns(
    path: Path,
    columns: Sequence[TimedColumn],
    request: ColumnRequest,
    units: Mapping[str, str] | None = None,
    notes: Sequence[str] = (),
) -> RecordedColumns:
    """Interpolate the columns to the times of the first one, counted from its first sample.

    Parameters
    ----------
    path
        The recording.
    columns
        All requested columns, that of the first signal first, each with one sample or more.
    request
        The columns of experiment.toml.
    units
        The unit that the recording states, by the column's name.
    notes
        What was read otherwise than it stands in the recording, a sentence each.

    Raises
    ------
    BadInput
        Where time does not run forwards, or the columns share too few samples.
    """
    zero_ns = int(columns[0].times_ns[0])
    series = {column.name: _make_series(path, column, zero_ns, request) for column in columns}
    base = series[columns[0].name]
    covered = np.ones(len(base.t_s), dtype=bool)
    for column in series.values():
        covered &= _reaches(column.t_s, base.t_s, request.longest_gap_s)
    if covered.sum() < FEWEST_SAMPLES:
        raise BadInput(
            f"{path}: {covered.sum()} samples of {columns[0].name} lie where all columns "
            "were recorded without a gap above "
            f"{request.longest_gap_s:g} s, which is windows.bin_s; needs {FEWEST_SAMPLES} or more"
        )
    t_s = base.t_s[covered]
    values = {name: np.interp(t_s, column.t_s, column.values) for name, column in series.items()}
    repeated = dict.fromkeys(column.repeated for column in series.values() if column.repeated)
    return RecordedColumns(path, t_s, values, units=units or {}, notes=(*notes, *repeated))


def _make_series(path: Path, column: TimedColumn, zero_ns: int, request: ColumnRequest) -> _Series:
    """A column without messages that repeat a stamp, as those of a node that republishes do. Raises
    BadInput as `_check_times`.
    """
    times_ns = column.times_ns
    values = column.values
    is_new = np.append(True, np.diff(times_ns) != 0)
    repeats = len(times_ns) - int(is_new.sum())
    note = ""
    if 0 < repeats < MANY_SAME * len(times_ns):
        note = f"{column.source}: {repeats} messages repeat a stamp and are left out"
        times_ns = times_ns[is_new]
        values = values[is_new]
    _check_times(path, column, times_ns, request)
    return _Series((times_ns - zero_ns) / NS_PER_S, values, note)


def _check_times(
    path: Path, column: TimedColumn, times_ns: NDArray[np.int64], request: ColumnRequest
) -> None:
    """Raises BadInput where time does not run forwards, or the median step is longer than a bin."""
    steps_s = np.diff(times_ns) / NS_PER_S
    backwards = np.flatnonzero(steps_s <= 0.0)
    if backwards.size:
        row = int(backwards[0]) + 1
        # From the first one, since a float of seconds since 1970 resolves only 0.2 us.
        since_first_s = (times_ns - times_ns[0]) / NS_PER_S
        message = (
            f"{path}: column {column.name}, sample {row + 1}: time does not run forwards: "
            f"{describe_step_back(since_first_s, row)}"
        )
        if column.time_hint:
            message += f"; {column.time_hint}"
        raise BadInput(message)
    if steps_s.size and np.median(steps_s) > request.longest_gap_s:
        raise BadInput(
            f"{path}: column {column.name}: samples come {np.median(steps_s):.3g} s apart, more "
            f"than windows.bin_s = {request.longest_gap_s:g} s; "
            "lengthen bin_s"
        )


def _reaches(t_s: Floats, base_s: Floats, longest_gap_s: float) -> NDArray[np.bool_]:
    """Which times of the base have a sample of the series, or two neighbouring samples that are
    close enough to interpolate.
    """
    after = np.searchsorted(t_s, base_s)
    inside = (after > 0) & (after < len(t_s))
    # Clipped indices keep the lookup valid; `inside` rejects them afterwards.
    if len(t_s) > 1:
        within = np.clip(after, 1, len(t_s) - 1)
    else:
        within = np.zeros(len(base_s), dtype=int)
    bridged = inside & (t_s[within] - t_s[within - 1] <= longest_gap_s)
    return np.asarray(bridged | np.isin(base_s, t_s))
