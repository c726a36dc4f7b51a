"""Reads any kind of recording, CSV, HDF5, MCAP or ROS 2 bag, into named columns on one time base."""

from importlib.util import find_spec
from pathlib import Path

from rfca_rig.campaign.hdf5_columns import list_hdf5_columns, read_hdf5_columns
from rfca_rig.campaign.recorded_columns import ColumnList, ColumnRequest, RecordedColumns, find_rising
from rfca_rig.campaign.table import columns, numeric_columns, read_table
from rfca_rig.errors import BadInput

CSV = ".csv"
HDF5 = (".h5", ".hdf5")
BAG_SUFFIXES = (".mcap", ".db3")

# In the folder of a ROS 2 bag, with the first key of that file.
_METADATA = "metadata.yaml"
_OF_A_BAG = "rosbag2_bagfile_information"


def read_columns(path: Path, request: ColumnRequest) -> RecordedColumns:
    """Read the requested columns.

    Parameters
    ----------
    path
        The recording: a file or, for a ROS 2 bag, a folder. A file of an unknown kind is read as CSV.
    request
        The columns of experiment.toml.

    Raises
    ------
    BadInput
        Where the recording cannot be read, a package for it is not installed, or a column is missing or holds anything but numbers.
    """
    if _is_bag(path):
        _require_bag_packages(path)
        from rfca_rig.campaign.bag_columns import read_bag_columns  # noqa: PLC0415  (optional)

        return read_bag_columns(path, request)
    if path.suffix.lower() in HDF5:
        return read_hdf5_columns(path, request)
    return _read_csv_columns(path, request)


def list_columns(path: Path) -> ColumnList:
    """List all columns of a recording. Raises BadInput as `read_columns` does."""
    if _is_bag(path):
        _require_bag_packages(path)
        from rfca_rig.campaign.bag_columns import list_bag_columns  # noqa: PLC0415  (optional)

        return list_bag_columns(path)
    if path.suffix.lower() in HDF5:
        return list_hdf5_columns(path)
    values = numeric_columns(read_table(path))
    return ColumnList(values, find_rising(values))


def find_recordings(folder: Path) -> dict[str, list[Path]]:
    """All recordings below a folder by their kind, ordered by name. Files in the folder of a bag belong to that bag."""
    # The .db3 files of a bag must not count as recordings of their own.
    bags = [file.parent for file in folder.rglob(_METADATA) if _is_rosbag_folder(file.parent)]
    files = sorted(file for file in folder.rglob("*") if file.is_file() and not any(bag in file.parents for bag in bags))
    found = {
        "CSV": [file for file in files if file.suffix.lower() == CSV],
        "HDF5": [file for file in files if file.suffix.lower() in HDF5],
        "bag": sorted([*bags, *(file for file in files if file.suffix.lower() in BAG_SUFFIXES)]),
    }
    return {kind: paths for kind, paths in found.items() if paths}


def _read_csv_columns(path: Path, request: ColumnRequest) -> RecordedColumns:
    """The columns of a CSV file with names in its first line. Raises BadInput naming line and column of the first fault."""
    table = read_table(path)
    for name, meaning in request.with_time.items():
        if name not in table.names:
            raise BadInput(f"{table.path}:1: column {name}, which is to hold {meaning}, is missing; the file has {', '.join(table.names)}")
    values = dict(zip(request.with_time, columns(table, list(request.with_time)).T, strict=True))
    return RecordedColumns(path, request.time_of(values), values, first_line=2)


def _is_bag(path: Path) -> bool:
    """Raises BadInput for a folder that is no bag."""
    if path.is_dir() and not _is_rosbag_folder(path):
        raise BadInput(f"{path}: is a folder without the {_METADATA} of a ROS 2 bag; `ros2 bag reindex` writes it")
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
        raise BadInput(f"{path}: bags are read by packages that are not installed: pip install 'rfca-rig[bags]'")
