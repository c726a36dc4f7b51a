"""Conversion of host time to UTC.

The host clock counts seconds from its start, and starts again from zero where a run was resumed. The run's events carry both times.
"""

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from rfca_rig.bench.resume import RESUMED
from rfca_rig.campaign.stored import StoredStage, StoredStream
from rfca_rig.errors import BadInput
from rfca_rig.recording.columns import HOST_TIME
from rfca_rig.recording.run_text import parse_events

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
NS = 1_000_000_000
# Gap between stages, or parts of a run, whose true distance in time is unknown.
APART_S = 1.0

Event = Mapping[str, Any]


@dataclass(frozen=True)
class HostClock:
    """Pairs of host time and UTC of one part of a run, ascending. Between two pairs, time runs on from the earlier one.

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
    """The run's events in order; none for an imported campaign. Raises BadInput for a line that is none."""
    events = parse_events(provenance.get("events", ""), "the events of the recording")
    for number, event in enumerate(events, start=1):
        try:
            float(event.get("t_s", 0.0))
            _utc_ns({"utc": EPOCH, **event})
        except (ValueError, TypeError, OverflowError):
            raise BadInput(f"the events of the recording:{number}: t_s should be seconds, and utc a date with time and zone") from None
    return events


def event_times(events: Iterable[Event]) -> Iterator[tuple[int, Event]]:
    """Each event with its UTC in ns; an event without a time gets that of the previous one."""
    ns = 0
    for part in _parts(events):
        for event in part.events:
            ns = part.ns(event) if "utc" in event else ns
            yield ns, event


def order_by_time(stages: Iterable[StoredStage], events: Iterable[Event]) -> list[tuple[int, StoredStage]]:
    """Each stage with the UTC of its t_s = 0 in ns, sorted by time. Where no host time was recorded, stages follow a second apart."""
    beginnings = list(_stage_beginnings(events))
    timed_stages: list[tuple[int, StoredStage]] = []
    free_ns = 0
    for stage in stages:
        zero_s = host_time_of_zero(stage)
        first_s, last_s = stage.samples.span_s
        zero_ns = free_ns - round(first_s * NS) if zero_s is None else _clock_of(stage, zero_s + first_s, beginnings).ns(zero_s)
        timed_stages.append((zero_ns, stage))
        free_ns = zero_ns + round((last_s + APART_S) * NS)
    return sorted(timed_stages, key=lambda pair: pair[0])


def host_time_of_zero(stage: StoredStage) -> float | None:
    """Host time of t_s = 0 in seconds, None where no host time was recorded.

    It is the smallest difference of host time and t_s over all records: a record never arrives before it was sampled.
    """
    with stage.samples.open_streams() as streams:
        least = [_least_delay(stream) for stream in streams if HOST_TIME in stream.columns and len(stream.t_s)]
    return min(least, default=None)


def _clock_of(stage: StoredStage, first_s: float, beginnings: list[StageBeginning]) -> HostClock:
    """Clock of that part of the run in which a stage of this label began closest to the first sample."""
    # A stage that was cut short and repeated has two beginnings of one label, perhaps in different parts of the run.
    same_label = [one for one in beginnings if one.label == stage.label] or beginnings
    return min(same_label, key=lambda one: abs(one.at_s - first_s)).clock if same_label else HostClock()


def _stage_beginnings(events: Iterable[Event]) -> Iterator[StageBeginning]:
    for part in _parts(events):
        timed = [event for event in part.events if "t_s" in event and "utc" in event]
        pairs = sorted((float(event["t_s"]), part.ns(event)) for event in timed)
        clock = HostClock(tuple(at_s for at_s, _ in pairs), tuple(utc_ns for _, utc_ns in pairs))
        yield from (StageBeginning(str(event.get("stage", "")), float(event["t_s"]), clock) for event in timed)


@dataclass(frozen=True)
class _Part:
    """Events from a start or resumption to the next stop. `later_ns` is added to their UTC, so that parts do not overlap."""

    events: list[Event]
    later_ns: int

    def ns(self, event: Event) -> int:
        return _utc_ns(event) + self.later_ns


def _parts(events: Iterable[Event]) -> Iterator[_Part]:
    """Parts of a run; a resumed run has several.

    Each part of a simulated run begins in the year 2000 again. A part is therefore shifted to begin after the previous one.
    """
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
    """UTC of an event in ns. Integer arithmetic: a float of seconds since 1970 resolves only some 200 ns."""
    return (datetime.fromisoformat(str(event["utc"])) - EPOCH) // timedelta(microseconds=1) * 1000


def _least_delay(stream: StoredStream) -> float:
    host = stream.columns[HOST_TIME].raw
    # Block by block: a stream in a file may be larger than memory.
    return min(float(np.min(host[rows] - stream.t_s[rows])) for rows in stream.blocks())
