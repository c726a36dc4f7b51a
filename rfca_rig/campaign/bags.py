"""Opens bags: MCAP files, folders that `ros2 bag record` wrote, their .db3 files, and bags of
ROS 1. Messages are decoded, in the order of the log.

ROS messages are decoded by the definitions in the bag. Bags from before ROS 2 Iron have no
definitions; those of ROS 2 itself are used.

Fields of decoded messages by name: `wrench.force.z`, `data[2]`, and `position[shoulder]` where a
list `name` accompanies `position`.

A message has the form that its decoder gives it: a JSON object, or a dataclass of a ROS message.
"""

import errno
import json
import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, fields, is_dataclass
from functools import partial
from pathlib import Path
from textwrap import shorten
from typing import Any

import numpy as np
from mcap.reader import McapReader, make_reader
from mcap.records import Channel, Schema
from rosbags.interfaces import ConnectionExtRosbag2, MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from rfca_rig.campaign.file_kinds import MCAP, ROS_1_BAG, ZSTD, read_beginning
from rfca_rig.campaign.time_base import NS_PER_S
from rfca_rig.errors import BadInput
from rfca_rig.suggestions import suggestion

# Characters of a library's message: some quote a whole definition.
LONGEST_QUOTE = 200

Decoder = Callable[[bytes], Any]
LoggedMessage = tuple[str, int, Any]
"""Topic, time of the log in ns, and the decoded message."""

# Longer arrays are pictures or point clouds, and not listed.
MOST_ENTRIES = 64

_PART = r"[^.\[\]]+(?:\[[^\[\]]+\])*"
_FIELD = re.compile(rf"{_PART}(?:\.{_PART})*")
# Field of sensor_msgs/JointState with the names of its arrays' entries.
_NAMES = "name"
# In ROS 2, and in JSON as Foxglove writes it.
_NANOSECONDS = ("nanosec", "nsec")

# Encoding of the messages of ROS 1; those of ROS 2 are "cdr".
ROS_1 = "ros1"
_FORMATS = {
    "ros1msg": MessageDefinitionFormat.MSG,
    "ros2msg": MessageDefinitionFormat.MSG,
    "ros2idl": MessageDefinitionFormat.IDL,
}
# Precedes each file of a definition in IDL.
_IDL_RULE = "=" * 80 + "\n"
_NO_DEFINITION = MessageDefinition(MessageDefinitionFormat.NONE, "")


@dataclass(frozen=True)
class Bag:
    """An open bag.

    Parameters
    ----------
    path
        Its file or folder.
    types
        The message type of each topic.
    unreadable
        Why messages of a topic cannot be decoded, by topic.
    read_messages
        Makes an iterator over the messages of some topics.
    """

    path: Path
    types: Mapping[str, str]
    unreadable: Mapping[str, str]
    open_log: Callable[[Collection[str]], Iterator[LoggedMessage]]

    def messages(self, topics: Collection[str]) -> Iterator[LoggedMessage]:
        """Iterate over the messages of these topics. Raises BadInput where a topic cannot be
        decoded, or the file is damaged.
        """
        for topic in topics:
            if topic in self.unreadable:
                raise BadInput(f"{self.path}: topic {topic}: {self.unreadable[topic]}")
        read_messages = self.open_log(topics)
        # Errors of the reader are translated, those of the caller that consumes the messages are
        # not; a plain for loop would cover both.
        while True:
            with _refuse_damage(self.path):
                message = next(read_messages, None)
            if message is None:
                return
            yield message


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """Open the bag at `path`.

    Raises
    ------
    BadInput
        Where it cannot be read, or holds no topics.
    """
    open_reader: Callable[[Path], AbstractContextManager[Bag]] = _open_rosbag
    if path.suffix.lower() == ".mcap":
        open_reader = _open_mcap
    elif _is_ros_1(path):
        open_reader = partial(_open_rosbag, reader_type=Ros1Reader)
    with open_reader(path) as bag:
        if not bag.types:
            raise BadInput(f"{path}: holds no messages")
        yield bag


def _is_ros_1(path: Path) -> bool:
    return path.is_file() and read_beginning(path).startswith(ROS_1_BAG)


