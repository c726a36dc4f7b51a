"""Whether the experiment that a diagnosis proposes settles a case that was left open, and in fewer than experiments drawn by lot.

The open cases are those of too few recordings. What is proposed is done on the same concealed rig by the exam's own engine, old and new
recordings are diagnosed together, and so on until the verdict is right with nothing left open. Beside it runs the same with proposals
drawn by lot from what such a rig can do.
"""

import json
import shutil
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.exam.answer import NAMED, NOTHING, read_said
from rfca_rig.exam.cases import POOR_DATA, Case, drawn_cases
from rfca_rig.exam.examine import DIAGNOSES, Diagnose
from rfca_rig.exam.outcome import DETECTABLE, RIGHT, Truth, outcome, truth_in
from rfca_rig.exam.plan import read_plan
from rfca_rig.exam.runner import worked_off
from rfca_rig.exam.scoring import DIAGNOSIS
from rfca_rig.exam.sealing import open_all
from rfca_rig.exam.simulate_campaign import add_experiment
from rfca_rig.exam.write import CAMPAIGNS
from rfca_rig.executors.base import TaskExecutor
from rfca_rig.progress import Told, silent
from rfca_rig.recording.atomic import write_atomically

FOLDER, RESULT = "follow-ups", "follow-up.json"
PROPOSED, BY_LOT = ARMS = ("proposed", "by lot")
MOST = 4  # experiments after which a case is given up
HEIGHTS_MM, SPEEDS_RAD_S, REPEATS = tuple(np.arange(195.0, 236.0, 5.0)), (1.0, 1.5, 2.0, 2.4), 3
BY_LOT_STATIC = 0.3  # share of static tables among experiments drawn by lot
BY_LOT_STAGES = tuple({"angle_deg": angle, "direction": "loading"} for angle in (60.0, 75.0, 90.0, 105.0, 120.0, 135.0))

Proposal = Mapping[str, Any]


@dataclass(frozen=True)
class FollowUp:
    """What became of one case: how many experiments were done, whether they settled it, and what was said last."""

    case: str
    arm: str
    experiments: int
    settled: bool
    said: str


def follow_up(folder: Path, diagnose: Diagnose, executor: TaskExecutor, told: Told = silent) -> None:
    """All open cases of a finished exam, each followed in both ways, into `folder`/follow-ups. What was followed already stays.

    Raises RigError where one could not be followed, when the others are done.
    """
    plan = read_plan(folder)
    cases = {case.id: case for case in drawn_cases(plan.seed, plan.numbers) if isinstance(case, Case) and case.kind == POOR_DATA}
    truths = {truth["case"]: truth_in(truth) for truth in open_all(folder) if truth["case"] in cases}
    jobs = [(case, truths[id_], arm) for id_, case in cases.items() for arm in ARMS]
    worked_off(executor, partial(followed, folder.resolve(), diagnose), jobs, _case_and_arm, "open cases followed", told)


def _case_and_arm(job: tuple[Case, Truth, str]) -> str:
    case, _, arm = job
    return f"{case.id} ({arm})"


def followed(folder: Path, diagnose: Diagnose, job: tuple[Case, Truth, str]) -> FollowUp:
    """One case in one way. Raises RigError where a campaign cannot be written."""
    case, truth, arm = job
    place = folder / FOLDER / f"{case.id}-{arm.replace(' ', '-')}"
    result = place / RESULT
    if result.is_file():
        return FollowUp(**json.loads(result.read_text(encoding="utf-8")))
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(folder / CAMPAIGNS / case.id, place / "campaign")
    found = _rounds(case, truth, arm, place, folder / DIAGNOSES / case.id / DIAGNOSIS, diagnose)
    write_atomically(result, json.dumps(asdict(found), indent=1).encode())
    return found


def _rounds(case: Case, truth: Truth, arm: str, place: Path, first: Path, diagnose: Diagnose) -> FollowUp:
    random = np.random.default_rng([case.seed, 77])
    latest = first
    for number in range(1, MOST + 1):
        proposal = _proposed(latest) if arm == PROPOSED else by_lot(random)
        if proposal is None:
            break
        add_experiment(case, place / "campaign", proposal, number)
        latest = place / f"diagnosis-{number}" / DIAGNOSIS
        with suppress(BadInput, SimulationFailed):  # an answer too, that there is none
            diagnose(place / "campaign", latest.parent)
        if _is_settled(truth, latest):
            return FollowUp(case.id, arm, number, settled=True, said=_in_words(latest))
    return FollowUp(case.id, arm, MOST, settled=False, said=_in_words(latest))


def _proposed(diagnosis: Path) -> Proposal | None:
    """The proposal for the rig; None where there is none, or one for a person."""
    proposal = json.loads(diagnosis.read_text(encoding="utf-8"))["next_experiment"] if diagnosis.is_file() else None
    return proposal if proposal and proposal["protocol"] else None


def by_lot(random: np.random.Generator) -> Proposal:
    """A stroke or a static table anywhere in what such a rig does."""
    height_mm = float(random.choice(HEIGHTS_MM))
    if random.random() < BY_LOT_STATIC:
        return {"height_mm": height_mm, "stages": BY_LOT_STAGES}
    return {"height_mm": height_mm, "speed_rad_s": float(random.choice(SPEEDS_RAD_S)), "repeats": REPEATS}


def _is_settled(truth: Truth, diagnosis: Path) -> bool:
    """Whether the verdict is right, and nothing else as likely."""
    said = read_said(diagnosis)
    alone = all(len(claim.members) == 1 for claim in said.named)
    return said.verdict in (NAMED, NOTHING) and outcome(truth, said) == RIGHT and alone


def _in_words(diagnosis: Path) -> str:
    said = read_said(diagnosis)
    return "+".join(claim.id for claim in said.named) or said.verdict


@dataclass(frozen=True)
class Way:
    """All follow-ups of one arm on cases that conceal nothing or something that shows: settled, of how many, experiments on average."""

    arm: str
    settled: int
    of: int
    experiments: float

    @property
    def words(self) -> str:
        return (
            f"open cases, next experiments {self.arm}: {self.settled} of {self.of} settled, {self.experiments:.2f} experiments on average"
        )


def ways(folder: Path) -> tuple[Way, ...]:
    """What the follow-ups in an exam's folder came to; empty where none were done."""
    found = [FollowUp(**json.loads(path.read_text(encoding="utf-8"))) for path in sorted((folder / FOLDER).glob(f"*/{RESULT}"))]
    faint = {truth.case for truth in map(truth_in, open_all(folder)) if truth.effects and truth.left < DETECTABLE} if found else set()
    shown = [each for each in found if each.case not in faint]
    return tuple(way for arm in ARMS if (way := _way(arm, [each for each in shown if each.arm == arm])).of)


def _way(arm: str, found: Sequence[FollowUp]) -> Way:
    mean = float(np.mean([each.experiments for each in found])) if found else np.nan
    return Way(arm, sum(each.settled for each in found), len(found), mean)
