"""rfca-rig diagnose and its --each: what stays, what cannot be diagnosed, and what is refused."""

import json
from pathlib import Path

import pytest

from rfca_rig.diagnosis.leg.findings import LegFindings
from rfca_rig.diagnosis.leg.problem import LegProblem, LegSolution
from rfca_rig.diagnosis.problem import AnswerPart
from tests.cli.typed import typed
from tests.report.test_diagnosis_page import UNEXPLAINED

CAMPAIGN = Path(__file__).parents[1] / "data" / "small-campaign"

ANSWER = {
    "format": "rfca-diagnosis/1",
    "verdict": "named",
    "effects": [{"id": "tip_mass", "probability": 0.987}],
}


@pytest.mark.slow
def test_what_is_there_stays_and_what_cannot_be_diagnosed_is_told(monkeypatch, capsys, tmp_path):
    for name in ("done", "empty", "void"):
        (tmp_path / "runs" / name).mkdir(parents=True)
    (tmp_path / "out" / "done").mkdir(parents=True)
    (tmp_path / "out" / "done" / "diagnosis.json").write_text(json.dumps(ANSWER))
    paths = sorted((tmp_path / "runs").iterdir())
    said = typed(
        monkeypatch, capsys, "diagnose", *paths, "--each", "--workers", 1, "--out", tmp_path / "out"
    )
    assert (said.exit_code, said.out) == (1, "done: named, tip_mass (98.7 %)\n")
    assert said.err.startswith(
        f"rfca-rig: 2 of 3 could not be diagnosed, as empty: {tmp_path / 'runs' / 'empty'}"
    )
    assert len(said.err.splitlines()) == 1
    assert [folder.name for folder in (tmp_path / "out").iterdir()] == ["done"]


def test_two_of_one_name_are_refused(monkeypatch, capsys, tmp_path):
    said = typed(
        monkeypatch,
        capsys,
        "diagnose",
        tmp_path / "a" / "run",
        tmp_path / "b" / "run",
        "--each",
        "--out",
        tmp_path / "out",
    )
    assert (
        said.exit_code == 2 and "is called run too" in said.err and not (tmp_path / "out").exists()
    )


def test_one_diagnosis_is_not_shared_out(monkeypatch, capsys, tmp_path):
    said = typed(monkeypatch, capsys, "diagnose", tmp_path, "--workers", 2)
    assert said.exit_code == 2 and "share out what --each makes many of" in said.err


def test_a_law_is_measured_of_one_diagnosis(monkeypatch, capsys, tmp_path):
    said = typed(monkeypatch, capsys, "diagnose", tmp_path, "--law", "hinges", "--each")
    assert (
        said.exit_code == 2
        and "--law measures the law of one diagnosis; leave out --each and --close-the-loop"
        in said.err
    )


class SolvedByHand(LegSolution):
    """Without a search; only the files of a measured law are as the product writes them."""

    def describe(self):
        return UNEXPLAINED

    def propose_experiment(self, _limits):
        return AnswerPart(None, lambda _folder: ())


@pytest.mark.slow
def test_the_measured_law_of_an_earlier_diagnosis_does_not_stay(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(
        LegProblem,
        "solve",
        lambda problem, *_: SolvedByHand(
            prepared=None,
            findings=LegFindings(forces=None),
            recording=problem.recordings_of_leg[0],
        ),
    )
    (tmp_path / "measured-law.toml").write_text("of an earlier diagnosis")
    said = typed(monkeypatch, capsys, "diagnose", CAMPAIGN, "--out", tmp_path)
    assert (
        said.exit_code == 0
        and (tmp_path / "diagnosis.json").is_file()
        and not (tmp_path / "measured-law.toml").exists()
    )
