"""Legs that move side by side move as each of them does alone, whatever their effects, and a
difference between two is free of steps.
"""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.errors import SimulationFailed
from rfca_rig.model import stroke as stroke_module
from rfca_rig.model.catalogue import catalogue, set_up
from rfca_rig.model.chain import Tolerance
from rfca_rig.model.motion import ramp_to_speed
from rfca_rig.model.parameters import TorqueSpline
from rfca_rig.model.stroke import (
    Job,
    StrokeRequest,
    simulate_stroke,
    simulate_strokes,
    simulate_variations,
)
from tests.model.effects.rigs import having
from tests.model.effects.test_strength import SMALL
from tests.model.legs import PAPER

T = np.arange(-20, 560) * 2e-3
MOTION = ramp_to_speed(PAPER.leg.start_angle_rad, 2.433, PAPER.drive.ramp_s, float(T[-1]))
TIGHT = Tolerance(1e-7, 3e-4)
OF_LEG = sorted(id_ for id_ in SMALL if id_ in catalogue())


def stiffer(rig, share):
    return replace(rig, leg=replace(rig.leg, k0_Nm_per_rad=rig.leg.k0_Nm_per_rad * (1.0 + share)))


@pytest.mark.parametrize("effect", OF_LEG)
def test_legs_with_an_effect_move_side_by_side_as_each_does_alone(effect):
    rigs = [stiffer(having(PAPER, **{effect: SMALL[effect]}), share) for share in (0.0, 0.01, 0.05)]
    found = simulate_strokes([Job(rig, 0.215, MOTION, T, TIGHT, (20,)) for rig in rigs])
    # The same steps in all lanes: they did move side by side.
    assert len({each.steps for each in found}) == 1
    for rig, each in zip(rigs, found, strict=True):
        alone = simulate_stroke(rig, 0.215, MOTION, T, TIGHT, (20,))
        # After a touchdown the leg chatters, and a moment of a few milliseconds may differ by more.
        assert np.percentile(np.abs(each.fz_N - alone.fz_N), 99) < 2e-3
        assert np.percentile(np.abs(each.fy_N - alone.fy_N), 99) < 2e-3
        assert np.percentile(np.abs(each.q_rad - alone.q_rad), 99) < 1e-5
    assert np.abs(found[2].fz_N - found[0].fz_N).max() > 0.1


def test_hinges_with_measured_curves_and_their_own_rest_angles_move_side_by_side():
    angles = (0.05, 0.1, 0.2, 0.4, 0.8)
    curve = TorqueSpline(angles, tuple(x + 0.3 * x**3 for x in angles))
    leg = replace(
        PAPER.leg,
        torque_splines=(curve,),
        k2_per_rad2=0.0,
        rest_angles_rad=(0.0, 0.01, 0.02, 0.0, -0.01, 0.02),
    )
    rigs = [stiffer(replace(PAPER, leg=leg), share) for share in (0.0, 0.02)]
    found = simulate_strokes([Job(rig, 0.215, MOTION, T, TIGHT) for rig in rigs])
    for rig, each in zip(rigs, found, strict=True):
        alone = simulate_stroke(rig, 0.215, MOTION, T, TIGHT)
        assert np.percentile(np.abs(each.fz_N - alone.fz_N), 99) < 2e-3


def request(rig, tolerance=None, height_m=0.215):
    return StrokeRequest(set_up(rig, height_m, MOTION), T, tolerance or Tolerance())


def test_a_difference_of_two_legs_side_by_side_is_free_of_what_different_steps_add():
    change = 1e-4
    ((above, here),) = simulate_variations(request(PAPER), [request(stiffer(PAPER, change))])
    alone = (
        simulate_stroke(stiffer(PAPER, change), 0.215, MOTION, T).fz_N
        - simulate_stroke(PAPER, 0.215, MOTION, T).fz_N
    )
    tighter = Tolerance(1e-9, 3e-6)
    true = [
        simulate_stroke(stiffer(PAPER, 30.0 * sign * change), 0.215, MOTION, T, tighter).fz_N
        for sign in (1.0, -1.0)
    ]
    slope = (true[0] - true[1]) / 60.0
    # The middle of the errors, because moments of chatter after touchdown have no slope.
    error_beside = np.median(np.abs(above.fz_N - here.fz_N - slope))
    error_alone = np.median(np.abs(alone - slope))
    assert error_beside < 0.2 * error_alone
    assert error_beside < 0.02 * np.median(np.abs(slope))


def test_what_changes_only_the_sensor_shares_the_motion(monkeypatch):
    sensed = having(PAPER, sensor_gain={"factor": 1.03})
    varied = [request(sensed), request(stiffer(PAPER, 0.01)), request(stiffer(sensed, 0.01))]
    moved = []
    move = stroke_module._move_block

    def count_legs(requests, every_s, only_sensed):
        moved.append(len(requests))
        return move(requests, every_s, only_sensed)

    monkeypatch.setattr(stroke_module, "_move_block", count_legs)
    gain, stiff, both = simulate_variations(request(PAPER), varied)
    assert moved == [2]
    assert np.array_equal(gain[0].shaft_torque_Nm, gain[1].shaft_torque_Nm)
    assert gain[0].fz_N == pytest.approx(1.03 * gain[1].fz_N)
    assert np.array_equal(both[0].shaft_torque_Nm, stiff[0].shaft_torque_Nm)


def test_a_variation_without_an_answer_fails_alone():
    broken = replace(PAPER, leg=replace(PAPER.leg, k0_Nm_per_rad=float("nan")))
    found = simulate_variations(
        request(PAPER),
        [request(stiffer(PAPER, share)) for share in (0.01, 0.02)] + [request(broken)],
    )
    assert [isinstance(each, SimulationFailed) for each in found] == [False, False, True]
    assert np.array_equal(
        found[0][0].fz_N, simulate_stroke(stiffer(PAPER, 0.01), 0.215, MOTION, T).fz_N
    )


def test_other_effects_move_apart():
    heavy = having(PAPER, tip_mass={"mass_g": 10.0})
    ((heavier, beside),) = simulate_variations(request(PAPER), [request(heavy)])
    assert beside is None
    assert np.array_equal(heavier.fz_N, simulate_stroke(heavy, 0.215, MOTION, T).fz_N)


def test_an_effect_of_each_leg_keeps_its_own_size_and_its_own_memory():
    rigs = [
        having(PAPER, spring_relaxation={"strength_relative": share, "time_constant_s": 0.2})
        for share in np.linspace(0.0, 0.3, 11)
    ]
    found = simulate_strokes([Job(rig, 0.215, MOTION, T, TIGHT) for rig in rigs])
    for rig, each in zip(rigs, found, strict=True):
        alone = simulate_stroke(rig, 0.215, MOTION, T, TIGHT)
        assert np.percentile(np.abs(each.fz_N - alone.fz_N), 99) < 2e-3
