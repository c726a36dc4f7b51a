"""Columns of a bag, `topic:field`, over one time base: the messages that the first signal comes from.

Other columns are interpolated linearly to these times. Times that not all columns reach are left out, and so are those in a gap of a
column, where two of its samples are further apart than a bin: the cutting of windows then finds the gap.
"""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rfca_rig.campaign.bags import Bag, open_bag
from rfca_rig.campaign.experiment_layout import TIME_UNITS
from rfca_rig.campaign.message_fields import (
    NS_PER_S,
    MessageField,
    NotNamed,
    has_stamp,
    list_numbers,
    parse_field,
    read_number,
    read_time_ns,
)
from rfca_rig.campaign.recorded_columns import ColumnList, ColumnRequest, RecordedColumns
from rfca_rig.campaign.table import FEWEST_SAMPLES
from rfca_rig.errors import BadInput
from rfca_rig.suggestions import suggestion

Floats = NDArray[np.float64]

LOG_TIME = "log time"  # what [time] column says for the time at which the recorder got a message
HEADER_STAMP = "header.stamp"


@dataclass(frozen=True)
class _Column:
    """Where the numbers of a column are in a bag."""

    name: str
    topic: str
    field: MessageField


@dataclass(frozen=True)
class _Series:
    """Times from the first sample of the time base, and values (k,)."""

    t_s: Floats
    values: Floats


def read_bag_columns(path: Path, request: ColumnRequest) -> RecordedColumns:
    """The columns that are asked for; times count from the first message of the time base.

    Raises
    ------
    BadInput
        Where the bag cannot be read, a topic or field is missing or holds no numbers, time does not run forwards, or columns have too few
        samples together.
    """
    with open_bag(path) as bag:
        columns = [_find_column(bag, name, meaning) for name, meaning in request.holds.items()]
        series = _read_series(bag, columns, request)
    base = series[columns[0].name]
    kept = np.ones(len(base.t_s), dtype=bool)
    for one in series.values():
        kept &= _reaches(one.t_s, base.t_s, request.longest_gap_s)
    if kept.sum() < FEWEST_SAMPLES:
        raise BadInput(
            f"{path}: {kept.sum()} samples of {columns[0].name} lie where all columns were recorded without a gap above "
            f"{request.longest_gap_s:g} s, which is windows.bin_s; needs {FEWEST_SAMPLES} or more"
        )
    t_s = base.t_s[kept]
    values = {name: np.interp(t_s, one.t_s, one.values) for name, one in series.items()}
    return RecordedColumns(path, t_s, values)


def list_bag_columns(path: Path) -> ColumnList:
    """All numbers in the messages of a bag.

    Raises
    ------
    BadInput
        Where the bag cannot be read.
    """
    stamp = parse_field(HEADER_STAMP)
    with open_bag(path) as bag:
        readable = sorted(topic for topic in bag.types if topic not in bag.unreadable)
        found: dict[str, dict[str, list[float]]] = {topic: defaultdict(list) for topic in readable}
        messages, stamped = dict.fromkeys(bag.types, 0), dict.fromkeys(bag.types, 0)
        for topic, _, message in bag.messages(readable) if readable else ():
            messages[topic] += 1
            stamped[topic] += has_stamp(message, stamp)
            for name, value in list_numbers(message):
                found[topic][f"{topic}:{name}"].append(value)
        notes = [
            f"topic {topic}: {name}, {bag.unreadable.get(topic, f'{messages[topic]} messages')}"
            for topic, name in sorted(bag.types.items())
        ]
    values = {name: np.array(numbers) for of_topic in found.values() for name, numbers in of_topic.items()}
    with_numbers = [topic for topic in readable if found[topic]]
    has_headers = bool(with_numbers) and all(stamped[topic] == messages[topic] for topic in with_numbers)
    return ColumnList(
        {name: column if np.isfinite(column).all() else None for name, column in values.items()},
        (HEADER_STAMP,) if has_headers else (),
        no_time=f"{LOG_TIME}; or {HEADER_STAMP}, where every topic that is used has one",
        time_unit="s",
        notes=tuple(notes),
    )


def _find_column(bag: Bag, name: str, meaning: str) -> _Column:
    """Where a column is. The name of a topic may hold a colon itself, so that the longest that fits is taken."""
    start = f"{bag.path}: column {name}, which is to hold {meaning}"
    topics = [topic for topic in bag.types if name.startswith(f"{topic}:")]
    if not topics:
        topic, colon, _ = name.partition(":")
        if not colon:
            raise BadInput(f"{start}, names no field; write it as topic:field, as in /joint_states:position[0]")
        raise BadInput(f"{start}: there is no topic {topic}; {suggestion(topic, sorted(bag.types))}")
    topic = max(topics, key=len)
    try:
        return _Column(name, topic, parse_field(name[len(topic) + 1 :]))
    except ValueError as error:
        raise BadInput(f"{start}: {error}") from None


