"""Seed and case numbers of an exam, kept in its folder, so that only the same exam can be continued there."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from rfca_rig.errors import BadInput, RigError
from rfca_rig.exam.cases import KINDS
from rfca_rig.recording.atomic import write_atomically

FILE, FORMAT = "plan.json", "rfca-exam-plan/1"


@dataclass(frozen=True)
class ExamPlan:
    """Seed and number of cases of each kind. Raises BadInput for an unknown kind."""

    seed: int
    numbers: Mapping[str, int]

    def __post_init__(self) -> None:
        unknown = set(self.numbers) - set(KINDS)
        if unknown:
            raise BadInput(f"kind {sorted(unknown)[0]!r} is unknown; there are {', '.join(KINDS)}")

    @property
    def words(self) -> str:
        """As in "seed 1, 500 cases"."""
        kinds = [kind for kind, number in self.numbers.items() if number]
        only = f" of the kind {kinds[0]!r}" if len(kinds) == 1 else ""
        return f"seed {self.seed}, {sum(self.numbers.values())} cases{only}"


def begin(folder: Path, plan: ExamPlan) -> None:
    """Create the folder with the plan, or check that it holds the same plan. Raises BadInput where `folder` holds anything else."""
    path = folder / FILE
    if path.is_file():
        _check_same(plan, read_plan(folder), folder)
        return
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise BadInput(f"{folder}: is not empty, and holds no exam that could be continued; name a new folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RigError(f"{folder}: cannot be made: {error.strerror}; name another folder") from None
    content = {"format": FORMAT, "seed": plan.seed, "numbers": dict(plan.numbers)}
    write_atomically(path, (json.dumps(content, indent=1) + "\n").encode())


def read_plan(folder: Path) -> ExamPlan:
    """The plan of an exam's folder. Raises BadInput where there is none that can be read."""
    path = folder / FILE
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if content["format"] != FORMAT:
            raise BadInput(f"{path}: format {content['format']!r} should be {FORMAT!r}; name a new folder")
        return ExamPlan(int(content["seed"]), {kind: int(number) for kind, number in content["numbers"].items()})
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise BadInput(f"{path}: is not the plan of an exam ({type(error).__name__}: {error}); name a new folder") from None


def _check_same(asked: ExamPlan, begun: ExamPlan, folder: Path) -> None:
    # A kind with zero cases is the same as a kind that is not listed.
    numbers = [{kind: number for kind, number in plan.numbers.items() if number} for plan in (asked, begun)]
    if asked.seed != begun.seed or numbers[0] != numbers[1]:
        raise BadInput(f"{folder}: holds an exam with {begun.words}, not {asked.words}; ask for the same again, or name a new folder")
