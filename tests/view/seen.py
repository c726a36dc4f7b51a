"""Ticks as a loop shows them, and what they brought, for whoever holds a view against them."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from rfca_rig.clock import TwinClock
from rfca_rig.drivers.roles import (
    ForceSamples,
    MotorStatus,
    SensorScale,
    ShaftSamples,
    StreamHealth,
)
from rfca_rig.engine.interfaces import StopRequest, Tick
from rfca_rig.protocol.plan import Plan
from rfca_rig.recording.block_queue import BlockQueue
from rfca_rig.view.leg_pose import Legs
from rfca_rig.view.process import LiveRun, LiveSource
from rfca_rig.view.run_facts import run_facts
from rfca_rig.view.run_queue import RunQueue
from tests.engine.rigs import one_condition, twin_rig

SCALE = SensorScale(1e6, 1e6, 15_000.0)
ENABLED = MotorStatus("closed loop", None, 0.01, 30.0)


def tick(
    now_s: float,
    counts: np.ndarray,
    angle_rad: float = 1.0,
    rate_Hz: float = 15_000.0,
    **about: float,
) -> Tick:
    """A tick of 2 ms that ends at `now_s`, its records (m, 6) evenly up to there."""
    times_s = now_s - np.arange(len(counts))[::-1] / rate_Hz
    none = np.zeros(len(counts), np.int64)
    force = ForceSamples(
        times_s + 1e-4, times_s, none, none.astype(np.uint32), counts.astype(np.int32)
    )
    one = np.array([now_s])
    shaft = ShaftSamples(one, one, np.array([angle_rad]), np.array([2.0]), np.array([0.1]))
    found = Tick(now_s, shaft, force, angle_rad, 2.0, 0.0, 0.002, ENABLED)
    return replace(found, **about)


def counts_of(force_N: float, moment_Nm: float = 0.0, rows: int = 1) -> np.ndarray:
    """Records (rows, 6) of so much along z, and about x."""
    counts = np.zeros((rows, 6), np.int32)
    counts[:, 2] = round(force_N * SCALE.counts_per_N)
    counts[:, 3] = round(moment_Nm * SCALE.counts_per_Nm)
    return counts


@dataclass
class Watched:
    """Both ends of a view, without any process in between. `told` is what the queue said of
    stops.
    """

    run_queue: RunQueue
    run: LiveRun
    stop_request: StopRequest
    told: list[str]
    clock: TwinClock
    plan: Plan


@contextmanager
def watched(queue_bytes: int = 1 << 20, given: Plan | None = None) -> Iterator[Watched]:
    rig = twin_rig()
    clock = TwinClock()
    stop_request = StopRequest()
    told = []
    plan = given or one_condition(rig)
    queue = BlockQueue.create(queue_bytes)
    try:
        run_queue = RunQueue(
            queue,
            plan.stages,
            stop_request,
            clock,
            lambda: (StreamHealth(received=7, lost=2), 1000),
            told.append,
        )
        known_to = rig.known_to.model_dump(exclude_none=True)
        source = LiveSource(
            run_facts(plan, "SIM", SCALE, rig.nominal(), known_to),
            queue,
            clock,
            Legs(rig.nominal()),
        )
        yield Watched(run_queue, LiveRun(source), stop_request, told, clock, plan)
    finally:
        queue.remove()
