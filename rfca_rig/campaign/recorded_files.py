"""Reads any kind of recording, a table of text, HDF5, MATLAB's files, a CAN log, MCAP or ROS bag,
into named columns on one time base.
"""

from collections import Counter
from collections.abc import Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rfca_rig.campaign.dialect import is_value
from rfca_rig.campaign.file_kinds import (
    CAN_DATABASES,
    ROS_1_BAG,
    find_can_log,
    is_hdf5,
    is_matlab_5,
    read_beginning,
)
from rfca_rig.campaign.layout import TimeSection
from rfca_rig.campaign.lerobot import INFO, META, describe_data_set, find_info
from rfca_rig.campaign.logger_files import find_logger
from rfca_rig.campaign.recorded_columns import (
    LOG_TIME,
    ColumnList,
    ColumnRequest,
    ColumnTable,
    RecordedColumns,
    find_rising,
)
from rfca_rig.campaign.stored_arrays import (
    HDF5_FORMAT,
    MATLAB_FORMAT,
    ArrayFormat,
    list_array_columns,
    list_array_episodes,
    read_array_columns,
    read_arrays,
)
from rfca_rig.campaign.table import columns, find_counts, numeric_columns, read_table
from rfca_rig.errors import BadInput
from rfca_rig.executors.reading import read_within_limits

Floats = NDArray[np.float64]

# Between two samples of a stroke in a bag: the slowest rate at which a leg is recorded, 20 Hz.
LONGEST_GAP_S = 0.05
# Endings of tables of text. A .txt or .dat may be anything, and is read where a file names it.
TEXT = (".csv", ".csv.gz", ".tsv", ".lvm")
HDF5 = (".h5", ".hdf5")
MATLAB = (".mat",)
LOGGERS = (".tdms", ".mf4", ".mdf", ".parquet", ".feather")
# A .log, .asc or .trc may be anything, and is one where its first bytes say so.
CAN_LOGS = (".blf", ".asc", ".log", ".trc")
# That kind of recordings in words.
CAN_LOG = "CAN log"
BAG_SUFFIXES = (".mcap", ".db3", ".bag")

# In the folder of a ROS 2 bag, with the first key of that file.
_METADATA = "metadata.yaml"
_OF_A_BAG = "rosbag2_bagfile_information"


def read_columns(path: Path, request: ColumnRequest) -> RecordedColumns:
    """Read the requested columns.

    Parameters
    ----------
    path
        The recording: a file or, for a ROS 2 bag, a folder. A file of an unknown kind is read as
        CSV.
    request
        The columns of experiment.toml.

    Raises
    ------
    BadInput
        Where the recording cannot be read, a package for it is not installed, or a column is
        missing or holds anything but numbers.
    """
    array_format = _find_format(path)
    if array_format is not None:
        return read_within_limits(path, partial(read_array_columns, path, request, array_format))
    if request.episode is not None:
        raise BadInput(
            f"{path}: is one recording; remove episode = {request.episode} from [[recordings]]"
        )
    if _is_bag(path):
        _require_bag_packages(path)
        from rfca_rig.campaign.bag_columns import read_bag_columns  # noqa: PLC0415  (optional)

        return read_within_limits(path, partial(read_bag_columns, path, request))
    can_log = _find_can_log(path)
    if can_log:
        _require_can_packages(path, can_log)
        if not request.databases:
            raise BadInput(
                f"{path}: is a CAN log ({can_log}), whose frames a database decodes; state it in "
                'experiment.toml: databases = ["motor.dbc"] in [can]'
            )
        from rfca_rig.campaign.can_columns import read_can_columns  # noqa: PLC0415  (optional)

        return read_within_limits(path, partial(read_can_columns, path, can_log, request))
    table = read_table(path)
    for name, meaning in request.with_time.items():
        if name not in table.names:
            raise BadInput(
                f"{path}:{table.dialect.names + 1}: column {name}, which is to hold {meaning}, "
                f"is missing; the file has {', '.join(table.names)}"
            )
    values = dict(zip(request.with_time, columns(table, list(request.with_time)).T, strict=True))
    return RecordedColumns(
        path, request.time_of(values), values, table.first_line, table.units, table.notes
    )


