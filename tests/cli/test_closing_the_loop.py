"""Rounds of proposal, run and diagnosis on the twin, what the diagnosis says given by hand."""

import io
from dataclasses import replace

import pytest

from rfca_rig.campaign.opening import open_recordings
from rfca_rig.cli.close_the_loop import ClosedLoop, close_the_loop
from rfca_rig.diagnosis.experiment_design.leg_experiment import NEXT_PROTOCOL, write_next_protocol
from rfca_rig.diagnosis.leg.problem import LegProblem
from rfca_rig.errors import BadInput
from tests.campaign.small import SMALL
from tests.diagnosis.by_hand import RIG_FILE
from tests.report.test_diagnosis_page import NAMED, UNEXPLAINED

TWIN = SMALL.parents[2] / "calibration" / "twin.toml"
REAL_RIG = SMALL.parent / "real-rig.toml"
FLAP = {
    "kind": "dynamic",
    "height_mm": 235.0,
    "speed_rad_s": 3.0,
    "repeats": 1,
    "minutes": 2.0,
    "separates": [],
    "why": "a try",
}
OPEN = replace(UNEXPLAINED, next_experiment={**FLAP, "protocol": NEXT_PROTOCOL})
BY_HAND = replace(
    UNEXPLAINED, next_experiment={"kind": "tap test", "why": "tap it", "protocol": None}
)
DONE = replace(
    NAMED,
    effects=tuple(replace(effect, cannot_tell_from=()) for effect in NAMED.effects),
    next_experiment=None,
)


@pytest.fixture
def first():
    """A recording that believes what the twin's rig file says."""
    (recording,) = open_recordings([SMALL])
    return replace(
        recording,
        nominal=RIG_FILE.nominal(),
        known_to=RIG_FILE.known_to.model_dump(exclude_none=True),
    )


class Answers:
    """Diagnoses in turn; keeps how many recordings each was given, and writes the protocol as
    the command does.
    """

    def __init__(self, folder, *diagnoses):
        self.folder = folder
        self.left = list(diagnoses)
        self.given = []

    def __call__(self, problem):
        self.given.append([recording.title for recording in problem.list_runs()])
        diagnosis = self.left.pop(0)
        write_next_protocol(self.folder, diagnosis.next_experiment)
        return diagnosis


def loop(tmp_path, rounds=3, rig=TWIN):
    return ClosedLoop(rig, rounds, tmp_path / "runs", tmp_path, None, quiet=False)


@pytest.mark.slow
def test_it_ends_when_one_class_is_left(tmp_path, first, capsys):
    answers = Answers(tmp_path, OPEN, OPEN, DONE)
    assert close_the_loop(loop(tmp_path), LegProblem((first,)), answers) is DONE
    assert [len(titles) for titles in answers.given] == [1, 2, 3]
    runs = sorted((tmp_path / "runs").iterdir())
    recorded = open_recordings(runs)
    assert [
        (len(r.strokes), r.strokes[0].height_m, r.strokes[0].speed_rad_s) for r in recorded
    ] == [(1, 0.235, 3.0)] * 2
    assert recorded[0].nominal == recorded[1].nominal == first.nominal
    assert recorded[0].provenance["seed"] != recorded[1].provenance["seed"]
    lines = capsys.readouterr().err.splitlines()
    assert sum(line.startswith(f"SIM round 1 of 3: {runs[0]}") for line in lines) == 1
    assert lines[-1] == "SIM nothing is left open"


@pytest.mark.slow
def test_it_ends_when_the_rounds_are_used_up(tmp_path, first, capsys):
    answers = Answers(tmp_path, OPEN, OPEN)
    close_the_loop(loop(tmp_path, rounds=1), LegProblem((first,)), answers)
    assert capsys.readouterr().err.splitlines()[-1] == "SIM the rounds are used up; next: a try"


def test_it_ends_when_a_person_is_asked(tmp_path, first, capsys):
    answers = Answers(tmp_path, BY_HAND)
    assert close_the_loop(loop(tmp_path), LegProblem((first,)), answers) is BY_HAND
    assert "not one for the rig: tap test" in capsys.readouterr().err
    assert not (tmp_path / "runs").exists()


@pytest.mark.slow
def test_new_runs_believe_what_the_first_recording_believes(tmp_path, first):
    leg = {**first.nominal["leg"], "k0_Nm_per_rad": 10.5}
    other = replace(first, nominal={**first.nominal, "leg": leg})
    answers = Answers(tmp_path, OPEN, DONE)
    close_the_loop(loop(tmp_path), LegProblem((other,)), answers)
    (recorded,) = open_recordings(list((tmp_path / "runs").iterdir()))
    assert (recorded.nominal, recorded.known_to) == (other.nominal, other.known_to)


def test_a_real_rig_moves_only_when_armed(tmp_path, first, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO("yes\n"))
    answers = Answers(tmp_path, OPEN)
    with pytest.raises(BadInput, match="not armed"):
        close_the_loop(loop(tmp_path, rig=REAL_RIG), LegProblem((first,)), answers)
    assert not (tmp_path / "runs").exists()


def test_the_limits_of_the_rig_file_hold(tmp_path, first):
    fast = replace(OPEN, next_experiment={**OPEN.next_experiment, "speed_rad_s": 21.0})
    answers = Answers(tmp_path, fast)
    with pytest.raises(BadInput, match="above the rig's limit of 20 rad/s"):
        close_the_loop(loop(tmp_path), LegProblem((first,)), answers)
