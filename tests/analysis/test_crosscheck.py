"""The model against MuJoCo."""

import json
import re
import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import typer

from rfca_rig.analysis.crosscheck import (
    PAPER_PCT,
    TIGHT_TOLERANCE,
    CheckedCondition,
    average_pct,
    check_condition,
    check_own_contact,
    difference_pct,
)
from rfca_rig.analysis.mujoco_leg import (
    leg_on_springs,
    mujoco_leg,
    settle_at_rest,
    stroke_in_mujoco,
    stroke_on_springs,
)
from rfca_rig.cli.commands.crosscheck import crosscheck
from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.model.chain import find_rest_state, make_chain
from rfca_rig.model.stroke import simulate_stroke_at_speed
from rfca_rig.protocol.experiments import PlannedCondition
from rfca_rig.reports.strokes.overlay import write_crosscheck_picture
from tests.model.legs import PAPER

needs_mujoco = pytest.mark.skipif(
    find_spec("mujoco") is None,
    reason='MuJoCo is not installed: pip install "rfca-rig[crosscheck]"',
)

ROOT = Path(__file__).parents[2]

PAPERS = (
    PlannedCondition(0.215, 2.433),
    PlannedCondition(0.215, 3.249),
    PlannedCondition(0.235, 2.478),
    PlannedCondition(0.235, 3.276),
)
QUICK = PAPERS[3]
SWEEP_DEG = 200.0
COARSE_S = 5e-5

ONE_CONDITION = """
experiment = "dynamic"
title = "one"
repeats = 1
sweep_deg = 150.0
return_speed_rad_s = 3.0
settle = {{ force_band_N = 0.3, angle_band_deg = 0.2, for_s = 0.3, limit_s = 10.0 }}
conditions = [{{ height_mm = {height_mm}, speed_rad_s = 3.276 }}]
"""


@pytest.fixture
def typed(tmp_path, monkeypatch, capsys):
    """Types `rfca-rig crosscheck` for one condition; gives standard output."""

    def type_it(*words, height_mm=235.0):
        protocol = tmp_path / "one.toml"
        protocol.write_text(ONE_CONDITION.format(height_mm=height_mm))
        app = typer.Typer()
        app.command()(crosscheck)
        monkeypatch.setattr(
            sys, "argv", ["crosscheck", "--protocol", str(protocol), *map(str, words)]
        )
        app(standalone_mode=False)
        return capsys.readouterr().out

    return type_it


