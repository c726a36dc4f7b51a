"""Runs jobs to their end: one that fails does not stop the others and is reported after them."""

from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

from rfca_rig.errors import RigError
from rfca_rig.executors.mapping import TaskExecutor, TaskFailure, map_unordered
from rfca_rig.progress import ProgressReport

Job = TypeVar("Job")
Result = TypeVar("Result")


def run_jobs(
    executor: TaskExecutor,
    work: Callable[[Job], Result],
    jobs: Sequence[Job],
    name_of: Callable[[Job], str],
    what: str,
    told: ProgressReport,
    before: int = 0,
) -> dict[str, Result]:
    """Run `work` on all `jobs` and return the results by name.

    Parameters
    ----------
    executor : TaskExecutor
        Does the work.
    work, jobs : callable, sequence
        The function and its arguments.
    name_of : callable
        Name of a job, the key of its result.
    what, told : str, callable
        `told` is called with `what`, the number done and the total.
    before : int
        Jobs that were done earlier; they count in the progress.

    Raises
    ------
    RigError
        Where a job fails, after the others are done.
    """
    results: dict[str, Result] = {}
    failed: dict[str, TaskFailure] = {}
    of = before + len(jobs)
    told(what, before, of)
    for job, result in map_unordered(executor, work, jobs):
        if isinstance(result, TaskFailure):
            failed[name_of(job)] = result
        else:
            results[name_of(job)] = result
        told(what, before + len(results), of)
    _raise_with_the_first(failed, what, of)
    return results


def _raise_with_the_first(failed: Mapping[str, TaskFailure], what: str, of: int) -> None:
    if failed:
        first, why = min(failed.items())
        raise RigError(f"{what}: all but {len(failed)} of {of}, as {first} not with {why.reason}; the same command tries them again")
