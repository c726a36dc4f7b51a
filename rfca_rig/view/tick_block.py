"""Encoding of a tick as bytes, from the run's process to the view's."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.engine.interfaces import Tick
from rfca_rig.recording.journal import BlockKind, JournalBlock
from rfca_rig.view.decimation import Floats, Numbers

# Little-endian without padding: eight doubles, the lost records, the numbers of shaft samples and of force records.
_HEAD = struct.Struct("<8dQII")
SHAFT_COLUMNS, FORCE_TIMES, AXES = 5, 2, 6


@dataclass(frozen=True)
class Stamp:
    """What the run adds to a tick: time on the clock that both processes share, and the number of force records dropped so far."""

    wall_s: float
    lost: int


@dataclass(frozen=True)
class SeenTicks:
    """Consecutive ticks at the view's end, joined. Times of samples are those of the host and of the devices.

    One value for each of k ticks, (k,): `wall_s` as stamped; `temperature_C`, NaN where the drive does not report it; `shaft_samples` and
    `force_records`, the numbers that the tick brought; the others as in `Tick`. `lost` is that of the last tick. `shaft` (5, m) holds host
    time, device time, angle, speed and torque. `force_host_s` and `force_device_s` are (n,), `counts` (n, 6) those of the force sensor.
    """

    wall_s: Floats
    now_s: Floats
    target_rad: Floats
    target_speed_rad_s: Floats
    late_s: Floats
    worst_gap_s: Floats
    temperature_C: Floats
    drive_silent_s: Floats
    lost: int
    shaft_samples: Numbers
    force_records: Numbers
    shaft: Floats
    force_host_s: Floats
    force_device_s: Floats
    counts: NDArray[np.int32]


def tick_block(tick: Tick, stamp: Stamp) -> JournalBlock:
    """A tick as one block. It takes microseconds, because it is called within the control loop."""
    shaft, force, status = tick.shaft, tick.force, tick.status
    temperature_C = np.nan if status is None or status.temperature_C is None else status.temperature_C
    head = _HEAD.pack(
        stamp.wall_s,
        tick.now_s,
        tick.target_rad,
        tick.target_speed_rad_s,
        tick.late_s,
        tick.worst_gap_s,
        temperature_C,
        0.0 if status is None else status.silent_s,
        stamp.lost,
        len(shaft.host_s),
        len(force.host_s),
    )
    columns = (shaft.host_s, shaft.device_s, shaft.angle_rad, shaft.speed_rad_s, shaft.torque_Nm, force.host_s, force.device_s)
    pieces = [column.tobytes() for column in columns]
    return JournalBlock(BlockKind.SAMPLES, b"".join((head, *pieces, force.counts.tobytes())))


def ticks_of(blocks: Sequence[JournalBlock]) -> SeenTicks:
    """Decodes one or more blocks. Raises ValueError or struct.error where a block does not hold a tick."""
    heads, shafts, times, counts = [], [], [], []
    for block in blocks:
        *head, m, n = _HEAD.unpack_from(block.payload)
        heads.append((*head, m, n))
        at = _HEAD.size
        # frombuffer reads without a copy; the concatenation below copies everything once.
        shafts.append(np.frombuffer(block.payload, "<f8", SHAFT_COLUMNS * m, at).reshape(SHAFT_COLUMNS, m))
        at += shafts[-1].nbytes
        times.append(np.frombuffer(block.payload, "<f8", FORCE_TIMES * n, at).reshape(FORCE_TIMES, n))
        at += times[-1].nbytes
        counts.append(np.frombuffer(block.payload, "<i4", AXES * n, at).reshape(n, AXES))
    wall_s, now_s, target_rad, target_speed_rad_s, late_s, gap_s, temperature_C, silent_s, lost, m, n = np.array(heads).T
    motion, sizes = (target_rad, target_speed_rad_s, late_s, gap_s), (int(lost[-1]), m.astype(np.int64), n.astype(np.int64))
    both = np.concatenate(times, axis=1)
    samples = np.concatenate(shafts, axis=1), both[0], both[1], np.concatenate(counts)
    return SeenTicks(wall_s, now_s, *motion, temperature_C, silent_s, *sizes, *samples)
