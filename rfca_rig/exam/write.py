"""Writes cases of the exam: python -m rfca_rig.exam.write --out DIR --seed 1 --cases 40."""

import argparse
import shutil
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from rfca_rig.errors import RigError
from rfca_rig.exam.campaign_of import write_campaign
from rfca_rig.exam.cases import KINDS, Case, drawn_cases, shared_out
from rfca_rig.exam.crew import Told, crew, silent
from rfca_rig.exam.plan import Plan, begin
from rfca_rig.exam.sealing import complete, is_sealed, seal_all, unwritten
from rfca_rig.exam.truth import truth_of

CAMPAIGNS = "campaigns"


def write_cases(folder: Path, seed: int, numbers: Mapping[str, int], workers: int = 0) -> list[Path]:
    """Writes as many cases of each kind as `numbers` says; returns the campaign folders, `folder`/campaigns/case-NNNN.

    The truths are sealed before the first campaign is written. `workers` processes share the work, see `crew`. What is there already
    from the same plan stays as it is. Raises BadInput where `folder` holds something else, or where a kind is unknown.
    """
    plan = Plan(seed, numbers)
    with crew(workers) as executor:
        return write_all(folder, plan, executor)


def write_all(folder: Path, plan: Plan, executor: Executor, told: Told = silent) -> list[Path]:
    """The same, by `executor`; `told` hears how far it is."""
    begin(folder, plan)
    cases = drawn_cases(plan.seed, plan.numbers)
    _seal(cases, folder, executor, told)
    folders = [folder / CAMPAIGNS / case.id for case in cases]
    to_write = [(case, into) for case, into in zip(cases, folders, strict=True) if not into.is_dir()]
    there = len(cases) - len(to_write)
    told("campaigns written", there, len(cases))
    for done, _ in enumerate(executor.map(_write_whole, *zip(*to_write, strict=True)) if to_write else (), start=there + 1):
        told("campaigns written", done, len(cases))
    return folders


def _seal(cases: Sequence[Case], folder: Path, executor: Executor, told: Told) -> None:
    """Seals all truths, or completes what was sealed."""
    sealed = is_sealed(folder)
    missing = set(unwritten(folder)) if sealed else {case.id for case in cases}
    to_seal = [case for case in cases if case.id in missing]
    told("truths sealed", len(cases) - len(to_seal), len(cases))
    truths: list[dict[str, Any]] = []
    for truth in executor.map(truth_of, to_seal):
        truths.append(truth)
        told("truths sealed", len(cases) - len(to_seal) + len(truths), len(cases))
    (complete if sealed else seal_all)(truths, folder)


def _write_whole(case: Case, folder: Path) -> None:
    """A campaign that is there is whole: it gets its name last."""
    partial = folder.with_name(f".{folder.name}.writing")
    shutil.rmtree(partial, ignore_errors=True)
    write_campaign(case, partial)
    partial.rename(folder)


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(description="Writes campaigns with concealed physics, and the truth about them under seal.")
    parser.add_argument("--out", type=Path, required=True, help="a new folder, or one where the same was interrupted")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cases", type=int, default=40, help="how many, kinds in the proportions of the whole exam")
    parser.add_argument("--workers", type=int, default=1, help="processes that share the work")
    parser.add_argument("--kind", choices=KINDS, help="cases of this kind only")
    asked = parser.parse_args()
    numbers = {asked.kind: asked.cases} if asked.kind else shared_out(asked.cases)
    try:
        folders = write_cases(asked.out, asked.seed, numbers, asked.workers)
    except RigError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    print(f"{len(folders)} campaigns in {asked.out / CAMPAIGNS}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
