"""The exam from end to end: cases are written and sealed, each is diagnosed as for any user, then the truths are opened and marked."""

from collections.abc import Callable, Mapping
from pathlib import Path

from rfca_rig.errors import RigError
from rfca_rig.exam.marking import mark
from rfca_rig.exam.score import Marks
from rfca_rig.exam.write import write_cases

DIAGNOSES, REFUSAL = "diagnoses", "refused.txt"

Diagnose = Callable[[Path, Path], object]
"""Reads the campaign in the first folder, writes diagnosis.json into the second, which is not there yet."""


def examine(folder: Path, seed: int, numbers: Mapping[str, int], diagnose: Diagnose, workers: int = 1) -> Marks:
    """The marks of `diagnose` on newly written cases, which stay in `folder`/campaigns, with its answers in `folder`/diagnoses.

    A RigError is an answer too, that the campaign cannot be used, and is kept as text; any other exception ends the exam.
    """
    for campaign in write_cases(folder, seed, numbers, workers):
        answer(campaign, folder / DIAGNOSES / campaign.name, diagnose)
    return mark(folder, folder / DIAGNOSES)


def answer(campaign: Path, into: Path, diagnose: Diagnose) -> None:
    """One diagnosis."""
    into.parent.mkdir(parents=True, exist_ok=True)
    try:
        diagnose(campaign, into)
    except RigError as error:
        into.mkdir(exist_ok=True)
        (into / REFUSAL).write_text(f"{error}\n", encoding="utf-8")
