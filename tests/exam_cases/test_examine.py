"""The exam from end to end, with diagnoses that are simple enough to know their marks."""

import json
import os
import shutil
from pathlib import Path

import pytest

from rfca_rig.clock import TwinClock
from rfca_rig.errors import BadInput, RigError
from rfca_rig.exam import cases
from rfca_rig.exam.examine import examine
from rfca_rig.exam.scored import score_exam, score_exam_so_far
from rfca_rig.exam.sealing import FILE, open_all
from rfca_rig.executors.mapping import process_executor
from tests.exam_cases.examinees import tells_its_process, wants_more_data

NUMBERS = {cases.POOR_DATA: 2}


def says(verdict: str):
    def diagnose(campaign: Path, into: Path) -> None:
        assert (campaign / "campaign.toml").is_file()
        into.mkdir()
        (into / "diagnosis.json").write_text(
            json.dumps({"format": "rfca-diagnosis/1", "verdict": verdict, "effects": []})
        )

    return diagnose


def refuses(campaign: Path, into: Path) -> None:
    raise BadInput(f"{campaign}: too few strokes")


def crashes_once(campaign: Path, into: Path) -> None:
    if campaign.name == "case-0001":
        raise ZeroDivisionError
    wants_more_data(campaign, into)


def must_not_be_asked(campaign: Path, into: Path) -> None:
    raise AssertionError(campaign)


