"""Export of a recording as MCAP, which Foxglove, Lichtblick and PlotJuggler open without plugins.

/shaft /force /table /cycles  a message per record: the columns' names and `t_s`, host clock
/stage            where a stage begins: height, speed, repeat
/static           the means of a static stage, and hinge angles
/log              the run's events
/photo /overlay   pictures

Every channel has a schema, because PlotJuggler opens no file in which one has none.
"""

import json
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from heapq import merge
from operator import itemgetter
from pathlib import Path
from typing import IO, Any

import numpy as np
from mcap.writer import CompressionType, Writer

from rfca_rig.bench.resume import RESUMED
from rfca_rig.campaign.stored import StoredRecording, StoredStage, StoredStream, open_stored
from rfca_rig.errors import TRIP, BadInput
from rfca_rig.export import messages as foxglove
from rfca_rig.export.csv_files import static_row
from rfca_rig.export.messages import Layout, layout_of, pack_samples
from rfca_rig.progress import ProgressCount, iterate_with_progress
from rfca_rig.recording.atomic import refuse_devices, remove, translate_os_errors
from rfca_rig.recording.columns import HOST_TIME
from rfca_rig.recording.layout import UNITS
from rfca_rig.recording.model import StaticStage
from rfca_rig.recording.run_text import parse_events

# The writer buffers one chunk, compresses it and writes it: memory stays at about this size.
CHUNK_BYTES = 1 << 20
LIBRARY = "rfca-rig"
# Characters. Viewers show a metadata entry in one piece, so longer texts are left out.
LONGEST_METADATA = 20_000
PICTURES = {"photo": "/photo", "overlay": "/overlay"}

Message = tuple[int, int, bytes]
"""When, in ns; in which channel; what."""

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
NS = 1_000_000_000
# Gap between stages, or parts of a run, whose true distance in time is unknown.
APART_S = 1.0

Event = Mapping[str, Any]


@dataclass(frozen=True)
class Exported:
    """Summary of an export: messages and pictures in the file, and names of pictures that could
    not be read.
    """

    messages: int
    pictures: int
    missing: tuple[str, ...]


def export_mcap(run: Path, out: Path, report_progress: ProgressCount) -> Exported:
    """Writes the recording at `run` to `out`, completely or not at all. Memory does not grow with
    the recording.

    Parameters
    ----------
    run
        A run's folder, a recording file or a campaign.
    out
        The file to write; an existing one is replaced.
    report_progress
        Progress callback: number of stages done, number of stages.

    Raises
    ------
    BadInput
        Where `run` is not a recording.
    RigError
        Where the file cannot be written.
    """
    refuse_devices(out)
    partial = out.with_name(out.name + ".writing")
    stored = open_stored(run)
    with translate_os_errors(out, "cannot be written"):
        out.parent.mkdir(parents=True, exist_ok=True)
        try:
            with partial.open("wb") as file:
                exported = _McapFile(file, stored).write(report_progress)
            # A rename within one folder is atomic: no reader finds half a file.
            partial.replace(out)
        finally:
            remove(partial)
    return exported


@dataclass
class _Channels:
    """Channels of the file by topic, registered at first use: a recording without photos gets no
    photo channel.
    """

    writer: Writer
    source: str
    ids: dict[str, int] = field(default_factory=dict)
    layouts: dict[str, Layout] = field(default_factory=dict)

    def plain(self, topic: str, schema: tuple[str, bytes]) -> int:
        if topic not in self.ids:
            schema_id = self.writer.register_schema(schema[0], "jsonschema", schema[1])
            self.ids[topic] = self.writer.register_channel(
                topic, "json", schema_id, {"source": self.source}
            )
        return self.ids[topic]

    def samples(self, stream: StoredStream) -> tuple[int, Layout]:
        """Channel id and layout for a stream.

        A channel has one schema. A later stream of the same name with other columns gets a topic of
        its own, with "_" appended.
        """
        layout = layout_of(stream)
        topic = f"/{stream.name}"
        while topic in self.layouts and self.layouts[topic] != layout:
            topic += "_"
        if topic not in self.ids:
            self.layouts[topic] = layout
            schema_id = self.writer.register_schema(layout.type_name, "protobuf", layout.descriptor)
            units = {name: column.unit for name, column in stream.columns.items() if column.unit}
            self.ids[topic] = self.writer.register_channel(
                topic, "protobuf", schema_id, {"source": self.source, "t_s": "s", **units}
            )
        return self.ids[topic], layout


