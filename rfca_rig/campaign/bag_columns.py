"""Columns of a bag, `topic:field`, on the time base of the first signal."""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rfca_rig.campaign.bags import (
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
    LOG_TIME,
    ColumnList,
    ColumnRequest,
    RecordedColumns,
    finite_or_none,
)
from rfca_rig.campaign.time_base import NS_PER_S, TimedColumn, join_columns
from rfca_rig.errors import BadInput
from rfca_rig.suggestions import suggestion

HEADER_STAMP = "header.stamp"


@dataclass(frozen=True)
class _Column:
    """Location of a column's numbers in a bag."""

    name: str
    topic: str
    field: MessageField


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
        timed = _read_messages(bag, columns, request)
    return join_columns(path, timed, request)


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


def _read_messages(bag: Bag, columns: list[_Column], request: ColumnRequest) -> list[TimedColumn]:
    """Every column with its own times."""
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
    if request.time.column == LOG_TIME:
        other = HEADER_STAMP
    else:
        other = LOG_TIME
    hint = f'are the times of [time] column = "{other}" better?'
    return [
        TimedColumn(
            column.name,
            f"topic {column.topic}",
            np.array(times_ns[column.name]),
            np.array(values[column.name]),
            hint,
        )
        for column in columns
    ]


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
