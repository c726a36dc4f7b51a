"""What recordings would have shown, and what chance makes of many looks at once."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rfca_rig.analysis.repeats import group_by_condition
from rfca_rig.diagnosis.decision.sizes import _threshold, find_detection_limits
from rfca_rig.diagnosis.inference.parameterization import EffectTerm, coordinate_of
from rfca_rig.diagnosis.inference.screening import EffectProbe
from rfca_rig.diagnosis.leg import problem as leg_problem
from rfca_rig.diagnosis.leg.drive_search import find_excluded_sizes
from rfca_rig.diagnosis.leg.shaft_observations import make_shaft_condition, tracking_error
from rfca_rig.diagnosis.residual_force.mismatch_map import _holm
from rfca_rig.diagnosis.result import NotSeen, join_not_seen
from rfca_rig.model.catalogue import catalogue
from tests.diagnosis.by_hand import RIG, late, present, recorded
from tests.diagnosis.test_invariants import IDENTIFIED


def test_a_force_in_proportion_to_size_is_seen_where_its_square_reaches_what_is_needed():
    sizes = np.array([0.1, 1.0, 10.0])
    distance, rising = _threshold(np.column_stack([sizes, 4.0 * sizes**2]), 16.0)
    assert rising
    assert distance == pytest.approx(2.0)


@pytest.mark.parametrize("sizes", [[5.0, 20.0], [0.02, 0.1]])
def test_beyond_what_was_tried_power_goes_on_with_the_square(sizes):
    sizes = np.array(sizes)
    assert _threshold(np.column_stack([sizes, 4.0 * sizes**2]), 16.0)[0] == pytest.approx(2.0)


def test_a_stiffness_shows_the_less_the_larger_it_is():
    stiffness = np.array([10.0, 100.0, 1000.0])
    distance, rising = _threshold(np.column_stack([stiffness, 4e6 / stiffness**2]), 16.0)
    assert not rising
    assert distance == pytest.approx(500.0)


def first_row(signature):
    """The power of a signature is what its first row says."""
    return float(signature[0])


def would_have_seen(effect, powers):
    """At these sizes of its first parameter, all else at its middle."""
    choice = EffectTerm(catalogue()[effect])
    size, *others = choice.free
    probes = [
        EffectProbe(
            choice,
            np.array([coordinate_of(size, value), *(0.0 for _ in others)]),
            np.array([power]),
        )
        for value, power in powers.items()
    ]
    return find_detection_limits([choice.effect], probes, first_row, RIG, needed=16.0)[
        0
    ].would_have_seen


def test_a_stop_that_no_hinge_reaches_is_not_ruled_out():
    (angle_deg,) = would_have_seen(
        "hinge_stop", {20.0: 6400.0, 23.0: 400.0, 24.0: 0.0, 30.0: 0.0}
    ).values()
    assert 23.0 < angle_deg < 24.0
    assert would_have_seen("hinge_stop", {20.0: 0.0, 30.0: 0.0}) is None


def test_nothing_is_said_of_a_stiffness_beyond_what_is_plausible():
    (stiffness,) = would_have_seen("ground_compliance", {2e4: 1e6, 2e5: 1e5, 9e5: 1e4}).values()
    assert stiffness == 1e6


def test_a_size_of_either_sign_is_ruled_out_from_where_both_signs_would_have_shown():
    """The residual looks like a negative crosstalk, so that the recordings hardly speak against
    one.
    """
    (crosstalk,) = would_have_seen(
        "sensor_crosstalk", {-0.1: 64.0, 0.1: 1600.0, -0.05: 16.0, 0.05: 400.0}
    ).values()
    assert crosstalk == pytest.approx(0.05)


def shafts_of(rig):
    conditions = group_by_condition(recorded(rig, [(205.0, 2.433), (220.0, 3.249)]))
    return [make_shaft_condition(condition, 1.2, RIG.drive.ramp_s) for condition in conditions]


def disobeyed(effect, **values):
    shafts = shafts_of(replace(RIG, effects=(present(effect, **values),)))
    return max(tracking_error(shaft, RIG.drive.ramp_s) for shaft in shafts)


def test_an_obedient_shaft_rules_out_drives_that_would_have_moved_it_otherwise():
    drives = [catalogue()[name] for name in ("motor_speed_droop", "motor_speed_ripple")]
    soft, rippling = (
        one.would_have_seen for one in find_excluded_sizes(shafts_of(RIG), RIG, drives)
    )
    assert soft == {"kp_Nm_s_per_rad": 200.0}  # the stiffest that is plausible, and even that
    assert disobeyed("motor_speed_droop", kp_Nm_s_per_rad=200.0, ki_Nm_per_rad=70.7) > 2.0
    (amplitude,) = rippling.values()
    ripple = {"amplitude_relative": amplitude, "cycles_per_turn": 30.0}
    at_phases = [
        disobeyed("motor_speed_ripple", **ripple, phase_cycles=phase)
        for phase in (-0.25, 0.0, 0.25, 0.5)
    ]
    assert np.median(at_phases) == pytest.approx(1.0, abs=0.3)


def test_an_effect_that_forces_and_shaft_would_have_shown_is_listed_once():
    by_forces = (NotSeen("shaft_compliance", {"k": 900.0}), NotSeen("tip_mass", None))
    by_shaft = (
        NotSeen("motor_speed_droop", {"kp": 40.0}),
        NotSeen("shaft_compliance", {"k": 300.0}),
        NotSeen("tip_mass", {"m": 3.0}),
    )
    joined = join_not_seen(by_forces, by_shaft)
    assert [one.id for one in joined] == ["motor_speed_droop", "shaft_compliance", "tip_mass"]
    assert [one.would_have_seen for one in joined] == [{"kp": 40.0}, {"k": 900.0}, {"m": 3.0}]


def test_a_shaft_that_follows_does_not_exclude_what_the_forces_show(monkeypatch):
    """The leg may turn behind an encoder that follows its command."""
    forces = replace(IDENTIFIED, not_seen=())
    monkeypatch.setattr(leg_problem, "build_leg_result", lambda *_: forces)
    prepared = SimpleNamespace(shafts=shafts_of(RIG), as_commanded=True, rig=RIG)
    decision = SimpleNamespace(suspects=frozenset({"shaft_compliance", "shaft_play"}))
    findings = SimpleNamespace(shaft=None, forces=SimpleNamespace(decision=decision))
    diagnosis = leg_problem.LegSolution(prepared, findings, None).describe()
    excluded = {effect.id for effect in diagnosis.not_seen}
    assert "motor_speed_droop" in excluded
    assert excluded.isdisjoint(decision.suspects)


def test_a_drive_that_the_rig_is_believed_to_have_is_not_ruled_out():
    soft = replace(
        RIG, effects=(present("motor_speed_droop", kp_Nm_s_per_rad=8.0, ki_Nm_per_rad=60.0),)
    )
    assert find_excluded_sizes(shafts_of(RIG), soft, [catalogue()["motor_speed_droop"]]) == ()


def test_a_shaft_that_is_late_disobeys_as_little_as_one_that_is_not():
    (condition,) = group_by_condition(
        [late(stroke, 2.5e-3) for stroke in recorded(RIG, [(205.0, 2.433)])]
    )
    assert (
        tracking_error(make_shaft_condition(condition, 1.2, RIG.drive.ramp_s), RIG.drive.ramp_s)
        < 0.2
    )


def test_holm_multiplies_the_smallest_chance_by_all_and_never_falls():
    corrected = _holm(np.array([0.04, 0.001, 0.03]))
    assert corrected == pytest.approx([0.06, 0.003, 0.06])
