"""Writes the files of an exam (the blind benchmark of the diagnosis).

exam.html is for people, exam.json for programs, exam.csv has a line for each case, and tables as CSV and LaTeX are for papers.
"""

import json
from dataclasses import asdict, fields
from pathlib import Path

from rfca_rig import __version__
from rfca_rig.exam.score import Share
from rfca_rig.exam.scored import ExamResult, ScoredCase
from rfca_rig.exam.scoring import bars
from rfca_rig.reports.diagnosis.json_file import to_json_types
from rfca_rig.reports.exam.page import page
from rfca_rig.reports.exam.tables import ablation_table, bars_table, confusion_table, follow_up_table
from rfca_rig.reports.provenance import version_text
from rfca_rig.reports.table import Table, TableColumn, TableRow, table_files, write_all
from rfca_rig.reports.table import as_csv as table_as_csv

FORMAT = "rfca-exam/1"
HEADER = ("case", "kind", "truth", "verdict", "named", "probability", "outcome", "seconds", "strength", "left_over_noise")


def write_exam(exam: ExamResult, out: Path) -> None:
    """Writes all files into the existing folder `out`. Raises RigError where a file cannot be written."""
    taken_out = (ablation_table(exam.taken_out),) if exam.taken_out else ()
    tables = (bars_table(bars(exam.marks)), follow_up_table(exam.ways), *taken_out, confusion_table(exam.cases))
    contents = {"exam.json": as_json(exam), "exam.csv": as_csv(exam), **table_files(tables)}
    write_all(out, {"exam.html": page(exam, tuple(contents), version_text()), **contents})


def as_csv(exam: ExamResult) -> str:
    """A line for each case. Several effects are joined by +; the probability is that of the least certain name."""
    rows = tuple(TableRow(dict(zip(HEADER, _line(case), strict=True))) for case in exam.cases)
    return table_as_csv(Table("exam", "", tuple(TableColumn(name) for name in HEADER), rows))


def _line(case: ScoredCase) -> list[str]:
    probability = f"{min(case.probabilities):.4f}" if case.probabilities else ""
    seconds = "" if case.seconds is None else f"{case.seconds:.1f}"
    answer = [case.verdict, "+".join(case.named), probability, case.outcome, seconds]
    return [case.id, case.kind, "+".join(case.concealed), *answer, f"{case.strength:.3f}", f"{case.left:.3g}"]


def as_json(exam: ExamResult) -> str:
    """The JSON document: required scores (bars), all scores (marks), and every case; unknown values are null."""
    scores = {field.name: _plain_score(getattr(exam.marks, field.name)) for field in fields(exam.marks)}
    confused = [{"truth": true, "named": called, "count": count} for (true, called), count in sorted(exam.marks.confusion.items())]
    document = {
        "format": FORMAT,
        "version": __version__,
        "seed": exam.plan.seed,
        "numbers": exam.plan.numbers,
        "bars": [asdict(bar) | {"passed": bar.passed} for bar in bars(exam.marks)],
        "marks": scores | {"confusion": confused},
        "follow_ups": [asdict(way) for way in exam.ways],
        "taken_out": {one.name: _plain_score(getattr(exam.taken_out, one.name)) for one in fields(exam.taken_out)}
        if exam.taken_out
        else None,
        "cases": [asdict(case) for case in exam.cases],
    }
    return json.dumps(to_json_types(document), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _plain_score(value: object) -> object:
    """A share with its confidence bounds; other values unchanged."""
    if isinstance(value, Share):
        return {"hits": value.hits, "of": value.of, "value": value.value, "lower": value.lower, "upper": value.upper}
    if isinstance(value, tuple):
        return [_plain_score(each) for each in value]
    return asdict(value) if hasattr(value, "__dataclass_fields__") else value  # type: ignore[call-overload]
