"""A finished exam: its scores, and for each case the hidden effects, the diagnosis and the
outcome.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rfca_rig.errors import BadInput
from rfca_rig.exam.answer import ParsedDiagnosis, Truth, outcome, parse_truth, read_diagnosis
from rfca_rig.exam.claims import parameter_errors
from rfca_rig.exam.examine import DIAGNOSES, SECONDS
from rfca_rig.exam.follow_up import AblationResult, ArmResult, read_ablation, ways
from rfca_rig.exam.score import ExamScores, gap_closed, score
from rfca_rig.exam.scoring import DIAGNOSIS
from rfca_rig.exam.sealing import ExamPlan, open_all, read_plan


@dataclass(frozen=True)
class ParameterDeviation:
    """One parameter of a rightly named effect: its relative error (see `parameter_errors`), and
    whether its 90 % interval holds the truth.

    `covered` is None for whole numbers, which have no interval.
    """

    effect: str
    parameter: str
    error: float
    covered: bool | None


@dataclass(frozen=True)
class ScoredCase:
    """One scored case.

    - `concealed`: its hidden effects, in or outside the catalogue, or the error of its file; empty
      where there is none.
    - `named`: the effects that the diagnosis names, with their `probabilities`.
    - `left`: shift of the forces beyond what nominal values explain, in units of the noise.
    - `seconds`: duration of the diagnosis; None where it is not known.
    """

    id: str
    kind: str
    concealed: tuple[str, ...]
    strength: float
    left: float
    verdict: str
    named: tuple[str, ...]
    probabilities: tuple[float, ...]
    outcome: str
    deviations: tuple[ParameterDeviation, ...]
    gap_closed: float | None
    seconds: float | None


@dataclass(frozen=True)
class ExamResult:
    """The whole exam; `ways` are the results of follow-ups, `taken_out` those of the ablation,
    where these were done.
    """

    plan: ExamPlan
    marks: ExamScores
    cases: tuple[ScoredCase, ...]
    ways: tuple[ArmResult, ...] = ()
    taken_out: AblationResult | None = None

    @property
    def words(self) -> str:
        """As in "seed 1, 500 cases"."""
        planned = sum(self.plan.numbers.values())
        if len(self.cases) == planned:
            return self.plan.words
        return f"{self.plan.words}, {len(self.cases)} of them so far"


def score_exam(folder: Path) -> ExamResult:
    """Open the truths of the exam in `folder` and score it. Raises BadInput where it is not
    complete.
    """
    return ExamResult(
        read_plan(folder),
        *_score_all(folder, open_all(folder)),
        ways(folder),
        read_ablation(folder),
    )


def score_exam_so_far(folder: Path) -> ExamResult:
    """Score the cases that are diagnosed already; all other truths stay sealed. Raises BadInput
    where nothing is diagnosed yet.
    """
    plan = read_plan(folder)
    answers = folder / DIAGNOSES
    if answers.is_dir():
        answered = {path.name for path in answers.iterdir() if path.is_dir()}
    else:
        answered = set()
    # Only these are opened: a truth that is known before its diagnosis would spoil the rest of the
    # exam.
    truths = open_all(folder, answered)
    if not truths:
        raise BadInput(f"{folder}: nothing is diagnosed yet; leave out --so-far to go on with it")
    return ExamResult(plan, *_score_all(folder, truths))


def _score_all(
    folder: Path, truths: Sequence[Mapping[str, Any]]
) -> tuple[ExamScores, tuple[ScoredCase, ...]]:
    answers = folder / DIAGNOSES
    answer_of = {
        truth["case"]: read_diagnosis(answers / truth["case"] / DIAGNOSIS) for truth in truths
    }
    marked = tuple(
        _score_case(truth, answer_of[truth["case"]], answers / truth["case"] / SECONDS)
        for truth in truths
    )
    return score(truths, answer_of), marked


def _score_case(truth: Mapping[str, Any], answer: ParsedDiagnosis, seconds: Path) -> ScoredCase:
    true = parse_truth(truth)
    concealed = [*truth["effects"], *truth["strangers"]]
    if truth["mislabelled"]:
        concealed.append(truth["mislabelled"])
    duration_s = None
    if seconds.is_file():
        duration_s = float(seconds.read_text(encoding="utf-8"))
    return ScoredCase(
        id=true.case,
        kind=true.kind,
        concealed=tuple(concealed),
        strength=true.strength,
        left=true.left,
        verdict=answer.verdict,
        named=tuple(claim.id for claim in answer.named),
        probabilities=tuple(claim.probability for claim in answer.named),
        outcome=outcome(true, answer),
        deviations=_deviations(true, answer),
        gap_closed=gap_closed(answer),
        seconds=duration_s,
    )


def _deviations(truth: Truth, answer: ParsedDiagnosis) -> tuple[ParameterDeviation, ...]:
    """Deviations of all parameters of true effects; empty where the true law is not the
    catalogue's, whose parameters mean nothing then.
    """
    if truth.lawless:
        return ()
    named = [
        (claim, name)
        for claim in answer.named
        for name in claim.parameters
        if name in truth.effects.get(claim.id, {})
    ]
    errors = [deviation for claim in answer.named for deviation in parameter_errors(truth, claim)]
    return tuple(
        ParameterDeviation(claim.id, name, error, covered)
        for (claim, name), (error, covered) in zip(named, errors, strict=True)
    )
