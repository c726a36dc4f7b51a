"""Tests whether the experiments that a diagnosis proposes settle open cases, and with fewer than
experiments drawn at random.

The open cases are those with too few recordings. The exam's simulator does the proposed experiment
on the same hidden rig, and old and new recordings are diagnosed together. This repeats until the
verdict is right with no alternative left. The control arm draws its experiments at random from the
rig's range.

An ablation diagnoses without an effect in the catalogue. Its cases are those of a finished exam
with one detectable hidden effect. Each is diagnosed again without that effect. Then no name is
right, and a confident one is the worst possible answer.
"""

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.exam.answer import (
    DETECTABLE,
    NAMED,
    NOTHING,
    RIGHT,
    ParsedDiagnosis,
    Truth,
    outcome,
    parse_truth,
    read_diagnosis,
)
from rfca_rig.exam.cases import POOR_DATA, SINGLE, Case, draw_cases
from rfca_rig.exam.claims import CONFIDENT, names_confidently
from rfca_rig.exam.examine import DIAGNOSES, Diagnose, diagnose_campaign
from rfca_rig.exam.score import Share
from rfca_rig.exam.scoring import DIAGNOSIS
from rfca_rig.exam.sealing import open_all, read_plan
from rfca_rig.exam.simulate_campaign import add_experiment
from rfca_rig.exam.write import CAMPAIGNS, run_jobs
from rfca_rig.executors.mapping import TaskExecutor
from rfca_rig.progress import ProgressReport, ignore_named_progress
from rfca_rig.recording.atomic import refresh_nfs_cache, remove_leftovers, write_atomically

FOLDER = "follow-ups"
RESULT = "follow-up.json"
PROPOSED, RANDOM = ARMS = ("proposed", "by lot")
# Number of experiments after which a case counts as not settled.
MAX_EXPERIMENTS = 4
HEIGHTS_MM = tuple(np.arange(195.0, 236.0, 5.0))
SPEEDS_RAD_S = (1.0, 1.5, 2.0, 2.4)
REPEATS = 3
# Share of static tables among the random experiments.
RANDOM_STATIC_SHARE = 0.3
RANDOM_STAGES = tuple(
    {"angle_deg": angle, "direction": "loading"}
    for angle in (60.0, 75.0, 90.0, 105.0, 120.0, 135.0)
)

Proposal = Mapping[str, Any]

ABLATION_FOLDER = "taken-out"

DiagnoseWithout = Callable[[str, Path, Path], object]


@dataclass(frozen=True)
class FollowUp:
    """Result of one case: number of experiments, whether they settled it, and the last answer."""

    case: str
    arm: str
    experiments: int
    settled: bool
    said: str


def follow_up(
    folder: Path,
    diagnose: Diagnose,
    executor: TaskExecutor,
    report_progress: ProgressReport = ignore_named_progress,
) -> None:
    """Follow all open cases of a finished exam in both arms, into `folder`/follow-ups. Finished
    ones are kept.

    Raises RigError where one fails, after the others are done.
    """
    plan = read_plan(folder)
    cases = {
        case.id: case
        for case in draw_cases(plan.seed, plan.numbers)
        if isinstance(case, Case) and case.kind == POOR_DATA
    }
    truths = {
        truth["case"]: parse_truth(truth) for truth in open_all(folder) if truth["case"] in cases
    }
    jobs = [(case, truths[id_], arm) for id_, case in cases.items() for arm in ARMS]
    run_jobs(
        executor,
        partial(follow_case, folder.resolve(), diagnose),
        jobs,
        _case_and_arm,
        "open cases followed",
        report_progress,
    )


def _case_and_arm(job: tuple[Case, Truth, str]) -> str:
    case, _, arm = job
    return f"{case.id} ({arm})"


