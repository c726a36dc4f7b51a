"""A tick as bytes: what the view needs of it, from the run's process to the view's."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.engine.observer import Tick
from rfca_rig.recording.journal import BlockKind, JournalBlock
from rfca_rig.view.decimation import Floats, Numbers

_HEAD = struct.Struct("<8dQII")
SHAFT_COLUMNS, FORCE_TIMES, AXES = 5, 2, 6


@dataclass(frozen=True)
class Stamp:
    """What the run adds to a tick: the clock that both processes share, and how many force records did not come through before it."""

    wall_s: float
    lost: int


@dataclass(frozen=True)
class SeenTicks:
    """Ticks in a row at the view's end, all that are in them in one. Times of samples are the host's and the devices' own.

    Each (k,): `wall_s` and `lost` as stamped; `temperature_C` NaN where no drive tells it; `shaft_samples` and `force_records` how many the
    tick brought. `shaft` (5, m): host time, device time, angle, speed, torque. `counts` (n, 6) are the force sensor's.
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
    """Microseconds: this is done within the control loop."""
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
    """At least one. Raises ValueError, struct.error where a block holds no tick."""
    heads, shafts, times, counts = [], [], [], []
    for block in blocks:
        *head, m, n = _HEAD.unpack_from(block.payload)
        heads.append((*head, m, n))
        at = _HEAD.size
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
