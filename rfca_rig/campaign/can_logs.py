"""Logs of a CAN bus, read by python-can: BLF and ASC of Vector, .log of candump, TRC of PEAK; and
the databases that say what their frames hold, read by cantools: DBC, KCD, SYM, ARXML.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from textwrap import shorten
from typing import IO, Any

import can
import cantools.database
from can.io.trc import TRCFileVersion
from cantools.database import Database
from cantools.database.can import Message
from cantools.database.errors import Error as CantoolsError

from rfca_rig.campaign.file_kinds import (
    ASC,
    BLF,
    CAN_DATABASES,
    CANDUMP,
    TRC,
    TRC_VERSION,
    read_beginning,
)
from rfca_rig.errors import BadInput
from rfca_rig.toml import read_bytes

# Identifier, and whether it is one of 29 bits: 0x29 may be either.
FrameId = tuple[int, bool]

# ARXML files of whole vehicles have tens of MB.
MOST_DATABASE_BYTES = 100_000_000

# Characters of a library's message.
LONGEST_QUOTE = 200

_READERS: Mapping[str, Callable[..., Any]] = {
    BLF: can.BLFReader,
    ASC: can.ASCReader,
    CANDUMP: can.CanutilsLogReader,
    TRC: can.TRCReader,
}
# Vector's tools count buses from 1, python-can from 0.
_COUNTED_FROM_ONE = (BLF, ASC)


@dataclass(frozen=True)
class MessageDefinition:
    """A message of a database."""

    message: Message
    database: Path

    @property
    def frame_id(self) -> FrameId:
        """Identifier of its frames."""
        return self.message.frame_id, self.message.is_extended_frame


@dataclass
class MessageFrames:
    """The frames (k,) of one message, in the order of the log: stamps in s, bytes, and the names of
    the buses on which they came.
    """

    stamps_s: list[float] = field(default_factory=list)
    payloads: list[bytes] = field(default_factory=list)
    buses: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class CanLog:
    """The frames of a log by their identifier, without error frames and remote frames, which hold
    no data. `notes` say what could not be read.
    """

    frames: Mapping[FrameId, MessageFrames]
    notes: tuple[str, ...]


def load_databases(files: Sequence[Path]) -> dict[str, MessageDefinition]:
    """The messages of all databases by name.

    Raises
    ------
    BadInput
        Where a database cannot be read, or two of them define one name or one identifier.
    """
    definitions: dict[str, MessageDefinition] = {}
    by_id: dict[FrameId, MessageDefinition] = {}
    for file in files:
        for message in _load_database(file).messages:
            # AUTOSAR's containers hold other messages, and no signals of their own.
            if message.is_container:
                continue
            definition = MessageDefinition(message, file)
            other = definitions.get(message.name) or by_id.get(definition.frame_id)
            # Within one file it is for cantools to judge.
            if other is not None and other.database != file:
                raise BadInput(
                    f"{file}: message {message.name} ({format_id(definition.frame_id)}) is also "
                    f"message {other.message.name} ({format_id(other.frame_id)}) of "
                    f"{other.database.name}; name one of these files in can.databases"
                )
            definitions[message.name] = definition
            by_id[definition.frame_id] = definition
    return definitions


def _load_database(file: Path) -> Database:
    content = read_bytes(file, MOST_DATABASE_BYTES, "name a smaller database")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        # The code page of Windows, in which Vector's tools write a degree sign.
        text = content.decode("cp1252", errors="replace")
    suffix = file.suffix.lower()
    file_format = None
    if suffix in CAN_DATABASES:
        file_format = suffix.removeprefix(".")
    try:
        # Not strict: a database with signals that overlap is common, and decodes.
        database = cantools.database.load_string(text, file_format, strict=False)
    except CantoolsError as error:
        raise BadInput(
            f"{file}: is no database of a CAN bus (DBC, KCD, SYM or ARXML): {_quote(error)}"
        ) from None
    except MemoryError:
        raise
    # Text that no parser expects may raise anything.
    except Exception as error:
        raise BadInput(f"{file}: cannot be read as a CAN database: {_quote(error)}") from None
    if not isinstance(database, Database) or not database.messages:
        raise BadInput(f"{file}: defines no messages of a CAN bus")
    return database


def read_can_log(path: Path, kind: str, bus: str | None) -> CanLog:
    """Read all frames of a log.

    Parameters
    ----------
    path
        The log.
    kind
        Its kind by its first bytes: BLF, ASC, CANDUMP or TRC.
    bus
        The only bus whose frames count; None for all.

    Raises
    ------
    BadInput
        Where it cannot be read, or has no frames.
    """
    # Here a line counts half a million times: the names of buses come afterwards.
    by_channel: dict[Any, dict[FrameId, MessageFrames]] = defaultdict(
        lambda: defaultdict(MessageFrames)
    )
    notes: list[str] = []
    for message in _read_messages(path, kind, notes):
        if not (message.is_error_frame or message.is_remote_frame):
            frame_id = (message.arbitration_id, message.is_extended_id)
            frames = by_channel[message.channel][frame_id]
            frames.stamps_s.append(message.timestamp)
            frames.payloads.append(bytes(message.data))
    by_bus = {_name_bus(channel, kind): frames for channel, frames in by_channel.items()}
    if not by_bus:
        raise BadInput(f"{path}: holds no frames with data")
    if bus is not None:
        if bus not in by_bus:
            raise BadInput(
                f"{path}: holds no frames of the bus {bus}, which can.bus names; it has the "
                f"buses {', '.join(by_bus)}"
            )
        by_bus = {bus: by_bus[bus]}
    return CanLog(_join_buses(by_bus), tuple(notes))


def _join_buses(
    by_bus: Mapping[str, Mapping[FrameId, MessageFrames]],
) -> dict[FrameId, MessageFrames]:
    """The frames of each identifier on all buses, one bus after the other."""
    joined: dict[FrameId, MessageFrames] = defaultdict(MessageFrames)
    for name, by_id in by_bus.items():
        for frame_id, frames in by_id.items():
            joined[frame_id].stamps_s += frames.stamps_s
            joined[frame_id].payloads += frames.payloads
            joined[frame_id].buses.append(name)
    return dict(joined)


def _read_messages(path: Path, kind: str, notes: list[str]) -> Iterator[can.Message]:
    """The frames of a log as far as it can be read; appends to the notes where its end is missing.
    Raises BadInput where anything before its end cannot be read.
    """
    count = 0
    with _open(path, kind) as file:
        try:
            reader = _READERS[kind](file)
            for message in reader:
                if not count:
                    _refuse_misread(path, reader)
                count += 1
                yield message
        except (BadInput, MemoryError):
            raise
        # Damaged bytes make the readers raise anything.
        except Exception as error:
            if not count or file.read(1):
                raise BadInput(
                    f"{path}: cannot be read as a CAN log ({kind}) after {count} frames: "
                    f"{_quote(error)}"
                ) from None
            notes.append(f"the end of the log is cut off; it is read up to there, {count} frames")
            return
    if kind == BLF and path.stat().st_size < reader.file_size:
        notes.append(f"the end of the log is cut off; it is read up to there, {count} frames")


def _open(path: Path, kind: str) -> IO[Any]:
    if kind == BLF:
        return path.open("rb")
    # Vector's tools write the months of their user's language, in the code page of Windows.
    return path.open(encoding="latin-1")


def _refuse_misread(path: Path, reader: Any) -> None:
    """Raise BadInput for a log that python-can reads as something else. The reader has read the
    head.
    """
    if isinstance(reader, can.ASCReader) and reader.timestamps_format == "relative":
        raise BadInput(
            f"{path}: states the time of each line from the line before (timestamps relative); "
            "save it with absolute timestamps"
        )
    # It takes a version that it does not know for the first one, which states none.
    if isinstance(reader, can.TRCReader) and reader.file_version is TRCFileVersion.UNKNOWN:
        beginning = read_beginning(path).decode("latin-1")
        if TRC_VERSION in beginning:
            version = beginning.partition(TRC_VERSION)[2].split()[0]
            raise BadInput(
                f"{path}: is a TRC file of version {version}, which python-can does not read; save "
                "it as version 1.1 or 2.1"
            )


def _name_bus(channel: object, kind: str) -> str:
    """The bus of a frame, as the program that wrote the log calls it."""
    if kind in _COUNTED_FROM_ONE and isinstance(channel, int):
        return str(channel + 1)
    return str(channel)


def format_id(frame_id: FrameId) -> str:
    """An identifier as tools write it: three digits, or eight of one of 29 bits."""
    identifier, is_extended = frame_id
    if is_extended:
        return f"0x{identifier:08X}"
    return f"0x{identifier:03X}"


def _quote(error: Exception) -> str:
    """The message of a library's exception, in one line of limited length."""
    return shorten(str(error), LONGEST_QUOTE, placeholder=" ...") or type(error).__name__
