"""A column as an HDF5 dataset. Raw counts stay raw; value = raw * conversion + offset, in `units`."""

import json
import math
import re
import urllib.parse
from collections.abc import Iterator
from typing import Any

import h5py
import numpy as np

from rfca_rig.recording.model import Column
from rfca_rig.recording.rows import ColumnForm

# Rows that are compressed, written and copied at a time.
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


def make_column(group: h5py.Group, form: ColumnForm, length: int) -> h5py.Dataset:
    """One 1-d dataset without values yet, compressed so that it opens everywhere without plugins."""
    dataset = group.create_dataset(link_name(form.name), shape=(length,), dtype=form.dtype, track_times=False, **_storage(length))
    long_name = _LONG_NAMES.get(form.name, form.name)
    for key, value in {"units": form.unit, "conversion": form.conversion, "offset": form.offset, "long_name": long_name}.items():
        dataset.attrs[key] = value
    return dataset


def column_form_of(name: str, column: Column) -> ColumnForm:
    """Layout of a column in memory. Raises ValueError where it is no 1-d array of numbers."""
    if column.raw.ndim != 1 or column.raw.dtype.kind not in "iuf":
        raise ValueError(f"column {name} must be a row of numbers, not {column.raw.ndim}-d {column.raw.dtype}")
    return ColumnForm(name, column.raw.dtype.str, column.unit, column.conversion, column.offset)


def write_column(group: h5py.Group, name: str, column: Column) -> h5py.Dataset:
    """One 1-d dataset with its values. Raises ValueError where the column is no 1-d array of numbers."""
    dataset = make_column(group, column_form_of(name, column), len(column.raw))
    if len(column.raw):
        dataset[:] = np.ascontiguousarray(column.raw)
    return dataset


def read_column_form(group: h5py.Group, name: str) -> ColumnForm:
    """Layout of a column on disk."""
    dataset = group[link_name(name)]
    return ColumnForm(name, dataset.dtype.str, *read_scale(dataset))


def read_scale(dataset: h5py.Dataset) -> tuple[str, float, float]:
    """Unit, conversion and offset of a column. Raises ValueError where one is no finite number."""
    unit, conversion, offset = (dataset.attrs[name] for name in ("units", "conversion", "offset"))
    scale = float(conversion), float(offset)
    if not all(map(math.isfinite, scale)):
        raise ValueError(f"{dataset.name} has the conversion {conversion} and the offset {offset}, which are to be finite numbers")
    return str(unit), *scale


def read_names(text: object) -> list[str]:
    """The names in an attribute, in their order. Raises ValueError where it is no list of different names."""
    names = json.loads(text) if isinstance(text, str) else None
    if not (isinstance(names, list) and all(isinstance(name, str) for name in names) and len(set(names)) == len(names)):
        raise ValueError(f"{str(text)[:60]!r} is no list of different names")
    return names


def check_column(group: h5py.Group, name: str) -> h5py.Dataset:
    """The dataset of a column. Raises ValueError where it is no row of numbers."""
    found = group.get(link_name(name))
    if not isinstance(found, h5py.Dataset) or found.ndim != 1 or found.dtype.kind not in "iuf":
        raise ValueError(f"{group.name}/{name} is no row of numbers")
    return found


def copy_column(source: h5py.Dataset, target: h5py.Dataset) -> Iterator[None]:
    """Copies all values, a chunk per step."""
    for at in range(0, len(source), ROWS_PER_CHUNK):
        if source.chunks == target.chunks and _packing(source) == _packing(target):
            # Compressed chunks are copied as they are where both datasets have the same filters: no unpacking, the
            # same bytes.
            mask, packed = source.id.read_direct_chunk((at,))
            target.id.write_direct_chunk((at,), packed, mask)
        else:
            target[at : at + ROWS_PER_CHUNK] = source[at : at + ROWS_PER_CHUNK]
        yield


def _packing(dataset: h5py.Dataset) -> tuple[object, ...]:
    return (dataset.dtype, dataset.compression, dataset.compression_opts, dataset.shuffle, dataset.fletcher32, dataset.scaleoffset)


def read_column(group: h5py.Group, name: str) -> Column:
    """One column, raw as it was stored."""
    dataset = check_column(group, name)
    return Column(dataset[:], *read_scale(dataset))


def _storage(length: int) -> dict[str, Any]:
    """gzip at its fastest, with shuffle; HDF5 allows no chunks in an empty dataset."""
    if not length:
        return {}
    return {"chunks": (min(length, ROWS_PER_CHUNK),), "compression": "gzip", "compression_opts": 1, "shuffle": True}


def link_name(name: str) -> str:
    """The name as an HDF5 link, in which "/" and a lone "." would be read as a path."""
    escaped = re.sub("[%/]", lambda found: urllib.parse.quote(found[0], safe=""), name)
    return escaped.replace(".", "%2E") if set(escaped) == {"."} else escaped
