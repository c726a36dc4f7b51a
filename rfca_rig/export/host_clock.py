"""When things happened by the host's clock, of which a recording knows two: seconds since the run began, and, in its events, UTC."""

import json
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from rfca_rig.export.stored import StoredStage, StoredStream
from rfca_rig.recording.rows import HOST_TIME

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
NS = 1_000_000_000


@dataclass(frozen=True)
class HostClock:
    """Pairs of both clocks, ascending; between two the time runs on from the one before. Without any, it begins in 1970."""

    at_s: tuple[float, ...] = ()
    utc_ns: tuple[int, ...] = ()

    def ns(self, host_s: float) -> int:
        """Nanoseconds of UTC since 1970."""
        if not self.at_s:
            return round(host_s * NS)
        pair = max(bisect_right(self.at_s, host_s) - 1, 0)
        return self.utc_ns[pair] + round((host_s - self.at_s[pair]) * NS)


def host_clock(events: Iterable[Mapping[str, Any]]) -> HostClock:
    """From the events of a run."""
    pairs = sorted((float(event["t_s"]), _ns(str(event["utc"]))) for event in events if "t_s" in event and "utc" in event)
    return HostClock(tuple(at_s for at_s, _ in pairs), tuple(utc_ns for _, utc_ns in pairs))


def _ns(utc: str) -> int:
    """Exact, where a float of seconds would lose the last hundred nanoseconds."""
    return (datetime.fromisoformat(utc) - EPOCH) // timedelta(microseconds=1) * 1000


def events_in(provenance: Mapping[str, str]) -> list[dict[str, Any]]:
    """The run's events in their order; none of a campaign from elsewhere."""
    return [json.loads(line) for line in provenance.get("events", "").splitlines()]


def placed(stages: Iterable[StoredStage]) -> Iterator[tuple[float, StoredStage]]:
    """Each stage with the host time of its zero. Where no host time was recorded, stages follow each other a second apart."""
    free_s = 0.0
    for stage in stages:
        zero_s = zero_of(stage)
        if zero_s is None:
            zero_s = free_s - min((float(stream.t_s[:1][0]) for stream in stage.streams if len(stream.t_s)), default=0.0)
        yield zero_s, stage
        free_s = 1.0 + zero_s + max((float(stream.t_s[-1:][0]) for stream in stage.streams if len(stream.t_s)), default=0.0)


def zero_of(stage: StoredStage) -> float | None:
    """The host time of t_s = 0: no record comes before it was taken, and some hardly later."""
    least = [_least_delay(stream) for stream in stage.streams if HOST_TIME in stream.columns and len(stream.t_s)]
    return min(least, default=None)


def _least_delay(stream: StoredStream) -> float:
    host = stream.columns[HOST_TIME].raw
    return min(float(np.min(host[rows] - stream.t_s[rows])) for rows in stream.blocks())
