"""A column as an HDF5 dataset. Raw counts stay raw; value = raw * conversion + offset, in `units`."""

import re
import urllib.parse
from collections.abc import Mapping
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from rfca_rig.recording.form import Column

ROWS_PER_CHUNK = 16384

_LONG_NAMES = {
    "t_s": "time since the commanded start, from the device's sample counter",
    "host_s": "time of arrival at the host",
    "shaft_angle_rad": "shaft angle from the horizontal, positive downwards",
    "shaft_speed_rad_s": "shaft speed",
    "motor_torque_Nm": "motor torque at the shaft",
    "fx_N": "force along the shaft",
    "fy_N": "force along the ground",
    "fz_N": "vertical force, sensor axis down",
    "tx_Nm": "torque about the shaft's direction, at the sensor",
    "ty_Nm": "torque about the direction along the ground, at the sensor",
    "tz_Nm": "torque about the vertical, at the sensor",
}


def write_column(group: h5py.Group, name: str, column: Column) -> h5py.Dataset:
    """One 1-d dataset, compressed so that it opens everywhere without plugins."""
    data = np.ascontiguousarray(column.raw)
    if data.ndim != 1 or data.dtype.kind not in "iuf":
        raise ValueError(f"column {name} must be a row of numbers, not {data.ndim}-d {data.dtype}")
    dataset = group.create_dataset(link(name), data=data, track_times=False, **_storage(data))
    for key, value in _column_attributes(name, column).items():
        dataset.attrs[key] = value
    return dataset


def read_column(group: h5py.Group, name: str) -> Column:
    """One column, raw as it was stored."""
    dataset = group[link(name)]
    attributes = dataset.attrs
    return Column(dataset[:], str(attributes["units"]), float(attributes["conversion"]), float(attributes["offset"]))


def _column_attributes(name: str, column: Column) -> Mapping[str, Any]:
    return {"units": column.unit, "conversion": column.conversion, "offset": column.offset, "long_name": _LONG_NAMES.get(name, name)}


def _storage(data: NDArray[Any]) -> dict[str, Any]:
    """gzip at its fastest, with shuffle; HDF5 allows no chunks in an empty dataset."""
    if not data.size:
        return {}
    return {"chunks": (min(data.size, ROWS_PER_CHUNK),), "compression": "gzip", "compression_opts": 1, "shuffle": True}


def link(name: str) -> str:
    """The name as an HDF5 link, in which "/" and a lone "." would mean a path."""
    escaped = re.sub("[%/]", lambda found: urllib.parse.quote(found[0], safe=""), name)
    return escaped.replace(".", "%2E") if set(escaped) == {"."} else escaped