def test_without_mujoco_one_line_names_the_extra(typed, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(BadInput, match=r'pip install "rfca-rig\[crosscheck\]"') as told:
        typed()
    assert "\n" not in str(told.value)


def test_the_difference_of_two_curves_is_that_of_their_norms():
    assert difference_pct(np.array([3.0, 4.4]), np.array([3.0, 4.0])) == pytest.approx(8.0)
    assert difference_pct(np.zeros(3), np.zeros(3)) == 0.0
    assert difference_pct(np.ones(3), np.zeros(3)) == np.inf


@pytest.mark.long
@needs_mujoco
@pytest.mark.parametrize(
    "condition", PAPERS, ids=lambda one: f"{1e3 * one.height_m:g} mm, {one.speed_rad_s:g} rad/s"
)
def test_under_the_papers_conditions_the_contact_force_is_mujocos(condition):
    checked = check_condition(PAPER, condition, SWEEP_DEG)
    assert checked.stroke_pct < 0.1
    assert checked.loading_pct < 0.05
    assert difference_pct(checked.ours.fz_N, checked.theirs.fz_N) < 0.1
    assert (
        difference_pct(checked.ours.tangential_N.sum(axis=1), checked.theirs.tangential_N) < 0.5
    )  # it jumps where stick ends
    assert abs(checked.theirs.speed_error) < 1e-8
    assert average_pct([checked, checked]) == checked.stroke_pct < PAPER_PCT


@pytest.mark.slow
@needs_mujoco
@pytest.mark.parametrize(("rise", "leaving"), [(1.0, 1.0), (0.0, 0.0), (0.6, 0.3)])
def test_so_it_is_deep_in_a_soft_floor_where_friction_acts_higher_and_leaving_is_damped_less(
    rise, leaving
):
    soft, plain = (
        replace(
            PAPER,
            ground=replace(
                PAPER.ground,
                stiffness_N_per_m1p5=1.2e4,
                friction_rise_share=r,
                leaving_damping_share=share,
            ),
        )
        for r, share in ((rise, leaving), (0.0, 1.0))
    )
    checked = check_condition(soft, QUICK, SWEEP_DEG)
    assert checked.stroke_pct < 0.01
    without = simulate_stroke_at_speed(plain, QUICK.height_m, QUICK.speed_rad_s, checked.ours.t_s)
    assert difference_pct(without.fz_N, checked.theirs.fz_N) > 3.0


@pytest.mark.slow
@needs_mujoco
def test_a_leg_that_is_bent_at_rest_agrees_with_mujoco():
    bent = replace(
        PAPER, leg=replace(PAPER.leg, rest_angles_rad=(0.02, -0.03, 0.05, 0.0, 0.01, -0.02))
    )
    checked = check_condition(bent, QUICK, SWEEP_DEG)
    assert checked.stroke_pct < 0.01
    straight = simulate_stroke_at_speed(PAPER, QUICK.height_m, QUICK.speed_rad_s, checked.ours.t_s)
    assert difference_pct(straight.fz_N, checked.theirs.fz_N) > 3.0


@pytest.mark.slow
@needs_mujoco
def test_what_difference_there_is_comes_from_the_tolerance():
    checked = check_condition(PAPER, QUICK, SWEEP_DEG)
    tight = simulate_stroke_at_speed(
        PAPER, QUICK.height_m, QUICK.speed_rad_s, checked.ours.t_s, TIGHT_TOLERANCE
    )
    assert difference_pct(tight.normal_N.sum(axis=1), checked.theirs.normal_N) < 0.002


@pytest.mark.long
@needs_mujoco
@pytest.mark.parametrize(
    "section, name",
    [
        ("ground", "friction_coefficient"),
        ("leg", "k0_Nm_per_rad"),
        ("leg", "k2_per_rad2"),
        ("ground", "stiffness_N_per_m1p5"),
        ("ground", "drag_N_s_per_m"),
        ("leg", "hinge_damping_Nm_s_per_rad"),
    ],
)
def test_a_parameter_two_percent_off_on_one_side_is_seen(section, name):
    part = getattr(PAPER, section)
    other = replace(PAPER, **{section: replace(part, **{name: 1.02 * getattr(part, name)})})
    t_s = np.arange(600) * 1e-3
    ours = simulate_stroke_at_speed(PAPER, QUICK.height_m, QUICK.speed_rad_s, t_s, TIGHT_TOLERANCE)
    same, off = (
        stroke_in_mujoco(rig, QUICK.height_m, QUICK.speed_rad_s, t_s, COARSE_S)
        for rig in (PAPER, other)
    )
    contact_N = ours.normal_N.sum(axis=1)
    assert difference_pct(contact_N, off.normal_N) > 10.0 * difference_pct(contact_N, same.normal_N)


@needs_mujoco
def test_both_hang_alike_and_weigh_what_they_weigh():
    leg = mujoco_leg(PAPER, 0.3, floor=False, integrator="RK4")
    settle_at_rest(leg, PAPER.leg.start_angle_rad)
    assert np.cumsum(leg.data.qpos) == pytest.approx(
        find_rest_state(make_chain(PAPER, 0.3), PAPER.leg.start_angle_rad).q, abs=1e-9
    )
    resting = stroke_in_mujoco(PAPER, 0.3, 1.0, np.array([-0.1, 0.0]))
    assert resting.fz_N == pytest.approx(0.32 * 9.81)
    assert resting.steps == 0


@needs_mujoco
def test_mujocos_own_contact_agrees_in_the_loading_phase():
    checked = check_own_contact(PAPER, QUICK, SWEEP_DEG)
    assert checked.loading_pct < 0.15
    assert checked.summary()["valley_ours"] == pytest.approx(
        checked.summary()["valley_mujoco"], rel=3e-3
    )


@needs_mujoco
def test_mujocos_contact_pushes_back_with_stiffness_times_indentation():
    height_m = 0.2
    indentation_m = 1e-3
    leg = leg_on_springs(PAPER, height_m, 5e4)
    leg.data.qpos[0] = np.arcsin(
        (height_m + indentation_m - PAPER.leg.link_radius_m) / sum(PAPER.leg.link_lengths_m)
    )
    leg.mujoco.mj_forward(leg.model, leg.data)
    force = np.zeros(6)
    leg.mujoco.mj_contactForce(leg.model, leg.data, 0, force)
    assert leg.data.ncon == 1
    assert force[0] == pytest.approx(5e4 * indentation_m, rel=1e-3)


@needs_mujoco
def test_a_step_too_long_is_told_in_one_line_and_leaves_nothing_behind(
    tmp_path, monkeypatch, capfd
):
    import mujoco

    monkeypatch.chdir(tmp_path)
    with pytest.raises(SimulationFailed, match=r"lost the leg at 0\.\d+ s with steps of 10000 us"):
        stroke_in_mujoco(PAPER, 0.235, 3.276, np.arange(50) * 1e-2, 1e-2)
    assert mujoco.get_mjcb_passive() is None
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr() == ("", "")


@needs_mujoco
@pytest.mark.parametrize("height_m, reason", [(0.4, "never touches"), (0.05, "lies on the ground")])
def test_a_stroke_that_has_no_contact_of_its_own_is_refused(height_m, reason):
    with pytest.raises(BadInput, match=reason):
        check_condition(PAPER, PlannedCondition(height_m, 3.276), SWEEP_DEG)


@needs_mujoco
def test_a_recording_that_ends_before_the_valley_has_no_loading_phase():
    t_s = np.arange(450) * 1e-3
    ours = simulate_stroke_at_speed(PAPER, QUICK.height_m, QUICK.speed_rad_s, t_s)
    short = CheckedCondition(
        QUICK, ours, stroke_in_mujoco(PAPER, QUICK.height_m, QUICK.speed_rad_s, t_s, COARSE_S)
    )
    assert short.loading_pct is None
    assert short.summary()["valley_mujoco"] is None


@pytest.mark.slow
@needs_mujoco
def test_the_command_answers_a_program_and_draws(typed, tmp_path):
    answer = json.loads(typed("--json", "--picture", tmp_path / "p.svg"))
    assert answer["paper_against_recurdyn_pct"] == 4.91
    (same,) = answer["same_ground"]
    assert (
        same["contact_force_difference_pct"] == answer["average_contact_force_difference_pct"] < 0.1
    )
    assert len(answer["own_contact_on_stiff_ground"]) == 1
    assert "235 mm, 3.276 rad/s" in (tmp_path / "p.svg").read_text()


@pytest.mark.slow
@needs_mujoco
def test_readme_and_model_page_state_what_the_command_prints(monkeypatch, capsys):
    app = typer.Typer()
    app.command()(crosscheck)
    monkeypatch.setattr(sys, "argv", ["crosscheck"])
    app(standalone_mode=False)
    average = re.search(r"average ([\d.]+) %", capsys.readouterr().out)[1]
    for page in ("README.md", "docs/model.md"):
        stated = re.findall(r"conditions\s+differs? by ([\d.]+) %", (ROOT / page).read_text())
        assert stated == [average], page


@pytest.mark.slow
@needs_mujoco
def test_the_command_answers_a_person(typed):
    said = typed().splitlines()
    assert said[1].split() == ["condition", "whole", "stroke", "(%)", "loading", "(%)"]
    assert (
        said[2].split()[:4] == ["235", "mm,", "3.276", "rad/s"]
        and 0.0 < float(said[2].split()[4]) < 0.1
    )
    assert "the paper's model and RecurDyn: 4.91 %" in said[3]


@needs_mujoco
def test_a_picture_of_no_known_kind_is_refused_before_anything_is_computed(typed, monkeypatch):
    monkeypatch.setattr("rfca_rig.analysis.crosscheck.simulate_stroke_at_speed", None)
    with pytest.raises(BadInput, match=r"p\.gif: a picture ends in \.svg"):
        typed("--picture", "p.gif")


@needs_mujoco
def test_a_picture_that_cannot_be_written_is_told(tmp_path):
    t_s = np.arange(400) * 1e-3
    ours = simulate_stroke_at_speed(PAPER, QUICK.height_m, QUICK.speed_rad_s, t_s)
    theirs = stroke_on_springs(PAPER, QUICK.height_m, QUICK.speed_rad_s, t_s, 1e4, 1e-4)
    with pytest.raises(BadInput, match="cannot be written"):
        write_crosscheck_picture(
            [CheckedCondition(QUICK, ours, theirs)], tmp_path / "nowhere" / "p.png"
        )
