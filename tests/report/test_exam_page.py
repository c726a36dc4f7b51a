import csv
import json
import re
from collections import Counter
from dataclasses import replace

import pytest

from rfca_rig.exam import cases
from rfca_rig.exam.answer import OUTCOMES
from rfca_rig.exam.cases import split_numbers
from rfca_rig.exam.follow_up import AblationResult, WronglyNamed
from rfca_rig.exam.score import Share
from rfca_rig.exam.scored import ScoredCase, score_exam
from rfca_rig.exam.scoring import bars
from rfca_rig.exam.sealing import ExamPlan
from rfca_rig.reports.exam.page import HEADER, as_json, page, share_text, write_exam
from rfca_rig.reports.exam.tables import MatrixCell, matrix_of
from tests.report.exams import made_up_exam
from tests.report.outline import Outline

COUNT = 90


@pytest.fixture(scope="module")
def exam(tmp_path_factory):
    return score_exam(
        made_up_exam(tmp_path_factory.mktemp("exam"), split_numbers(COUNT), false_names=0.1)
    )


@pytest.fixture(scope="module")
def shown(exam):
    return page(exam)


def test_the_page_is_whole_and_fetches_nothing(shown):
    outline = Outline(shown)
    assert len(set(outline.ids)) == len(outline.ids)
    assert all(each.startswith(("#", "diagnoses/case-")) for each in outline.fetched)
    assert "nan" not in outline.text and "None" not in outline.text
    assert shown.count("<svg ") == 4


def test_the_words_are_those_of_the_field(shown):
    text = Outline(shown).text
    assert "effect outside the catalogue" in text and "inconclusive" in text
    assert (
        re.findall(
            (
                r"(?i)(?<![a-z])(?:strangers?|named|decoys?|sealed|marks|silent|cautious|by "
                r"lot)(?![a-z])"
            ),
            text,
        )
        == []
    )


def test_every_bar_is_told_with_goal_value_and_counts(exam, shown):
    text = " ".join(Outline(shown).text.replace("\u00a0", " ").split())
    for bar in bars(exam.marks):
        assert bar.name in text and bar.counted in text
    false = exam.marks.false_discoveries
    assert false.hits > 0
    assert (
        f"wrong among all identified effectsat most 5 %{100 * false.value:.1f} "
        f"%{false.hits} of {false.of}"
    ) in text
    assert f"{false.hits} of {false.of} identified effects were wrong" in text
    failed = sum(bar.passed is False for bar in bars(exam.marks))
    assert failed > 0 and shown.count('<td class="failed">') == failed


def test_the_worst_are_listed_with_reasons(exam, shown):
    text = Outline(shown).text
    assert exam.marks.worst
    for miss in exam.marks.worst:
        assert miss.reason in text and f'href="diagnoses/{miss.case}/diagnosis.html"' in shown


def test_the_csv_has_a_line_for_each_case(exam, tmp_path):
    write_exam(exam, tmp_path)
    lines = list(csv.DictReader((tmp_path / "exam.csv").read_text(encoding="utf-8").splitlines()))
    assert len(lines) == COUNT and tuple(lines[0]) == HEADER
    outcomes = Counter(line["outcome"] for line in lines)
    marked = Counter()
    for counts in exam.marks.outcomes.values():
        for word in OUTCOMES:
            marked[word] += counts.get(word, 0)
    assert outcomes == marked
    for line in lines:
        assert bool(line["named"]) == (line["verdict"] == "named") == bool(line["probability"])
        assert 20.0 <= float(line["seconds"]) <= 200.0
    strange = next(line for line in lines if line["kind"] == cases.STRANGER)
    assert strange["truth"]


def test_the_json_holds_bars_marks_and_cases(exam):
    document = json.loads(as_json(exam))
    assert document["seed"] == 3 and document["numbers"] == split_numbers(COUNT)
    assert [bar["name"] for bar in document["bars"]] == [bar.name for bar in bars(exam.marks)]
    assert document["marks"]["false_discoveries"]["hits"] == exam.marks.false_discoveries.hits
    assert (
        sum(entry["count"] for entry in document["marks"]["confusion"])
        == split_numbers(COUNT)[cases.SINGLE]
    )
    assert len(document["cases"]) == COUNT


