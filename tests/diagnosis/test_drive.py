"""The search in the shaft's own motion, beside what was found in the forces."""

from dataclasses import replace

import pytest

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.analysis.repeats import group_by_condition
from rfca_rig.diagnosis.config import DEFAULT_SEARCH
from rfca_rig.diagnosis.data import rms
from rfca_rig.diagnosis.decision.decide import decide
from rfca_rig.diagnosis.decision.joined import join_decisions
from rfca_rig.diagnosis.inference.hypotheses import ModelSelectionResult
from rfca_rig.diagnosis.leg.drive_search import list_drive_effects, search_drive
from rfca_rig.diagnosis.leg.result import _describe_delay, _with_delay
from rfca_rig.diagnosis.leg.shaft_observations import (
    estimate_delay_s,
    tracks_command,
    turns_as_commanded,
)
from rfca_rig.diagnosis.leg.strokes import make_turn
from rfca_rig.diagnosis.result import Criterion, StatedFamily
from rfca_rig.diagnosis.result_builder import build_result
from rfca_rig.model.effect import MOTOR_SIDE
from rfca_rig.model.motion import ramp_to_speed
from rfca_rig.model.parameters import RigModel
from rfca_rig.model.stroke import simulate_stroke
from tests.diagnosis.by_hand import (
    RIG,
    finding_of,
    flaps_of,
    found_among,
    late,
    named,
    nothing_missing,
    prepared_of,
    present,
    recorded,
    shafts_of,
    undecided,
)

THREE = ((215.0, 2.433), (215.0, 3.249), (235.0, 2.478))
EFFECTS = list_drive_effects((MOTOR_SIDE,))


@pytest.mark.slow
def test_a_drive_that_sags_is_looked_for_though_the_forces_look_a_little_like_a_soft_shaft():
    rig = replace(
        RIG, effects=(present("motor_speed_droop", kp_Nm_s_per_rad=5.0, ki_Nm_per_rad=40.0),)
    )
    strokes = recorded(rig, [(215.0, 2.433)])
    flaps = flaps_of(strokes)
    shafts = shafts_of(strokes, flaps)
    leg = found_among(flaps, ["shaft_compliance"])
    soft = replace(leg, named=tuple(replace(h, log_prior=1e6) for h in leg.named))
    drive = search_drive(
        prepared_of(flaps, soft, shafts), soft, EFFECTS, lambda *_: None, DEFAULT_SEARCH
    )
    assert drive.named[0].ids == ("motor_speed_droop",)


LATE_S = 3e-3


def found_late(rig: RigModel) -> tuple[ModelSelectionResult, ModelSelectionResult]:
    """What is found in the leg and in the drive where all of the rig does everything 3 ms after
    it was told to.
    """
    strokes = [late(stroke, LATE_S) for stroke in recorded(rig, THREE)]
    flaps = [
        replace(f, turn=make_turn(c, True))
        for c, f in zip(group_by_condition(strokes), flaps_of(strokes), strict=True)
    ]
    leg = found_among(flaps, [""])
    return leg, search_drive(
        prepared_of(flaps, leg, shafts_of(strokes, flaps)),
        leg,
        EFFECTS,
        lambda *_: None,
        DEFAULT_SEARCH,
    )


def test_a_drive_that_is_late_lacks_nothing_and_is_told_to_be_late():
    leg, drive = found_late(RIG)
    decision = decide(drive)
    assert decision.verdict == "nothing missing"
    prepared = prepared_of(drive.dataset.parts, leg, drive.dataset.parts)
    (said,) = _describe_delay(prepared, finding_of(drive, decision))
    assert said.startswith("the drive follows its commands 3.0 ms late")
    forces = build_result("late", leg, nothing_missing(leg), (), "dynamic")
    both = _with_delay(forces, decision.explanation)
    assert (
        set(both.priors) - set(forces.priors)
        == {"command_delay"}
        == set(both.believed_values) - set(forces.believed_values)
    )
    assert (both.priors["command_delay"].value, both.priors["command_delay"].std) == (0.0, 2.0)
    assert (both.nuisance_units["command_delay"], both.nuisance_keys["command_delay"]) == (
        "ms",
        "command_delay_ms",
    )
    assert both.believed_values["command_delay"].value == pytest.approx(3.0, abs=0.1)
    assert {**both.priors, **forces.priors} == both.priors


def test_a_shaft_that_is_only_late_is_no_case_for_the_drive():
    strokes = [late(stroke, LATE_S) for stroke in recorded(RIG, THREE[:1])]
    (shaft,) = shafts_of(strokes, flaps_of(strokes))
    assert not turns_as_commanded(shaft)
    assert tracks_command(shaft, RIG.drive.ramp_s)
    assert estimate_delay_s(shaft, RIG.drive.ramp_s) == pytest.approx(3e-3, rel=0.01)


def test_a_leg_behind_a_late_shaft_that_obeys_turns_by_its_command():
    """Along the recorded turn it would be shaken by the encoder's noise."""
    strokes = [late(stroke, LATE_S) for stroke in recorded(RIG, THREE, encoder_rad=3e-4)]
    conditions = group_by_condition(strokes)
    flaps = flaps_of(strokes)
    shafts = shafts_of(strokes, flaps)
    assert all(tracks_command(shaft, RIG.drive.ramp_s) for shaft in shafts)

    def missed(turns):
        behind = [replace(f, turn=turn) for f, turn in zip(flaps, turns, strict=True)]
        return max(
            rms((flap.simulated(ModelPoint(RIG)) - flap.rows().measured) / flap.rows().noise)
            for flap in behind
        )

    by_command = missed(
        [
            make_turn(c, False, estimate_delay_s(shaft, RIG.drive.ramp_s))
            for c, shaft in zip(conditions, shafts, strict=True)
        ]
    )
    assert by_command < 1.15
    assert missed([make_turn(c, True) for c in conditions]) > 1.15 * by_command
    assert missed([make_turn(c, False) for c in conditions]) > 10.0 * by_command


