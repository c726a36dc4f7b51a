"""Scores a folder of diagnoses: python -m rfca_rig.exam.scoring --cases DIR --diagnoses DIR."""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from rfca_rig.errors import RigError
from rfca_rig.exam.answer import read_diagnosis
from rfca_rig.exam.bars import ScoreGoal, bars
from rfca_rig.exam.outcome import OUTCOMES
from rfca_rig.exam.score import POWER_AT, ExamScores, score
from rfca_rig.exam.sealing import open_all

DIAGNOSIS = "diagnosis.json"


def score_folder(cases: Path, diagnoses: Path) -> ExamScores:
    """Open the truths under `cases` and score `diagnoses`/case-NNNN/diagnosis.json; a missing one counts as refused."""
    truths = open_all(cases)
    return score(truths, {truth["case"]: read_diagnosis(diagnoses / truth["case"] / DIAGNOSIS) for truth in truths})


def format_scores(marks: ExamScores) -> Iterator[str]:
    """The scores as lines of text."""
    wide = max(map(len, ("kind", *marks.outcomes)))
    yield f"{'kind':{wide}}" + "".join(f" {word}" for word in OUTCOMES)
    for kind, counted in marks.outcomes.items():
        yield f"{kind:{wide}}" + "".join(f" {counted.get(word, 0) or '.':>{len(word)}}" for word in OUTCOMES)
    yield ""
    for bar in bars(marks):
        yield from _lines(bar)
    yield ""
    if any(each.of for each in marks.power):
        yield (
            f"one effect, it or its family stated, by multiples of what can be seen ({', '.join(f'{at:g}' for at in POWER_AT)}): "
            + ", ".join(f"{each.hits}/{each.of}" for each in marks.power)
        )
    if marks.calibration.bins:
        yield f"Brier {marks.calibration.brier:.3f}, logarithmic score {marks.calibration.log_score:.3f}"
    yield (
        f"detection: {marks.false_alarms.hits} false alarms of {marks.false_alarms.of}, {marks.missed.hits} missed of {marks.missed.of}, "
        f"{marks.detection_errors.hits} errors of {marks.detection_errors.of}; {marks.classification_errors} names wrong or missing"
    )
    if marks.null_false_claims.of:
        yield f"false names where nothing is missing: below {marks.null_false_claims.upper:.1%} with 95 % confidence"
    yield from _confusion_lines(marks)
    yield from (f"{miss.case} ({miss.kind}): {miss.reason}" for miss in marks.worst)


def _lines(bar: ScoreGoal) -> Iterator[str]:
    goal = " and ".join(f"{word} {limit:g}" for word, limit in (("at least", bar.at_least), ("at most", bar.at_most)) if limit is not None)
    result = {True: "passed", False: "FAILED", None: "-"}[bar.passed]
    value = f"{bar.value:.3f}" if np.isfinite(bar.value) else "-"
    yield f"{result:7s} {bar.name:60s} {value:>6s}"
    yield f"{'':7s} {goal}; {bar.counted}"


def _confusion_lines(marks: ExamScores) -> Iterator[str]:
    for (true, called), count in sorted(marks.confusion.items()):
        if true != called:
            yield f"{count} x {true} called {called}"


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(description="Opens the truths and marks what was diagnosed.")
    parser.add_argument("--cases", type=Path, required=True, help="the folder that the cases were written into")
    parser.add_argument("--diagnoses", type=Path, required=True, help="holds case-NNNN/diagnosis.json")
    arguments = parser.parse_args()
    try:
        print("\n".join(format_scores(score_folder(arguments.cases, arguments.diagnoses))))
    except RigError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
