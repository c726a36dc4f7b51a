"""Columns of a bag, `topic:field`, on one time base: the times of the messages of the first signal.

Other columns are interpolated linearly to these times. Times outside the range of any column are
omitted. So are times in a gap of a column, where two of its samples are further apart than a bin.
The cutting of windows then finds the gap.
"""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rfca_rig.campaign.bags import (
    NS_PER_S,
    Bag,
    JointNotNamed,
    MessageField,
    has_stamp,
    list_numbers,
    open_bag,
    parse_field,
    read_number,
    read_time_ns,
)
from rfca_rig.campaign.layout import TIME_UNITS
from rfca_rig.campaign.recorded_columns import (
    ColumnList,
    ColumnRequest,
    RecordedColumns,
    finite_or_none,
)
from rfca_rig.campaign.table import FEWEST_SAMPLES, MANY_SAME, describe_step_back
from rfca_rig.errors import BadInput
from rfca_rig.suggestions import suggestion

Floats = NDArray[np.float64]

# Value of [time] column for the time at which the recorder received a message.
LOG_TIME = "log time"
HEADER_STAMP = "header.stamp"


@dataclass(frozen=True)
class _Column:
    """Location of a column's numbers in a bag."""

    name: str
    topic: str
    field: MessageField


@dataclass(frozen=True)
class _Series:
    """Times (k,) from the first sample of the time base, and values (k,); `repeated` says which
    stamps were left out.
    """

    t_s: Floats
    values: Floats
    repeated: str = ""


def read_bag_columns(path: Path, request: ColumnRequest) -> RecordedColumns:
    """Read the requested columns; times count from the first message of the time base.

    Raises
    ------
    BadInput
        Where the bag cannot be read, a topic or field is missing or holds no numbers, time does not
        run forwards, or the columns share too few samples.
    """
    with open_bag(path) as bag:
        columns = [_find_column(bag, name, meaning) for name, meaning in request.holds.items()]
        series = _read_series(bag, columns, request)
    base = series[columns[0].name]
    covered = np.ones(len(base.t_s), dtype=bool)
    for column in series.values():
        covered &= _reaches(column.t_s, base.t_s, request.longest_gap_s)
    if covered.sum() < FEWEST_SAMPLES:
        raise BadInput(
            f"{path}: {covered.sum()} samples of {columns[0].name} lie where all columns "
            "were recorded without a gap above "
            f"{request.longest_gap_s:g} s, which is windows.bin_s; needs {FEWEST_SAMPLES} or more"
        )
    t_s = base.t_s[covered]
    values = {name: np.interp(t_s, column.t_s, column.values) for name, column in series.items()}
    notes = dict.fromkeys(column.repeated for column in series.values() if column.repeated)
    return RecordedColumns(path, t_s, values, notes=tuple(notes))


def list_bag_columns(path: Path) -> ColumnList:
    """List all numbers in the messages of a bag.

    Raises
    ------
    BadInput
        Where the bag cannot be read.
    """
    stamp = parse_field(HEADER_STAMP)
    with open_bag(path) as bag:
        # A draft lists what can be read, and states for other topics why not.
        readable = sorted(topic for topic in bag.types if topic not in bag.unreadable)
        series: dict[str, dict[str, list[float]]] = {topic: defaultdict(list) for topic in readable}
        messages = dict.fromkeys(bag.types, 0)
        stamped = dict.fromkeys(bag.types, 0)
        if readable:
            for topic, _, message in bag.messages(readable):
                messages[topic] += 1
                stamped[topic] += has_stamp(message, stamp)
                for name, value in list_numbers(message):
                    series[topic][f"{topic}:{name}"].append(value)
        notes = [
            f"topic {topic}: {name}, {bag.unreadable.get(topic, f'{messages[topic]} messages')}"
            for topic, name in sorted(bag.types.items())
        ]
    columns = {}
    for of_topic in series.values():
        for name, numbers in of_topic.items():
            columns[name] = finite_or_none(np.array(numbers))
    with_numbers = [topic for topic in readable if series[topic]]
    time_columns: tuple[str, ...] = ()
    # Stamps serve as the time only if every message has one.
    if with_numbers and all(stamped[topic] == messages[topic] for topic in with_numbers):
        time_columns = (HEADER_STAMP,)
    return ColumnList(
        columns,
        time_columns,
        no_time=f"{LOG_TIME}; or {HEADER_STAMP}, where every topic that is used has one",
        time_unit="s",
        notes=tuple(notes),
    )


def _find_column(bag: Bag, name: str, meaning: str) -> _Column:
    """Locate a column. The name of a topic may contain a colon itself, so the longest matching
    topic is taken.
    """
    start = f"{bag.path}: column {name}, which is to hold {meaning}"
    topics = [topic for topic in bag.types if name.startswith(f"{topic}:")]
    if not topics:
        topic, colon, _ = name.partition(":")
        if not colon:
            raise BadInput(
                f"{start}, names no field; write it as topic:field, as in /joint_states:position[0]"
            )
        raise BadInput(
            f"{start}: there is no topic {topic}; {suggestion(topic, sorted(bag.types))}"
        )
    topic = max(topics, key=len)
    try:
        return _Column(name, topic, parse_field(name[len(topic) + 1 :]))
    except ValueError as error:
        raise BadInput(f"{start}: {error}") from None


def _parse_stamp(bag: Bag, time: str, unit_ns: int) -> MessageField | None:
    """The field with the time of a message; None for the time of the log, which is in s."""
    if time != LOG_TIME:
        try:
            return parse_field(time)
        except ValueError as error:
            raise BadInput(f"{bag.path}: [time] column: {error}") from None
    if unit_ns != NS_PER_S:
        raise BadInput(f'{bag.path}: [time] column: {LOG_TIME} is read in s; write unit = "s"')
    return None