@contextmanager
def _refuse_damage(path: Path) -> Iterator[None]:
    """Turns any exception of a bag reader into BadInput, because damaged bytes may cause any
    exception.
    """
    try:
        yield
    except (BadInput, MemoryError):
        raise
    except Exception as error:
        # A compressed bag that is too large when it is unpacked.
        if isinstance(error, OSError) and error.errno == errno.EFBIG:
            raise MemoryError from None
        # A whole MCAP file has checksums, so that such a message was recorded so. The pages of a
        # damaged database may be those of another table.
        is_whole = isinstance(error, _UndecodableMessage) and path.suffix.lower() == ".mcap"
        is_unsupported = "not supported" in str(error)
        advice = "" if is_whole or is_unsupported else _advise_repair(path)
        raise BadInput(f"{path}: cannot be read as a bag: {_shorten(error)}{advice}") from None


class _UndecodableMessage(Exception):
    """A message that does not fit its definition."""


def _advise_repair(path: Path) -> str:
    """The repair of a bag that was cut off, where it was; "" elsewhere."""
    if _is_ros_1(path):
        return "; was the recording cut off? `rosbag reindex` saves what it can"
    if path.suffix.lower() != ".mcap":
        return "; was the recording cut off? `ros2 bag reindex` saves what it can"
    try:
        with path.open("rb") as file:
            # Its end alone: a recording may have gigabytes.
            file.seek(max(path.stat().st_size - len(MCAP), 0))
            end = file.read()
    except OSError:
        return ""
    if end == MCAP:
        return "; the file has its end, and bytes within it are wrong: copy it again"
    return "; the end of the file is missing: `mcap recover` saves what it can"


def _shorten(error: Exception) -> str:
    """The message of a library's exception, in one line of limited length."""
    return shorten(str(error), LONGEST_QUOTE, placeholder=" ...") or type(error).__name__


@dataclass
class _Topics:
    """The types of the topics of a bag, and a decoder for each of its channels."""

    types: dict[str, str] = field(default_factory=dict)
    unreadable: dict[str, str] = field(default_factory=dict)
    decoders: dict[int, Decoder] = field(default_factory=dict)

    def add(
        self, channel: int, topic: str, type_name: str, encoding: str, definition: MessageDefinition
    ) -> None:
        # A topic that cannot be decoded is noted and refused only when it is used; others remain
        # readable.
        self.types[topic] = type_name
        try:
            self.decoders[channel] = _make_decoder(type_name, encoding, definition)
        except ValueError as error:
            self.unreadable[topic] = str(error)


@contextmanager
def _open_mcap(path: Path) -> Iterator[Bag]:
    with _refuse_damage(path):
        file = path.open("rb")
    with file:
        topics = _Topics()
        with _refuse_damage(path):
            # Damage must be noticed here; changed bytes would otherwise become wrong numbers.
            reader = make_reader(file, validate_crcs=True)
            for schema, channel in _mcap_channels(reader):
                topics.add(
                    channel.id,
                    channel.topic,
                    _name_type(schema),
                    channel.message_encoding,
                    _definition(schema),
                )

        def read_messages(wanted: Collection[str]) -> Iterator[LoggedMessage]:
            for _, channel, message in reader.iter_messages(wanted):
                _refuse_compressed(path, message.data)
                yield channel.topic, message.log_time, topics.decoders[channel.id](message.data)

        yield Bag(path, topics.types, topics.unreadable, read_messages)


def _refuse_compressed(path: Path, message: bytes) -> None:
    """Raise BadInput for a message that a recorder compressed; others begin with a byte order."""
    if message.startswith(ZSTD):
        raise BadInput(
            f"{path}: its messages are compressed by zstd; give the folder of the bag, whose "
            "metadata.yaml says so"
        )


def _name_type(schema: Schema | None) -> str:
    """The type of a channel's messages, as ROS 2 writes it."""
    if schema is None:
        return "no schema"
    package, slash, name = schema.name.partition("/")
    if schema.encoding == "ros1msg" and slash and "/" not in name:
        return f"{package}/msg/{name}"
    return schema.name


def _definition(schema: Schema | None) -> MessageDefinition:
    if schema is None or schema.encoding not in _FORMATS or not schema.data.strip():
        # A recorder that did not find the definition leaves it empty.
        return _NO_DEFINITION
    return MessageDefinition(_FORMATS[schema.encoding], schema.data.decode())


def _mcap_channels(reader: McapReader) -> list[tuple[Schema | None, Channel]]:
    """Channels from the summary at the file's end, or else from all messages."""
    # A recording that was cut off has no summary.
    summary = reader.get_summary()
    if summary is not None and summary.channels:
        return [
            (summary.schemas.get(channel.schema_id), channel)
            for channel in summary.channels.values()
        ]
    return list(
        {channel.id: (schema, channel) for schema, channel, _ in reader.iter_messages()}.values()
    )


