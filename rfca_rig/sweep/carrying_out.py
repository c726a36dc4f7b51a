"""Carries a sweep out: hands spans of cases to an executor, keeps what comes back on disk, and puts it together at the end."""

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
    """The whole sweep, from where it stands in `folder`; the same bytes there in the end, however often it was stopped on the way.

    Results that came are on disk when this ends with an exception. Raises BadInput for a folder of another sweep, RigError, DiskFull.
    """
    shards = Shards(folder, settle(plan, folder))
    with shards.held():
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
    size = measured_pace(plan, clocks()).cases_per_shard
    here = plan.count - sum(map(len, gaps))
    told(CASES, here, plan.count)
    lost = []
    for span, rows in map_unordered(executor, partial(compute, plan), cut(gaps, size), clocks):
        if isinstance(rows, Failed):
            lost.append(span)
            continue
        shards.write(span, rows)
        here += len(span)
        told(CASES, here, plan.count)
    for span, found in map_unordered(executor, partial(compute, plan), cut(lost, 1), clocks):
        shards.write(span, _rows(plan, span, found))
        here += 1
        told(CASES, here, plan.count)


def _rows(plan: SweepPlan, span: CaseRange, found: Rows | Failed) -> Rows:
    """One case, which is told as failed where it ends whoever computes it."""
    return failed(plan, span, found.reason) if isinstance(found, Failed) else found


def merged(plan: SweepPlan, shards: Shards) -> SweepResult:
    """All shards as one table, in the order of the cases. Raises BadInput for a shard that is damaged, or cannot be."""
    spans = shards.spans()
    if sum(map(len, spans)) != plan.count:
        raise BadInput(f"{shards.folder}: holds some cases twice; remove the folder, and the same command computes them anew")
    rows = [shards.read(span) for span in spans]
    return SweepResult(plan, np.concatenate([each.values for each in rows]), tuple(remark for each in rows for remark in each.remarks))
