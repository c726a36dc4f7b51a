"""The exam from end to end: write and seal cases, diagnose each as for any user, then open the
truths and score.

An interrupted exam keeps its results: the same call resumes it.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

from rfca_rig.clock import Clock
from rfca_rig.errors import BadInput, RigError, SimulationFailed
from rfca_rig.exam.score import ExamScores
from rfca_rig.exam.scoring import score_folder
from rfca_rig.exam.sealing import ExamPlan
from rfca_rig.exam.write import write_all
from rfca_rig.executors.mapping import InProcessExecutor, TaskExecutor, TaskFailure, map_unordered
from rfca_rig.progress import ProgressReport, ignore_named_progress
from rfca_rig.recording.atomic import atomic_directory, refresh_nfs_cache, remove_leftovers

DIAGNOSES = "diagnoses"
CRASHES = "crashed"
REFUSAL = "refused.txt"
SECONDS = "seconds.txt"

Diagnose = Callable[[Path, Path], object]
"""Reads the campaign in the first folder, writes diagnosis.json into the second, which is new."""

Clocks = Callable[[], Clock]
"""Makes the clock of one process, to time its diagnoses with."""


def examine(
    folder: Path,
    seed: int,
    numbers: Mapping[str, int],
    diagnose: Diagnose,
    executor: TaskExecutor | None = None,
    clocks: Clocks | None = None,
    report_progress: ProgressReport = ignore_named_progress,
) -> ExamScores:
    """Score `diagnose` on newly written cases.

    Parameters
    ----------
    folder : Path
        Receives the cases in `campaigns` and the answers in `diagnoses`.
    seed, numbers : int, mapping
        Seed, and number of cases of each kind.
    diagnose : callable
        The diagnosis, see `Diagnose`.
    executor : TaskExecutor, optional
        Does the work; this process by default.
    clocks : callable, optional
        Makes a clock in each process, to time the diagnoses.
    report_progress : callable
        Called with the progress.

    Returns
    -------
    Marks
        The scores.

    Raises
    ------
    RigError
        Where a diagnosis raises anything but BadInput or SimulationFailed. The other cases are
        still answered, nothing is scored, and the message names the case. A BadInput or
        SimulationFailed counts as an answer, that the campaign cannot be used.
    """
    executor = executor or InProcessExecutor()
    campaigns = write_all(folder, ExamPlan(seed, numbers), executor, report_progress)
    diagnose_campaigns(campaigns, folder, diagnose, executor, clocks, report_progress)
    return score_folder(folder, folder / DIAGNOSES)


def diagnose_campaigns(
    campaigns: Sequence[Path],
    folder: Path,
    diagnose: Diagnose,
    executor: TaskExecutor,
    clocks: Clocks | None = None,
    report_progress: ProgressReport = ignore_named_progress,
) -> None:
    """Diagnose each campaign that has no diagnosis yet. Raises RigError where one crashes, after
    the others are done.
    """
    diagnoses = folder / DIAGNOSES
    diagnoses.mkdir(exist_ok=True)
    remove_leftovers(diagnoses)
    to_answer = [
        campaign.resolve() for campaign in campaigns if not (diagnoses / campaign.name).is_dir()
    ]
    before = len(campaigns) - len(to_answer)
    report_progress("campaigns diagnosed", before, len(campaigns))
    crashed: dict[str, TaskFailure] = {}
    work = partial(diagnose_campaign, diagnoses.resolve(), diagnose, clocks)
    for number, (campaign, result) in enumerate(
        map_unordered(executor, work, to_answer), start=before + 1
    ):
        _keep(result, folder / CRASHES / f"{campaign.name}.txt")
        if isinstance(result, TaskFailure):
            crashed[campaign.name] = result
        report_progress("campaigns diagnosed", number, len(campaigns))
    if crashed:
        first, failed = min(crashed.items())
        raise RigError(
            f"{len(crashed)} of {len(campaigns)} diagnoses crashed, as {first} with "
            f"{failed.reason}; "
            f"nothing is marked; {folder / CRASHES} shows where, the same command tries them again"
        )
    # Other machines may have written these files: the local view of a network folder may be old.
    refresh_nfs_cache(diagnoses)


def diagnose_campaign(
    diagnoses: Path, diagnose: Diagnose, clocks: Clocks | None, campaign: Path
) -> None:
    """Diagnose one campaign and write the duration beside it, atomically."""
    clock = clocks() if clocks else None
    with atomic_directory(diagnoses / campaign.name) as into:
        try:
            diagnose(campaign, into)
        except (BadInput, SimulationFailed) as error:
            into.mkdir(exist_ok=True)
            (into / REFUSAL).write_text(f"{error}\n", encoding="utf-8")
        if clock is not None:
            (into / SECONDS).write_text(f"{clock.now_s():.1f}\n", encoding="utf-8")


def _keep(result: TaskFailure | None, path: Path) -> None:
    """Write the traceback of a crash, or delete an older one once the case is answered."""
    path.unlink(missing_ok=True)
    if result is not None:
        path.parent.mkdir(exist_ok=True)
        path.write_text(result.trace or f"{result.reason}\n", encoding="utf-8")
