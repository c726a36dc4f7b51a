"""Effects that somebody knows are none."""

import json

import pytest

from rfca_rig.diagnosis.candidate_effects import describe_exclusions, select_candidates
from rfca_rig.errors import BadInput
from rfca_rig.exam.campaign_of import write_campaign
from rfca_rig.exam.cases import POOR_DATA, drawn_cases
from rfca_rig.model.catalogue import catalogue
from tests.cli.typed import typed


def test_all_are_looked_for_but_those():
    kept = select_candidates(catalogue().values(), ["tip_mass", "fluid_drag"])
    assert set(catalogue()) - {effect.id for effect in kept} == {"tip_mass", "fluid_drag"}
    assert select_candidates(catalogue().values(), ()) == list(catalogue().values())
    assert describe_exclusions(()) == () and describe_exclusions(["tip_mass"]) == ("not looked for, as asked: tip_mass",)


def test_one_that_is_in_no_catalogue_is_refused_before_anything_is_read(monkeypatch, capsys, tmp_path):
    with pytest.raises(BadInput, match="did you mean tip_mass"):
        select_candidates((), ["tip_mas"])
    said = typed(monkeypatch, capsys, "diagnose", tmp_path / "none", "--without", "hinge_backlsh", "--each", "--out", tmp_path / "out")
    assert (said.exit_code, said.err) == (2, "rfca-rig: effect 'hinge_backlsh' is not in the catalogue; did you mean hinge_backlash?\n")
    assert not (tmp_path / "out").exists()


def test_the_answer_says_so_and_does_not_speak_of_them(monkeypatch, capsys, tmp_path):
    (case,) = drawn_cases(7, {POOR_DATA: 1})
    write_campaign(case, tmp_path / "campaign")
    words = ("diagnose", tmp_path / "campaign", "--without", "tip_mass", "--without", "fluid_drag", "--out", tmp_path / "out")
    said = typed(monkeypatch, capsys, *words)
    assert said.exit_code == 0
    assert "left out: not looked for" not in said.out
    answer = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert "not looked for, as asked: tip_mass, fluid_drag" in answer["remarks"]
    assert not {"tip_mass", "fluid_drag"} & set(answer["settings"]["effects_tried"])
    assert "--without tip_mass --without fluid_drag" in (tmp_path / "out" / "diagnosis.html").read_text()