def list_columns(path: Path, databases: Sequence[Path] = ()) -> ColumnList:
    """List all columns of a recording; the `databases` define the messages of a CAN log. Raises
    BadInput as `read_columns` does.
    """
    if _is_bag(path):
        _require_bag_packages(path)
        from rfca_rig.campaign.bag_columns import list_bag_columns  # noqa: PLC0415  (optional)

        return read_within_limits(path, partial(list_bag_columns, path))
    can_log = _find_can_log(path)
    if can_log:
        _require_can_packages(path, can_log)
        if not databases:
            raise BadInput(
                f"{path}: is a CAN log ({can_log}), whose frames a database decodes; put its file "
                f"({', '.join(CAN_DATABASES)}) into the folder of the recordings"
            )
        from rfca_rig.campaign.can_columns import list_can_columns  # noqa: PLC0415  (optional)

        return read_within_limits(path, partial(list_can_columns, path, can_log, databases))
    array_format = _find_format(path)
    if array_format is not None:
        listed = read_within_limits(path, partial(list_array_columns, path, array_format))
        return describe_data_set(path, listed)
    table = read_table(path)
    values = numeric_columns(table)
    units = [f"{name}: the file states the unit {unit}" for name, unit in table.units.items()]
    twice = sorted({name for name in table.names if table.names.count(name) > 1})
    repeated = [f"two columns are named {name}; rename one to use it" for name in twice]
    return ColumnList(
        values,
        find_rising(values),
        units=table.units,
        notes=(*table.notes, *units, *repeated),
    )


def open_columns(path: Path) -> ColumnTable:
    """All columns of a recording whose columns share one time. Raises BadInput as `read_columns`
    does.

    The columns of a bag are interpolated to the times of the first that is asked for beside the
    time.
    """
    if _is_bag(path):
        return _open_bag(path)
    array_format = _find_format(path)
    if array_format is not None:
        return _open_arrays(path, array_format)
    table = read_table(path)
    first = table.split(0)
    numbers = [name for name, cell in zip(table.names, first, strict=False) if is_value(cell)]

    def read(names: Sequence[str], gaps: Sequence[str]) -> Floats:
        return columns(table, names, gaps)

    return ColumnTable(
        path,
        table.names,
        read,
        tuple(numbers),
        tuple(find_counts(table)),
        table.units,
        table.header,
        table.first_line,
        table.notes,
    )


def _open_arrays(path: Path, array_format: ArrayFormat) -> ColumnTable:
    listed = list_columns(path)

    def read(names: Sequence[str], _gaps: Sequence[str]) -> Floats:
        holds = dict.fromkeys(names, "a quantity of the leg")
        recorded = read_within_limits(path, partial(read_arrays, path, holds, array_format))
        return np.column_stack([recorded.values[name] for name in names])

    # Arrays of another length are no samples of the stroke.
    lengths = Counter(len(values) for values in listed.values.values() if values is not None)
    usual = max(lengths, key=lambda length: lengths[length], default=0)
    extras = []
    for name, values in listed.values.items():
        if values is not None and len(values) == usual:
            extras.append(name)
    return ColumnTable(
        path,
        tuple(listed.values),
        read,
        tuple(extras),
        (),
        listed.units,
        str(path),
        notes=listed.notes,
    )


def _open_bag(path: Path) -> ColumnTable:
    listed = list_columns(path)

    def read(names: Sequence[str], _gaps: Sequence[str]) -> Floats:
        time, *others = names
        # Times are those of some column.
        holds = dict.fromkeys(others or list(listed.values)[:1], "a quantity of the leg")
        request = ColumnRequest(TimeSection(column=time, unit="s"), holds, LONGEST_GAP_S)
        recorded = read_columns(path, request)
        return np.column_stack([recorded.t_s, *(recorded.values[name] for name in others)])

    times = (LOG_TIME, *listed.times)
    return ColumnTable(
        path,
        (*times, *listed.values),
        read,
        (),
        (),
        dict.fromkeys(times, "s"),
        str(path),
        notes=listed.notes,
    )


def list_episodes(path: Path) -> tuple[int, ...]:
    """The numbers of the episodes in a file; none where it has no such column. Raises BadInput as
    `read_columns` does.
    """
    array_format = _find_format(path)
    if array_format is None:
        return ()
    return read_within_limits(path, partial(list_array_episodes, path, array_format))


def _find_format(path: Path) -> ArrayFormat | None:
    """The format of a file that holds arrays; None for a table of text."""
    if is_hdf5(path) or path.suffix.lower() in HDF5:
        return HDF5_FORMAT
    if is_matlab_5(path):
        return MATLAB_FORMAT
    return find_logger(path)


