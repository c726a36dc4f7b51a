"""A finished exam: its marks, and each case with what is in it, what was said and what came of it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rfca_rig.errors import BadInput
from rfca_rig.exam.ablation import TakenOut, taken_out
from rfca_rig.exam.answer import Said, read_said
from rfca_rig.exam.claims import parameter_errors
from rfca_rig.exam.examine import DIAGNOSES, SECONDS
from rfca_rig.exam.follow_up import Way, ways
from rfca_rig.exam.outcome import Truth, outcome, truth_in
from rfca_rig.exam.plan import ExamPlan, read_plan
from rfca_rig.exam.score import Marks, gap_closed, score
from rfca_rig.exam.scoring import DIAGNOSIS
from rfca_rig.exam.sealing import open_all


@dataclass(frozen=True)
class Deviation:
    """One parameter of a true name: its relative error, see `parameter_errors`, and whether the 90 % interval holds the truth.

    `covered` is None for whole numbers, which have no interval.
    """

    effect: str
    parameter: str
    error: float
    covered: bool | None


@dataclass(frozen=True)
class MarkedCase:
    """One case. `concealed` names what is in it: effects, strangers, or what its file says wrongly; empty where nothing is.

    `named` are the effects that the diagnosis stands by, with their probabilities; `left` is how far the forces shift beyond what
    nominal values explain, in units of the noise; `seconds` how long the diagnosis took; None where not known.
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
    deviations: tuple[Deviation, ...]
    gap_closed: float | None
    seconds: float | None


@dataclass(frozen=True)
class Examined:
    """The whole exam; `ways` tells what follow-ups of open cases came to, `taken_out` what was said of effects that the catalogue did not
    hold, where that was done.
    """

    plan: ExamPlan
    marks: Marks
    cases: tuple[MarkedCase, ...]
    ways: tuple[Way, ...] = ()
    taken_out: TakenOut | None = None

    @property
    def words(self) -> str:
        """As in "seed 1, 500 cases"."""
        planned = sum(self.plan.numbers.values())
        return self.plan.words if len(self.cases) == planned else f"{self.plan.words}, {len(self.cases)} of them so far"


def examined(folder: Path) -> Examined:
    """Opens the truths of the exam in `folder` and marks it. Raises BadInput where it is not whole."""
    return Examined(read_plan(folder), *_marks_of(folder, open_all(folder)), ways(folder), taken_out(folder))


def examined_so_far(folder: Path) -> Examined:
    """The marks of what is diagnosed already; all other truths stay sealed. Raises BadInput where nothing is diagnosed yet."""
    plan, answers = read_plan(folder), folder / DIAGNOSES
    answered = {path.name for path in answers.iterdir() if path.is_dir()} if answers.is_dir() else set()
    truths = open_all(folder, answered)
    if not truths:
        raise BadInput(f"{folder}: nothing is diagnosed yet; leave out --so-far to go on with it")
    return Examined(plan, *_marks_of(folder, truths))


def _marks_of(folder: Path, truths: Sequence[Mapping[str, Any]]) -> tuple[Marks, tuple[MarkedCase, ...]]:
    answers = folder / DIAGNOSES
    said = {truth["case"]: read_said(answers / truth["case"] / DIAGNOSIS) for truth in truths}
    marked = tuple(_marked(truth, said[truth["case"]], answers / truth["case"] / SECONDS) for truth in truths)
    return score(truths, said), marked


def _marked(truth: Mapping[str, Any], said: Said, seconds: Path) -> MarkedCase:
    true = truth_in(truth)
    return MarkedCase(
        id=true.case,
        kind=true.kind,
        concealed=(*truth["effects"], *truth["strangers"], *([truth["mislabelled"]] if truth["mislabelled"] else [])),
        strength=true.strength,
        left=true.left,
        verdict=said.verdict,
        named=tuple(claim.id for claim in said.named),
        probabilities=tuple(claim.probability for claim in said.named),
        outcome=outcome(true, said),
        deviations=_deviations(true, said),
        gap_closed=gap_closed(said),
        seconds=float(seconds.read_text(encoding="utf-8")) if seconds.is_file() else None,
    )


def _deviations(truth: Truth, said: Said) -> tuple[Deviation, ...]:
    """None where the law is another than the catalogue's, whose parameters mean nothing then."""
    if truth.lawless:
        return ()
    named = [(claim, name) for claim in said.named for name in claim.parameters if name in truth.effects.get(claim.id, {})]
    errors = [each for claim in said.named for each in parameter_errors(truth, claim)]
    return tuple(Deviation(claim.id, name, error, covered) for (claim, name), (error, covered) in zip(named, errors, strict=True))
