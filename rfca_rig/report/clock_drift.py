"""How far each device's clock went from the host's, from the two times that every sample carries."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.recording.cycle_table import CYCLES
from rfca_rig.recording.model import RawStage, Recording, Stream, Stroke
from rfca_rig.recording.rows import DEVICE_TIME, HOST_TIME

Floats = NDArray[np.float64]

BLOCK_S = 0.25
FEWEST_BLOCKS = 4


@dataclass(frozen=True)
class ClockDrift:
    """`ppm` more time on the device than on the host, over `span_s` of `blocks` quarters of a second.

    `half_ppm` is the most that uneven arrival can feign: the loop looks only so often, so that a sample may be early or late by all that
    is seen of it, at either end. No confidence level: such errors are no noise.
    """

    device: str
    ppm: float
    half_ppm: float
    span_s: float
    blocks: int


def clock_drifts(recording: Recording) -> list[ClockDrift]:
    """Of each device whose samples carry both clocks.

    A sample arrives late, never early: in each quarter of a second the one that came soonest counts. A device that was started anew
    within the run counts since then.
    """
    stages: Sequence[Stroke | RawStage] = (*recording.strokes, *recording.raw)
    names = dict.fromkeys(name for stage in stages for name in stage.streams if name != CYCLES)
    drifts = (_drift(name, [stage.streams[name] for stage in stages if name in stage.streams]) for name in names)
    return [drift for drift in drifts if drift is not None]


def _drift(device: str, streams: Sequence[Stream]) -> ClockDrift | None:
    pairs = sorted(pair for stream in streams for pair in _soonest(stream))
    host_s, device_s = np.array(pairs).reshape(-1, 2).T
    anew = np.flatnonzero(np.diff(device_s) < 0.0)
    since = int(anew[-1]) + 1 if len(anew) else 0
    host_s, ahead_s = host_s[since:], (device_s - host_s)[since:]
    if len(host_s) < FEWEST_BLOCKS or np.ptp(host_s) < BLOCK_S:
        return None
    centred = host_s - host_s.mean()
    slope = float(centred @ ahead_s) / float(centred @ centred)
    uneven_s = float(np.ptp(ahead_s - slope * centred))
    span_s = float(np.ptp(host_s))
    return ClockDrift(device, 1e6 * slope, 2e6 * uneven_s / span_s, span_s, len(host_s))


def _soonest(stream: Stream) -> Iterator[tuple[float, float]]:
    """(host, device) of the sample of each block that was under way for the shortest time."""
    if HOST_TIME not in stream.columns or DEVICE_TIME not in stream.columns:
        return
    host_s, device_s = (_on_its_clock(stream, name) for name in (HOST_TIME, DEVICE_TIME))
    if not len(host_s):
        return
    block = ((host_s - host_s[0]) // BLOCK_S).astype(int)
    late_s = host_s - device_s
    for number in np.unique(block):
        of_it = np.flatnonzero(block == number)
        best = int(of_it[np.argmin(late_s[of_it])])
        yield float(host_s[best]), float(device_s[best])


def _on_its_clock(stream: Stream, name: str) -> Floats:
    """Without the offset, which counts from the stage's start."""
    column = stream.columns[name]
    return np.asarray(column.raw.astype(np.float64) * column.conversion)
