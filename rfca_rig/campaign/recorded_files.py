"""Reads any kind of recording, CSV, HDF5, MCAP or ROS 2 bag, into named columns on one time
base.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from rfca_rig.campaign.recorded_columns import (
    ColumnList,
    ColumnRequest,
    RecordedColumns,
    find_rising,
    finite_or_none,
)
from rfca_rig.campaign.table import FEWEST_SAMPLES, columns, numeric_columns, read_table
from rfca_rig.errors import BadInput
from rfca_rig.executors.reading import read_within_limits
from rfca_rig.recording.hdf5_file import open_plain
from rfca_rig.suggestions import suggestion

Floats = NDArray[np.float64]

# Columns of a 2-D dataset that a draft lists: a wider one is a picture or a map.
MOST_COLUMNS = 64

_OF_2D = re.compile(r"(.+)\[(\d+)\]")
# Kinds of dtype: signed, unsigned, floating point.
_NUMBERS = "iuf"

CSV = ".csv"
HDF5 = (".h5", ".hdf5")
BAG_SUFFIXES = (".mcap", ".db3")

# In the folder of a ROS 2 bag, with the first key of that file.
_METADATA = "metadata.yaml"
_OF_A_BAG = "rosbag2_bagfile_information"


def read_hdf5_columns(path: Path, request: ColumnRequest) -> RecordedColumns:
    """Read the requested columns.

    Raises
    ------
    BadInput
        Where the file cannot be read, a dataset is missing, holds no numbers or differs in length
        from the others, or a value is not finite.
    """
    with _open(path) as file:
        values = {
            name: _read_column(path, file, name, meaning)
            for name, meaning in request.with_time.items()
        }
    samples = len(values[request.time.column])
    for name, column in values.items():
        if len(column) != samples:
            raise BadInput(
                f"{path}: column {name} has {len(column)} samples and "
                f"{request.time.column} has {samples}; they must be as many"
            )
        faulty = np.flatnonzero(~np.isfinite(column))
        if faulty.size:
            row = int(faulty[0])
            raise BadInput(
                f"{path}: column {name}: sample {row + 1} is {column[row]:g}; every "
                "sample needs a finite number"
            )
    return RecordedColumns(path, request.time_of(values), values)


def list_hdf5_columns(path: Path) -> ColumnList:
    """List all columns of the file with enough samples for a recording. Raises BadInput where it
    cannot be read.
    """
    values: dict[str, Floats | None] = {}
    notes = []
    with _open(path) as file:
        for name, dataset in _datasets(file).items():
            if dataset.ndim in (1, 2) and len(dataset) >= FEWEST_SAMPLES:
                if dataset.ndim == 2 and dataset.shape[1] > MOST_COLUMNS:
                    notes.append(f"{name}: {dataset.shape[1]} columns, which are too many to list")
                else:
                    values |= _list_dataset(name, dataset)
    return ColumnList(values, find_rising(values), notes=tuple(notes))


@contextmanager
def _open(path: Path) -> Iterator[h5py.File]:
    """Opens the file. Anything that h5py cannot read in it, then or later, raises BadInput."""
    try:
        with open_plain(path) as file:
            yield file
    # h5py raises all of these for damaged files.
    except (OSError, RuntimeError, ValueError, KeyError, MemoryError) as error:
        raise BadInput(f"{path}: cannot be read as HDF5: {' '.join(str(error).split())}") from None


def _datasets(file: h5py.File) -> dict[str, h5py.Dataset]:
    datasets: dict[str, h5py.Dataset] = {}

    def visit(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset):
            datasets[name] = item

    file.visititems(visit)
    return datasets


def _read_column(path: Path, file: h5py.File, name: str, meaning: str) -> Floats:
    # A dataset may itself be named `x[2]`, so the whole name is tried first.
    of_2d = _OF_2D.fullmatch(name)
    dataset = _dataset(file, name)
    index = None
    if dataset is None and of_2d:
        dataset = _dataset(file, of_2d[1])
        index = int(of_2d[2])
    if dataset is None:
        known = sorted(_datasets(file))
        if known:
            hint = suggestion(of_2d[1] if of_2d else name, known)
        else:
            hint = "the file has no datasets"
        raise BadInput(f"{path}: column {name}, which is to hold {meaning}, is missing; {hint}")
    if fault := _fault_in_column(dataset, index):
        raise BadInput(f"{path}: column {name}, which is to hold {meaning}: {fault}")
    if index is None:
        return np.asarray(dataset[:], dtype=np.float64)
    return np.asarray(dataset[:, index], dtype=np.float64)


def _dataset(file: h5py.File, name: str) -> h5py.Dataset | None:
    item = file.get(name)
    if isinstance(item, h5py.Dataset):
        return item
    return None


def _fault_in_column(dataset: h5py.Dataset, index: int | None) -> str | None:
    name = dataset.name.lstrip("/")
    if dataset.dtype.kind not in _NUMBERS:
        return f"it holds {dataset.dtype}, no numbers"
    if dataset.ndim == 1:
        if index is None:
            return None
        return f"{name} has one dimension; leave [{index}] out"
    if dataset.ndim != 2:
        return f"{name} has {dataset.ndim} dimensions; a column comes from one or two"
    last = dataset.shape[1] - 1
    if index is None:
        return f"{name} has {last + 1} columns; write {name}[0] to {name}[{last}]"
    if index > last:
        return f"{name} has {last + 1} columns, so the last is {name}[{last}]"
    return None


def _list_dataset(name: str, dataset: h5py.Dataset) -> dict[str, Floats | None]:
    if dataset.ndim == 1:
        names = [name]
    else:
        names = [f"{name}[{index}]" for index in range(dataset.shape[1])]
    if dataset.dtype.kind not in _NUMBERS:
        return dict.fromkeys(names)
    columns = np.asarray(dataset[:], dtype=np.float64).reshape(len(dataset), len(names)).T
    return {name: finite_or_none(column) for name, column in zip(names, columns, strict=True)}


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
    if _is_bag(path):
        _require_bag_packages(path)
        from rfca_rig.campaign.bag_columns import read_bag_columns  # noqa: PLC0415  (optional)

        return read_within_limits(path, partial(read_bag_columns, path, request))
    if path.suffix.lower() in HDF5:
        return read_within_limits(path, partial(read_hdf5_columns, path, request))
    table = read_table(path)
    for name, meaning in request.with_time.items():
        if name not in table.names:
            raise BadInput(
                f"{table.path}:1: column {name}, which is to hold {meaning}, is missing; "
                f"the file has {', '.join(table.names)}"
            )
    values = dict(zip(request.with_time, columns(table, list(request.with_time)).T, strict=True))
    return RecordedColumns(path, request.time_of(values), values, first_line=2)


def list_columns(path: Path) -> ColumnList:
    """List all columns of a recording. Raises BadInput as `read_columns` does."""
    if _is_bag(path):
        _require_bag_packages(path)
        from rfca_rig.campaign.bag_columns import list_bag_columns  # noqa: PLC0415  (optional)

        return read_within_limits(path, partial(list_bag_columns, path))
    if path.suffix.lower() in HDF5:
        return read_within_limits(path, partial(list_hdf5_columns, path))
    values = numeric_columns(read_table(path))
    return ColumnList(values, find_rising(values))


def find_recordings(folder: Path) -> dict[str, list[Path]]:
    """All recordings below a folder by their kind, ordered by name. Files in the folder of a bag
    belong to that bag.
    """
    # The .db3 files of a bag must not count as recordings of their own.
    bags = [file.parent for file in folder.rglob(_METADATA) if _is_rosbag_folder(file.parent)]
    files = []
    for file in sorted(folder.rglob("*")):
        is_of_bag = any(bag in file.parents for bag in bags)
        if file.is_file() and not is_of_bag:
            files.append(file)
    recordings = {
        "CSV": [file for file in files if file.suffix.lower() == CSV],
        "HDF5": [file for file in files if file.suffix.lower() in HDF5],
        "bag": sorted([*bags, *(file for file in files if file.suffix.lower() in BAG_SUFFIXES)]),
    }
    return {kind: paths for kind, paths in recordings.items() if paths}


def list_files(recording: Path) -> list[Path]:
    """The files of one recording: the file itself, or all in the folder of a bag."""
    if recording.is_dir():
        return [recording, *sorted(recording.rglob("*"))]
    return [recording]


def _is_bag(path: Path) -> bool:
    """Raises BadInput for a folder that is no bag, and for a device or a pipe."""
    if path.exists() and not (path.is_dir() or path.is_file()):
        raise BadInput(f"{path}: is a device or a pipe; give a file")
    if path.is_dir() and not _is_rosbag_folder(path):
        raise BadInput(
            f"{path}: is a folder without the {_METADATA} of a ROS 2 bag; `ros2 bag "
            "reindex` writes it"
        )
    return path.is_dir() or path.suffix.lower() in BAG_SUFFIXES


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
