"""Columns of a CSV file for an experiment: the names are those in its first line."""

from pathlib import Path

from rfca_rig.campaign.experiment_layout import TIME_UNITS
from rfca_rig.campaign.recorded_columns import ColumnList, ColumnRequest, RecordedColumns, find_rising
from rfca_rig.campaign.table import columns, numeric_columns, read_table
from rfca_rig.errors import BadInput


def read_csv_columns(path: Path, request: ColumnRequest) -> RecordedColumns:
    """The columns that are asked for. Raises BadInput naming line and column of the first fault."""
    table = read_table(path)
    holds = {request.time.column: "the time", **request.holds}
    for name, meaning in holds.items():
        if name not in table.names:
            raise BadInput(f"{table.path}:1: column {name}, which is to hold {meaning}, is missing; the file has {', '.join(table.names)}")
    values = dict(zip(holds, columns(table, list(holds)).T, strict=True))
    return RecordedColumns(path, TIME_UNITS[request.time.unit] * values[request.time.column], values, first_line=2)


def list_csv_columns(path: Path) -> ColumnList:
    """All columns of the file. Raises BadInput as `read_table` and `rows` do."""
    values = numeric_columns(read_table(path))
    return ColumnList(values, find_rising(values))
