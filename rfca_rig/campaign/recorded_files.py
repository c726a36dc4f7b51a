"""Which kind of file a recording is: CSV or HDF5. Each is read into named columns over one time base."""

from pathlib import Path

from rfca_rig.campaign.csv_columns import list_csv_columns, read_csv_columns
from rfca_rig.campaign.hdf5_columns import list_hdf5_columns, read_hdf5_columns
from rfca_rig.campaign.recorded_columns import ColumnList, ColumnRequest, RecordedColumns

CSV = ".csv"
HDF5 = (".h5", ".hdf5")


def read_columns(path: Path, request: ColumnRequest) -> RecordedColumns:
    """The columns that are asked for.

    Parameters
    ----------
    path
        The recording. A file of an unknown kind is read as CSV.
    request
        The columns of experiment.toml.

    Raises
    ------
    BadInput
        Where the recording cannot be read, or a column is missing or holds anything but numbers.
    """
    if path.suffix.lower() in HDF5:
        return read_hdf5_columns(path, request)
    return read_csv_columns(path, request)


def list_columns(path: Path) -> ColumnList:
    """All columns of a recording. Raises BadInput as `read_columns` does."""
    return list_hdf5_columns(path) if path.suffix.lower() in HDF5 else list_csv_columns(path)


def find_recordings(folder: Path) -> dict[str, list[Path]]:
    """All recordings below a folder by their kind, in their order by name."""
    files = sorted(file for file in folder.rglob("*") if file.is_file())
    found = {
        "CSV": [file for file in files if file.suffix.lower() == CSV],
        "HDF5": [file for file in files if file.suffix.lower() in HDF5],
    }
    return {kind: paths for kind, paths in found.items() if paths}
