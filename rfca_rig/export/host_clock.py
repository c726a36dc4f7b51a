"""When things happened in UTC. A host clock counts seconds from its start, anew where a run was resumed; the run's events tell both."""

import json
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from rfca_rig.bench.begun import RESUMED
from rfca_rig.campaign.stored import StoredStage
from rfca_rig.campaign.stored_streams import StoredStream
from rfca_rig.recording.rows import HOST_TIME

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
NS = 1_000_000_000
APART_S = 1.0  # stages of which nobody knows when they were

Event = Mapping[str, Any]


@dataclass(frozen=True)
class HostClock:
    """Pairs of both clocks of one part of a run, ascending; between two the time runs on from the one before. Without any, from 1970."""

    at_s: tuple[float, ...] = ()
    utc_ns: tuple[int, ...] = ()

    def ns(self, host_s: float) -> int:
        """Nanoseconds of UTC since 1970."""
        if not self.at_s:
            return round(host_s * NS)
        pair = max(bisect_right(self.at_s, host_s) - 1, 0)
        return self.utc_ns[pair] + round((host_s - self.at_s[pair]) * NS)


@dataclass(frozen=True)
class StageBeginning:
    """A stage that began, by the clock of its part of the run."""

    label: str
    at_s: float
    clock: HostClock


def events_in(provenance: Mapping[str, str]) -> list[dict[str, Any]]:
    """The run's events in their order; none of a campaign from elsewhere."""
    return [json.loads(line) for line in provenance.get("events", "").splitlines()]


def event_times(events: Iterable[Event]) -> Iterator[tuple[int, Event]]:
    """Each with its UTC in ns; one without has that of the one before."""
    ns = 0
    for part in _parts(events):
        for event in part.events:
            ns = part.ns(event) if "utc" in event else ns
            yield ns, event


def placed(stages: Iterable[StoredStage], events: Iterable[Event]) -> list[tuple[int, StoredStage]]:
    """Each stage with the UTC of its zero in ns, in the order of time. Where no host time was recorded, stages follow a second apart."""
    begun = list(_begun(events))
    found: list[tuple[int, StoredStage]] = []
    free_ns = 0
    for stage in stages:
        zero_s = zero_of(stage)
        first_s, last_s = stage.samples.span_s
        zero_ns = free_ns - round(first_s * NS) if zero_s is None else _clock_of(stage, zero_s + first_s, begun).ns(zero_s)
        found.append((zero_ns, stage))
        free_ns = zero_ns + round((last_s + APART_S) * NS)
    return sorted(found, key=lambda pair: pair[0])


def zero_of(stage: StoredStage) -> float | None:
    """The host time of t_s = 0: no record comes before it was taken, and some hardly later."""
    with stage.samples.opened() as streams:
        least = [_least_delay(stream) for stream in streams if HOST_TIME in stream.columns and len(stream.t_s)]
    return min(least, default=None)


def _clock_of(stage: StoredStage, first_s: float, begun: list[StageBeginning]) -> HostClock:
    """That of the part of the run in which a stage of this name began about when the first sample came."""
    named = [one for one in begun if one.label == stage.label] or begun
    return min(named, key=lambda one: abs(one.at_s - first_s)).clock if named else HostClock()


def _begun(events: Iterable[Event]) -> Iterator[StageBeginning]:
    for part in _parts(events):
        timed = [event for event in part.events if "t_s" in event and "utc" in event]
        pairs = sorted((float(event["t_s"]), part.ns(event)) for event in timed)
        clock = HostClock(tuple(at_s for at_s, _ in pairs), tuple(utc_ns for _, utc_ns in pairs))
        yield from (StageBeginning(str(event.get("stage", "")), float(event["t_s"]), clock) for event in timed)


@dataclass(frozen=True)
class _Part:
    """What happened from start or resumption to stop, and by how much later than its clock says it counts."""

    events: list[Event]
    later_ns: int

    def ns(self, event: Event) -> int:
        return _utc_ns(event) + self.later_ns


def _parts(events: Iterable[Event]) -> Iterator[_Part]:
    """A run that was resumed has several. Those of a twin all begin in 2000: a part counts from when the one before has ended."""
    free_ns = 0
    for part in _split(events):
        times = [_utc_ns(event) for event in part if "utc" in event]
        later_ns = max(0, free_ns - min(times)) if times else 0
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
    """Exact, where a float of seconds would lose the last hundred nanoseconds."""
    return (datetime.fromisoformat(str(event["utc"])) - EPOCH) // timedelta(microseconds=1) * 1000


def _least_delay(stream: StoredStream) -> float:
    host = stream.columns[HOST_TIME].raw
    return min(float(np.min(host[rows] - stream.t_s[rows])) for rows in stream.blocks())