def follow_case(folder: Path, diagnose: Diagnose, job: tuple[Case, Truth, str]) -> FollowUp:
    """Follow one case in one arm. Raises RigError where a campaign cannot be written."""
    case, truth, arm = job
    case_folder = folder / FOLDER / f"{case.id}-{arm.replace(' ', '-')}"
    result = case_folder / RESULT
    if result.is_file():
        return FollowUp(**json.loads(result.read_text(encoding="utf-8")))
    # Without a result the folder is from an interrupted attempt, whose rounds cannot be continued.
    shutil.rmtree(case_folder, ignore_errors=True)
    shutil.copytree(folder / CAMPAIGNS / case.id, case_folder / "campaign")
    trial = _rounds(
        case, truth, arm, case_folder, folder / DIAGNOSES / case.id / DIAGNOSIS, diagnose
    )
    write_atomically(result, json.dumps(asdict(trial), indent=1).encode())
    return trial


def _rounds(
    case: Case, truth: Truth, arm: str, case_folder: Path, first: Path, diagnose: Diagnose
) -> FollowUp:
    # A stream of its own: experiments must not repeat the noise of the case's recordings.
    random = np.random.default_rng([case.seed, 77])
    latest = first
    for number in range(1, MAX_EXPERIMENTS + 1):
        if arm == PROPOSED:
            proposal = _read_proposal(latest)
        else:
            proposal = draw_experiment(random)
        if proposal is None:
            break
        add_experiment(case, case_folder / "campaign", proposal, number)
        latest = case_folder / f"diagnosis-{number}" / DIAGNOSIS
        # A refusal is an answer too: the missing file reads as "refused".
        with suppress(BadInput, SimulationFailed):
            diagnose(case_folder / "campaign", latest.parent)
        # Settled: the verdict is right and each named effect is distinguishable from all others.
        answer = read_diagnosis(latest)
        alone = all(len(claim.members) == 1 for claim in answer.named)
        if answer.verdict in (NAMED, NOTHING) and outcome(truth, answer) == RIGHT and alone:
            return FollowUp(case.id, arm, number, settled=True, said=_in_words(latest))
    return FollowUp(case.id, arm, MAX_EXPERIMENTS, settled=False, said=_in_words(latest))


def _read_proposal(diagnosis: Path) -> Proposal | None:
    """The proposed experiment; None where there is none, or where it needs a person instead of
    the rig.
    """
    if not diagnosis.is_file():
        return None
    proposal: Proposal | None = json.loads(diagnosis.read_text(encoding="utf-8"))["next_experiment"]
    if proposal and proposal["protocol"]:
        return proposal
    return None


def draw_experiment(random: np.random.Generator) -> Proposal:
    """A random stroke or static table within the rig's range."""
    height_mm = float(random.choice(HEIGHTS_MM))
    if random.random() < RANDOM_STATIC_SHARE:
        return {"height_mm": height_mm, "stages": RANDOM_STAGES}
    return {
        "height_mm": height_mm,
        "speed_rad_s": float(random.choice(SPEEDS_RAD_S)),
        "repeats": REPEATS,
    }


def _in_words(diagnosis: Path) -> str:
    answer = read_diagnosis(diagnosis)
    return "+".join(claim.id for claim in answer.named) or answer.verdict


@dataclass(frozen=True)
class ArmResult:
    """All follow-ups of one arm: settled cases, number of cases, mean number of experiments.

    Cases whose hidden effects are not detectable are left out.
    """

    arm: str
    settled: int
    of: int
    experiments: float

    @property
    def words(self) -> str:
        return (
            f"open cases, next experiments {self.arm}: {self.settled} of {self.of} settled, "
            f"{self.experiments:.2f} experiments on average"
        )


def ways(folder: Path) -> tuple[ArmResult, ...]:
    """Results of the follow-ups in an exam's folder, by arm; empty where none were done."""
    trials = [
        FollowUp(**json.loads(path.read_text(encoding="utf-8")))
        for path in sorted((folder / FOLDER).glob(f"*/{RESULT}"))
    ]
    if trials:
        faint = {
            truth.case
            for truth in map(parse_truth, open_all(folder))
            if truth.effects and truth.left < DETECTABLE
        }
    else:
        faint = set()
    shown = [trial for trial in trials if trial.case not in faint]
    results = []
    for arm in ARMS:
        result = _way(arm, [trial for trial in shown if trial.arm == arm])
        if result.of:
            results.append(result)
    return tuple(results)


