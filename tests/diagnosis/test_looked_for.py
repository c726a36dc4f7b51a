"""Effects that somebody knows are none."""

import json
from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.campaign.reading import read_campaign
from rfca_rig.diagnosis.config import describe_exclusions, select_candidates
from rfca_rig.diagnosis.leg.prepared import prepare_leg
from rfca_rig.diagnosis.leg.problem import list_candidates
from rfca_rig.diagnosis.leg.stages import make_stage_tables
from rfca_rig.errors import BadInput
from rfca_rig.exam.cases import POOR_DATA, draw_cases
from rfca_rig.exam.simulate_campaign import write_campaign
from rfca_rig.model.catalogue import catalogue
from rfca_rig.model.parameters import PresentEffect
from rfca_rig.recording.model import Recording
from tests.campaign.small import SMALL
from tests.cli.typed import typed
from tests.diagnosis.by_hand import RIG, flaps_of, recorded


def test_all_are_looked_for_but_those():
    kept = select_candidates(catalogue().values(), ["tip_mass", "fluid_drag"])
    assert set(catalogue()) - {effect.id for effect in kept} == {"tip_mass", "fluid_drag"}
    assert select_candidates(catalogue().values(), ()) == list(catalogue().values())
    assert describe_exclusions(()) == () and describe_exclusions(["tip_mass"]) == (
        "not looked for, as asked: tip_mass",
    )


def counted(recording: Recording) -> Recording:
    strokes = tuple(
        replace(stroke, strokes_before=before) for before, stroke in enumerate(recording.strokes)
    )
    return replace(
        recording,
        strokes=strokes,
        static=tuple(replace(stage, strokes_before=len(strokes)) for stage in recording.static),
    )


def is_looked_for(effect_id: str, *recordings: Recording) -> bool:
    return effect_id in {effect.id for effect in list_candidates(prepare_leg(recordings))}


def test_what_changes_from_stroke_to_stroke_is_looked_for_only_where_their_order_is_known():
    plain = read_campaign(SMALL)
    known = counted(plain)
    partly = replace(known, strokes=(*known.strokes[:-1], plain.strokes[-1]))
    assert is_looked_for("stiffness_fading", known)
    for unknown in ((plain,), (partly,), (replace(known, static=plain.static),), (known, known)):
        assert not is_looked_for("stiffness_fading", *unknown)
    assert is_looked_for("damaged_hinge", plain)


def test_the_strokes_of_a_run_stand_in_the_order_in_which_it_made_them():
    run = replace(read_campaign(SMALL), source="SIM").with_order()
    assert [stroke.strokes_before for stroke in run.strokes] == [0, 1, 2, 3]


def test_conditions_and_tables_are_simulated_after_the_strokes_before_them():
    (flap,) = flaps_of([replace(recorded(RIG, [(215.0, 2.4)])[0], strokes_before=9)])
    table = prepare_leg([counted(read_campaign(SMALL))]).tables[0]
    fading = PresentEffect("stiffness_fading", (("loss_per_decade_relative", 0.2),))
    for condition, before in [(flap, 9), (table, 4)]:
        leg = replace(RIG.leg, k0_Nm_per_rad=RIG.leg.k0_Nm_per_rad * 0.8 ** np.log10(1.0 + before))
        softer = condition.simulated(ModelPoint(replace(RIG, leg=leg)))
        assert condition.simulated(ModelPoint(replace(RIG, effects=(fading,)))) == pytest.approx(
            softer, rel=1e-6, abs=1e-6
        )
    later = [replace(stage, strokes_before=9) for stage in table.stages]
    assert len(make_stage_tables([*table.stages, *later], {}, table.moves)) == 2


def test_one_that_is_in_no_catalogue_is_refused_before_anything_is_read(
    monkeypatch, capsys, tmp_path
):
    with pytest.raises(BadInput, match="did you mean tip_mass"):
        select_candidates((), ["tip_mas"])
    said = typed(
        monkeypatch,
        capsys,
        "diagnose",
        tmp_path / "none",
        "--without",
        "hinge_backlsh",
        "--each",
        "--out",
        tmp_path / "out",
    )
    assert (said.exit_code, said.err) == (
        2,
        "rfca-rig: effect 'hinge_backlsh' is not in the catalogue; did you mean hinge_backlash?\n",
    )
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_the_answer_says_so_and_does_not_speak_of_them(monkeypatch, capsys, tmp_path):
    (case,) = draw_cases(7, {POOR_DATA: 1})
    write_campaign(case, tmp_path / "campaign")
    words = (
        "diagnose",
        tmp_path / "campaign",
        "--without",
        "tip_mass",
        "--without",
        "fluid_drag",
        "--out",
        tmp_path / "out",
    )
    said = typed(monkeypatch, capsys, *words)
    assert said.exit_code == 0
    assert "left out: not looked for" not in said.out
    answer = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert "not looked for, as asked: tip_mass, fluid_drag" in answer["remarks"]
    assert not {"tip_mass", "fluid_drag"} & set(answer["settings"]["effects_tried"])
    assert (
        "--without tip_mass --without fluid_drag"
        in (tmp_path / "out" / "diagnosis.html").read_text()
    )