def test_the_same_exam_gives_the_same_page(exam, shown):
    assert page(exam) == shown


def test_an_exam_of_one_kind_is_told_without_what_it_did_not_ask(tmp_path):
    small = score_exam(made_up_exam(tmp_path, {cases.NOTHING: 4}, false_names=0.0))
    told = page(small)
    text = Outline(told).text
    assert "nan" not in text and "no case" in text
    assert (
        "no effect was identified; in none of 4 campaigns without one, an effect was identified"
        in text
    )
    assert "rfca-rig prove --out exam --seed 3 --cases 4 --kind 'nothing missing'" in text
    assert score_exam(tmp_path).plan == ExamPlan(3, {cases.NOTHING: 4})


PLAIN = ScoredCase(
    "a",
    cases.SINGLE,
    ("tip_mass",),
    0.5,
    9.0,
    "named",
    ("tip_mass",),
    (0.9,),
    "right",
    (),
    None,
    None,
)


def test_the_matrix_counts_and_shows_the_worst():
    marked = [
        PLAIN,
        PLAIN,
        replace(PLAIN, named=("fluid_drag",), outcome="class"),
        replace(PLAIN, named=("fluid_drag",), outcome="wrong"),
        replace(PLAIN, named=("tip_mass", "fluid_drag"), outcome="extra"),
        replace(PLAIN, verdict="nothing missing", named=(), outcome="silent"),
        replace(
            PLAIN,
            kind=cases.STRANGER,
            concealed=("floor_magnet",),
            verdict="unexplained",
            named=(),
            outcome="right",
        ),
        replace(PLAIN, kind=cases.PAIR, concealed=("tip_mass", "sensor_lag")),
    ]
    matrix = matrix_of(marked)
    assert (matrix.names, matrix.verdicts) == (
        ("tip_mass", "fluid_drag"),
        ("several effects", "nothing missing", "unexplained"),
    )
    (single, (row,)), (stranger, (other,)) = matrix.kinds
    assert (single, stranger, row.concealed, other.concealed) == (
        cases.SINGLE,
        cases.STRANGER,
        "tip_mass",
        "floor_magnet",
    )
    assert row.cells == (
        MatrixCell(2, "right"),
        MatrixCell(2, "wrong"),
        MatrixCell(1, "wrong"),
        MatrixCell(1, ""),
        None,
    )
    assert other.cells == (None, None, None, None, MatrixCell(1, "right"))


def test_shares_in_words():
    words = [share_text(each) for each in (0.0, 0.05, 0.124, 1.0)]
    assert words == ["0\u00a0%", "5\u00a0%", "12.4\u00a0%", "100\u00a0%"]
    assert (share_text(0.8, trimmed=False), share_text(float("nan"))) == ("80.0\u00a0%", "\u2013")


@pytest.mark.slow
def test_effects_that_were_taken_out_are_told_with_what_they_were_called(exam, shown, tmp_path):
    assert (
        "its catalogue does not hold" not in shown
        and json.loads(as_json(exam))["taken_out"] is None
    )
    called = WronglyNamed("case-0007", "tip_mass", ("height_offset",), 0.95)
    asked = replace(
        exam, taken_out=AblationResult(Share(1, 20), Share(17, 20), Share(2, 20), (called,))
    )
    text = " ".join(Outline(page(asked)).text.replace("\u00a0", " ").split())
    assert (
        "Each effect removed from the catalogue in turn: 1 of 20 identified as another "
        "at 90 % or more, 17 reported as unexplained, 2 as"
    ) in text
    assert "tip mass" in text and "height offset" in text and "--take-out-each" in text
    none = replace(exam, taken_out=AblationResult(Share(0, 20), Share(18, 20), Share(2, 20), ()))
    assert "0 of 20 identified as another" in Outline(page(none)).text
    write_exam(asked, tmp_path)
    (line,) = csv.DictReader((tmp_path / "taken-out.csv").read_text(encoding="utf-8").splitlines())
    assert line == {"concealed": "tip mass", "named": "height offset", "probability": "0.95"}
    assert json.loads(as_json(asked))["taken_out"]["confident_wrong"]["hits"] == 1
