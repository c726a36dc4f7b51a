"""Counts of the control loop's gaps, the times between two of its ticks, in logarithmic bins.

The drive's watchdog and the limit on a late loop are about single long gaps. The counts also show
how near the usual ones come.
"""

import json
from bisect import bisect_right
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import ceil

# A bin is 6 % wide: 2.0 ms, the tick of a stroke, and 2.2 ms are in different bins. Recordings are
# read with these edges, so they stay.
BINS_PER_DECADE = 40
SHORTEST_S = 1e-4
DECADES = 4
# Below an edge by this share counts as on it: a twin's ticks of 10 ms are so by rounding.
ROUNDING = 1e-9
# Lower edges from 0.1 ms to 1 s. What is shorter is in a bin of its own, what is longer in the last
# one.
EDGES_S = tuple(
    SHORTEST_S * 10.0 ** (number / BINS_PER_DECADE) * (1.0 - ROUNDING)
    for number in range(DECADES * BINS_PER_DECADE + 1)
)


class GapCounter:
    """Counts gaps. `longest_s` is the longest so far."""

    def __init__(self) -> None:
        self._counts = [0] * (len(EDGES_S) + 1)
        self.longest_s = 0.0

    def take(self, gap_s: float) -> None:
        """Counts one gap. Called at every tick: a search in a table, and one increment."""
        self._counts[bisect_right(EDGES_S, gap_s)] += 1
        self.longest_s = max(self.longest_s, gap_s)

    def histogram(self) -> "GapHistogram":
        """The counts so far, without the empty bins."""
        lower_edges_s = (0.0, *EDGES_S)
        counts = {
            _as_ms(edge_s): count
            for edge_s, count in zip(lower_edges_s, self._counts, strict=True)
            if count
        }
        return GapHistogram(counts)


@dataclass(frozen=True)
class GapHistogram:
    """Numbers of ticks by the lower edge of their bin in ms, ascending, without empty bins.

    A bin ends at the next of `EDGES_S`; the first begins at 0, the last has no end.
    """

    ticks_by_edge_ms: Mapping[float, int]

    @property
    def ticks(self) -> int:
        """Number of all ticks."""
        return sum(self.ticks_by_edge_ms.values())

    def bound_ms(self, share: float) -> float | None:
        """The time within which at least this share of the ticks came: the end of the bin that
        holds it. None without ticks, and in the last bin.
        """
        needed = ceil(share * self.ticks)
        counted = 0
        for edge_ms, count in self.ticks_by_edge_ms.items():
            counted += count
            if counted >= needed:
                return bin_end_ms(edge_ms)
        return None

    def text(self) -> str:
        """For the recording: a JSON object."""
        return json.dumps({f"{edge:g}": count for edge, count in self.ticks_by_edge_ms.items()})


def add_histograms(histograms: Iterable[GapHistogram]) -> GapHistogram:
    """The ticks of all parts of a run together."""
    total: dict[float, int] = {}
    for histogram in histograms:
        for edge_ms, count in histogram.ticks_by_edge_ms.items():
            total[edge_ms] = total.get(edge_ms, 0) + count
    return GapHistogram(dict(sorted(total.items())))


def bin_end_ms(lower_edge_ms: float) -> float | None:
    """Where the bin ends that begins there; None for the last one."""
    place = bisect_right(_EDGES_MS, lower_edge_ms)
    if place == len(_EDGES_MS):
        return None
    return _EDGES_MS[place]


def _as_ms(edge_s: float) -> float:
    """An edge as it is recorded: to a hundredth of a bin's width."""
    return float(f"{1e3 * edge_s:.4g}")


_EDGES_MS = tuple(_as_ms(edge_s) for edge_s in EDGES_S)