@pytest.mark.parametrize(
    "effects", [(), (present("motor_speed_ripple", amplitude_relative=0.1, cycles_per_turn=9.0),)]
)
def test_a_shaft_that_the_leg_does_not_act_on_turns_as_in_the_whole_stroke(effects):
    strokes = recorded(RIG, THREE[:1], encoder_rad=0.0)
    (shaft,) = shafts_of(strokes, flaps_of(strokes))
    rig = replace(RIG, effects=effects)
    motion = ramp_to_speed(
        shaft.start_rad, shaft.speed_rad_s, rig.drive.ramp_s, float(shaft.t_s[-1])
    )
    whole = simulate_stroke(rig, shaft.height_m, motion, shaft.t_s).shaft_angle_rad
    stood_rad = whole[shaft.t_s <= 0.0].mean()
    assert shaft.simulated(ModelPoint(rig)) == pytest.approx(
        shaft._bin_means(whole - stood_rad - motion.angle_rad(shaft.t_s) + shaft.start_rad),
        abs=1e-7,
    )


def test_a_shaft_that_sags_is_not_only_late():
    strokes = recorded(
        replace(
            RIG, effects=(present("motor_speed_droop", kp_Nm_s_per_rad=30.0, ki_Nm_per_rad=500.0),)
        ),
        THREE[:1],
    )
    (shaft,) = shafts_of(strokes, flaps_of(strokes))
    assert not tracks_command(shaft, RIG.drive.ramp_s)


@pytest.mark.long
def test_a_drive_that_sags_and_is_late_is_given_its_own_gains():
    """A command that comes late is made up for by the integral alone, as a smaller proportional
    gain would have it.
    """
    _, drive = found_late(
        replace(
            RIG, effects=(present("motor_speed_droop", kp_Nm_s_per_rad=8.0, ki_Nm_per_rad=60.0),)
        )
    )
    decision = decide(drive)
    (effect,) = decision.effects
    assert effect.id == "motor_speed_droop"
    assert effect.parameters["kp_Nm_s_per_rad"].value == pytest.approx(8.0, rel=0.04)
    assert effect.parameters["ki_Nm_per_rad"].value == pytest.approx(60.0, rel=0.04)


def test_a_drive_that_is_explained_is_told_beside_forces_that_are_not():
    leg = found_among(flaps_of(recorded(RIG, THREE[:1])), ["tip_mass"])
    why = Criterion("held-out misfit", False, "3.1")
    passed = Criterion("held-out misfit", True, "0.8")
    joint = join_decisions(
        replace(undecided(leg), criteria=(why,)), replace(named(leg), criteria=(passed,))
    )
    assert (joint.grade, joint.verdict) == ("mostly", "unexplained")
    assert [effect.id for effect in joint.effects] == ["tip_mass"] and joint.criteria == (
        why,
        passed,
    )
    assert joint.explanation.ids == ()


@pytest.mark.parametrize(
    ("forces", "shaft", "grade", "probability"),
    [
        ("nothing missing", "nothing missing", "nothing missing", 0.9 * 0.8),
        ("nothing missing", "identified", "identified", 0.95),
        ("unexplained", "nothing missing", "unexplained", 1.0 - 0.1 * 0.8),
        ("nothing missing", "unexplained", "unexplained", 1.0 - 0.9 * 0.2),
    ],
)
def test_forces_and_shaft_are_answered_together(forces, shaft, grade, probability):
    leg = found_among(flaps_of(recorded(RIG, THREE[:1])), ["tip_mass"])
    of = {
        "nothing missing": nothing_missing,
        "identified": lambda found, _: named(found),
        "unexplained": lambda found, _: undecided(found),
    }
    joint = join_decisions(
        replace(of[forces](leg, 0.9), probability=0.9),
        replace(of[shaft](leg, 0.8), probability=0.95 if shaft == "identified" else 0.8),
    )
    assert joint.grade == grade and joint.probability == pytest.approx(probability)


def test_the_family_of_a_stated_effect_of_the_drive_is_not_stated_beside_it():
    leg = found_among(flaps_of(recorded(RIG, THREE[:1])), ["tip_mass"])
    stated = named(leg)
    own = StatedFamily("leg_mass", "", "tip", 0.95, ("tip_mass", "heavier_link"))
    other = StatedFamily("floor_yields", "", "ground", 0.95, ("ground_compliance",))
    joint = join_decisions(
        replace(undecided(leg), grade="family", family=other), replace(stated, family=own)
    )
    assert joint.family == other
    assert joint.other_families == ()
    # What has no stated effect stays.
    apart = join_decisions(
        replace(undecided(leg), grade="family", family=own),
        replace(undecided(leg), grade="family", family=other),
    )
    assert (apart.family, apart.other_families) == (own, (other,))


def test_reasons_against_effects_of_forces_and_drive_are_both_given():
    leg = found_among(flaps_of(recorded(RIG, THREE[:1])), ["tip_mass"])
    joint = join_decisions(
        replace(undecided(leg), not_stated={"ground_bump": "too improbable"}),
        replace(named(leg), not_stated={"motor_cogging": "at its bound"}),
    )
    assert joint.not_stated == {"ground_bump": "too improbable", "motor_cogging": "at its bound"}
