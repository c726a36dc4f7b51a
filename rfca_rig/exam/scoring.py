"""Scores a folder of diagnoses: python -m rfca_rig.exam.scoring --cases DIR --diagnoses DIR.

Each score has a goal, see `bars`.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rfca_rig.errors import RigError
from rfca_rig.exam.answer import OUTCOMES, read_diagnosis
from rfca_rig.exam.score import POWER_AT, ExamScores, Share, score
from rfca_rig.exam.sealing import open_all

DIAGNOSIS = "diagnosis.json"


@dataclass(frozen=True)
class ScoreGoal:
    """One score, its goal, and whether it passes; a score without cases neither passes nor fails.

    `bound`: how bad the true share may still be, at 95 % confidence; None for a score that is no
    share.
    """

    name: str
    value: float
    at_least: float | None
    at_most: float | None
    counted: str
    bound: float | None = None

    @property
    def passed(self) -> bool | None:
        if not np.isfinite(self.value):
            return None
        return (self.at_least is None or self.value >= self.at_least) and (
            self.at_most is None or self.value <= self.at_most
        )


def bars(marks: ExamScores) -> Sequence[ScoreGoal]:
    """All goals with their scores, the most important first."""
    claims = marks.calibration
    values = marks.values
    statements = marks.statements
    pendulums = marks.pendulums
    return (
        _most(
            "nothing missing: effects or families stated", Share(*statements.claims_on_nothing), 0.0
        ),
        _most("wrong effects or families stated at 80 % or more", Share(*statements.wrong), 0.02),
        _most("nothing missing: effects identified", marks.null_false_claims, 0.0),
        _most("wrong among all identified effects", marks.false_discoveries, 0.05),
        _most(
            "outside the catalogue: wrong effect at 90 % or more",
            marks.stranger_confident_wrong,
            0.05,
        ),
        _least("outside the catalogue: reported as unexplained", marks.stranger_unexplained, 0.8),
        _least(
            "one detectable effect: right, or in its indistinguishable set",
            marks.single_in_class_detectable,
            0.95,
        ),
        _least(
            "one detectable effect: effect or family stated at any grade",
            Share(*statements.singles),
            0.95,
        ),
        _least(
            "one effect above a model error of 1 %: right, or in its set",
            marks.single_in_class_above,
            0.9,
        ),
        _least("two detectable effects: exactly both", marks.pairs_exact_detectable, 0.9),
        _least(
            "two effects above a model error of 1 %: exactly both", marks.pairs_exact_above, 0.8
        ),
        _least("two effects: none wrong", marks.pairs_without_wrong, 0.9),
        _least("three effects: two or more stated, none wrong", Share(*statements.triples), 0.7),
        _least("laws wrong by 20 to 40 %: right family stated", Share(*statements.family), 0.9),
        _least(
            "laws wrong by 20 to 40 %: sizes inside their 90 % interval",
            Share(*statements.family_sizes),
            0.87,
        ),
        _least("outside the catalogue: place, where one is stated", Share(*statements.place), 0.8),
        _least(
            "right family with a wrong law: family, or unexplained", marks.wrong_law_acceptable, 0.9
        ),
        _most("poor data: wrong effects", marks.poor_data_wrong, 0.05),
        _most("wrong metadata: wrong effects", marks.mislabelled_wrong, 0.05),
        _least("truth in the indistinguishable set that is stated", marks.truth_in_class, 0.95),
        ScoreGoal("mean size of an indistinguishable set", marks.mean_class_size, None, 3.0, ""),
        ScoreGoal(
            "calibration error of stated probabilities",
            statements.calibration_error,
            None,
            0.05,
            f"{statements.probabilities} probabilities",
        ),
        ScoreGoal(
            "calibration error of probabilities of identified effects", claims.ece, None, 0.05, ""
        ),
        ScoreGoal(
            "right among effects identified at 90 % or more",
            claims.confident_right,
            0.9,
            None,
            f"{claims.confident} claims",
        ),
        ScoreGoal(
            "median error of parameters", values.median_error, None, 0.1, f"{values.count} values"
        ),
        _least("stated sizes inside their 90 % interval", Share(*statements.sizes), 0.87),
        ScoreGoal(
            "parameters of identified effects inside their 90 % interval",
            values.coverage_90,
            0.85,
            0.95,
            f"{values.count} values",
        ),
        _most(
            "pendulums, nothing missing: effects or families stated",
            Share(*pendulums.claims_on_nothing),
            0.0,
        ),
        _most(
            "pendulums: wrong effects or families at 80 % or more", Share(*pendulums.wrong), 0.02
        ),
        _least(
            "pendulums, one detectable effect: it or its family", Share(*pendulums.singles), 0.9
        ),
        _least("pendulums: stated sizes inside their 90 % interval", Share(*pendulums.sizes), 0.87),
        ScoreGoal(
            "pendulums: calibration error",
            pendulums.calibration_error,
            None,
            0.05,
            f"{pendulums.probabilities} probabilities",
        ),
        ScoreGoal(
            "misfit removed on held-out conditions",
            marks.gap_closed,
            0.8,
            None,
            f"{marks.gap_worse.of} cases",
        ),
    )


def _most(name: str, share: Share, limit: float) -> ScoreGoal:
    bound = None
    if share.of:
        bound = share.upper
    return ScoreGoal(name, share.value, None, limit, _count_text(share), bound)


def _least(name: str, share: Share, limit: float) -> ScoreGoal:
    bound = None
    if share.of:
        bound = share.lower
    return ScoreGoal(name, share.value, limit, None, _count_text(share), bound)


def _count_text(share: Share) -> str:
    return f"{share.hits} of {share.of}"


def score_folder(cases: Path, diagnoses: Path) -> ExamScores:
    """Open the truths under `cases` and score `diagnoses`/case-NNNN/diagnosis.json; a missing
    one counts as refused.
    """
    truths = open_all(cases)
    return score(
        truths,
        {truth["case"]: read_diagnosis(diagnoses / truth["case"] / DIAGNOSIS) for truth in truths},
    )


def format_scores(marks: ExamScores) -> Iterator[str]:
    """The scores as lines of text."""
    wide = max(map(len, ("kind", *marks.outcomes)))
    yield f"{'kind':{wide}}" + "".join(f" {word}" for word in OUTCOMES)
    for kind, counted in marks.outcomes.items():
        yield f"{kind:{wide}}" + "".join(
            f" {counted.get(word, 0) or '.':>{len(word)}}" for word in OUTCOMES
        )
    yield ""
    for bar in bars(marks):
        yield from _lines(bar)
    yield ""
    if any(share.of for share in marks.power):
        yield (
            (
                "one effect, it or its family stated, by multiples of the detection limit "
                f"({', '.join(f'{at:g}' for at in POWER_AT)}): "
            )
            + ", ".join(f"{share.hits}/{share.of}" for share in marks.power)
        )
    if marks.calibration.bins:
        yield (
            f"Brier {marks.calibration.brier:.3f}, logarithmic score "
            f"{marks.calibration.log_score:.3f}"
        )
    yield (
        f"detection: {marks.false_alarms.hits} false alarms of {marks.false_alarms.of}, "
        f"{marks.missed.hits} missed of {marks.missed.of}, "
        f"{marks.detection_errors.hits} errors of {marks.detection_errors.of}; "
        f"{marks.classification_errors} effects wrong or missing"
    )
    if marks.null_false_claims.of:
        yield (
            "effects identified where nothing is missing: below "
            f"{marks.null_false_claims.upper:.1%} with 95 % confidence"
        )
    for (true, called), count in sorted(marks.confusion.items()):
        if true != called:
            yield f"{count} x {true} identified as {called}"
    yield from (f"{miss.case} ({miss.kind}): {miss.reason}" for miss in marks.worst)


def _lines(bar: ScoreGoal) -> Iterator[str]:
    goal = " and ".join(
        f"{word} {limit:g}"
        for word, limit in (("at least", bar.at_least), ("at most", bar.at_most))
        if limit is not None
    )
    result = {True: "passed", False: "FAILED", None: "-"}[bar.passed]
    value = "-"
    if np.isfinite(bar.value):
        value = f"{bar.value:.3f}"
    yield f"{result:7s} {bar.name:60s} {value:>6s}"
    yield f"{'':7s} {goal}; {bar.counted}"


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(
        description="Opens the hidden truths and scores the diagnoses."
    )
    parser.add_argument(
        "--cases", type=Path, required=True, help="the folder that the cases were written into"
    )
    parser.add_argument(
        "--diagnoses", type=Path, required=True, help="holds case-NNNN/diagnosis.json"
    )
    arguments = parser.parse_args()
    try:
        print("\n".join(format_scores(score_folder(arguments.cases, arguments.diagnoses))))
    except RigError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
