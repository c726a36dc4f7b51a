"""twin conceal writes a riddle, diagnose --reveal says what it was."""

from dataclasses import replace

import pytest

from rfca_rig.cli.reveal import describe_reveal
from rfca_rig.diagnosis.result import NamedEffect, StatedFamily, Value
from rfca_rig.model.parameters import PresentEffect
from tests.cli.typed import typed
from tests.diagnosis.test_invariants import IDENTIFIED, NOTHING

PLAY = PresentEffect("hinge_backlash", (("half_gap_deg", 0.71234),))
OTHER = PresentEffect("tip_mass", (("mass_g", 6.0),))
HYSTERESIS = PresentEffect(
    "spring_hysteresis",
    (("strength_relative", 0.2), ("saturation_deg", 3.0), ("exponent", 1.0)),
)


def test_a_stated_effect_is_found_with_its_sizes():
    (line,) = describe_reveal([PLAY], IDENTIFIED)
    assert line == "concealed: hinge_backlash, half_gap_deg 0.712: found"


def test_an_effect_that_cannot_be_told_from_the_stated_one_is_no_mistake():
    (line,) = describe_reveal([HYSTERESIS], IDENTIFIED)
    # Shape parameters are no sizes.
    assert line == (
        "concealed: spring_hysteresis, strength_relative 0.2, saturation_deg 3: stated as "
        "hinge_backlash, which these data cannot tell from it"
    )


def test_a_member_of_the_stated_family_is_said_to_be_one():
    family = StatedFamily("leg_mass", "", "tip", 0.9, ("tip_mass", "heavier_link"))
    of_family = replace(IDENTIFIED, grade="family", effects=(), family=family)
    assert describe_reveal([OTHER], of_family)[0].endswith(": of the stated family")
    assert describe_reveal([PLAY], of_family)[0].endswith(": WRONG: something else is stated")


def test_something_else_is_wrong_and_silence_is_not():
    assert describe_reveal([OTHER], IDENTIFIED)[0].endswith(": WRONG: something else is stated")
    assert describe_reveal([OTHER], NOTHING)[0].endswith(": not found, and nothing else is stated")


def test_an_effect_beside_it_that_is_not_there_is_said():
    mass = NamedEffect("tip_mass", "", 0.9, {"mass_g": Value(6.0, 1.0)}, (), "")
    both = replace(IDENTIFIED, effects=(*IDENTIFIED.effects, mass))
    assert describe_reveal([PLAY], both)[0].endswith(
        ": found, beside tip_mass, which the twin does not have"
    )
    assert [line.rpartition(": ")[2] for line in describe_reveal([PLAY, OTHER], both)] == [
        "found",
        "found",
    ]


@pytest.mark.slow
def test_a_riddle_is_written_run_found_and_revealed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    written = typed(monkeypatch, capsys, "twin", "conceal", "riddle.toml", "--seed", 4)
    assert written.exit_code == 0
    assert "hinge" not in written.out + written.err
    ran = typed(
        monkeypatch, capsys, "dynamic", "run", "--protocol", "table2", "--rig", "riddle.toml"
    )
    assert ran.exit_code == 0
    found = typed(monkeypatch, capsys, "diagnose", "runs/SIM-table-ii-001", "--reveal")
    assert found.out.splitlines()[-1] == "concealed: hinge_backlash, half_gap_deg 0.771: found"
    text = (tmp_path / "diagnosis" / "diagnosis.html").read_text(encoding="utf-8")
    assert "concealed" not in text


def test_a_rig_file_that_is_there_stays(tmp_path, monkeypatch, capsys):
    path = tmp_path / "riddle.toml"
    path.write_text("mine", encoding="utf-8")
    said = typed(monkeypatch, capsys, "twin", "conceal", path)
    assert said.exit_code == 2
    assert "is there already" in said.err
    assert path.read_text(encoding="utf-8") == "mine"
    assert typed(monkeypatch, capsys, "twin", "conceal", tmp_path / "no" / "a.toml").exit_code == 2


def test_nothing_is_revealed_of_recordings_that_conceal_nothing(monkeypatch, capsys):
    said = typed(monkeypatch, capsys, "diagnose", "tests/data/small-campaign", "--reveal")
    assert said.exit_code == 2
    assert "--reveal: the twin of these recordings conceals nothing" in said.err
    said = typed(monkeypatch, capsys, "diagnose", "tests/data/small-campaign", "--each", "--reveal")
    assert said.exit_code == 2
    assert "--reveal: is about one diagnosis; leave out --each" in said.err
