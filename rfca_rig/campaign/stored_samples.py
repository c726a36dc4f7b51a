"""Samples of one recorded stage, in memory or still in their file."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import h5py
import numpy as np

from rfca_rig.campaign.stored_streams import StoredStream, streams_in_file, streams_in_memory
from rfca_rig.recording.model import Stream
from rfca_rig.recording.store import report_damage
from rfca_rig.recording.strokes import TIME, check_times, read_streams, streams_in

Streams = Mapping[str, Stream]


class StoredSamples(Protocol):
    """Access to a stage's samples. `names` are those of its streams, `span_s` its first and last time, both 0 without samples."""

    @property
    def names(self) -> tuple[str, ...]: ...

    @property
    def span_s(self) -> tuple[float, float]: ...

    def whole(self) -> Streams:
        """All samples, in memory."""
        ...

    def opened(self) -> AbstractContextManager[tuple[StoredStream, ...]]:
        """The samples, to be read in blocks."""
        ...


@dataclass(frozen=True)
class SamplesInMemory:
    """Implements StoredSamples for a stage that was read already."""

    streams: Streams

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.streams)

    @property
    def span_s(self) -> tuple[float, float]:
        return _span([(float(stream.t_s.min()), float(stream.t_s.max())) for stream in self.streams.values() if len(stream.t_s)])

    def whole(self) -> Streams:
        return self.streams

    def opened(self) -> AbstractContextManager[tuple[StoredStream, ...]]:
        return nullcontext(streams_in_memory(self.streams))


@dataclass(frozen=True)
class SamplesInFile:
    """Implements StoredSamples for a group of a file, whose seal was verified when the file was first opened."""

    path: Path
    group: str
    names: tuple[str, ...]
    span_s: tuple[float, float]

    @classmethod
    def of(cls, path: Path, file: h5py.File, group: str) -> "SamplesInFile":
        """The samples of a group. Raises ValueError where one of its streams is not of the recording's source, or has no times."""
        streams = dict(streams_in(file[group], file.attrs["source"]))
        spans = []
        for stream in streams.values():
            if len(times := stream[TIME]):
                # Only the first and last time are read, not the samples between them.
                span = float(times[0]), float(times[-1])
                check_times(stream, np.array(span))
                spans.append(span)
        return cls(path, group, tuple(streams), _span(spans))

    def whole(self) -> Streams:
        with report_damage(self.path), h5py.File(self.path, "r") as file:
            return read_streams(file[self.group], file.attrs["source"])

    @contextmanager
    def opened(self) -> Iterator[tuple[StoredStream, ...]]:
        # Damage shows where a block is read. The caller's own errors, for instance of a full disk, are not the recording's.
        with h5py.File(self.path, "r") as file:
            yield streams_in_file(self.path, file[self.group], file.attrs["source"])


def _span(spans: Sequence[tuple[float, float]]) -> tuple[float, float]:
    return min((first_s for first_s, _ in spans), default=0.0), max((last_s for _, last_s in spans), default=0.0)
