"""Strokes and other stages as HDF5 groups, and their streams.

Each stream is a group of equally long 1-d datasets with its own `t_s`, to which the others are
bound as a dimension scale: that is how xarray, MATLAB and HDFView find the axis. NeXus attributes
let viewers find something to plot: a chain of defaults that ends at a signal and its axis.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence

import h5py
import numpy as np

from rfca_rig.recording.columns import (
    ROWS_PER_CHUNK,
    ColumnForm,
    Rows,
    StreamForm,
    check_column,
    column_form_of,
    copy_column,
    is_of_counts,
    link_name,
    make_column,
    read_column,
    read_form,
    read_names,
)
from rfca_rig.recording.model import RawStage, Source, Stream, Stroke

# The column that viewers plot first.
PLOTTED = "fz_N"

STROKES = "strokes"
TIME = "t_s"
# Attribute of strokes that were counted: how many the leg had made before.
BEFORE = "strokes_before"
# Far above any rig: only numbers that are no measure, such as infinity, are refused.
MOST_HEIGHT_MM = 1e6
MOST_SPEED_RAD_S = 1e6
MOST_TIME_S = 1e9
_TIME_FORM = ColumnForm(TIME, "<f8", "s")

RAW = "raw"


def mark_root(file: h5py.Group, default: str) -> None:
    """`default` names the entry that is shown first."""
    file.attrs["NX_class"] = "NXroot"
    file.attrs["default"] = default


def mark_entry(group: h5py.Group) -> None:
    """A group of numbered stages, of which the first is shown."""
    group.attrs["NX_class"] = "NXentry"
    group.attrs["default"] = "001"


def mark_stage(group: h5py.Group, streams: Sequence[str]) -> None:
    """A group of streams; the force is shown where there is one."""
    group.attrs["NX_class"] = "NXsubentry"
    if streams:
        group.attrs["default"] = link_name("force" if "force" in streams else streams[0])


def mark_stream(group: h5py.Group, columns: Sequence[str], time: str) -> None:
    """Columns over a time; the vertical force is shown where there is one."""
    group.attrs["NX_class"] = "NXdata"
    if columns:
        group.attrs["signal"] = link_name(PLOTTED if PLOTTED in columns else columns[0])
        group.attrs["axes"] = time


def write_strokes(parent: h5py.Group, strokes: Iterable[Stroke], source: Source) -> None:
    """strokes/001, strokes/002 ... in the order given."""
    group = make_strokes(parent)
    for number, stroke in enumerate(strokes, start=1):
        write_stroke(group.create_group(f"{number:03d}"), stroke, source)


def make_strokes(parent: h5py.Group) -> h5py.Group:
    """The group of all strokes, still without any."""
    group = parent.create_group(STROKES)
    mark_entry(group)
    return group


def read_strokes(parent: h5py.Group, source: Source) -> tuple[Stroke, ...]:
    """The strokes in their order."""
    group = parent[STROKES]
    return tuple(read_stroke(group[number], source) for number in sorted(group, key=int))


def write_stroke(group: h5py.Group, stroke: Stroke, source: Source) -> None:
    """Fills an empty group with the stroke."""
    mark_stroke(group, stroke.height_m, stroke.speed_rad_s, stroke.repeat)
    if stroke.strokes_before is not None:
        group.attrs[BEFORE] = stroke.strokes_before
    write_streams(group, stroke.streams, source)


def mark_stroke(group: h5py.Group, height_m: float, speed_rad_s: float, repeat: int) -> None:
    """The condition, as attributes."""
    group.attrs["height_mm"] = height_mm(height_m)
    group.attrs["speed_rad_s"] = speed_rad_s
    group.attrs["repeat"] = repeat


def write_streams(group: h5py.Group, streams: Mapping[str, Stream], source: Source) -> None:
    """A group per stream, and their order."""
    make_streams(
        group,
        [(_form_of(name, stream), len(stream.t_s)) for name, stream in streams.items()],
        source,
    )
    for name, stream in streams.items():
        for column, values in {
            TIME: stream.t_s,
            **{name: column.data for name, column in stream.columns.items()},
        }.items():
            write_rows(group[link_name(name)], column, 0, values)


def make_streams(
    group: h5py.Group, streams: Iterable[tuple[StreamForm, int]], source: Source
) -> None:
    """Streams of the given numbers of samples, still without values."""
    # An iterator would be used up by the names, before the streams are made.
    streams = list(streams)
    names = {}
    for form, _ in streams:
        names[form.name] = [column.name for column in form.columns]
    groups = _make_groups(group, names, source)
    for (form, length), stream in zip(streams, groups, strict=True):
        time = make_column(stream, _TIME_FORM, length)
        time.make_scale(TIME)
        for column in form.columns:
            make_column(stream, column, length).dims[0].attach_scale(time)


def _make_groups(
    stage: h5py.Group, columns: Mapping[str, Sequence[str]], source: Source
) -> list[h5py.Group]:
    """A group for each stream, with the names of its columns, still without any."""
    stage.attrs["order"] = json.dumps(list(columns))
    mark_stage(stage, list(columns))
    groups = []
    for name, of_stream in columns.items():
        stream = stage.create_group(link_name(name))
        stream.attrs["source"] = source
        stream.attrs["order"] = json.dumps(of_stream)
        mark_stream(stream, of_stream, TIME)
        groups.append(stream)
    return groups


def write_rows(group: h5py.Group, column: str, at: int, values: Rows) -> None:
    """Writes `values` (n,) of a column, or of TIME, from sample `at` on."""
    if len(values):
        group[link_name(column)][at : at + len(values)] = np.ascontiguousarray(values)


def read_stroke(group: h5py.Group, source: Source) -> Stroke:
    """The stroke in the group. Raises ValueError where one of its streams is not of the
    recording's source.
    """
    height_mm, speed_rad_s, repeat = read_condition(group)
    streams = read_streams(group, source)
    return Stroke(height_mm / 1e3, speed_rad_s, repeat, streams, read_strokes_before(group))


def read_strokes_before(stroke: h5py.Group) -> int | None:
    """How many strokes the leg had made before; None where they were not counted."""
    if BEFORE in stroke.attrs:
        return int(stroke.attrs[BEFORE])
    return None


def read_condition(stroke: h5py.Group) -> tuple[float, float, int]:
    """Height in mm, speed in rad/s, and repeat. Raises ValueError for a height or speed that no
    stroke has.
    """
    height = read_height_mm(stroke)
    speed_rad_s = float(stroke.attrs["speed_rad_s"])
    if not 0.0 < speed_rad_s < MOST_SPEED_RAD_S:
        raise ValueError(f"{stroke.name} has the speed {speed_rad_s:g} rad/s")
    return height, speed_rad_s, int(stroke.attrs["repeat"])


def read_height_mm(stage: h5py.Group) -> float:
    """In mm. Raises ValueError for a height that no rig has."""
    height = float(stage.attrs["height_mm"])
    if not 0.0 <= height < MOST_HEIGHT_MM:
        raise ValueError(f"{stage.name} has the height {height:g} mm")
    return height


def read_streams(group: h5py.Group, source: Source) -> dict[str, Stream]:
    """The streams in their order. Raises ValueError where one is not of the recording's source."""
    return {name: _read_stream(stream) for name, stream in streams_in(group, source)}