def _way(arm: str, trials: Sequence[FollowUp]) -> ArmResult:
    if trials:
        mean = float(np.mean([trial.experiments for trial in trials]))
    else:
        mean = np.nan
    return ArmResult(arm, sum(trial.settled for trial in trials), len(trials), mean)


"""Reads the campaign in the first folder and writes diagnosis.json into the second, without the
effect of that id in the catalogue."""


def run_ablation(
    folder: Path,
    diagnose: DiagnoseWithout,
    executor: TaskExecutor,
    report_progress: ProgressReport = ignore_named_progress,
) -> None:
    """Diagnose every such case of the exam in `folder` without its effect, into `folder`/taken-out.
    Finished ones are kept.

    Raises RigError where one could not be diagnosed, after the others are done.
    """
    answers = folder.resolve() / ABLATION_FOLDER
    answers.mkdir(exist_ok=True)
    remove_leftovers(answers)
    to_diagnose = [truth for truth in _visible(folder) if not (answers / truth.case).is_dir()]
    jobs = [(truth.case, effect) for truth in to_diagnose for effect in truth.effects]
    run_jobs(
        executor,
        partial(_diagnose, folder.resolve(), diagnose),
        jobs,
        _case,
        "entries taken out",
        report_progress,
    )
    refresh_nfs_cache(answers)


def _case(job: tuple[str, str]) -> str:
    return job[0]


def _visible(folder: Path) -> list[Truth]:
    return [
        truth
        for truth in map(parse_truth, open_all(folder))
        if truth.kind == SINGLE and truth.left >= DETECTABLE
    ]


def _diagnose(folder: Path, diagnose: DiagnoseWithout, job: tuple[str, str]) -> None:
    case, effect = job
    diagnose_campaign(
        folder / ABLATION_FOLDER, partial(diagnose, effect), None, folder / CAMPAIGNS / case
    )


@dataclass(frozen=True)
class WronglyNamed:
    """A case whose effect was removed and in which effects were named nevertheless, with the
    lowest of their probabilities.
    """

    case: str
    effect: str
    named: tuple[str, ...]
    probability: float


@dataclass(frozen=True)
class AblationResult:
    """Shares of cases with a wrong name at CONFIDENT or more, with "unexplained" and with
    "nothing missing"; and all named ones.
    """

    confident_wrong: Share
    unexplained: Share
    silent: Share
    named: tuple[WronglyNamed, ...]

    @property
    def words(self) -> str:
        wrong = self.confident_wrong
        unexplained = self.unexplained
        return (
            f"each effect removed from the catalogue in turn: {wrong.hits} of {wrong.of} "
            f"identified as another at {100.0 * CONFIDENT:g} % "
            f"or more, {unexplained.hits} reported as unexplained, {self.silent.hits} as "
            "nothing missing"
        )


def read_ablation(folder: Path) -> AblationResult | None:
    """Results of the ablation in an exam's folder; None where it was not done."""
    answers = folder / ABLATION_FOLDER
    if not answers.is_dir():
        return None
    judged = [
        (truth, read_diagnosis(answers / truth.case / DIAGNOSIS))
        for truth in _visible(folder)
        if (answers / truth.case).is_dir()
    ]
    return AblationResult(
        confident_wrong=_share([names_confidently(result) for _, result in judged]),
        unexplained=_share(
            [not result.named and result.verdict != NOTHING for _, result in judged]
        ),
        silent=_share([result.verdict == NOTHING for _, result in judged]),
        named=tuple(_judge_named_case(truth, result) for truth, result in judged if result.named),
    )


def _judge_named_case(truth: Truth, result: ParsedDiagnosis) -> WronglyNamed:
    # The cases are those of one effect, see `_visible`.
    (effect,) = truth.effects
    return WronglyNamed(
        truth.case,
        effect,
        tuple(claim.id for claim in result.named),
        min(claim.probability for claim in result.named),
    )


def _share(hits: Sequence[bool]) -> Share:
    return Share(sum(hits), len(hits))