class _McapFile:
    """One file while it is written."""

    def __init__(self, file: IO[bytes], stored: StoredRecording) -> None:
        self._writer = Writer(file, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._stored = stored
        self._events = events_in(stored.provenance)
        self._channels = _Channels(self._writer, stored.source)
        self._messages = self._pictures = 0
        self._missing: list[str] = []

    def write(self, report_progress: ProgressCount) -> Exported:
        self._writer.start(library=LIBRARY)
        self._describe()
        # Events and samples are each in order of time. Viewers play a file from front to back, so
        # the two are merged.
        for ns, channel, content in merge(
            self._log_messages(), self._stage_messages_in_order(report_progress), key=itemgetter(0)
        ):
            # MCAP's sequence number has 32 bits; it wraps in recordings of more than 4e9 messages.
            self._writer.add_message(channel, ns, content, ns, self._messages & 0xFFFFFFFF)
            self._messages += 1
        self._writer.finish()  # type: ignore[no-untyped-call]
        return Exported(self._messages, self._pictures, tuple(self._missing))

    def _describe(self) -> None:
        """Writes title, source, nominal model, provenance and units as metadata."""
        stored = self._stored
        self._writer.add_metadata(
            "recording",
            {
                "title": stored.title,
                "source": stored.source,
                "believed": json.dumps(dict(stored.nominal)),
            },
        )
        # Events are left out here because they are messages on /log.
        texts = {
            name: text
            for name, text in stored.provenance.items()
            if name != "events" and len(text) <= LONGEST_METADATA
        }
        self._writer.add_metadata("provenance", texts)
        self._writer.add_metadata("units", dict(UNITS))

    def _log_messages(self) -> Iterator[Message]:
        channel = self._channels.plain("/log", foxglove.LOG)
        events = list(event_times(self._events))
        begin_ns = 0
        if events:
            begin_ns = events[0][0]
        yield (
            begin_ns,
            channel,
            foxglove.log(begin_ns, f"{self._stored.source} recording: {self._stored.title}"),
        )
        for ns, event in events:
            level = "info"
            if TRIP in str(event.get("why", "")):
                level = "error"
            yield ns, channel, foxglove.log(ns, event_text(event), level)

    def _stage_messages_in_order(self, report_progress: ProgressCount) -> Iterator[Message]:
        """Messages of all stages in order. Static stages of which only means are known come
        last, a second apart.
        """
        stages = order_by_time((*self._stored.strokes, *self._stored.raw), self._events)
        holds = match_static_stages(self._stored.static, [stage for _, stage in stages])
        ns = 0
        for zero_ns, stage in iterate_with_progress(stages, report_progress):
            with stage.samples.open_streams() as streams:
                # Each device's messages ascend by themselves: a lazy merge orders them without
                # holding the stage in memory.
                for message in merge(
                    *self._stage_messages(zero_ns, stage, streams, holds.get(id(stage))),
                    key=itemgetter(0),
                ):
                    ns = max(ns, message[0])
                    yield message
        if not holds:
            for means in self._stored.static:
                ns += NS
                yield from self._static_messages(ns, means)

    def _stage_messages(
        self,
        zero_ns: int,
        stage: StoredStage,
        streams: Iterable[StoredStream],
        means: StaticStage | None,
    ) -> Iterator[Iterable[Message]]:
        """One iterator of messages in ascending time for each channel of the stage."""
        begin_ns = zero_ns + round(stage.samples.span_s[0] * NS)
        channel = self._channels.plain("/stage", foxglove.STAGE)
        yield [(begin_ns, channel, foxglove.values(label=stage.label, **stage.about))]
        if means is not None:
            yield list(self._static_messages(begin_ns, means))
        for stream in streams:
            if len(stream.t_s):
                yield _samples(stream, *self._channels.samples(stream), zero_ns)

    def _static_messages(self, ns: int, means: StaticStage) -> Iterator[Message]:
        yield (
            ns,
            self._channels.plain("/static", foxglove.STATIC),
            foxglove.values(**static_row(means)),
        )
        for kind, topic in PICTURES.items():
            name = getattr(means, kind)
            if not name:
                continue
            try:
                picture = foxglove.image(ns, self._stored.folder / name)
            # A photo that was moved, or in a format that Foxglove does not show (KeyError of
            # FORMATS), is reported, not fatal.
            except (BadInput, KeyError):
                self._missing.append(name)
                continue
            self._pictures += 1
            yield ns, self._channels.plain(topic, foxglove.IMAGE), picture


def _samples(stream: StoredStream, channel: int, layout: Layout, zero_ns: int) -> Iterator[Message]:
    size = layout.dtype.itemsize
    for t_s, content in pack_samples(stream, layout):
        times = (zero_ns + np.rint(t_s * NS).astype(np.int64)).tolist()
        if min(times) < 0:
            raise BadInput(
                f"the times of {stream.name} run backwards to before 1970, which MCAP "
                "cannot hold; export csv can"
            )
        for row, ns in enumerate(times):
            yield ns, channel, bytes(content[row * size : (row + 1) * size])


def match_static_stages(
    static: Sequence[StaticStage], stages: Sequence[StoredStage]
) -> Mapping[int, StaticStage]:
    """Static stages (means) by the `id` of the stored stage that holds their samples.

    Empty where the two numbers differ: then it is not known which samples belong to which means.
    """
    whole = [stage for stage in stages if not stage.cut_short and stage.label.startswith("hold")]
    if len(whole) == len(static):
        return {id(stage): means for stage, means in zip(whole, static, strict=True)}
    return {}


def event_text(event: Mapping[str, Any]) -> str:
    """An event in one line: its name, then its values."""
    shown = {
        name: value
        for name, value in event.items()
        if name not in ("event", "t_s", "utc", "sha256")
    }
    values = ", ".join(f"{name} {value}" for name, value in shown.items())
    if values:
        return f"{event.get('event', 'event')}: {values}"
    return str(event.get("event", "event"))


@dataclass(frozen=True)
class HostClock:
    """Pairs of host time and UTC of one part of a run, ascending. Between two pairs, time runs on
    from the earlier one.

    Without any pair, host time counts from 1970.
    """

    at_s: tuple[float, ...] = ()
    utc_ns: tuple[int, ...] = ()

    def ns(self, host_s: float) -> int:
        """UTC of a host time, in nanoseconds since 1970."""
        if not self.at_s:
            return round(host_s * NS)
        # Times before the first pair are extrapolated back from it.
        pair = max(bisect_right(self.at_s, host_s) - 1, 0)
        return self.utc_ns[pair] + round((host_s - self.at_s[pair]) * NS)


@dataclass(frozen=True)
class StageBeginning:
    """Start of a stage: host time in seconds, and the clock of that part of the run."""

    label: str
    at_s: float
    clock: HostClock


def events_in(provenance: Mapping[str, str]) -> list[dict[str, Any]]:
    """The run's events in order; none for an imported campaign. Raises BadInput for a line that
    is none.
    """
    events = parse_events(provenance.get("events", ""), "the events of the recording")
    for number, event in enumerate(events, start=1):
        try:
            float(event.get("t_s", 0.0))
            _utc_ns({"utc": EPOCH, **event})
        except (ValueError, TypeError, OverflowError):
            raise BadInput(
                f"the events of the recording:{number}: t_s should be seconds, and utc a "
                "date with time and zone"
            ) from None
    return events


def event_times(events: Iterable[Event]) -> Iterator[tuple[int, Event]]:
    """Each event with its UTC in ns; an event without a time gets that of the previous one."""
    ns = 0
    for part in _parts(events):
        for event in part.events:
            if "utc" in event:
                ns = part.ns(event)
            yield ns, event


def order_by_time(
    stages: Iterable[StoredStage], events: Iterable[Event]
) -> list[tuple[int, StoredStage]]:
    """Each stage with the UTC of its t_s = 0 in ns, sorted by time. Where no host time was
    recorded, stages follow a second apart.
    """
    beginnings = list(_stage_beginnings(events))
    timed_stages: list[tuple[int, StoredStage]] = []
    free_ns = 0
    for stage in stages:
        zero_s = host_time_of_zero(stage)
        first_s, last_s = stage.samples.span_s
        if zero_s is None:
            zero_ns = free_ns - round(first_s * NS)
        else:
            zero_ns = _clock_of(stage, zero_s + first_s, beginnings).ns(zero_s)
        timed_stages.append((zero_ns, stage))
        free_ns = zero_ns + round((last_s + APART_S) * NS)
    return sorted(timed_stages, key=lambda pair: pair[0])


def host_time_of_zero(stage: StoredStage) -> float | None:
    """Host time of t_s = 0 in seconds, None where no host time was recorded.

    It is the smallest difference of host time and t_s over all records: a record never arrives
    before it was sampled.
    """
    with stage.samples.open_streams() as streams:
        least = [
            _least_delay(stream)
            for stream in streams
            if HOST_TIME in stream.columns and len(stream.t_s)
        ]
    return min(least, default=None)


def _clock_of(stage: StoredStage, first_s: float, beginnings: list[StageBeginning]) -> HostClock:
    """Clock of that part of the run in which a stage of this label began closest to the first
    sample.
    """
    # A stage that was cut short and repeated has two beginnings of one label, perhaps in different
    # parts of the run.
    same_label = [
        beginning for beginning in beginnings if beginning.label == stage.label
    ] or beginnings
    if same_label:
        return min(same_label, key=lambda beginning: abs(beginning.at_s - first_s)).clock
    return HostClock()


def _stage_beginnings(events: Iterable[Event]) -> Iterator[StageBeginning]:
    for part in _parts(events):
        timed = [event for event in part.events if "t_s" in event and "utc" in event]
        pairs = sorted((float(event["t_s"]), part.ns(event)) for event in timed)
        clock = HostClock(tuple(at_s for at_s, _ in pairs), tuple(utc_ns for _, utc_ns in pairs))
        yield from (
            StageBeginning(str(event.get("stage", "")), float(event["t_s"]), clock)
            for event in timed
        )


@dataclass(frozen=True)
class _Part:
    """Events from a start or resumption to the next stop. `later_ns` is added to their UTC, so
    that parts do not overlap.
    """

    events: list[Event]
    later_ns: int

    def ns(self, event: Event) -> int:
        return _utc_ns(event) + self.later_ns


def _parts(events: Iterable[Event]) -> Iterator[_Part]:
    """Parts of a run; a resumed run has several.

    Each part of a simulated run begins in the year 2000 again. A part is therefore shifted to begin
    after the previous one.
    """
    free_ns = 0
    for part in _split(events):
        times = [_utc_ns(event) for event in part if "utc" in event]
        later_ns = 0
        if times:
            later_ns = max(0, free_ns - min(times))
        yield _Part(part, later_ns)
        free_ns = max(times, default=0) + later_ns + round(APART_S * NS)


def _split(events: Iterable[Event]) -> Iterator[list[Event]]:
    part: list[Event] = []
    for event in events:
        if event.get("event") == RESUMED:
            yield part
            part = []
        part.append(event)
    yield part


def _utc_ns(event: Event) -> int:
    """UTC of an event in ns. Integer arithmetic: a float of seconds since 1970 resolves only
    some 200 ns.
    """
    return (datetime.fromisoformat(str(event["utc"])) - EPOCH) // timedelta(microseconds=1) * 1000


def _least_delay(stream: StoredStream) -> float:
    host = stream.columns[HOST_TIME].data
    # Block by block: a stream in a file may be larger than memory.
    return min(float(np.min(host[rows] - stream.t_s[rows])) for rows in stream.blocks())