def copy_streams(
    source_group: h5py.Group, target_group: h5py.Group, source: Source
) -> Iterator[None]:
    """Copies all streams of a stage, a column per step; counts of the first format become values.
    Raises ValueError where a stream is not of the recording's source.
    """
    groups = dict(streams_in(source_group, source))
    columns = {name: read_names(group.attrs["order"]) for name, group in groups.items()}
    targets = _make_groups(target_group, columns, source)
    for target, (name, group) in zip(targets, groups.items(), strict=True):
        time = _copy_values(group, target, TIME)
        for column in columns[name]:
            h5py.h5ds.attach_scale(_copy_values(group, target, column), time, 0)
            yield


def _copy_values(source: h5py.Group, target: h5py.Group, name: str) -> h5py.h5d.DatasetID:
    """Copies a column, as it is packed unless it holds counts."""
    # Where it makes no sense it is refused here, where the stage's file is known.
    form = read_form(source, name)
    if not is_of_counts(source):
        return copy_column(source, target, name)
    dataset = source[link_name(name)]
    copied = make_column(target, form, len(dataset))
    for at in range(0, len(dataset), ROWS_PER_CHUNK):
        write_rows(target, name, at, form.values(dataset[at : at + ROWS_PER_CHUNK]))
    if name == TIME:
        copied.make_scale(TIME)
    return copied.id


