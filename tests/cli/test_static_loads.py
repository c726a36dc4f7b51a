"""rfca-rig static load and static force, as they are typed."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.cli.typed import typed

SMALL_CAMPAIGN = Path(__file__).parents[1] / "data" / "small-campaign"


def test_the_force_of_a_shape_is_the_one_that_bent_it(monkeypatch, capsys, tmp_path):
    said = typed(
        monkeypatch,
        capsys,
        "static",
        "load",
        "--shaft",
        30,
        "--along",
        3,
        "--down",
        -20,
        "--json",
        "--picture",
        tmp_path / "load.svg",
    )
    assert said.exit_code == 0
    assert (tmp_path / "load.svg").read_text().startswith("<?xml")
    shape = json.loads(said.out)
    angles = ",".join(str(angle) for angle in shape["angles_deg"])
    (found,) = json.loads(
        typed(monkeypatch, capsys, "static", "force", "--angles", angles, "--json").out
    )
    assert found["force_N"] == pytest.approx([3.0, -20.0], abs=1e-4)
    words = typed(monkeypatch, capsys, "static", "load", "--shaft", 30, "--down", -20).out
    assert "force at the tip: +0.00 N along, -20.00 N down" in words
    assert "hinge 7:" in words


def test_the_photos_of_a_run_agree_with_its_sensor(monkeypatch, capsys):
    stages = json.loads(typed(monkeypatch, capsys, "static", "force", SMALL_CAMPAIGN, "--json").out)
    off = [(np.array(stage["force_N"]) - stage["felt_N"]) / stage["std_N"] for stage in stages]
    assert len(stages) >= 4
    assert np.median(np.abs(off)) < 3.0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "takes either a run or --angles"),
        (("--angles", "30,4"), "2 angles: this leg has 7"),
        (("--angles", "30,x"), "takes numbers in degrees"),
        (("--angles", "30,nan,1,1,1,1,1"), "takes numbers in degrees"),
        (("--angles", "1e300,0,0,0,0,0,0"), "beyond a whole turn"),
    ],
)
def test_what_cannot_be_used_is_said_in_one_line(monkeypatch, capsys, words, said):
    refused = typed(monkeypatch, capsys, "static", "force", *words)
    assert refused.exit_code == 2
    assert len(refused.err.splitlines()) == 1
    assert said in refused.err