@contextmanager
def _open_rosbag(path: Path, reader_type: type[Reader | Ros1Reader] = Reader) -> Iterator[Bag]:
    with _refuse_damage(path):
        reader = reader_type(path)
        reader.open()
    try:
        topics = _Topics()
        for connection in reader.connections:
            if isinstance(connection.ext, ConnectionExtRosbag2):
                serialization = connection.ext.serialization_format
            else:
                serialization = ROS_1
            topics.add(
                connection.id,
                connection.topic,
                connection.msgtype,
                serialization,
                connection.msgdef,
            )

        def read_messages(wanted: Collection[str]) -> Iterator[LoggedMessage]:
            connections = [
                connection for connection in reader.connections if connection.topic in wanted
            ]
            for connection, ns, data in reader.messages(connections):
                if isinstance(connection.ext, ConnectionExtRosbag2):
                    _refuse_compressed(path, data)
                yield connection.topic, ns, topics.decoders[connection.id](data)

        yield Bag(path, topics.types, topics.unreadable, read_messages)
    finally:
        reader.close()


def _make_decoder(type_name: str, encoding: str, definition: MessageDefinition) -> Decoder:
    """Decoder of a message type. Raises ValueError with the reason where there is none."""
    if encoding == "json":
        return json.loads
    if encoding not in ("cdr", ROS_1):
        raise ValueError(
            f"its messages are encoded as {encoding or 'nothing known'}; json, cdr and ros1 can be "
            "read"
        )
    try:
        # Definitions in the bag describe its messages exactly; types of another ROS release may
        # differ in their fields.
        store = get_typestore(
            Stores.LATEST if definition.format == MessageDefinitionFormat.NONE else Stores.EMPTY
        )
        if definition.format == MessageDefinitionFormat.MSG:
            store.register(get_types_from_msg(definition.data, type_name))
        elif definition.format == MessageDefinitionFormat.IDL:
            # A definition holds one file, or several with a rule and a line with the file's name
            # before each.
            if definition.data.startswith(_IDL_RULE):
                files = [part.partition("\n")[2] for part in definition.data.split(_IDL_RULE)[1:]]
            else:
                files = [definition.data]
            store.register(
                {name: type_ for file in files for name, type_ in get_types_from_idl(file).items()}
            )
    # A definition that the parser does not know may raise any exception.
    except Exception as error:
        raise ValueError(
            f"the definition of {type_name} cannot be read: {_shorten(error)}"
        ) from None
    if type_name not in store.fielddefs:
        raise ValueError(
            f"the bag does not define {type_name}; record it with mcap storage, which "
            "keeps definitions"
        )

    deserialize = store.deserialize_ros1 if encoding == ROS_1 else store.deserialize_cdr

    def decode(data: bytes) -> Any:
        try:
            return deserialize(data, type_name)
        # The bytes of another type may raise anything.
        except Exception as error:
            raise _UndecodableMessage(
                f"a message does not fit the definition of {type_name}: {_shorten(error)}"
            ) from None

    return decode


class JointNotNamed(LookupError):
    """A message names other joints than the requested one. Its argument is their names."""


@dataclass(frozen=True)
class MessageField:
    """Location of a field in a message: names from the outside inwards, each with the keys in
    brackets after it.
    """

    text: str
    parts: tuple[tuple[str, tuple[str, ...]], ...]


def parse_field(text: str) -> MessageField:
    """Parse the name of a field. Raises ValueError where the text is no such name."""
    if not _FIELD.fullmatch(text):
        raise ValueError(
            f"{text!r} is no field; write it as position[0], position[shoulder] or wrench.force.z"
        )
    parts = []
    for part in re.findall(_PART, text):
        name, *keys = re.split(r"[\[\]]+", part.rstrip("]"))
        parts.append((name, tuple(keys)))
    return MessageField(text, tuple(parts))


def read_number(message: Any, field: MessageField) -> float:
    """The finite number in a field.

    Raises
    ------
    ValueError
        Where the message has no such field, or it is no finite number; the text says which.
    NotNamed
        Where the message has no joint of that name.
    """
    value = _value(message, field)
    if not _is_number(value):
        raise ValueError(f"{field.text} {_describe(value, field.text)}")
    if not math.isfinite(value):
        raise ValueError(f"{field.text} is {value:g}; every message needs a finite number")
    return float(value)


