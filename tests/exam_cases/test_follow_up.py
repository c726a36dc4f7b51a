"""Follow-ups of open cases, by diagnoses that name the truth once they have seen enough
conditions.
"""

import json
import tomllib
from pathlib import Path

import pytest

from rfca_rig.campaign.reading import read_campaign
from rfca_rig.errors import BadInput
from rfca_rig.exam import cases
from rfca_rig.exam.examine import examine
from rfca_rig.exam.follow_up import FOLDER, MAX_EXPERIMENTS, follow_up, ways
from rfca_rig.exam.sealing import open_all
from rfca_rig.executors.mapping import InProcessExecutor

STROKE = {"height_mm": 230.0, "speed_rad_s": 2.0, "repeats": 2, "protocol": "next-experiment.toml"}
REVERSAL = {
    "height_mm": 210.0,
    "stages": [
        {"angle_deg": 110.0, "direction": "loading"},
        {"angle_deg": 110.0, "direction": "loading"},
    ],
    "protocol": "next-experiment.toml",
}


def conditions_of(campaign: Path) -> int:
    runs = tomllib.loads((campaign / "campaign.toml").read_text())["runs"]
    return len({(run.get("height_mm"), run.get("speed_rad_s")) for run in runs})


def naming(truths, enough, proposal):
    """Names what is sealed once there are `enough` conditions, and proposes the same experiment
    until then.
    """

    def diagnose(campaign: Path, into: Path) -> None:
        read_campaign(campaign)  # what was added can be read
        into.mkdir(parents=True)
        name = next(part for part in campaign.parts[::-1] if part.startswith("case-"))[:9]
        effects = [
            {"id": id_, "probability": 0.99, "parameters": {}} for id_ in truths[name]["effects"]
        ]
        if conditions_of(campaign) < enough:
            verdict = "not enough data"
            effects = []
        elif effects:
            verdict = "named"
        else:
            verdict = "nothing missing"
        said = {
            "format": "rfca-diagnosis/1",
            "verdict": verdict,
            "effects": effects,
            "next_experiment": proposal,
        }
        (into / "diagnosis.json").write_text(json.dumps(said))

    return diagnose


@pytest.fixture
def exam(tmp_path):
    """Two open cases, one of which conceals something."""

    def answered(proposal):
        folder = tmp_path / "exam"
        examine(
            folder,
            1,
            {cases.POOR_DATA: 2},
            naming({f"case-000{i}": {"effects": {}} for i in (1, 2)}, 99, proposal),
        )
        return folder, {truth["case"]: truth for truth in open_all(folder)}

    return answered


@pytest.mark.slow
def test_what_is_proposed_is_done_until_the_verdict_is_right(exam):
    folder, truths = exam(STROKE)
    follow_up(folder, naming(truths, 2, STROKE), InProcessExecutor())
    proposed, lot = ways(folder)
    assert (
        proposed.settled
        == proposed.of
        == len(
            [t for t in truths.values() if not t["effects"] or t["size"]["left_over_noise"] >= 2.0]
        )
    )
    assert proposed.experiments == 1.0 and lot.experiments >= 1.0
    added = folder / FOLDER / "case-0001-proposed" / "campaign" / "runs"
    assert sorted(path.name for path in added.glob("next-*")) == [
        "next-01-dynamic-01.csv",
        "next-01-dynamic-02.csv",
    ]


@pytest.mark.slow
def test_a_static_proposal_is_done_in_its_own_stages(exam):
    folder, truths = exam(REVERSAL)
    follow_up(folder, naming(truths, 2, REVERSAL), InProcessExecutor())
    (recording,) = [read_campaign(folder / FOLDER / "case-0002-proposed" / "campaign")]
    assert [stage.shaft_angle_rad for stage in recording.static] == pytest.approx(
        [1.92, 1.92], abs=0.03
    )  # a soft drive sags


@pytest.mark.slow
def test_a_case_that_nothing_settles_counts_as_given_up(exam):
    folder, truths = exam(None)
    follow_up(folder, naming(truths, 99, None), InProcessExecutor())
    proposed, lot = ways(folder)
    assert proposed.settled == lot.settled == 0
    assert proposed.experiments == lot.experiments == MAX_EXPERIMENTS


def test_what_was_followed_is_not_followed_again(exam):
    folder, truths = exam(STROKE)
    follow_up(folder, naming(truths, 2, STROKE), InProcessExecutor())
    before = ways(folder)

    def refuses(campaign: Path, into: Path) -> None:
        raise BadInput("asked again")

    follow_up(folder, refuses, InProcessExecutor())
    assert ways(folder) == before