def _read_series(bag: Bag, columns: list[_Column], request: ColumnRequest) -> dict[str, _Series]:
    """Every column by its name, over times of its own."""
    time, unit_ns = request.time.column, round(TIME_UNITS[request.time.unit] * NS_PER_S)
    try:
        stamp = None if time == LOG_TIME else parse_field(time)
        if stamp is None and unit_ns != NS_PER_S:
            raise ValueError(f'{LOG_TIME} is read in s; write unit = "s"')
    except ValueError as error:
        raise BadInput(f"{bag.path}: [time] column: {error}") from None
    of_topic: dict[str, list[_Column]] = defaultdict(list)
    for column in columns:
        of_topic[column.topic].append(column)
    times_ns: dict[str, list[int]] = {column.name: [] for column in columns}
    values: dict[str, list[float]] = {column.name: [] for column in columns}
    messages = dict.fromkeys(of_topic, 0)
    for topic, log_ns, message in bag.messages(of_topic):
        messages[topic] += 1
        try:
            at_ns = log_ns if stamp is None else read_time_ns(message, stamp, unit_ns)
            for column in of_topic[topic]:
                _append(column, message, at_ns, times_ns, values)
        except ValueError as error:
            raise BadInput(f"{bag.path}: message {messages[topic]} of topic {topic}: {error}") from None
    for column in columns:
        if not messages[column.topic]:
            raise BadInput(f"{bag.path}: topic {column.topic} holds no messages")
        if not values[column.name]:
            raise BadInput(f"{bag.path}: column {column.name}: no message names it; {_suggest_name(bag, column)}")
        _check_times(bag.path, column.name, np.array(times_ns[column.name]), request)
    zero_ns = times_ns[columns[0].name][0]
    return {name: _Series((np.array(times_ns[name]) - zero_ns) / NS_PER_S, np.array(values[name])) for name in values}


def _append(column: _Column, message: object, at_ns: int, times_ns: Mapping[str, list[int]], values: Mapping[str, list[float]]) -> None:
    """Takes a column's number from a message; one that names other joints holds none."""
    try:
        value = read_number(message, column.field)
    except NotNamed:
        return
    times_ns[column.name].append(at_ns)
    values[column.name].append(value)


def _suggest_name(bag: Bag, column: _Column) -> str:
    """Names that the column's array has, in all messages together."""
    names: dict[str, None] = {}
    for _, _, message in bag.messages([column.topic]):
        try:
            read_number(message, column.field)
        except NotNamed as error:
            names |= dict.fromkeys(error.args)
    asked = next(key for _, keys in column.field.parts for key in keys if not key.isdecimal())
    return suggestion(asked, names) if names else "the list of names is empty"


def _check_times(path: Path, name: str, times_ns: NDArray[np.int64], request: ColumnRequest) -> None:
    """Raises BadInput where time does not run forwards, or samples are further apart than a bin as a rule."""
    steps_s = np.diff(times_ns) / NS_PER_S
    backwards = np.flatnonzero(steps_s <= 0.0)
    if backwards.size:
        row = int(backwards[0]) + 1
        other = HEADER_STAMP if request.time.column == LOG_TIME else LOG_TIME
        raise BadInput(
            f"{path}: column {name}, sample {row + 1}: time does not run forwards: it comes {-steps_s[row - 1]:g} s before sample {row}; "
            f'are the times of [time] column = "{other}" better?'
        )
    if steps_s.size and np.median(steps_s) > request.longest_gap_s:
        raise BadInput(
            f"{path}: column {name}: samples come {np.median(steps_s):.3g} s apart, more than windows.bin_s = {request.longest_gap_s:g} s; "
            "lengthen bin_s"
        )


def _reaches(t_s: Floats, base_s: Floats, longest_gap_s: float) -> NDArray[np.bool_]:
    """At which times of the base a series has a sample, or one before and one after that are not too far apart."""
    after = np.searchsorted(t_s, base_s)
    inside = (after > 0) & (after < len(t_s))
    within = np.clip(after, 1, len(t_s) - 1) if len(t_s) > 1 else np.zeros(len(base_s), dtype=int)
    bridged = inside & (t_s[within] - t_s[within - 1] <= longest_gap_s)
    return np.asarray(bridged | np.isin(base_s, t_s))