def read_time_ns(message: Any, field: MessageField, unit_ns: int) -> int:
    """The time in a field in ns: a stamp of seconds and nanoseconds, or a number in a unit of
    `unit_ns`.

    Raises ValueError as `read_number` does, and for a stamp whose unit is not stated as s.
    """
    value = _value(message, field)
    stamp = _stamp_ns(value)
    if stamp is not None:
        if unit_ns != NS_PER_S:
            raise ValueError(f'{field.text} is read in s; write unit = "s" in [time]')
        return stamp
    # Integers are multiplied exactly: as a float, ns since 1970 would lose the last digits.
    if isinstance(value, int | np.integer) and not isinstance(value, bool):
        return int(value) * unit_ns
    return round(read_number(message, field) * unit_ns)


def list_numbers(message: Any, before: str = "") -> Iterator[tuple[str, float]]:
    """Name and value of each number in a message, without stamps and without the content of long
    arrays.
    """
    for name in _field_names(message):
        value = _child(message, name)
        yield from _numbers_in(f"{before}{name}", value, _names_beside(message, value))


def has_stamp(message: Any, field: MessageField) -> bool:
    """Whether that field is a stamp."""
    try:
        return _stamp_ns(_value(message, field)) is not None
    except ValueError:
        return False


def _value(message: Any, field: MessageField) -> Any:
    # `holder` is one level behind `at`: the names of an array's entries are its neighbours.
    at = message
    place = "the message"
    for name, keys in field.parts:
        if not _has(at, name):
            known = _field_names(at)
            hint = "it has no fields at all"
            if known:
                hint = suggestion(name, known)
            raise ValueError(f"{place} has no field {name}; {hint}")
        holder = at
        at = _child(at, name)
        place = name
        for key in keys:
            at = _entry(holder, at, place, key)
            place = f"{place}[{key}]"
    return at


def _entry(holder: Any, array: Any, place: str, key: str) -> Any:
    if not _is_array(array):
        raise ValueError(f"{place} is no array; leave [{key}] out")
    if key.isdecimal():
        index = int(key)
    else:
        names = _names_beside(holder, array)
        if names is None:
            raise ValueError(
                f"{place} has {len(array)} entries without names; write {place}[0] for the first"
            )
        if key not in names:
            raise JointNotNamed(*names)
        index = names.index(key)
    if index >= len(array):
        raise ValueError(
            f"{place}[{key}] is out of range: {place} has {len(array)} entries, the first "
            f"is {place}[0]"
        )
    return array[index]


def _names_beside(holder: Any, array: Any) -> list[str] | None:
    """The names of an array's entries, where the enclosing message has them. An array may be
    empty if it was not measured.
    """
    names = None
    if _has(holder, _NAMES):
        names = _child(holder, _NAMES)
    # An array next to `name` belongs to it only if both have the same length.
    if (
        array is names
        or not _is_array(array)
        or not isinstance(names, list)
        or len(array) not in (0, len(names))
    ):
        return None
    if all(isinstance(name, str) for name in names):
        return names
    return None


def _numbers_in(name: str, value: Any, names: Sequence[str] | None) -> Iterator[tuple[str, float]]:
    if _is_number(value):
        yield name, float(value)
    elif _is_array(value):
        if len(value) <= MOST_ENTRIES:
            for index, entry in enumerate(value):
                yield from _numbers_in(f"{name}[{names[index] if names else index}]", entry, None)
    elif _stamp_ns(value) is None:
        yield from list_numbers(value, f"{name}.")


def _stamp_ns(value: Any) -> int | None:
    if not _has(value, "sec"):
        return None
    for nanoseconds in _NANOSECONDS:
        if _has(value, nanoseconds):
            return int(_child(value, "sec")) * NS_PER_S + int(_child(value, nanoseconds))
    return None


def _field_names(value: Any) -> list[str]:
    """The fields of a message, none for anything else. A ROS message also has its type as a field,
    in double underscores, which is skipped.
    """
    if isinstance(value, dict):
        return list(value)
    if is_dataclass(value):
        return [field.name for field in fields(value) if not field.name.startswith("__")]
    return []


def _has(value: Any, name: str) -> bool:
    if isinstance(value, dict):
        return name in value
    return name in getattr(value, "__dataclass_fields__", ())


def _child(holder: Any, name: str) -> Any:
    if isinstance(holder, dict):
        return holder[name]
    return getattr(holder, name)


# A bool is an int in Python, but no measured number.
def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | np.number) and not isinstance(value, bool)


def _is_array(value: Any) -> bool:
    return isinstance(value, list | np.ndarray)


def _describe(value: Any, name: str) -> str:
    """Description of a value that should be a number."""
    if _is_array(value):
        return f"is an array of {len(value)}; write {name}[0] for its first entry"
    if known := _field_names(value):
        return f"has the fields {', '.join(known)}; name one of them"
    if isinstance(value, str):
        return "is text, no number"
    return f"is {value}, no number"
