"""Runs a sweep: sends ranges of cases to an executor, stores their results on disk, and merges them at the end."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from rfca_rig.clock import Clock
from rfca_rig.errors import BadInput
from rfca_rig.executors.base import TaskExecutor
from rfca_rig.executors.mapping import Failed, map_unordered
from rfca_rig.progress import Told
from rfca_rig.sweep.cases import CaseRange, Rows, compute, failed
from rfca_rig.sweep.identity import settle
from rfca_rig.sweep.pilot import measured_pace
from rfca_rig.sweep.plan import SweepPlan
from rfca_rig.sweep.result import SweepResult, read_result, write_result
from rfca_rig.sweep.shards import Shards, cut, missing

CASES = "cases"


def carry_out(plan: SweepPlan, folder: Path, executor: TaskExecutor, clocks: Callable[[], Clock], told: Told) -> SweepResult:
    """Run the whole sweep, continuing from what `folder` already holds.

    Parameters
    ----------
    plan
        The sweep.
    folder
        Where it is stored.
    executor
        Computes the cases.
    clocks
        Makes a clock for each measurement of time.
    told
        Progress callback.

    Raises
    ------
    BadInput
        Where the folder belongs to another sweep.
    RigError, DiskFull
        Where the disk refuses.

    Notes
    -----
    The files are bitwise the same however often the sweep was interrupted. Results received before an exception are on disk.
    """
    shards = Shards(folder, settle(plan, folder))
    with shards.held():
        # A finished sweep that stopped before its shards were removed only needs that.
        result = read_result(plan, folder)
        if result is None:
            _compute_missing(plan, shards, executor, clocks, told)
            result = merged(plan, shards)
            write_result(result, folder)
        shards.clear()
    return result


def _compute_missing(plan: SweepPlan, shards: Shards, executor: TaskExecutor, clocks: Callable[[], Clock], told: Told) -> None:
    gaps = missing(plan.count, shards.spans())
    if not gaps:
        return
    # Shards are sized by time, so that writing them costs little and an interruption loses little.
    size = measured_pace(plan, clocks()).cases_per_shard
    computed = plan.count - sum(map(len, gaps))
    told(CASES, computed, plan.count)
    lost = []
    for span, rows in map_unordered(executor, partial(compute, plan), cut(gaps, size), clocks):
        if isinstance(rows, Failed):
            lost.append(span)
            continue
        shards.write(span, rows)
        computed += len(span)
        told(CASES, computed, plan.count)
    # A lost shard is tried again case by case, so that one case that ends its worker does not take its neighbours along.
    for span, found in map_unordered(executor, partial(compute, plan), cut(lost, 1), clocks):
        shards.write(span, _rows(plan, span, found))
        computed += 1
        told(CASES, computed, plan.count)


def _rows(plan: SweepPlan, span: CaseRange, found: Rows | Failed) -> Rows:
    """Rows of one case; a case that ends its worker counts as failed."""
    return failed(plan, span, found.reason) if isinstance(found, Failed) else found


def merged(plan: SweepPlan, shards: Shards) -> SweepResult:
    """All shards as one table, in the order of the cases. Raises BadInput for a damaged shard, or for cases that are stored twice."""
    spans = shards.spans()
    if sum(map(len, spans)) != plan.count:
        raise BadInput(f"{shards.folder}: holds some cases twice; remove the folder, and the same command computes them anew")
    rows = [shards.read(span) for span in spans]
    return SweepResult(plan, np.concatenate([each.values for each in rows]), tuple(remark for each in rows for remark in each.remarks))
