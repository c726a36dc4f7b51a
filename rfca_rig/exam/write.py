"""Writes cases of the exam and seals their truths.

Run: python -m rfca_rig.exam.write --out DIR --seed 1 --cases 40
"""

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from rfca_rig.errors import RigError
from rfca_rig.exam.cases import KINDS, Case, draw_cases, split_numbers
from rfca_rig.exam.pendulums.campaign import truth_of_pendulum, write_pendulum_campaign
from rfca_rig.exam.pendulums.cases import PendulumCase
from rfca_rig.exam.sealing import (
    ExamPlan,
    begin,
    is_sealed,
    list_unwritten,
    seal_all,
    write_missing,
)
from rfca_rig.exam.simulate_campaign import write_campaign
from rfca_rig.exam.truth import truth_of
from rfca_rig.executors.mapping import TaskExecutor, TaskFailure, map_unordered, process_executor
from rfca_rig.progress import ProgressReport, ignore_named_progress
from rfca_rig.recording.atomic import atomic_directory, remove_leftovers

Job = TypeVar("Job")
Result = TypeVar("Result")

CAMPAIGNS = "campaigns"


def run_jobs(
    executor: TaskExecutor,
    work: Callable[[Job], Result],
    jobs: Sequence[Job],
    name_of: Callable[[Job], str],
    what: str,
    report_progress: ProgressReport,
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
    what, report_progress : str, callable
        `report_progress` is called with `what`, the number done and the total.
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
    report_progress(what, before, of)
    for job, result in map_unordered(executor, work, jobs):
        if isinstance(result, TaskFailure):
            failed[name_of(job)] = result
        else:
            results[name_of(job)] = result
        report_progress(what, before + len(results), of)
    if failed:
        first, why = min(failed.items())
        raise RigError(
            f"{what}: all but {len(failed)} of {of}, as {first} not with {why.reason}; "
            "the same command tries them again"
        )
    return results


def write_cases(
    folder: Path, seed: int, numbers: Mapping[str, int], workers: int = 0
) -> list[Path]:
    """Write `numbers` of cases of each kind; returns the campaign folders,
    `folder`/campaigns/case-NNNN.

    The truths are sealed before the first campaign is written. `workers` processes share the work,
    see `executors.local`. Cases that exist already from the same plan are kept. Raises BadInput
    where `folder` holds something else, or where a kind is unknown.
    """
    plan = ExamPlan(seed, numbers)
    with process_executor(workers) as executor:
        return write_all(folder, plan, executor)


def write_all(
    folder: Path,
    plan: ExamPlan,
    executor: TaskExecutor,
    report_progress: ProgressReport = ignore_named_progress,
) -> list[Path]:
    """As `write_cases`, with an executor; `report_progress` is called with the progress."""
    begin(folder, plan)
    cases = draw_cases(plan.seed, plan.numbers)
    # Seal all truths, or complete an interrupted sealing. Hashes are written once. After an
    # interruption only contents are added, which must match their hashes when they are opened.
    sealed = is_sealed(folder)
    if sealed:
        missing = set(list_unwritten(folder))
    else:
        missing = {case.id for case in cases}
    to_seal = [case for case in cases if case.id in missing]
    truths = run_jobs(
        executor,
        _truth_of,
        to_seal,
        _id,
        "truths sealed",
        report_progress,
        len(cases) - len(to_seal),
    )
    in_order = [truths[case.id] for case in to_seal]
    if sealed:
        write_missing(in_order, folder)
    else:
        seal_all(in_order, folder)
    campaigns = folder / CAMPAIGNS
    remove_leftovers(campaigns)
    to_write = [case for case in cases if not (campaigns / case.id).is_dir()]
    before = len(cases) - len(to_write)
    run_jobs(
        executor,
        partial(_write_whole, campaigns.resolve()),
        to_write,
        _id,
        "campaigns written",
        report_progress,
        before,
    )
    return [campaigns / case.id for case in cases]


def _id(case: Case | PendulumCase) -> str:
    return case.id


def _truth_of(case: Case | PendulumCase) -> dict[str, Any]:
    if isinstance(case, PendulumCase):
        return truth_of_pendulum(case)
    return truth_of(case)


def _write_whole(campaigns: Path, case: Case | PendulumCase) -> None:
    """Write one campaign folder atomically: a folder that exists is complete."""
    with atomic_directory(campaigns / case.id) as into:
        if isinstance(case, PendulumCase):
            write_pendulum_campaign(case, into)
        else:
            write_campaign(case, into)


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(
        description="Writes campaigns with concealed physics, and the truth about them under seal."
    )
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        help="a new folder, or one where the same was interrupted",
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--cases", type=int, default=40, help="how many, kinds in the proportions of the whole exam"
    )
    parser.add_argument("--workers", type=int, default=1, help="processes that share the work")
    parser.add_argument("--kind", choices=KINDS, help="cases of this kind only")
    arguments = parser.parse_args()
    if arguments.kind:
        numbers = {arguments.kind: arguments.cases}
    else:
        numbers = split_numbers(arguments.cases)
    try:
        folders = write_cases(arguments.out, arguments.seed, numbers, arguments.workers)
    except RigError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    print(f"{len(folders)} campaigns in {arguments.out / CAMPAIGNS}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
