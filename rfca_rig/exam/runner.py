"""All cases of one kind of work, to their end: who fails keeps nobody else from it, and is named when the others are done."""

from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

from rfca_rig.errors import RigError
from rfca_rig.executors.base import TaskExecutor
from rfca_rig.executors.mapping import Failed, map_unordered
from rfca_rig.progress import Told

Job = TypeVar("Job")
Result = TypeVar("Result")


def worked_off(
    executor: TaskExecutor,
    work: Callable[[Job], Result],
    jobs: Sequence[Job],
    name_of: Callable[[Job], str],
    what: str,
    told: Told,
    before: int = 0,
) -> dict[str, Result]:
    """The results by name; `told` hears of `what` how many there are, with those that were there `before`.

    Raises RigError where one fails, when the others are done.
    """
    results: dict[str, Result] = {}
    failed: dict[str, Failed] = {}
    of = before + len(jobs)
    told(what, before, of)
    for job, result in map_unordered(executor, work, jobs):
        if isinstance(result, Failed):
            failed[name_of(job)] = result
        else:
            results[name_of(job)] = result
        told(what, before + len(results), of)
    _raise_with_the_first(failed, what, of)
    return results


def _raise_with_the_first(failed: Mapping[str, Failed], what: str, of: int) -> None:
    if failed:
        first, why = min(failed.items())
        raise RigError(f"{what}: all but {len(failed)} of {of}, as {first} not with {why.reason}; the same command tries them again")
