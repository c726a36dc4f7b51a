"""Ablation: the diagnosis of effects that are removed from its catalogue, each in turn.

The cases are those of a finished exam with one detectable hidden effect. Each is diagnosed again without that effect in the catalogue.
Then no name is right, and a confident one is the worst possible answer.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from rfca_rig.exam.answer import DETECTABLE, NOTHING, ParsedDiagnosis, Truth, parse_truth, read_diagnosis
from rfca_rig.exam.cases import SINGLE
from rfca_rig.exam.claims import CONFIDENT
from rfca_rig.exam.examine import diagnose_campaign
from rfca_rig.exam.score import Share
from rfca_rig.exam.scoring import DIAGNOSIS
from rfca_rig.exam.sealing import open_all
from rfca_rig.exam.write import CAMPAIGNS, run_jobs
from rfca_rig.executors.mapping import TaskExecutor
from rfca_rig.progress import ProgressReport, ignore_named_progress
from rfca_rig.recording.atomic import refresh_nfs_cache, remove_leftovers

FOLDER = "taken-out"

DiagnoseWithout = Callable[[str, Path, Path], object]
"""Without the effect of that id in the catalogue, reads the campaign in the first folder and writes diagnosis.json into the second."""


def run_ablation(
    folder: Path, diagnose: DiagnoseWithout, executor: TaskExecutor, report_progress: ProgressReport = ignore_named_progress
) -> None:
    """Diagnose every such case of the exam in `folder` without its effect, into `folder`/taken-out. Finished ones are kept.

    Raises RigError where one could not be diagnosed, after the others are done.
    """
    answers = folder.resolve() / FOLDER
    answers.mkdir(exist_ok=True)
    remove_leftovers(answers)
    to_diagnose = [truth for truth in _visible(folder) if not (answers / truth.case).is_dir()]
    jobs = [(truth.case, effect) for truth in to_diagnose for effect in truth.effects]
    run_jobs(executor, partial(_diagnose, folder.resolve(), diagnose), jobs, _case, "entries taken out", report_progress)
    refresh_nfs_cache(answers)


def _case(job: tuple[str, str]) -> str:
    return job[0]


def _visible(folder: Path) -> list[Truth]:
    return [truth for truth in map(parse_truth, open_all(folder)) if truth.kind == SINGLE and truth.left >= DETECTABLE]


def _diagnose(folder: Path, diagnose: DiagnoseWithout, job: tuple[str, str]) -> None:
    case, effect = job
    diagnose_campaign(folder / FOLDER, partial(diagnose, effect), None, folder / CAMPAIGNS / case)


@dataclass(frozen=True)
class WronglyNamed:
    """A case whose effect was removed and in which effects were named nevertheless, with the lowest of their probabilities."""

    case: str
    effect: str
    named: tuple[str, ...]
    probability: float


@dataclass(frozen=True)
class AblationResult:
    """Shares of cases with a wrong name at CONFIDENT or more, with "unexplained" and with "nothing missing"; and all named ones."""

    confident_wrong: Share
    unexplained: Share
    silent: Share
    named: tuple[WronglyNamed, ...]

    @property
    def words(self) -> str:
        wrong, unexplained = self.confident_wrong, self.unexplained
        return (
            f"each entry taken out of the catalogue: {wrong.hits} of {wrong.of} given a wrong name at {100.0 * CONFIDENT:g} % or more, "
            f"{unexplained.hits} reported as unexplained, {self.silent.hits} as nothing missing"
        )


def read_ablation(folder: Path) -> AblationResult | None:
    """Results of the ablation in an exam's folder; None where it was not done."""
    answers = folder / FOLDER
    if not answers.is_dir():
        return None
    judged = [(truth, read_diagnosis(answers / truth.case / DIAGNOSIS)) for truth in _visible(folder) if (answers / truth.case).is_dir()]
    return AblationResult(
        confident_wrong=_share([any(claim.probability >= CONFIDENT for claim in result.named) for _, result in judged]),
        unexplained=_share([not result.named and result.verdict != NOTHING for _, result in judged]),
        silent=_share([result.verdict == NOTHING for _, result in judged]),
        named=tuple(_judge_named_case(truth, result) for truth, result in judged if result.named),
    )


def _judge_named_case(truth: Truth, result: ParsedDiagnosis) -> WronglyNamed:
    # The cases are those of one effect, see `_visible`.
    (effect,) = truth.effects
    return WronglyNamed(truth.case, effect, tuple(claim.id for claim in result.named), min(claim.probability for claim in result.named))


def _share(hits: Sequence[bool]) -> Share:
    return Share(sum(hits), len(hits))
