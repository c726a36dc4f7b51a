"""Files of data loggers, read by the packages that their users know: TDMS of LabVIEW, MDF of
measurement tools in vehicles, Parquet and Feather of data analysis.

These packages are the extra `loggers`. Entry point: `find_logger`.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.campaign.file_kinds import read_beginning
from rfca_rig.campaign.stored_arrays import ArrayFormat, StoredArray
from rfca_rig.errors import BadInput

EXTRA = "pip install 'rfca-rig[loggers]'"
# Of the samples of a channel, beside them.
TIME = "time"
# Types of conversions of MDF 4 that give values a name: tables of values, and of ranges, to text
# (ASAM MDF 4.1, CCBLOCK).
VALUES_TO_TEXT = (7, 8)


@dataclass(frozen=True)
class Logger:
    """A format, its first bytes, and the module that reads it."""

    array_format: ArrayFormat
    beginnings: tuple[bytes, ...]
    module: str


def find_logger(path: Path) -> ArrayFormat | None:
    """The format of a file of a data logger; None for other files. Raises BadInput where the
    package is not installed.
    """
    if not path.is_file():
        return None
    beginning = read_beginning(path)
    for logger in LOGGERS:
        if beginning.startswith(logger.beginnings):
            if find_spec(logger.module) is None:
                words = logger.array_format.name
                raise BadInput(
                    f"{path}: is {words}, and {logger.module}, which reads it, is not installed: "
                    f"{EXTRA}, or export the file as CSV"
                )
            return logger.array_format
    return None


@contextmanager
def _open_tdms(path: Path) -> Iterator[Mapping[str, StoredArray]]:
    """Channels as `group/channel`. A waveform has its times as `group/channel.time`."""
    from nptdms import TdmsFile  # noqa: PLC0415  (optional)

    with TdmsFile.open(path) as file:
        arrays: dict[str, StoredArray] = {}
        for group in file.groups():
            for channel in group.channels():
                name = f"{group.name}/{channel.name}"
                unit = str(channel.properties.get("unit_string", ""))
                arrays[name] = _make_array(name, channel[:], unit)
                if "wf_increment" in channel.properties:
                    times = f"{name}.{TIME}"
                    arrays[times] = _make_array(times, channel.time_track(), "s")
        yield arrays


@contextmanager
def _open_mdf(path: Path) -> Iterator[Mapping[str, StoredArray]]:
    """Channels as `group/channel`, the groups counted from 0. The times of a group are
    `group/time`.
    """
    from asammdf import MDF  # noqa: PLC0415  (optional)

    with MDF(path) as file:
        arrays: dict[str, StoredArray] = {}
        # Of two types, for MDF 3 and 4.
        groups: Sequence[Any] = file.groups
        for number, group in enumerate(groups):
            names = _number_repeated([channel.name for channel in group.channels])
            master = file.masters_db.get(number)
            for index, channel_name in enumerate(names):
                if index == master:
                    continue
                # All samples: without the invalid ones, a channel would be shorter than its times.
                signal = file.get(group=number, index=index, ignore_invalidation_bits=True)
                name = f"{number}/{channel_name}"
                arrays[name] = _make_array(name, signal.samples, signal.unit)
                # The types of conversions of MDF 3 have other numbers.
                if file.version >= "4":
                    is_invalid = _find_invalid(group.channels[index], signal)
                    arrays[name] = replace(arrays[name], is_invalid=is_invalid)
                times = f"{number}/{TIME}"
                arrays[times] = _make_array(times, signal.timestamps, "s")
        yield arrays


def _find_invalid(channel: Any, signal: Any) -> NDArray[np.bool_] | None:
    """Which samples (m,) of a channel of MDF 4 are marked as invalid, or have a name in place of a
    number, as "SNA"; None where none may.
    """
    is_invalid: NDArray[np.bool_] | None = signal.invalidation_bits
    conversion = channel.conversion
    has_names = conversion is not None and conversion.conversion_type in VALUES_TO_TEXT
    # asammdf puts NaN for a name beside numbers.
    if has_names and signal.samples.dtype.kind == "f":
        is_named = np.isnan(signal.samples)
        is_invalid = is_named if is_invalid is None else is_invalid | is_named
    return is_invalid


def _number_repeated(names: Sequence[str]) -> list[str]:
    """The names, of which those that stand there several times have their number behind them."""
    seen: Counter[str] = Counter()
    numbered = []
    for name in names:
        seen[name] += 1
        if names.count(name) > 1:
            numbered.append(f"{name} ({seen[name]})")
        else:
            numbered.append(name)
    return numbered


@contextmanager
def _open_parquet(path: Path) -> Iterator[Mapping[str, StoredArray]]:
    from pyarrow import parquet  # noqa: PLC0415  (optional)

    yield _list_columns(parquet.read_table(path))


@contextmanager
def _open_feather(path: Path) -> Iterator[Mapping[str, StoredArray]]:
    from pyarrow import feather  # noqa: PLC0415  (optional)

    yield _list_columns(feather.read_table(path))


def _list_columns(table: Any) -> dict[str, StoredArray]:
    """Columns of an Arrow table. Lists of one length, as LeRobot's states and actions, are matrices
    (m, k); dates and times are seconds since 1970, durations seconds. Lists of different lengths
    are left out.
    """
    arrays = {}
    for name in table.column_names:
        column = table.column(name)
        try:
            data = _convert_column(column)
        # Lists of different lengths, or records.
        except (TypeError, ValueError):
            continue
        arrays[name] = _make_array(name, data, "")
    return arrays


def _convert_column(column: Any) -> NDArray[Any]:
    """A column as an array (m,), or (m, k) of lists. Raises ValueError where it makes none."""
    import pyarrow  # noqa: PLC0415  (optional)

    kind = pyarrow.types
    is_of_lists = (
        kind.is_list(column.type)
        or kind.is_large_list(column.type)
        or kind.is_fixed_size_list(column.type)
    )
    if is_of_lists:
        entries = column.combine_chunks().flatten()
        lengths = set(pyarrow.compute.list_value_length(column).unique().to_pylist())
        if len(lengths) != 1 or None in lengths or not len(column):
            raise ValueError("lists of different lengths")
        return np.asarray(entries.to_numpy(zero_copy_only=False)).reshape(len(column), -1)
    if kind.is_decimal(column.type) or kind.is_boolean(column.type):
        return np.array(column.to_pylist(), dtype=np.float64)
    return np.asarray(column.to_numpy())


def _make_array(name: str, data: NDArray[Any], unit: str) -> StoredArray:
    """An array with its unit, "" where the file states none. Dates and times become seconds since
    1970, durations seconds, and NaN where there is none.
    """
    if data.dtype.kind == "M":
        data = data - np.datetime64(0, "s")
    if data.dtype.kind == "m":
        data = data / np.timedelta64(1, "s")
        unit = "s"
    attributes = {}
    if unit:
        attributes["units"] = unit
    return StoredArray(name, data, attributes)


LOGGERS = (
    Logger(ArrayFormat("a LabVIEW file (TDMS)", _open_tdms), (b"TDSm",), "nptdms"),
    Logger(ArrayFormat("a measurement (MDF)", _open_mdf), (b"MDF     ", b"UnFinMF "), "asammdf"),
    Logger(ArrayFormat("a Parquet table", _open_parquet), (b"PAR1",), "pyarrow"),
    Logger(ArrayFormat("a Feather table", _open_feather), (b"ARROW1", b"FEA1"), "pyarrow"),
)
