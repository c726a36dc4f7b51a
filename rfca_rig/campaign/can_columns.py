"""Columns of a CAN log, `Message.Signal`, on the time base of the first signal.

A database says which bytes of which frames hold a signal, and its unit. Frames come with the times
at which they were on the bus. The signals of one message share its times.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from cantools.database import DecodeError
from cantools.database.can import Signal
from cantools.database.namedsignalvalue import NamedSignalValue
from numpy.typing import NDArray

from rfca_rig.campaign.can_logs import (
    CanLog,
    FrameId,
    MessageDefinition,
    MessageFrames,
    format_id,
    load_databases,
    read_can_log,
)
from rfca_rig.campaign.recorded_columns import (
    LOG_TIME,
    ColumnList,
    ColumnRequest,
    RecordedColumns,
    finite_or_none,
)
from rfca_rig.campaign.time_base import TimedColumn, join_columns
from rfca_rig.errors import BadInput
from rfca_rig.suggestions import suggestion

Floats = NDArray[np.float64]

NS_PER_US = 1000
# Identifiers that a note lists; a car has hundreds.
MOST_IDS = 8


@dataclass(frozen=True)
class _CanColumn:
    """A requested column, and the message and signal that hold it."""

    name: str
    meaning: str
    definition: MessageDefinition
    signal: Signal


@dataclass(frozen=True)
class _Samples:
    """Values (k,) of a signal, and which frames (k,) of its message hold them.

    `short` frames of the message have fewer bytes than the database states. `named` are the values
    to which it gives a name, as "SNA" for a signal that is not available, with their number: states
    and no numbers. `undefined` are reasons why frames cannot be decoded, with their number.
    """

    frames: NDArray[np.int64]
    values: Floats
    short: int
    named: Mapping[str, int]
    undefined: Mapping[str, int]


def read_can_columns(path: Path, kind: str, request: ColumnRequest) -> RecordedColumns:
    """Read the requested columns of a CAN log; times count from the first frame of the time base.

    Parameters
    ----------
    path
        The log.
    kind
        Its kind by its first bytes.
    request
        The columns of experiment.toml, and its databases.

    Raises
    ------
    BadInput
        Where the log or a database cannot be read, a message or signal is not defined, no frame
        holds it, time does not run forwards, or the columns share too few samples.
    """
    if request.time.column != LOG_TIME or request.time.unit != "s":
        raise BadInput(
            f"{path}: [time]: the frames of a CAN log have the time of the log; write column = "
            f'"{LOG_TIME}" and unit = "s"'
        )
    definitions = load_databases(request.databases)
    columns = [
        _find_column(path, definitions, request.databases, name, meaning)
        for name, meaning in request.holds.items()
    ]
    log = read_can_log(path, kind, request.bus)
    notes = [*log.notes, *_describe_unknown(log, definitions, request.databases)]
    decoded: dict[str, dict[str, _Samples]] = {}
    timed = []
    for column in columns:
        frames = _find_frames(path, log, column)
        name = column.definition.message.name
        if name not in decoded:
            signals = [other.signal for other in columns if other.definition is column.definition]
            decoded[name] = _decode(frames, column.definition, signals)
        samples = decoded[name][column.signal.name]
        _check_samples(path, column, frames, samples)
        notes += _describe_samples(name, column.signal, samples)
        times_ns = _round_stamps(frames)[samples.frames]
        timed.append(TimedColumn(column.name, f"message {name}", times_ns, samples.values))
    units = {column.name: column.signal.unit for column in columns if column.signal.unit}
    return join_columns(path, timed, request, units, tuple(dict.fromkeys(notes)))


def list_can_columns(path: Path, kind: str, databases: Sequence[Path]) -> ColumnList:
    """List all signals of the frames in a CAN log. Raises BadInput where the log or a database
    cannot be read.
    """
    definitions = load_databases(databases)
    log = read_can_log(path, kind, None)
    values: dict[str, Floats | None] = {}
    notes = [*log.notes, *_describe_unknown(log, definitions, databases)]
    for name, definition in sorted(definitions.items()):
        frames = log.frames.get(definition.frame_id)
        if frames is None:
            continue
        words = f"message {name}: {len(frames.stamps_s)} frames"
        if len(frames.buses) > 1:
            words += f" on the buses {', '.join(frames.buses)}, of which can.bus names one"
        notes.append(words)
        decoded = _decode(frames, definition, definition.message.signals)
        for signal in definition.message.signals:
            samples = decoded[signal.name]
            column = f"{name}.{signal.name}"
            values[column] = None
            if samples.values.size:
                values[column] = finite_or_none(samples.values)
            notes += _describe_samples(name, signal, samples)
            if signal.unit:
                notes.append(f"{column}: the database states the unit {signal.unit}")
    return ColumnList(values, (LOG_TIME,), time_unit="s", notes=tuple(notes))


def _find_column(
    path: Path,
    definitions: Mapping[str, MessageDefinition],
    databases: Sequence[Path],
    name: str,
    meaning: str,
) -> _CanColumn:
    """The message and signal of a column. Raises BadInput where no database defines them."""
    start = f"{path}: column {name}, which is to hold {meaning}"
    message_name, dot, signal_name = name.rpartition(".")
    if not dot:
        raise BadInput(f"{start}, names no signal; write it as Message.Signal")
    definition = definitions.get(message_name)
    if definition is None:
        files = ", ".join(file.name for file in databases)
        raise BadInput(
            f"{start}: {files} defines no message {message_name}; "
            f"{suggestion(message_name, sorted(definitions))}"
        )
    signals = {signal.name: signal for signal in definition.message.signals}
    if signal_name not in signals:
        raise BadInput(
            f"{start}: message {message_name} has no signal {signal_name}; "
            f"{suggestion(signal_name, signals)}"
        )
    return _CanColumn(name, meaning, definition, signals[signal_name])


def _find_frames(path: Path, log: CanLog, column: _CanColumn) -> MessageFrames:
    """The frames of a column's message. Raises BadInput where there are none, or those of several
    buses, which are those of different devices.
    """
    name = column.definition.message.name
    identifier = format_id(column.definition.frame_id)
    frames = log.frames.get(column.definition.frame_id)
    start = f"{path}: column {column.name}, which is to hold {column.meaning}"
    if frames is None:
        raise BadInput(
            f"{start}: the log has no frame of message {name} ({identifier}); its frames have the "
            f"identifiers {_list_ids(log.frames)}"
        )
    if len(frames.buses) > 1:
        raise BadInput(
            f"{start}: message {name} ({identifier}) comes on the buses "
            f"{', '.join(frames.buses)}; state one as bus in [can]"
        )
    return frames


def _decode(
    frames: MessageFrames, definition: MessageDefinition, signals: Sequence[Signal]
) -> dict[str, _Samples]:
    """The samples of signals of one message, by the name of the signal."""
    message = definition.message
    decoded: list[Mapping[str, Any]] = []
    short = 0
    undefined: Counter[str] = Counter()
    for payload in frames.payloads:
        short += len(payload) < message.length
        try:
            decoded.append(message.decode_simple(payload, allow_truncated=True))
        except DecodeError as error:
            undefined[str(error)] += 1
            decoded.append({})
    samples = {}
    for signal in signals:
        indices: list[int] = []
        values: list[float] = []
        named: Counter[str] = Counter()
        for index, of_frame in enumerate(decoded):
            # None where the frame is too short, or its multiplexer selects other signals.
            value = of_frame.get(signal.name)
            if isinstance(value, NamedSignalValue):
                named[str(value)] += 1
            elif value is not None:
                indices.append(index)
                values.append(float(value))
        rows = np.array(indices, dtype=np.int64)
        samples[signal.name] = _Samples(rows, np.array(values), short, named, undefined)
    return samples


def _check_samples(
    path: Path, column: _CanColumn, frames: MessageFrames, samples: _Samples
) -> None:
    """Raises BadInput where a signal has no values, or one that is no finite number."""
    start = f"{path}: column {column.name}, which is to hold {column.meaning}"
    faulty = np.flatnonzero(~np.isfinite(samples.values))
    if faulty.size:
        frame = int(samples.frames[faulty[0]])
        raise BadInput(
            f"{start}: frame {frame + 1} of message {column.definition.message.name} holds "
            f"{samples.values[faulty[0]]:g}; every frame needs a finite number"
        )
    if samples.values.size:
        return
    count = len(frames.payloads)
    if samples.named:
        reason = (
            f"all its values have names ({', '.join(samples.named)}): it is a state, and no number"
        )
    elif samples.undefined:
        reason = f"none of {count} frames holds it: {next(iter(samples.undefined))}"
    elif samples.short == count:
        longest = max(len(payload) for payload in frames.payloads)
        reason = (
            f"none of {count} frames holds it: they have up to {longest} bytes, and the database "
            f"states {column.definition.message.length}; is it the database of this device?"
        )
    else:
        reason = (
            f"none of {count} frames holds it: they select others of the signals that share their "
            "bytes"
        )
    raise BadInput(f"{start}: {reason}")


def _describe_samples(message: str, signal: Signal, samples: _Samples) -> Iterable[str]:
    """Which frames of a message are left out, a sentence each."""
    if samples.short:
        yield (
            f"message {message}: {samples.short} frames are shorter than the database states; "
            "signals that they do not hold are left out"
        )
    for reason, count in samples.undefined.items():
        yield f"message {message}: {count} frames cannot be decoded and are left out: {reason}"
    for name, count in samples.named.items():
        yield f"{message}.{signal.name}: {count} values named {name} are left out"


def _describe_unknown(
    log: CanLog, definitions: Mapping[str, MessageDefinition], databases: Sequence[Path]
) -> Iterable[str]:
    """How many frames no database defines."""
    known = {definition.frame_id for definition in definitions.values()}
    unknown = {frame_id: frames for frame_id, frames in log.frames.items() if frame_id not in known}
    if unknown:
        count = sum(len(frames.stamps_s) for frames in unknown.values())
        files = ", ".join(file.name for file in databases)
        yield f"{count} frames that {files} does not define are left out: {_list_ids(unknown)}"


def _list_ids(frame_ids: Iterable[FrameId]) -> str:
    """Identifiers for a message, the lowest ones where there are many."""
    ordered = sorted(frame_ids)
    words = ", ".join(format_id(frame_id) for frame_id in ordered[:MOST_IDS])
    if len(ordered) > MOST_IDS:
        words += f" and {len(ordered) - MOST_IDS} more"
    return words


def _round_stamps(frames: MessageFrames) -> NDArray[np.int64]:
    """The stamps (k,) of frames in ns, rounded to us.

    python-can has them as floats of seconds since 1970, which resolve 0.24 us. Logs have us, and
    no frame is shorter than ten of them.
    """
    stamps_us = np.round(np.array(frames.stamps_s) * 1e6).astype(np.int64)
    return stamps_us * NS_PER_US
