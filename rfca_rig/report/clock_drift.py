"""Drift of each device's clock relative to the host's, from the two times that every sample carries."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.recording.cycle_table import CYCLES
from rfca_rig.recording.model import RawStage, Recording, Stream, Stroke
from rfca_rig.recording.rows import DEVICE_TIME, HOST_TIME

Floats = NDArray[np.float64]

# From each block of this length, the sample with the shortest delay counts.
BLOCK_S = 0.25
# A line through fewer points says little about a slope.
FEWEST_BLOCKS = 4


@dataclass(frozen=True)
class ClockDrift:
    """Clock drift of one device: `ppm`, positive where the device's clock is faster than the host's.

    It comes from `blocks` blocks of a quarter of a second over `span_s`. `half_ppm` bounds the error from uneven arrival: the loop polls
    only so often, so that a sample at either end may be early or late by the whole observed spread. It is a bound without a confidence
    level, because such errors are not noise.
    """

    device: str
    ppm: float
    half_ppm: float
    span_s: float
    blocks: int


def clock_drifts(recording: Recording) -> list[ClockDrift]:
    """Drift of each device whose samples carry both clocks.

    A sample arrives late, never early: in each quarter of a second, the sample with the shortest delay counts. Where a device was
    restarted within the run, only samples since the last restart count.
    """
    stages: Sequence[Stroke | RawStage] = (*recording.strokes, *recording.raw)
    names = dict.fromkeys(name for stage in stages for name in stage.streams if name != CYCLES)
    drifts = (_drift(name, [stage.streams[name] for stage in stages if name in stage.streams]) for name in names)
    return [drift for drift in drifts if drift is not None]


def _drift(device: str, streams: Sequence[Stream]) -> ClockDrift | None:
    pairs = sorted(pair for stream in streams for pair in _shortest_delays(stream))
    host_s, device_s = np.array(pairs).reshape(-1, 2).T
    restarts = np.flatnonzero(np.diff(device_s) < 0.0)
    since = int(restarts[-1]) + 1 if len(restarts) else 0
    host_s, ahead_s = host_s[since:], (device_s - host_s)[since:]
    if len(host_s) < FEWEST_BLOCKS or np.ptp(host_s) < BLOCK_S:
        return None
    # Least squares of (device - host) over host time: the slope is the drift itself, a small number without cancellation.
    centred = host_s - host_s.mean()
    slope = float(centred @ ahead_s) / float(centred @ centred)
    uneven_s = float(np.ptp(ahead_s - slope * centred))
    # The worst case: the whole spread of one sign at the first block, of the other sign at the last one.
    span_s = float(np.ptp(host_s))
    return ClockDrift(device, 1e6 * slope, 2e6 * uneven_s / span_s, span_s, len(host_s))


def _shortest_delays(stream: Stream) -> Iterator[tuple[float, float]]:
    """Host and device time in s of the sample with the shortest delay in each block."""
    if HOST_TIME not in stream.columns or DEVICE_TIME not in stream.columns:
        return
    host_s, device_s = (_clock_time(stream, name) for name in (HOST_TIME, DEVICE_TIME))
    if not len(host_s):
        return
    block = ((host_s - host_s[0]) // BLOCK_S).astype(int)
    late_s = host_s - device_s
    for number in np.unique(block):
        of_it = np.flatnonzero(block == number)
        best = int(of_it[np.argmin(late_s[of_it])])
        yield float(host_s[best]), float(device_s[best])


def _clock_time(stream: Stream, name: str) -> Floats:
    """Times (m,) in s without the column's offset, which refers to the start of the stage: all stages share one clock then."""
    column = stream.columns[name]
    return np.asarray(column.raw.astype(np.float64) * column.conversion)
