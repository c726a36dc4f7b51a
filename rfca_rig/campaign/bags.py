"""Opens bags: MCAP files, folders that `ros2 bag record` wrote, and their .db3 files. Messages are decoded, in the order of the log.

ROS messages (CDR) are decoded by the definitions in the bag. Bags from before ROS 2 Iron have no definitions; those of ROS 2 itself are
used.
"""

import json
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from textwrap import shorten
from typing import Any

from mcap.reader import McapReader, make_reader
from mcap.records import Channel, Schema
from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinition, MessageDefinitionFormat
from rosbags.interfaces.typing import Typesdict
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from rfca_rig.errors import BadInput

# Characters of a library's message: some quote a whole definition.
LONGEST_QUOTE = 200

Decoder = Callable[[bytes], Any]
LoggedMessage = tuple[str, int, Any]
"""Topic, time of the log in ns, and the decoded message."""

_FORMATS = {"ros2msg": MessageDefinitionFormat.MSG, "ros2idl": MessageDefinitionFormat.IDL}
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
    logged
        Makes an iterator over the messages of some topics.
    """

    path: Path
    types: Mapping[str, str]
    unreadable: Mapping[str, str]
    open_log: Callable[[Collection[str]], Iterator[LoggedMessage]]

    def messages(self, topics: Collection[str]) -> Iterator[LoggedMessage]:
        """Iterate over the messages of these topics. Raises BadInput where a topic cannot be decoded, or the file is damaged."""
        for topic in topics:
            if topic in self.unreadable:
                raise BadInput(f"{self.path}: topic {topic}: {self.unreadable[topic]}")
        logged = self.open_log(topics)
        # Errors of the reader are translated, those of the caller that consumes the messages are not; a plain for loop would cover both.
        while True:
            with _refuse_damage(self.path):
                found = next(logged, None)
            if found is None:
                return
            yield found


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """Open the bag at `path`.

    Raises
    ------
    BadInput
        Where it cannot be read, or holds no topics.
    """
    with _open_mcap(path) if path.suffix.lower() == ".mcap" else _open_rosbag(path) as bag:
        if not bag.types:
            raise BadInput(f"{path}: holds no messages")
        yield bag


@contextmanager
def _refuse_damage(path: Path) -> Iterator[None]:
    """Turns any exception of a bag reader into BadInput, because damaged bytes may cause any exception."""
    try:
        yield
    except BadInput:
        raise
    except Exception as error:
        cut_off = f"was the recording cut off? {_repair(path)} saves what it can"
        raise BadInput(f"{path}: cannot be read as a bag: {_shorten(error)}; {cut_off}") from None


def _shorten(error: Exception) -> str:
    """The message of a library's exception, in one line of limited length."""
    return shorten(str(error), LONGEST_QUOTE, placeholder=" ...") or type(error).__name__


def _repair(path: Path) -> str:
    return "`mcap recover`" if path.suffix.lower() == ".mcap" else "`ros2 bag reindex`"


@dataclass
class _Topics:
    """The types of the topics of a bag, and a decoder for each of its channels."""

    types: dict[str, str] = field(default_factory=dict)
    unreadable: dict[str, str] = field(default_factory=dict)
    decoders: dict[int, Decoder] = field(default_factory=dict)

    def add(self, channel: int, topic: str, type_name: str, encoding: str, definition: MessageDefinition) -> None:
        # A topic that cannot be decoded is noted and refused only when it is used; others remain readable.
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
                topics.add(channel.id, channel.topic, schema.name if schema else "no schema", channel.message_encoding, _definition(schema))

        def logged(wanted: Collection[str]) -> Iterator[LoggedMessage]:
            for _, channel, message in reader.iter_messages(wanted):
                yield channel.topic, message.log_time, topics.decoders[channel.id](message.data)

        yield Bag(path, topics.types, topics.unreadable, logged)


def _definition(schema: Schema | None) -> MessageDefinition:
    if schema is None or schema.encoding not in _FORMATS:
        return _NO_DEFINITION
    return MessageDefinition(_FORMATS[schema.encoding], schema.data.decode())


def _mcap_channels(reader: McapReader) -> list[tuple[Schema | None, Channel]]:
    """Channels from the summary at the file's end, or else from all messages."""
    # A recording that was cut off has no summary.
    summary = reader.get_summary()
    if summary is not None and summary.channels:
        return [(summary.schemas.get(channel.schema_id), channel) for channel in summary.channels.values()]
    return list({channel.id: (schema, channel) for schema, channel, _ in reader.iter_messages()}.values())


@contextmanager
def _open_rosbag(path: Path) -> Iterator[Bag]:
    with _refuse_damage(path):
        reader = Reader(path)
        reader.open()
    try:
        topics = _Topics()
        for connection in reader.connections:
            topics.add(connection.id, connection.topic, connection.msgtype, _serialization(connection), connection.msgdef)

        def logged(wanted: Collection[str]) -> Iterator[LoggedMessage]:
            connections = [connection for connection in reader.connections if connection.topic in wanted]
            for connection, ns, data in reader.messages(connections):
                yield connection.topic, ns, topics.decoders[connection.id](data)

        yield Bag(path, topics.types, topics.unreadable, logged)
    finally:
        reader.close()


def _serialization(connection: Connection) -> str:
    return connection.ext.serialization_format if isinstance(connection.ext, ConnectionExtRosbag2) else ""


def _types_of_idl(text: str) -> Typesdict:
    """The types of a definition, which holds one file, or several with a rule and a line with the file's name before each."""
    files = [part.partition("\n")[2] for part in text.split(_IDL_RULE)[1:]] if text.startswith(_IDL_RULE) else [text]
    return {name: type_ for file in files for name, type_ in get_types_from_idl(file).items()}


def _make_decoder(type_name: str, encoding: str, definition: MessageDefinition) -> Decoder:
    """Decoder of a message type. Raises ValueError with the reason where there is none."""
    if encoding == "json":
        return json.loads
    if encoding != "cdr":
        raise ValueError(f"its messages are encoded as {encoding or 'nothing known'}; json and cdr can be read")
    try:
        # Definitions in the bag describe its messages exactly; types of another ROS release may differ in their fields.
        store = get_typestore(Stores.LATEST if definition.format == MessageDefinitionFormat.NONE else Stores.EMPTY)
        if definition.format == MessageDefinitionFormat.MSG:
            store.register(get_types_from_msg(definition.data, type_name))
        elif definition.format == MessageDefinitionFormat.IDL:
            store.register(_types_of_idl(definition.data))
    # A definition that the parser does not know may raise any exception.
    except Exception as error:
        raise ValueError(f"the definition of {type_name} cannot be read: {_shorten(error)}") from None
    if type_name not in store.fielddefs:
        raise ValueError(f"the bag does not define {type_name}; record it with mcap storage, which keeps definitions")
    return lambda data: store.deserialize_cdr(data, type_name)
