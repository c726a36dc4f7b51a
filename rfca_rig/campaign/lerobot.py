"""Data sets of LeRobot: a folder with meta/info.json, which names the entries of the lists in its
Parquet files. A file holds one episode, or several since version 3.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from rfca_rig.campaign.recorded_columns import ColumnList
from rfca_rig.errors import BadInput
from rfca_rig.toml import read_bytes

META = "meta"
INFO = "info.json"
# In s from the beginning of an episode, in every data set.
TIMESTAMP = "timestamp"
# data/chunk-000/file-000.parquet
_LEVELS = 3


def find_info(file: Path) -> Path | None:
    """The description of the data set to which a file belongs; None where it belongs to none."""
    for folder in file.parents[:_LEVELS]:
        info = folder / META / INFO
        if info.is_file():
            return info
    return None


def describe_data_set(file: Path, columns: ColumnList) -> ColumnList:
    """The columns of a file with what the description of its data set says of them: its time, and
    what each is called, as `gripper.pos` by `observation.state[5]`. Columns of other files stay.

    Raises
    ------
    BadInput
        Where the description is no JSON.
    """
    info = find_info(file)
    if info is None:
        return columns
    labels = _list_names(info)
    if TIMESTAMP not in columns.times:
        return replace(columns, labels=labels)
    return replace(columns, times=(TIMESTAMP,), time_unit="s", labels=labels)


def _list_names(info: Path) -> dict[str, str]:
    """What columns are called, by their name. Raises BadInput for a file that is no JSON."""
    try:
        content = json.loads(read_bytes(info))
    except ValueError as error:
        raise BadInput(f"{info}: is no JSON: {error}") from None
    names: dict[str, str] = {}
    features = content.get("features") if isinstance(content, Mapping) else None
    for column, feature in _entries(features).items():
        of_entries = list(_flatten(feature.get("names")))
        # A list of one entry is stored as a number.
        if len(of_entries) == 1:
            names[column] = of_entries[0]
        else:
            names |= {f"{column}[{index}]": name for index, name in enumerate(of_entries)}
    return names


def _entries(table: object) -> dict[str, Mapping[str, Any]]:
    """The entries of a JSON object that are objects."""
    if not isinstance(table, Mapping):
        return {}
    return {name: entry for name, entry in table.items() if isinstance(entry, Mapping)}


def _flatten(names: object) -> Iterator[str]:
    """Names in their order. Older data sets have them by what they name: {"motors": [...]}."""
    if isinstance(names, str):
        yield names
    elif isinstance(names, Mapping):
        for part in names.values():
            yield from _flatten(part)
    elif isinstance(names, list):
        for part in names:
            yield from _flatten(part)
