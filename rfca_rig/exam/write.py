"""Writes cases of the exam: python -m rfca_rig.exam.write --out DIR --seed 1 --cases 40."""

import argparse
import sys
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from rfca_rig.errors import BadInput, RigError
from rfca_rig.exam.campaign_of import write_campaign
from rfca_rig.exam.cases import KINDS, drawn_cases, shared_out
from rfca_rig.exam.sealing import seal_all
from rfca_rig.exam.truth import truth_of

CAMPAIGNS = "campaigns"


def write_cases(folder: Path, seed: int, numbers: Mapping[str, int], workers: int = 1) -> list[Path]:
    """Writes as many cases of each kind as `numbers` says; returns the campaign folders, `folder`/campaigns/case-NNNN.

    The truths are sealed before the first campaign is written. `workers` processes share the work. Raises BadInput where `folder`
    holds something already, or where a kind is unknown.
    """
    unknown = set(numbers) - set(KINDS)
    if unknown:
        raise BadInput(f"kind {sorted(unknown)[0]!r} is unknown; there are {', '.join(KINDS)}")
    if folder.exists() and any(folder.iterdir()):
        raise BadInput(f"{folder}: is not empty; name a new folder")
    cases = drawn_cases(seed, numbers)
    folders = [folder / CAMPAIGNS / case.id for case in cases]
    if workers == 1:
        seal_all([truth_of(case) for case in cases], folder)
        for case, into in zip(cases, folders, strict=True):
            write_campaign(case, into)
        return folders
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        seal_all(list(pool.map(truth_of, cases)), folder)
        list(pool.map(write_campaign, cases, folders))
    return folders


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(description="Writes campaigns with concealed physics, and the truth about them under seal.")
    parser.add_argument("--out", type=Path, required=True, help="a new folder")
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
