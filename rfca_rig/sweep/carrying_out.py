"""Runs a sweep: sends ranges of cases to an executor, stores their results on disk, and merges them at the end."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from rfca_rig.clock import Clock
from rfca_rig.errors import BadInput
from rfca_rig.executors.base import TaskExecutor
from rfca_rig.executors.mapping import TaskFailure, map_unordered
from rfca_rig.progress import ProgressReport
from rfca_rig.sweep.cases import CaseRange, CaseRows, compute, make_failed_rows
from rfca_rig.sweep.identity import claim_folder
from rfca_rig.sweep.pilot import measure_pace
from rfca_rig.sweep.plan import SweepPlan
from rfca_rig.sweep.result import SweepResult, read_result, write_result
from rfca_rig.sweep.shards import Shards, find_gaps, split_gaps

CASES = "cases"


def run_sweep(plan: SweepPlan, folder: Path, executor: TaskExecutor, clocks: Callable[[], Clock], told: ProgressReport) -> SweepResult:
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
    shards = Shards(folder, claim_folder(plan, folder))
    with shards.held():
        # A finished sweep that stopped before its shards were removed only needs that.
        result = read_result(plan, folder)
        if result is None:
            _compute_missing(plan, shards, executor, clocks, told)
            result = merge_shards(plan, shards)
            write_result(result, folder)
        shards.clear()
    return result


def _compute_missing(plan: SweepPlan, shards: Shards, executor: TaskExecutor, clocks: Callable[[], Clock], told: ProgressReport) -> None:
    gaps = find_gaps(plan.count, shards.spans())
    if not gaps:
        return
    # Shards are sized by time, so that writing them costs little and an interruption loses little.
    size = measure_pace(plan, clocks()).cases_per_shard
    computed = plan.count - sum(map(len, gaps))
    told(CASES, computed, plan.count)
    lost = []
    for span, rows in map_unordered(executor, partial(compute, plan), split_gaps(gaps, size), clocks):
        if isinstance(rows, TaskFailure):
            lost.append(span)
            continue
        shards.write(span, rows)
        computed += len(span)
        told(CASES, computed, plan.count)
    # A lost shard is tried again case by case, so that one case that ends its worker does not take its neighbours along.
    for span, found in map_unordered(executor, partial(compute, plan), split_gaps(lost, 1), clocks):
        shards.write(span, _rows(plan, span, found))
        computed += 1
        told(CASES, computed, plan.count)


def _rows(plan: SweepPlan, span: CaseRange, found: CaseRows | TaskFailure) -> CaseRows:
    """Rows of one case; a case that ends its worker counts as failed."""
    return make_failed_rows(plan, span, found.reason) if isinstance(found, TaskFailure) else found


def merge_shards(plan: SweepPlan, shards: Shards) -> SweepResult:
    """All shards as one table, in the order of the cases. Raises BadInput for a damaged shard, or for cases that are stored twice."""
    spans = shards.spans()
    if sum(map(len, spans)) != plan.count:
        raise BadInput(f"{shards.folder}: holds some cases twice; remove the folder, and the same command computes them anew")
    rows = [shards.read(span) for span in spans]
    return SweepResult(plan, np.concatenate([each.values for each in rows]), tuple(remark for each in rows for remark in each.remarks))