def files(folder: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*.*")}


@pytest.fixture(scope="module")
def done(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("exam") / "done"
    examine(folder, 1, NUMBERS, wants_more_data)
    return folder


@pytest.fixture
def exam(done, tmp_path) -> Path:
    return shutil.copytree(done, tmp_path / "exam")


@pytest.mark.slow
def test_one_who_wants_more_data_is_right_about_poor_data(exam):
    assert score_exam(exam).marks.outcomes == {cases.POOR_DATA: {"right": 2}}


def test_one_who_sees_nothing_misses_what_is_there(exam):
    shutil.rmtree(exam / "diagnoses")
    assert examine(exam, 1, NUMBERS, says("nothing missing")).outcomes == {
        cases.POOR_DATA: {"right": 1, "silent": 1}
    }


def test_a_refusal_is_an_answer(exam):
    shutil.rmtree(exam / "diagnoses")
    assert examine(exam, 1, NUMBERS, refuses).outcomes == {cases.POOR_DATA: {"right": 2}}
    assert "too few strokes" in next((exam / "diagnoses").glob("*/refused.txt")).read_text()
    examine(exam, 1, NUMBERS, must_not_be_asked)


def test_a_crash_is_no_answer_but_the_others_are_asked(exam):
    shutil.rmtree(exam / "diagnoses")
    with pytest.raises(
        RigError,
        match=r"1 of 2 diagnoses crashed, as case-0001 with ZeroDivisionError; nothing is marked",
    ):
        examine(exam, 1, NUMBERS, crashes_once)
    assert "crashes_once" in (exam / "crashed" / "case-0001.txt").read_text()
    assert [
        folder.name for folder in (exam / "diagnoses").iterdir() if folder.name.startswith("case")
    ] == ["case-0002"]
    examine(exam, 1, NUMBERS, wants_more_data)
    assert not list((exam / "crashed").iterdir())


def test_a_disk_that_refuses_is_no_answer(exam):
    def writes_nothing(campaign: Path, into: Path) -> None:
        raise RigError("no space left")

    shutil.rmtree(exam / "diagnoses")
    with pytest.raises(RigError, match="2 of 2 diagnoses crashed"):
        examine(exam, 1, NUMBERS, writes_nothing)


def test_a_finished_exam_is_only_marked_again(exam):
    before = files(exam)
    assert examine(exam, 1, NUMBERS, must_not_be_asked).outcomes == {cases.POOR_DATA: {"right": 2}}
    assert files(exam) == before


def test_what_was_half_done_is_done_again_and_the_rest_stays(exam):
    before = files(exam)
    lost = [exam / "campaigns" / "case-0002", exam / "diagnoses" / "case-0002"]
    content = (lost[0] / "campaign.toml").read_text()
    for folder in lost:
        folder.rename(folder.with_name(".case-0002.writing"))
    (exam / "campaigns" / ".case-0002.writing" / "campaign.toml").write_text("half")
    told = []
    examine(exam, 1, NUMBERS, wants_more_data, report_progress=lambda *said: told.append(said))
    assert (lost[0] / "campaign.toml").read_text() == content
    after = files(exam)
    assert set(after) == set(before)
    assert {path.parts[-2] for path in after if after[path] != before[path]} == {
        "case-0002",
        "runs",
    }
    assert [said for said in told if said[0] == "campaigns diagnosed"] == [
        ("campaigns diagnosed", 1, 2),
        ("campaigns diagnosed", 2, 2),
    ]


@pytest.mark.slow
def test_a_sealing_that_was_interrupted_is_completed_against_its_hashes(exam):
    seals = (exam / "seals.txt").read_bytes()
    truths = open_all(exam)
    (exam / "sealed" / "case-0002.sealed").unlink()
    examine(exam, 1, NUMBERS, must_not_be_asked)
    assert (exam / "seals.txt").read_bytes() == seals and open_all(exam) == truths
    (exam / "seals.txt").write_bytes(seals.replace(seals.splitlines()[1][:64], b"0" * 64))
    (exam / "sealed" / "case-0002.sealed").unlink()
    with pytest.raises(BadInput, match="is not what was sealed"):
        examine(exam, 1, NUMBERS, must_not_be_asked)


@pytest.mark.parametrize(
    ("seed", "numbers", "words"),
    [
        (
            2,
            NUMBERS,
            "holds an exam with seed 1, 2 cases of the kind 'poor data', not seed 2, 2 cases",
        ),
        (1, {cases.POOR_DATA: 3}, "not seed 1, 3 cases of the kind 'poor data'"),
        (1, {cases.SINGLE: 2}, "not seed 1, 2 cases of the kind 'one effect'"),
    ],
)
def test_another_exam_in_the_same_folder_is_refused(exam, seed, numbers, words):
    before = files(exam)
    with pytest.raises(BadInput, match=words):
        examine(exam, seed, numbers, must_not_be_asked)
    assert files(exam) == before


def test_a_plan_that_cannot_be_read_is_refused(exam):
    for broken in (
        "{",
        '{"format": "rfca-exam-plan/2"}',
        '{"format": "rfca-exam-plan/1", "seed": 1}',
    ):
        (exam / FILE).write_text(broken)
        with pytest.raises(BadInput, match=r"plan\.json"):
            examine(exam, 1, NUMBERS, must_not_be_asked)


class Slow(TwinClock):
    """On which everything takes seven seconds."""

    def now_s(self) -> float:
        self.wait_until(super().now_s() + 7.0)
        return super().now_s()


def test_time_is_told_by_the_clock_that_is_passed_in(exam):
    assert [case.seconds for case in score_exam(exam).cases] == [None, None]
    shutil.rmtree(exam / "diagnoses")
    examine(exam, 1, NUMBERS, wants_more_data, clocks=Slow)
    assert [case.seconds for case in score_exam(exam).cases] == [7.0, 7.0]


def test_what_is_diagnosed_so_far_is_marked_and_the_other_truths_stay_sealed(exam):
    shutil.rmtree(exam / "diagnoses" / "case-0001")
    (exam / "sealed" / "case-0001.sealed").write_text("never looked at")
    found = score_exam_so_far(exam)
    assert [case.id for case in found.cases] == ["case-0002"]
    assert found.marks.outcomes == {cases.POOR_DATA: {"right": 1}}
    assert found.words == "seed 1, 2 cases of the kind 'poor data', 1 of them so far"
    with pytest.raises(BadInput, match="is not what was sealed"):
        score_exam(exam)
    shutil.rmtree(exam / "diagnoses")
    with pytest.raises(BadInput, match="nothing is diagnosed yet"):
        score_exam_so_far(exam)


@pytest.mark.slow
def test_workers_have_one_thread_each(exam):
    shutil.rmtree(exam / "diagnoses")
    before = os.environ.get("OPENBLAS_NUM_THREADS")
    with process_executor(2) as processes:
        examine(exam, 1, NUMBERS, tells_its_process, processes)
    for told in (
        json.loads(path.read_text()) for path in (exam / "diagnoses").glob("*/process.json")
    ):
        assert told == {"threads": 1, "openblas": "1"}
    assert os.environ.get("OPENBLAS_NUM_THREADS") == before