def refuse_arrays(path: Path, what: str) -> None:
    """Raise BadInput for a file that is no table of text; `what` says what such a table holds."""
    array_format = None
    if path.is_file():
        array_format = _find_format(path)
    if array_format is not None or _is_bag(path):
        name = array_format.name if array_format is not None else "a bag"
        raise BadInput(f"{path}: is {name}; {what}, are read from a table of text, as CSV")


def is_recording(path: Path) -> bool:
    """Whether a file is a recording by its name."""
    return path.name.lower().endswith((*TEXT, *HDF5, *MATLAB, *LOGGERS, *BAG_SUFFIXES))


def find_recordings(folder: Path) -> dict[str, list[Path]]:
    """All recordings below a folder by their kind, ordered by name. Files in the folder of a bag
    belong to that bag.
    """
    # The .db3 files of a bag must not count as recordings of their own.
    bags = [file.parent for file in folder.rglob(_METADATA) if _is_rosbag_folder(file.parent)]
    # Tables that describe a data set of LeRobot are no recordings either.
    descriptions = [file.parent for file in folder.rglob(INFO) if file.parent.name == META]
    files = []
    for file in sorted(folder.rglob("*")):
        is_of_other = any(other in file.parents for other in (*bags, *descriptions))
        if file.is_file() and not is_of_other:
            files.append(file)
    recordings = {
        "CSV": [file for file in files if file.name.lower().endswith(TEXT)],
        "HDF5": [file for file in files if file.suffix.lower() in HDF5],
        "MATLAB": [file for file in files if file.suffix.lower() in MATLAB],
        "logger": [file for file in files if file.suffix.lower() in LOGGERS],
        CAN_LOG: [file for file in files if _has_can_log(file)],
        "bag": sorted([*bags, *(file for file in files if file.suffix.lower() in BAG_SUFFIXES)]),
    }
    return {kind: paths for kind, paths in recordings.items() if paths}


def find_databases(folder: Path) -> list[Path]:
    """All databases of CAN messages below a folder, ordered by name."""
    return sorted(
        file
        for file in folder.rglob("*")
        if file.is_file() and file.suffix.lower() in CAN_DATABASES
    )


def list_files(recording: Path) -> list[Path]:
    """The files of one recording: the file itself, or all in the folder of a bag; with the
    description of a data set to which it belongs.
    """
    if recording.is_dir():
        return [recording, *sorted(recording.rglob("*"))]
    info = find_info(recording)
    if info is not None:
        return [recording, info]
    return [recording]


def _find_can_log(path: Path) -> str:
    """The kind of a CAN log; "" for other recordings."""
    if not path.is_file():
        return ""
    return find_can_log(read_beginning(path))


def _has_can_log(file: Path) -> bool:
    return file.suffix.lower() in CAN_LOGS and bool(_find_can_log(file))


def _require_can_packages(path: Path, can_log: str) -> None:
    if find_spec("cantools") is None:
        raise BadInput(
            f"{path}: is a CAN log ({can_log}), and cantools, which decodes its frames, is not "
            "installed: pip install 'rfca-rig[canlogs]'"
        )


def _is_bag(path: Path) -> bool:
    """Raises BadInput for a folder that is no bag, and for a device or a pipe."""
    if path.exists() and not (path.is_dir() or path.is_file()):
        raise BadInput(f"{path}: is a device or a pipe; give a file")
    if path.is_dir() and not _is_rosbag_folder(path):
        raise BadInput(
            f"{path}: is a folder without the {_METADATA} of a ROS 2 bag; `ros2 bag "
            "reindex` writes it"
        )
    if path.is_dir() or path.suffix.lower() in BAG_SUFFIXES:
        return True
    return path.is_file() and read_beginning(path).startswith(ROS_1_BAG)


def _is_rosbag_folder(path: Path) -> bool:
    file = path / _METADATA
    try:
        # Other tools write a metadata.yaml too; only the first key tells a bag.
        return file.is_file() and _OF_A_BAG in file.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False


def _require_bag_packages(path: Path) -> None:
    if any(find_spec(name) is None for name in ("mcap", "rosbags")):
        raise BadInput(
            f"{path}: bags are read by packages that are not installed: pip install "
            "'rfca-rig[bags]'"
        )