def streams_in(stage: h5py.Group, source: Source) -> Iterator[tuple[str, h5py.Group]]:
    """The groups of a stage's streams by name. Raises ValueError where one is not of the
    recording's source.
    """
    for name in read_names(stage.attrs["order"]):
        group = stage[link_name(name)]
        if group.attrs["source"] != source:
            raise ValueError(
                f"{group.name} is marked {group.attrs['source']} in a recording marked {source}"
            )
        length = len(check_column(group, TIME))
        if any(
            len(check_column(group, name)) != length for name in read_names(group.attrs["order"])
        ):
            raise ValueError(f"the columns of {group.name} differ in length")
        yield name, group


def _form_of(name: str, stream: Stream) -> StreamForm:
    forms = tuple(column_form_of(name, column) for name, column in stream.columns.items())
    for column, known in stream.columns.items():
        if known.data.shape != stream.t_s.shape:
            raise ValueError(
                f"column {column} has shape {known.data.shape}, its time {stream.t_s.shape}"
            )
    return StreamForm(name, forms)


def _read_stream(group: h5py.Group) -> Stream:
    columns = {name: read_column(group, name) for name in read_names(group.attrs["order"])}
    t_s = read_column(group, TIME).data
    check_times(group, t_s)
    return Stream(t_s, columns)


def check_times(group: h5py.Group, t_s: Rows) -> None:
    """Raises ValueError where one of these times (n,) of a stream is no number, or of no run."""
    # Not above the limit also holds for NaN.
    wrong = ~(np.abs(t_s) <= MOST_TIME_S)
    if wrong.any():
        raise ValueError(f"{group.name}/{TIME} holds {t_s[wrong][0]}, which is no time of a run")


def height_mm(height_m: float) -> float:
    """In mm without binary rounding errors: 0.215 m becomes 215 mm, and reading 215 mm gives
    0.215 m again.
    """
    clean = round(1e3 * height_m, 9)
    # Rounded only where reading gives back the very same number: the height is a key that plans are
    # compared by.
    if clean / 1e3 == height_m:
        return clean
    return 1e3 * height_m


def write_raw_stages(parent: h5py.Group, stages: Sequence[RawStage], source: Source) -> None:
    """raw/001, raw/002 ... in the order given; no group where there are none."""
    if not stages:
        return
    parent = make_raw_stages(parent)
    for number, stage in enumerate(stages, start=1):
        group = parent.create_group(f"{number:03d}")
        mark_raw_stage(group, stage.label, stage.height_m, stage.cut_short)
        write_streams(group, stage.streams, source)


def make_raw_stages(parent: h5py.Group) -> h5py.Group:
    """The group of all of them, still without any."""
    group = parent.create_group(RAW)
    mark_entry(group)
    return group


def mark_raw_stage(group: h5py.Group, label: str, height_m: float, cut_short: str) -> None:
    """What the stage was, as attributes."""
    group.attrs["label"] = label
    group.attrs["height_mm"] = height_mm(height_m)
    group.attrs["cut_short"] = cut_short


def read_raw_stages(parent: h5py.Group, source: Source) -> tuple[RawStage, ...]:
    """The stages in their order; () where there are none."""
    if RAW not in parent:
        return ()
    group = parent[RAW]
    return tuple(_read(group[number], source) for number in sorted(group, key=int))


def _read(group: h5py.Group, source: Source) -> RawStage:
    attributes = group.attrs
    return RawStage(
        str(attributes["label"]),
        read_height_mm(group) / 1e3,
        read_streams(group, source),
        str(attributes["cut_short"]),
    )
