"""Strokes and their streams as HDF5 groups.

Each stream is a group of equally long 1-d datasets with its own `t_s`, to which the others are bound as a dimension scale: that is
how xarray, MATLAB and HDFView find the axis.
"""

import json
from collections.abc import Iterable, Mapping

import h5py

from rfca_rig.recording import nexus
from rfca_rig.recording.columns import link, read_column, write_column
from rfca_rig.recording.form import Column, Source, Stream, Stroke

TIME = "t_s"


def write_strokes(parent: h5py.Group, strokes: Iterable[Stroke], source: Source) -> None:
    """strokes/001, strokes/002 ... in the order given."""
    group = parent.create_group("strokes")
    nexus.mark_entry(group)
    for number, stroke in enumerate(strokes, start=1):
        write_stroke(group.create_group(f"{number:03d}"), stroke, source)


def read_strokes(parent: h5py.Group, source: Source) -> tuple[Stroke, ...]:
    """The strokes in their order."""
    group = parent["strokes"]
    return tuple(read_stroke(group[number], source) for number in sorted(group, key=int))


def write_stroke(group: h5py.Group, stroke: Stroke, source: Source) -> None:
    """Fills an empty group with the stroke."""
    group.attrs["height_mm"] = height_mm(stroke.height_m)
    group.attrs["speed_rad_s"] = stroke.speed_rad_s
    group.attrs["repeat"] = stroke.repeat
    write_streams(group, stroke.streams, source)


def write_streams(group: h5py.Group, streams: Mapping[str, Stream], source: Source) -> None:
    """A group per stream, and their order."""
    group.attrs["order"] = json.dumps(list(streams))
    nexus.mark_stage(group, list(streams))
    for name, stream in streams.items():
        _write_stream(group.create_group(link(name)), stream, source)


def read_stroke(group: h5py.Group, source: Source) -> Stroke:
    """The stroke in the group. Raises ValueError where one of its streams is not of the recording's source."""
    attributes = group.attrs
    height_m, speed_rad_s = float(attributes["height_mm"]) / 1e3, float(attributes["speed_rad_s"])
    return Stroke(height_m, speed_rad_s, int(attributes["repeat"]), read_streams(group, source))


def read_streams(group: h5py.Group, source: Source) -> dict[str, Stream]:
    """The streams in their order. Raises ValueError where one is not of the recording's source."""
    return {name: _read_stream(group[link(name)], source) for name in json.loads(group.attrs["order"])}


def _write_stream(group: h5py.Group, stream: Stream, source: Source) -> None:
    group.attrs["source"] = source
    group.attrs["order"] = json.dumps(list(stream.columns))
    nexus.mark_stream(group, list(stream.columns), TIME)
    time = write_column(group, TIME, Column(stream.t_s, "s"))
    time.make_scale(TIME)
    for name, column in stream.columns.items():
        if column.raw.shape != stream.t_s.shape:
            raise ValueError(f"column {name} has shape {column.raw.shape}, its time {stream.t_s.shape}")
        write_column(group, name, column).dims[0].attach_scale(time)


def _read_stream(group: h5py.Group, source: Source) -> Stream:
    if group.attrs["source"] != source:
        raise ValueError(f"{group.name} is marked {group.attrs['source']} in a recording marked {source}")
    columns = {name: read_column(group, name) for name in json.loads(group.attrs["order"])}
    t_s = read_column(group, TIME).raw
    if any(column.raw.shape != t_s.shape for column in columns.values()):
        raise ValueError(f"the columns of {group.name} differ in length")
    return Stream(t_s, columns)


def height_mm(height_m: float) -> float:
    """In mm without the dust of binary fractions: 0.215 m is 215 mm, and reading 215 mm gives 0.215 m again."""
    clean = round(1e3 * height_m, 9)
    return clean if clean / 1e3 == height_m else 1e3 * height_m
