"""Simulates many strokes in threads, on all cores."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import SimulationFailed
from rfca_rig.executors.cores import cores
from rfca_rig.model.chain import Tolerance
from rfca_rig.model.motion import ShaftMotion
from rfca_rig.model.parameters import RigModel
from rfca_rig.model.stroke import SimulatedStroke, simulate_stroke

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Job:
    """One stroke to simulate, with sample times `t_s` (m,); fields as the arguments of `simulate_stroke`."""

    rig: RigModel
    height_m: float
    motion: ShaftMotion
    t_s: Floats
    tolerance: Tolerance | None = None


def simulate_strokes(jobs: Sequence[Job], threads: int | None = None) -> list[SimulatedStroke | SimulationFailed]:
    """Simulates the strokes of `jobs`; each result is in the order of its job, a SimulationFailed where there is none.

    Bit for bit as one after the other. On `threads`, or as many as there are cores: compiled code releases the interpreter lock. Each
    thread takes every n-th job, so that neighbours, which tend to cost alike, are spread. Raises BadInput for effects that do not fit,
    as for a single stroke.
    """
    count = max(1, min(threads or cores(), len(jobs)))
    if count == 1:
        return [_stroke(job) for job in jobs]
    results: list[SimulatedStroke | SimulationFailed] = [SimulationFailed("not simulated")] * len(jobs)
    with ThreadPoolExecutor(count) as pool:
        for first, part in enumerate(pool.map(_simulate_in_turn, [jobs[first::count] for first in range(count)])):
            results[first::count] = part
    return results


def _simulate_in_turn(jobs: Sequence[Job]) -> list[SimulatedStroke | SimulationFailed]:
    return [_stroke(job) for job in jobs]


def _stroke(job: Job) -> SimulatedStroke | SimulationFailed:
    try:
        return simulate_stroke(job.rig, job.height_m, job.motion, job.t_s, job.tolerance)
    except SimulationFailed as failed:
        # One stroke that fails must not lose the others.
        return failed
