"""The exam from end to end: cases are written and sealed, each is diagnosed as for any user, then the truths are opened and marked.

What an interrupted exam has done stays: the same call goes on where it stood.
"""

import shutil
import traceback
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, as_completed
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

from rfca_rig.clock import Clock
from rfca_rig.errors import BadInput, RigError, SimulationFailed
from rfca_rig.exam.crew import Told, crew, silent
from rfca_rig.exam.marking import mark
from rfca_rig.exam.plan import Plan
from rfca_rig.exam.score import Marks
from rfca_rig.exam.write import write_all

DIAGNOSES, CRASHES, REFUSAL, SECONDS = "diagnoses", "crashed", "refused.txt", "seconds.txt"

Diagnose = Callable[[Path, Path], object]
"""Reads the campaign in the first folder, writes diagnosis.json into the second, which is not there yet."""

Clocks = Callable[[], Clock]
"""Makes the clock of one process, to time its diagnoses with."""


def examine(
    folder: Path,
    seed: int,
    numbers: Mapping[str, int],
    diagnose: Diagnose,
    workers: int = 0,
    clocks: Clocks | None = None,
    told: Told = silent,
) -> Marks:
    """The marks of `diagnose` on newly written cases, which stay in `folder`/campaigns, with its answers in `folder`/diagnoses.

    A BadInput or SimulationFailed is an answer too, that the campaign cannot be used, and is kept as text. Any other exception is not:
    then the other cases are answered yet, nothing is marked, and RigError names the case.
    """
    plan = Plan(seed, numbers)
    with crew(workers) as executor:
        campaigns = write_all(folder, plan, executor, told)
        answer_all(campaigns, folder, diagnose, executor, clocks, told)
    return mark(folder, folder / DIAGNOSES)


def answer_all(
    campaigns: Sequence[Path], folder: Path, diagnose: Diagnose, executor: Executor, clocks: Clocks | None = None, told: Told = silent
) -> None:
    """A diagnosis of each campaign that has none yet."""
    (folder / DIAGNOSES).mkdir(exist_ok=True)
    to_answer = [campaign for campaign in campaigns if not (folder / DIAGNOSES / campaign.name).is_dir()]
    told("campaigns diagnosed", len(campaigns) - len(to_answer), len(campaigns))
    asked = {executor.submit(answer, campaign, folder / DIAGNOSES / campaign.name, diagnose, clocks): campaign for campaign in to_answer}
    crashed: dict[str, BaseException] = {}
    for done, future in enumerate(as_completed(asked), start=len(campaigns) - len(to_answer) + 1):
        error = future.exception()
        if isinstance(error, BrokenProcessPool):
            raise RigError("a worker process was ended from outside, perhaps for want of memory; the same command continues")
        _keep(error, folder / CRASHES / f"{asked[future].name}.txt")
        if error is not None:
            crashed[asked[future].name] = error
        told("campaigns diagnosed", done, len(campaigns))
    if crashed:
        first, error = min(crashed.items())
        raise RigError(
            f"{len(crashed)} of {len(campaigns)} diagnoses crashed, as {first} with {_line(error)}; "
            f"nothing is marked; {folder / CRASHES} shows where, the same command tries them again"
        )


def answer(campaign: Path, into: Path, diagnose: Diagnose, clocks: Clocks | None = None) -> None:
    """One diagnosis, with the seconds it took. It is there as a whole or not at all: its folder gets its name last."""
    clock = clocks() if clocks else None
    partial = into.with_name(f".{into.name}.writing")
    shutil.rmtree(partial, ignore_errors=True)
    try:
        diagnose(campaign, partial)
    except (BadInput, SimulationFailed) as error:
        partial.mkdir(exist_ok=True)
        (partial / REFUSAL).write_text(f"{error}\n", encoding="utf-8")
    if clock is not None:
        (partial / SECONDS).write_text(f"{clock.now_s():.1f}\n", encoding="utf-8")
    partial.rename(into)


def _line(error: BaseException) -> str:
    return " ".join("".join(traceback.format_exception_only(error)).split())


def _keep(error: BaseException | None, path: Path) -> None:
    """The trace of a crash, until the case is answered."""
    path.unlink(missing_ok=True)
    if error is not None:
        path.parent.mkdir(exist_ok=True)
        path.write_text("".join(traceback.format_exception(error)), encoding="utf-8")
