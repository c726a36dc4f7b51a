"""Files of data loggers, read by the packages that their users know: TDMS of LabVIEW, MDF of
measurement tools in vehicles, Parquet and Feather of data analysis.

These packages are the extra `loggers`. Entry point: `find_logger`.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from rfca_rig.campaign.file_kinds import read_beginning
from rfca_rig.campaign.stored_arrays import ArrayFormat, StoredArray
from rfca_rig.errors import BadInput

EXTRA = "pip install 'rfca-rig[loggers]'"
# Of the samples of a channel, beside them.
TIME = "time"


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
                arrays[name] = StoredArray(name, channel[:], _attributes_of(unit))
                if "wf_increment" in channel.properties:
                    times = f"{name}.{TIME}"
                    arrays[times] = StoredArray(times, channel.time_track(), _attributes_of("s"))
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
            names = [channel.name for channel in group.channels]
            master = file.masters_db.get(number)
            for index, channel_name in enumerate(names):
                if index == master:
                    continue
                signal = file.get(group=number, index=index)
                name = f"{number}/{channel_name}"
                arrays[name] = StoredArray(name, signal.samples, _attributes_of(signal.unit))
                times = f"{number}/{TIME}"
                arrays[times] = StoredArray(times, signal.timestamps, _attributes_of("s"))
        yield arrays


@contextmanager
def _open_parquet(path: Path) -> Iterator[Mapping[str, StoredArray]]:
    from pyarrow import parquet  # noqa: PLC0415  (optional)

    yield _list_columns(parquet.read_table(path))


@contextmanager
def _open_feather(path: Path) -> Iterator[Mapping[str, StoredArray]]:
    from pyarrow import feather  # noqa: PLC0415  (optional)

    yield _list_columns(feather.read_table(path))


def _list_columns(table: Any) -> dict[str, StoredArray]:
    """Columns of an Arrow table; lists of one length, as LeRobot's states and actions, are matrices
    (m, k).
    """
    arrays = {}
    for name in table.column_names:
        values = table.column(name).to_pylist()
        try:
            data = np.array(values, dtype=np.float64)
        # Text, dates, or lists of different lengths.
        except (TypeError, ValueError):
            continue
        arrays[name] = StoredArray(name, data)
    return arrays


def _attributes_of(unit: str) -> dict[str, Any]:
    if unit:
        return {"units": unit}
    return {}


LOGGERS = (
    Logger(ArrayFormat("a LabVIEW file (TDMS)", _open_tdms), (b"TDSm",), "nptdms"),
    Logger(ArrayFormat("a measurement (MDF)", _open_mdf), (b"MDF     ", b"UnFinMF "), "asammdf"),
    Logger(ArrayFormat("a Parquet table", _open_parquet), (b"PAR1",), "pyarrow"),
    Logger(ArrayFormat("a Feather table", _open_feather), (b"ARROW1", b"FEA1"), "pyarrow"),
)
