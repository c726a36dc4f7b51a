"""Export of a recording as MCAP, which Foxglove, Lichtblick and PlotJuggler open without plugins.

/shaft /force /table /cycles  a message per record, with the columns' names and `t_s`, times by the host's clock
/stage            where a stage begins: height, speed, repeat
/static           the means of a static stage, and hinge angles
/log              the run's events
/photo /overlay   pictures

Every channel has a schema, because PlotJuggler opens no file in which one has none.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from heapq import merge
from operator import itemgetter
from pathlib import Path
from typing import IO, Any

import numpy as np
from mcap.writer import CompressionType, Writer

from rfca_rig.campaign.stored import StoredRecording, StoredStage, StoredStream, open_stored
from rfca_rig.errors import TRIP, BadInput
from rfca_rig.export import messages as foxglove
from rfca_rig.export.csv_files import static_row
from rfca_rig.export.host_clock import NS, event_times, events_in, order_by_time
from rfca_rig.export.messages import Layout, layout_of, pack_samples
from rfca_rig.progress import ProgressCount, iterate_with_progress
from rfca_rig.recording.atomic import refuse_devices, remove, translate_os_errors
from rfca_rig.recording.layout import UNITS
from rfca_rig.recording.model import StaticStage

# The writer buffers one chunk, compresses it and writes it: memory stays at about this size.
CHUNK_BYTES = 1 << 20
LIBRARY = "rfca-rig"
# Characters. Viewers show a metadata entry in one piece, so longer texts are left out.
LONGEST_METADATA = 20_000
PICTURES = {"photo": "/photo", "overlay": "/overlay"}

Message = tuple[int, int, bytes]
"""When, in ns; in which channel; what."""


@dataclass(frozen=True)
class Exported:
    """Summary of an export: messages and pictures in the file, and names of pictures that could not be read."""

    messages: int
    pictures: int
    missing: tuple[str, ...]


def export_mcap(run: Path, out: Path, report_progress: ProgressCount) -> Exported:
    """Writes the recording at `run` to `out`, completely or not at all. Memory does not grow with the recording.

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
    """Channels of the file by topic, registered at first use: a recording without photos gets no photo channel."""

    writer: Writer
    source: str
    ids: dict[str, int] = field(default_factory=dict)
    layouts: dict[str, Layout] = field(default_factory=dict)

    def plain(self, topic: str, schema: tuple[str, bytes]) -> int:
        if topic not in self.ids:
            schema_id = self.writer.register_schema(schema[0], "jsonschema", schema[1])
            self.ids[topic] = self.writer.register_channel(topic, "json", schema_id, {"source": self.source})
        return self.ids[topic]

    def samples(self, stream: StoredStream) -> tuple[int, Layout]:
        """Channel id and layout for a stream.

        A channel has one schema. A later stream of the same name with other columns gets a topic of its own, with "_" appended.
        """
        layout = layout_of(stream)
        topic = f"/{stream.name}"
        while topic in self.layouts and self.layouts[topic] != layout:
            topic += "_"
        if topic not in self.ids:
            self.layouts[topic] = layout
            schema_id = self.writer.register_schema(layout.type_name, "protobuf", layout.descriptor)
            units = {name: column.unit for name, column in stream.columns.items() if column.unit}
            self.ids[topic] = self.writer.register_channel(topic, "protobuf", schema_id, {"source": self.source, "t_s": "s", **units})
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
        # Events and samples are each in order of time. Viewers play a file from front to back, so the two are merged.
        for ns, channel, content in merge(self._log_messages(), self._stage_messages_in_order(report_progress), key=itemgetter(0)):
            # MCAP's sequence number has 32 bits; it wraps in recordings of more than 4e9 messages.
            self._writer.add_message(channel, ns, content, ns, self._messages & 0xFFFFFFFF)
            self._messages += 1
        self._writer.finish()  # type: ignore[no-untyped-call]
        return Exported(self._messages, self._pictures, tuple(self._missing))

    def _describe(self) -> None:
        """Writes title, source, nominal model, provenance and units as metadata."""
        stored = self._stored
        self._writer.add_metadata(
            "recording", {"title": stored.title, "source": stored.source, "believed": json.dumps(dict(stored.nominal))}
        )
        # Events are left out here because they are messages on /log.
        texts = {name: text for name, text in stored.provenance.items() if name != "events" and len(text) <= LONGEST_METADATA}
        self._writer.add_metadata("provenance", texts)
        self._writer.add_metadata("units", dict(UNITS))

    def _log_messages(self) -> Iterator[Message]:
        channel = self._channels.plain("/log", foxglove.LOG)
        events = list(event_times(self._events))
        begin_ns = events[0][0] if events else 0
        yield begin_ns, channel, foxglove.log(begin_ns, f"{self._stored.source} recording: {self._stored.title}")
        for ns, event in events:
            yield ns, channel, foxglove.log(ns, event_text(event), "error" if TRIP in str(event.get("why", "")) else "info")

    def _stage_messages_in_order(self, report_progress: ProgressCount) -> Iterator[Message]:
        """Messages of all stages in order. Static stages of which only means are known come last, a second apart."""
        stages = order_by_time((*self._stored.strokes, *self._stored.raw), self._events)
        holds = match_static_stages(self._stored.static, [stage for _, stage in stages])
        ns = 0
        for zero_ns, stage in iterate_with_progress(stages, report_progress):
            with stage.samples.open_streams() as streams:
                # Each device's messages ascend by themselves: a lazy merge orders them without holding the stage in memory.
                for message in merge(*self._stage_messages(zero_ns, stage, streams, holds.get(id(stage))), key=itemgetter(0)):
                    ns = max(ns, message[0])
                    yield message
        for means in self._stored.static if not holds else ():
            ns += NS
            yield from self._static_messages(ns, means)

    def _stage_messages(
        self, zero_ns: int, stage: StoredStage, streams: Iterable[StoredStream], means: StaticStage | None
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
        yield ns, self._channels.plain("/static", foxglove.STATIC), foxglove.values(**static_row(means))
        for kind, topic in PICTURES.items():
            name = getattr(means, kind)
            if not name:
                continue
            try:
                picture = foxglove.image(ns, self._stored.folder / name)
            # A photo that was moved, or in a format that Foxglove does not show (KeyError of FORMATS), is reported, not fatal.
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
            raise BadInput(f"the times of {stream.name} run backwards to before 1970, which MCAP cannot hold; export csv can")
        for row, ns in enumerate(times):
            yield ns, channel, bytes(content[row * size : (row + 1) * size])


def match_static_stages(static: Sequence[StaticStage], stages: Sequence[StoredStage]) -> Mapping[int, StaticStage]:
    """Static stages (means) by the `id` of the stored stage that holds their samples.

    Empty where the two numbers differ: then it is not known which samples belong to which means.
    """
    whole = [stage for stage in stages if not stage.cut_short and stage.label.startswith("hold")]
    return {id(stage): means for stage, means in zip(whole, static, strict=True)} if len(whole) == len(static) else {}


def event_text(event: Mapping[str, Any]) -> str:
    """An event in one line: its name, then its values."""
    shown = {name: value for name, value in event.items() if name not in ("event", "t_s", "utc", "sha256")}
    values = ", ".join(f"{name} {value}" for name, value in shown.items())
    return f"{event.get('event', 'event')}: {values}" if values else str(event.get("event", "event"))
