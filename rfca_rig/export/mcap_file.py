"""A recording as MCAP, which Foxglove, Lichtblick and PlotJuggler open without plugins.

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

from rfca_rig.campaign.stored import Stored, StoredStage, stored_at
from rfca_rig.campaign.stored_streams import StoredStream
from rfca_rig.channels import UNITS
from rfca_rig.errors import TRIP
from rfca_rig.export import foxglove_messages as foxglove
from rfca_rig.export.host_clock import NS, event_times, events_in, placed
from rfca_rig.export.sample_messages import Layout, layout_of, packed_samples
from rfca_rig.export.static_row import static_row
from rfca_rig.progress import Watcher, counted
from rfca_rig.recording.atomic import refusals, remove
from rfca_rig.recording.model import StaticStage

CHUNK_BYTES = 1 << 20
LIBRARY = "rfca-rig"
LONGEST_METADATA = 20_000  # a reader shows it in one piece
PICTURES = {"photo": "/photo", "overlay": "/overlay"}

Message = tuple[int, int, bytes]
"""When, in ns; in which channel; what."""


@dataclass(frozen=True)
class Exported:
    """What went into the file."""

    messages: int
    pictures: int
    missing: tuple[str, ...]


def export_mcap(run: Path, out: Path, told: Watcher) -> Exported:
    """Writes the recording at `run` to `out`, whole or not at all, in little memory however long it is; `told` hears how many stages of how
    many are done. Raises BadInput for what is no recording, RigError when the disk refuses.
    """
    partial = out.with_name(out.name + ".writing")
    stored = stored_at(run)
    with refusals(out, "cannot be written"):
        out.parent.mkdir(parents=True, exist_ok=True)
        try:
            with partial.open("wb") as file:
                exported = _McapFile(file, stored).write(told)
            partial.replace(out)
        finally:
            remove(partial)
    return exported


@dataclass
class _Channels:
    """Registered as they are needed."""

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
        """A stream of other columns than the one of that name before gets a channel of its own."""
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

    def __init__(self, file: IO[bytes], stored: Stored) -> None:
        self._writer = Writer(file, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._stored = stored
        self._events = events_in(stored.provenance)
        self._channels = _Channels(self._writer, stored.source)
        self._messages = self._pictures = 0
        self._missing: list[str] = []

    def write(self, told: Watcher) -> Exported:
        self._writer.start(library=LIBRARY)
        self._describe()
        for ns, channel, content in merge(self._logged(), self._recorded(told), key=itemgetter(0)):
            self._writer.add_message(channel, ns, content, ns, self._messages & 0xFFFFFFFF)
            self._messages += 1
        self._writer.finish()  # type: ignore[no-untyped-call]
        return Exported(self._messages, self._pictures, tuple(self._missing))

    def _describe(self) -> None:
        """Where the recording comes from, as metadata."""
        stored = self._stored
        self._writer.add_metadata(
            "recording", {"title": stored.title, "source": stored.source, "believed": json.dumps(dict(stored.nominal))}
        )
        texts = {name: text for name, text in stored.provenance.items() if name != "events" and len(text) <= LONGEST_METADATA}
        self._writer.add_metadata("provenance", texts)
        self._writer.add_metadata("units", dict(UNITS))

    def _logged(self) -> Iterator[Message]:
        channel = self._channels.plain("/log", foxglove.LOG)
        events = list(event_times(self._events))
        begin_ns = events[0][0] if events else 0
        yield begin_ns, channel, foxglove.log(begin_ns, f"{self._stored.source} recording: {self._stored.title}")
        for ns, event in events:
            yield ns, channel, foxglove.log(ns, event_text(event), "error" if TRIP in str(event.get("why", "")) else "info")

    def _recorded(self, told: Watcher) -> Iterator[Message]:
        """Stage after stage; static stages of which only the means are known follow a second apart."""
        stages = placed((*self._stored.strokes, *self._stored.raw), self._events)
        holds = held_behind(self._stored.static, [stage for _, stage in stages])
        ns = 0
        for zero_ns, stage in counted(stages, told):
            with stage.samples.opened() as streams:
                for message in merge(*self._stage_messages(zero_ns, stage, streams, holds.get(id(stage))), key=itemgetter(0)):
                    ns = max(ns, message[0])
                    yield message
        for held in self._stored.static if not holds else ():
            ns += NS
            yield from self._held_messages(ns, held)

    def _stage_messages(
        self, zero_ns: int, stage: StoredStage, streams: Iterable[StoredStream], held: StaticStage | None
    ) -> Iterator[Iterable[Message]]:
        """One ascending row of messages per channel."""
        begin_ns = zero_ns + round(stage.samples.span_s[0] * NS)
        channel = self._channels.plain("/stage", foxglove.STAGE)
        yield [(begin_ns, channel, foxglove.values(label=stage.label, **stage.about))]
        if held is not None:
            yield list(self._held_messages(begin_ns, held))
        for stream in streams:
            if len(stream.t_s):
                yield _samples(stream, *self._channels.samples(stream), zero_ns)

    def _held_messages(self, ns: int, held: StaticStage) -> Iterator[Message]:
        yield ns, self._channels.plain("/static", foxglove.STATIC), foxglove.values(**static_row(held))
        for kind, topic in PICTURES.items():
            name = getattr(held, kind)
            if not name:
                continue
            try:
                picture = foxglove.image(ns, self._stored.folder / name)
            except (OSError, KeyError):
                self._missing.append(name)
                continue
            self._pictures += 1
            yield ns, self._channels.plain(topic, foxglove.IMAGE), picture


def _samples(stream: StoredStream, channel: int, layout: Layout, zero_ns: int) -> Iterator[Message]:
    size = layout.dtype.itemsize
    for t_s, content in packed_samples(stream, layout):
        times = (zero_ns + np.rint(t_s * NS).astype(np.int64)).tolist()
        for row, ns in enumerate(times):
            yield ns, channel, bytes(content[row * size : (row + 1) * size])


def held_behind(static: Sequence[StaticStage], stages: Sequence[StoredStage]) -> Mapping[int, StaticStage]:
    """The static stage behind whose means the samples of a stage are, by the stage's id; none where their numbers differ."""
    whole = [stage for stage in stages if not stage.cut_short and stage.label.startswith("hold")]
    return {id(stage): held for stage, held in zip(whole, static, strict=True)} if len(whole) == len(static) else {}


def event_text(event: Mapping[str, Any]) -> str:
    """An event in one line: what, then its values."""
    said = {name: value for name, value in event.items() if name not in ("event", "t_s", "utc", "sha256")}
    values = ", ".join(f"{name} {value}" for name, value in said.items())
    return f"{event.get('event', 'event')}: {values}" if values else str(event.get("event", "event"))
