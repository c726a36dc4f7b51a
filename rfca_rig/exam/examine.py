"""The exam from end to end: cases are written and sealed, each is diagnosed as for any user, then the truths are opened and marked.

What an interrupted exam has done stays: the same call goes on where it stood.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

from rfca_rig.clock import Clock
from rfca_rig.errors import BadInput, RigError, SimulationFailed
from rfca_rig.exam.plan import ExamPlan
from rfca_rig.exam.score import Marks
from rfca_rig.exam.scoring import mark
from rfca_rig.exam.write import write_all
from rfca_rig.executors.base import InProcessExecutor, TaskExecutor
from rfca_rig.executors.mapping import Failed, map_unordered
from rfca_rig.progress import Told, silent
from rfca_rig.recording.atomic_dir import see_afresh, sweep_out, whole

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
    executor: TaskExecutor | None = None,
    clocks: Clocks | None = None,
    told: Told = silent,
) -> Marks:
    """The marks of `diagnose` on newly written cases, which stay in `folder`/campaigns, with its answers in `folder`/diagnoses.

    `executor` does the work, this process if it is not given. A BadInput or SimulationFailed is an answer too, that the campaign cannot be
    used, and is kept as text. Any other exception is not: then the other cases are answered yet, nothing is marked, and RigError names
    the case.
    """
    executor = executor or InProcessExecutor()
    campaigns = write_all(folder, ExamPlan(seed, numbers), executor, told)
    answer_all(campaigns, folder, diagnose, executor, clocks, told)
    return mark(folder, folder / DIAGNOSES)


def answer_all(
    campaigns: Sequence[Path], folder: Path, diagnose: Diagnose, executor: TaskExecutor, clocks: Clocks | None = None, told: Told = silent
) -> None:
    """A diagnosis of each campaign that has none yet."""
    diagnoses = folder / DIAGNOSES
    diagnoses.mkdir(exist_ok=True)
    sweep_out(diagnoses)
    to_answer = [campaign.resolve() for campaign in campaigns if not (diagnoses / campaign.name).is_dir()]
    before = len(campaigns) - len(to_answer)
    told("campaigns diagnosed", before, len(campaigns))
    crashed: dict[str, Failed] = {}
    work = partial(answer, diagnoses.resolve(), diagnose, clocks)
    for number, (campaign, result) in enumerate(map_unordered(executor, work, to_answer), start=before + 1):
        _keep(result, folder / CRASHES / f"{campaign.name}.txt")
        if isinstance(result, Failed):
            crashed[campaign.name] = result
        told("campaigns diagnosed", number, len(campaigns))
    if crashed:
        first, failed = min(crashed.items())
        raise RigError(
            f"{len(crashed)} of {len(campaigns)} diagnoses crashed, as {first} with {failed.reason}; "
            f"nothing is marked; {folder / CRASHES} shows where, the same command tries them again"
        )
    see_afresh(diagnoses)


def answer(diagnoses: Path, diagnose: Diagnose, clocks: Clocks | None, campaign: Path) -> None:
    """One diagnosis, with the seconds it took. It is there as a whole or not at all."""
    clock = clocks() if clocks else None
    with whole(diagnoses / campaign.name) as into:
        try:
            diagnose(campaign, into)
        except (BadInput, SimulationFailed) as error:
            into.mkdir(exist_ok=True)
            (into / REFUSAL).write_text(f"{error}\n", encoding="utf-8")
        if clock is not None:
            (into / SECONDS).write_text(f"{clock.now_s():.1f}\n", encoding="utf-8")


def _keep(result: Failed | None, path: Path) -> None:
    """The trace of a crash, until the case is answered."""
    path.unlink(missing_ok=True)
    if result is not None:
        path.parent.mkdir(exist_ok=True)
        path.write_text(result.trace or f"{result.reason}\n", encoding="utf-8")
