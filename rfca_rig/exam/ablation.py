"""What the diagnosis says of an effect that its catalogue does not hold: each entry taken out in turn.

The cases are those of a finished exam that conceal one effect which can be seen. Each is diagnosed again without that effect; then no name
is right, and a sure one is the worst answer there is.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from rfca_rig.exam.answer import NOTHING, Said, read_said
from rfca_rig.exam.cases import SINGLE
from rfca_rig.exam.claims import CONFIDENT
from rfca_rig.exam.examine import answer
from rfca_rig.exam.outcome import DETECTABLE, Truth, truth_in
from rfca_rig.exam.runner import worked_off
from rfca_rig.exam.score import Share
from rfca_rig.exam.scoring import DIAGNOSIS
from rfca_rig.exam.sealing import open_all
from rfca_rig.exam.write import CAMPAIGNS
from rfca_rig.executors.base import TaskExecutor
from rfca_rig.progress import Told, silent
from rfca_rig.recording.atomic_dir import see_afresh, sweep_out

FOLDER = "taken-out"

DiagnoseWithout = Callable[[str, Path, Path], object]
"""Without the effect of that id in the catalogue, reads the campaign in the first folder and writes diagnosis.json into the second."""


def take_out_each(folder: Path, diagnose: DiagnoseWithout, executor: TaskExecutor, told: Told = silent) -> None:
    """Every such case of the exam in `folder`, into `folder`/taken-out. What was diagnosed already stays.

    Raises RigError where one could not be diagnosed, when the others are done.
    """
    answers = folder.resolve() / FOLDER
    answers.mkdir(exist_ok=True)
    sweep_out(answers)
    to_diagnose = [truth for truth in _visible(folder) if not (answers / truth.case).is_dir()]
    jobs = [(truth.case, effect) for truth in to_diagnose for effect in truth.effects]
    worked_off(executor, partial(_diagnosed, folder.resolve(), diagnose), jobs, _case, "entries taken out", told)
    see_afresh(answers)


def _case(job: tuple[str, str]) -> str:
    return job[0]


def _visible(folder: Path) -> list[Truth]:
    return [truth for truth in map(truth_in, open_all(folder)) if truth.kind == SINGLE and truth.left >= DETECTABLE]


def _diagnosed(folder: Path, diagnose: DiagnoseWithout, job: tuple[str, str]) -> None:
    case, effect = job
    answer(folder / FOLDER, partial(diagnose, effect), None, folder / CAMPAIGNS / case)


@dataclass(frozen=True)
class Named:
    """A case whose effect was taken out and that was given names nevertheless, with the probability of the least sure one."""

    case: str
    effect: str
    named: tuple[str, ...]
    probability: float


@dataclass(frozen=True)
class TakenOut:
    """How many were given a name at CONFIDENT or more, were told as unexplained, or as nothing missing; and all that were named."""

    confident_wrong: Share
    unexplained: Share
    silent: Share
    named: tuple[Named, ...]

    @property
    def words(self) -> str:
        wrong, told = self.confident_wrong, self.unexplained
        return (
            f"each entry taken out of the catalogue: {wrong.hits} of {wrong.of} given a wrong name at {100.0 * CONFIDENT:g} % or more, "
            f"{told.hits} told as unexplained, {self.silent.hits} as nothing missing"
        )


def taken_out(folder: Path) -> TakenOut | None:
    """What came of it in an exam's folder; None where it was not done."""
    answers = folder / FOLDER
    if not answers.is_dir():
        return None
    judged = [(truth, read_said(answers / truth.case / DIAGNOSIS)) for truth in _visible(folder) if (answers / truth.case).is_dir()]
    return TakenOut(
        confident_wrong=_share([any(claim.probability >= CONFIDENT for claim in said.named) for _, said in judged]),
        unexplained=_share([not said.named and said.verdict != NOTHING for _, said in judged]),
        silent=_share([said.verdict == NOTHING for _, said in judged]),
        named=tuple(_named(truth, said) for truth, said in judged if said.named),
    )


def _named(truth: Truth, said: Said) -> Named:
    (effect,) = truth.effects
    return Named(truth.case, effect, tuple(claim.id for claim in said.named), min(claim.probability for claim in said.named))


def _share(hits: Sequence[bool]) -> Share:
    return Share(sum(hits), len(hits))