def _read_series(bag: Bag, columns: list[_Column], request: ColumnRequest) -> dict[str, _Series]:
    """Every column by its name, with its own times."""
    unit_ns = round(TIME_UNITS[request.time.unit] * NS_PER_S)
    stamp = _parse_stamp(bag, request.time.column, unit_ns)
    of_topic: dict[str, list[_Column]] = defaultdict(list)
    for column in columns:
        of_topic[column.topic].append(column)
    # Integers of ns until the very end, so that no digit is lost.
    times_ns: dict[str, list[int]] = {column.name: [] for column in columns}
    values: dict[str, list[float]] = {column.name: [] for column in columns}
    messages = dict.fromkeys(of_topic, 0)
    for topic, log_ns, message in bag.messages(of_topic):
        messages[topic] += 1
        try:
            at_ns = log_ns
            if stamp is not None:
                at_ns = read_time_ns(message, stamp, unit_ns)
            for column in of_topic[topic]:
                _append(column, message, at_ns, times_ns, values)
        except ValueError as error:
            raise BadInput(
                f"{bag.path}: message {messages[topic]} of topic {topic}: {error}"
            ) from None
    for column in columns:
        if not messages[column.topic]:
            raise BadInput(f"{bag.path}: topic {column.topic} holds no messages")
        if not values[column.name]:
            raise BadInput(
                f"{bag.path}: column {column.name}: no message names it; "
                f"{_suggest_name(bag, column)}"
            )
    zero_ns = times_ns[columns[0].name][0]
    series = {}
    for column in columns:
        of_column = np.array(values[column.name])
        series[column.name] = _make_series(
            bag.path, column, np.array(times_ns[column.name]), of_column, zero_ns, request
        )
    return series


def _make_series(
    path: Path,
    column: _Column,
    times_ns: NDArray[np.int64],
    values: Floats,
    zero_ns: int,
    request: ColumnRequest,
) -> _Series:
    """A column's times (k,) and values (k,), without messages that repeat a stamp, as those of a
    node that republishes do. Raises BadInput as `_check_times`.
    """
    is_new = np.append(True, np.diff(times_ns) != 0)
    repeats = len(times_ns) - int(is_new.sum())
    note = ""
    if 0 < repeats < MANY_SAME * len(times_ns):
        note = f"topic {column.topic}: {repeats} messages repeat a stamp and are left out"
        times_ns = times_ns[is_new]
        values = values[is_new]
    _check_times(path, column.name, times_ns, request)
    # Subtracted as integers: a float of seconds since 1970 resolves only 0.2 us.
    return _Series((times_ns - zero_ns) / NS_PER_S, values, note)


def _append(
    column: _Column,
    message: object,
    at_ns: int,
    times_ns: Mapping[str, list[int]],
    values: Mapping[str, list[float]],
) -> None:
    """Appends a column's number from a message; a message that names other joints holds none."""
    try:
        value = read_number(message, column.field)
    except JointNotNamed:
        return
    times_ns[column.name].append(at_ns)
    values[column.name].append(value)


def _suggest_name(bag: Bag, column: _Column) -> str:
    """Suggestion from the names that the column's array has in all messages."""
    names: dict[str, None] = {}
    for _, _, message in bag.messages([column.topic]):
        try:
            read_number(message, column.field)
        except JointNotNamed as error:
            names |= dict.fromkeys(error.args)
    asked = next(key for _, keys in column.field.parts for key in keys if not key.isdecimal())
    if names:
        return suggestion(asked, names)
    return "the list of names is empty"


def _check_times(
    path: Path, name: str, times_ns: NDArray[np.int64], request: ColumnRequest
) -> None:
    """Raises BadInput where time does not run forwards, or the median step is longer than a bin."""
    steps_s = np.diff(times_ns) / NS_PER_S
    backwards = np.flatnonzero(steps_s <= 0.0)
    if backwards.size:
        row = int(backwards[0]) + 1
        if request.time.column == LOG_TIME:
            other = HEADER_STAMP
        else:
            other = LOG_TIME
        # From the first one, since a float of seconds since 1970 resolves only 0.2 us.
        since_first_s = (times_ns - times_ns[0]) / NS_PER_S
        raise BadInput(
            f"{path}: column {name}, sample {row + 1}: time does not run forwards: "
            f"{describe_step_back(since_first_s, row)}; "
            f'are the times of [time] column = "{other}" better?'
        )
    if steps_s.size and np.median(steps_s) > request.longest_gap_s:
        raise BadInput(
            f"{path}: column {name}: samples come {np.median(steps_s):.3g} s apart, more "
            f"than windows.bin_s = {request.longest_gap_s:g} s; "
            "lengthen bin_s"
        )


def _reaches(t_s: Floats, base_s: Floats, longest_gap_s: float) -> NDArray[np.bool_]:
    """Which times of the base have a sample of the series, or two neighbouring samples that are
    close enough to interpolate.
    """
    after = np.searchsorted(t_s, base_s)
    inside = (after > 0) & (after < len(t_s))
    # Clipped indices keep the lookup valid; `inside` rejects them afterwards.
    if len(t_s) > 1:
        within = np.clip(after, 1, len(t_s) - 1)
    else:
        within = np.zeros(len(base_s), dtype=int)
    bridged = inside & (t_s[within] - t_s[within - 1] <= longest_gap_s)
    return np.asarray(bridged | np.isin(base_s, t_s))
