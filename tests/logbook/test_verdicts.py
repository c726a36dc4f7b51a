"""A run is listed with what the newest diagnosis that names it said, wherever either lies."""

import json
import os
import shutil

import pytest

from rfca_rig.logbook.listing import list_runs
from rfca_rig.logbook.reading import read_entry
from tests.logbook.made import DONE, plan, run

PLAN = plan("flapping")


def said(folder, identities, verdict="named", effects=(("hinge_backlash", 0.97),), at_s=None):
    folder.mkdir(parents=True, exist_ok=True)
    text = {
        "verdict": verdict,
        "effects": [{"id": name, "probability": sure} for name, sure in effects],
        "recordings": [
            {"title": "", "source": "SIM", "identity": identity} for identity in identities
        ],
    }
    (folder / "diagnosis.json").write_text(json.dumps(text))
    if at_s is not None:
        os.utime(folder / "diagnosis.json", (at_s, at_s))


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for number in range(2):
        run(tmp_path / "runs" / f"SIM-{number}", PLAN, ending=DONE, sample=f"leg {number}")
    return tmp_path


def listed(here):
    return {
        entry.sample: entry.verdict
        and (entry.verdict.words, entry.verdict.effects, entry.verdict.file)
        for entry in list_runs(here / "runs")
    }


def identity(here, number):
    return read_entry(here / "runs", f"SIM-{number}").identity


@pytest.mark.parametrize("place", ["diagnosis", "runs/SIM-0", "runs/SIM-0/diagnosis", "anything"])
def test_a_diagnosis_is_found_by_what_it_names(here, place):
    said(here / place, [identity(here, 0)])
    found = listed(here)
    assert found["leg 0"] == ("named", ("hinge_backlash",), f"{place}/diagnosis.json")
    assert found["leg 1"] is None


def test_the_newest_word_counts_and_a_new_one_is_heard_at_once(here):
    both = [identity(here, 0), identity(here, 1)]
    said(here / "old", both, at_s=1e9)
    said(here / "new", both[:1], "nothing missing", (), at_s=2e9)
    assert [listed(here)[f"leg {k}"][0] for k in (0, 1)] == ["nothing missing", "named"]
    said(here / "newest", both, "unexplained", (), at_s=3e9)
    assert [listed(here)[f"leg {k}"][0] for k in (0, 1)] == ["unexplained", "unexplained"]
    shutil.rmtree(here / "newest")
    assert listed(here)["leg 0"][0] == "nothing missing"


def test_a_run_that_was_renamed_keeps_its_verdict_and_one_that_took_its_name_gets_none(here):
    said(here / "diagnosis", [identity(here, 0)])
    (here / "runs" / "SIM-0").rename(here / "runs" / "best")
    run(here / "runs" / "SIM-0", PLAN, ending=DONE, sample="another leg")
    found = listed(here)
    assert found["leg 0"][0] == "named"
    assert found["another leg"] is None


@pytest.mark.parametrize(
    "content",
    [
        "",
        "{",
        "[]",
        "null",
        '{"verdict": "named"}',
        '{"recordings": [{}], "verdict": 1, "effects": []}',
    ],
)
def test_a_file_that_is_no_diagnosis_says_nothing(here, content):
    (here / "diagnosis").mkdir()
    (here / "diagnosis" / "diagnosis.json").write_text(content)
    assert set(listed(here).values()) == {None}
