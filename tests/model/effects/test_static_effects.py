"""Effects in the static experiment: what each of them does to the stages."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.model.catalogue import catalogue
from rfca_rig.model.paper.statics import tip_chain_of, touching_point_jacobian, weight_torques_Nm
from rfca_rig.model.static_stages import STILL_AFTER_S, StageMoves, Touch, simulate_static_stages
from tests.model.effects.rigs import having
from tests.model.effects.test_strength import SMALL
from tests.model.legs import NO_GROUND_M, PAPER

STAGES = np.radians([60.0, 90.0, 120.0])
MOVES = StageMoves(0.5, 0.05)
SMOOTH = replace(PAPER, ground=replace(PAPER.ground, friction_coefficient=0.0))
K0 = PAPER.leg.k0_Nm_per_rad
K2 = PAPER.leg.k2_per_rad2


def stages(rig=PAPER, angles=STAGES, height_m=0.215, **effects):
    return simulate_static_stages(having(rig, **effects), height_m, angles, MOVES)


def readings(states):
    return np.array([(state.fy_N, state.fz_N, state.tx_Nm) for state in states])


@pytest.fixture(scope="module")
def plain():
    return stages()


def carried(state):
    """Torque that weight and ground put into every hinge, which its springs must carry, (6,)."""
    chain = tip_chain_of(PAPER.leg)
    phi = np.diff(state.q_rad, prepend=0.0)
    assert not state.normal_N[:-1].any()
    tip = np.array([state.tangential_N[-1], -state.normal_N[-1]])
    return (weight_torques_Nm(chain, phi) + touching_point_jacobian(chain, phi).T @ tip)[1:]


def spring(phi):
    return K0 * phi * (1.0 + K2 * phi**2)


def loads(torque_Nm):
    """A loop shows where shaft angles come twice: going up, and turning back on a floor without
    friction.
    """
    up, _, back = (
        state.fz_N for state in stages(SMOOTH, np.radians([100.0, 120.0, 100.0]), **torque_Nm)
    )
    return up, back


def test_a_plain_leg_on_a_smooth_floor_forgets_which_way_it_came():
    up, back = loads({})
    assert up == pytest.approx(back, abs=1e-3)


@pytest.mark.parametrize(
    "effect",
    [
        {"hinge_coulomb_friction": {"torque_Nm": 0.1}},
        {"spring_hysteresis": {"strength_relative": 0.3, "saturation_deg": 3.0}},
    ],
    ids=lambda effect: next(iter(effect)),
)
def test_dry_friction_and_hysteresis_press_harder_on_the_way_up_than_on_the_way_back(effect):
    neither, _ = loads({})
    up, back = loads(effect)
    assert up < neither - 0.2
    assert back > neither + 0.2


def test_a_loop_in_the_hinges_carries_what_the_spring_does_not():
    for state in stages(SMOOTH, hinge_coulomb_friction={"torque_Nm": 0.1}):
        left = carried(state) - spring(state.hinge_angles_rad)
        assert (np.abs(left) <= 0.1 + 1e-4).all()
        assert (
            np.abs(left).max() > 0.09
        )  # the stop throws the pins back a little, within their sticking


def test_with_play_the_leg_presses_less_and_the_spring_begins_beyond_the_gap(plain):
    gap = np.radians(1.0)
    for state, without in zip(stages(hinge_backlash={"half_gap_deg": 1.0}), plain, strict=True):
        assert state.fz_N > without.fz_N + 0.5
        phi = state.hinge_angles_rad
        assert spring(np.sign(phi) * np.maximum(np.abs(phi) - gap, 0.0)) == pytest.approx(
            carried(state), abs=2e-3
        )


def test_a_stop_does_nothing_until_a_hinge_comes_to_it_and_then_carries_the_rest(plain):
    limit = np.radians(10.0)
    stiffness = 100.0
    with_stop = stages(hinge_stop={"angle_deg": 10.0, "stiffness_Nm_per_rad": stiffness})
    assert np.abs(plain[0].hinge_angles_rad).max() < limit < np.abs(plain[2].hinge_angles_rad).max()
    assert readings(with_stop[:1]) == pytest.approx(readings(plain[:1]), abs=1e-2)
    assert with_stop[2].fz_N < 2.0 * plain[2].fz_N
    phi = with_stop[2].hinge_angles_rad
    stopped = np.sign(phi) * stiffness * np.maximum(np.abs(phi) - limit, 0.0)
    assert spring(phi) + stopped == pytest.approx(carried(with_stop[2]), abs=2e-3)


def test_a_stage_that_is_held_creeps_as_slowly_as_its_arm_relaxes():
    """Read at every hold of one angle. The arm is soft, so that the spring beside it slows the
    creep by its share at most.
    """
    strength = 0.1
    tau = 2.0
    apart = MOVES.hold_s + STILL_AFTER_S
    arm = {"spring_relaxation": {"strength_relative": strength, "time_constant_s": tau}}
    first, second, third = (state.fz_N for state in stages(SMOOTH, np.radians([100.0] * 3), **arm))
    without, later, _ = (state.fz_N for state in stages(SMOOTH, np.radians([100.0] * 3)))
    assert first < second - 0.1 and later == pytest.approx(without, abs=5e-3)
    assert (
        np.exp(-apart / tau) - 1e-3
        < (third - second) / (second - first)
        < np.exp(-apart / (tau * (1.0 + strength))) + 1e-3
    )


def test_a_higher_rack_is_a_height_offset(plain):
    higher = readings(stages(height_offset={"offset_mm": 2.0}))
    assert higher == pytest.approx(readings(stages(height_m=0.217)), abs=1e-9)
    assert (higher[:, 1] > readings(plain)[:, 1] + 0.1).all()


def test_another_hardening_is_a_leg_with_that_hardening(plain):
    harder = readings(stages(stiffness_hardening={"k2_per_rad2": 9.0}))
    assert harder == pytest.approx(
        readings(stages(replace(PAPER, leg=replace(PAPER.leg, k2_per_rad2=9.0)))), abs=1e-9
    )
    assert (harder[1:, 1] < readings(plain)[1:, 1] - 1.0).all()


def test_a_twisting_shaft_leaves_the_leg_behind_the_motor(plain):
    for motor_rad, state, without in zip(
        STAGES, stages(shaft_compliance={"stiffness_Nm_per_rad": 50.0}), plain, strict=True
    ):
        assert state.shaft_torque_Nm == pytest.approx(
            50.0 * (motor_rad - state.shaft_angle_rad), abs=2e-3
        )
        assert state.shaft_angle_rad < motor_rad - 0.01
        assert state.fz_N > without.fz_N + 0.2


def test_crosstalk_and_gain_act_on_the_readings_alone(plain):
    fy, fz, tx = readings(plain).T
    assert readings(stages(sensor_crosstalk={"fz_per_fy": 0.1})) == pytest.approx(
        np.column_stack([fy, fz + 0.1 * fy, tx]), abs=1e-9
    )
    assert readings(stages(sensor_gain={"factor": 1.1})) == pytest.approx(
        1.1 * readings(plain), abs=1e-9
    )


@pytest.mark.parametrize(
    "effect",
    [
        {"sensor_lag": {"time_constant_s": 0.05}},
        {"clock_offset": {"offset_s": -0.05}},
        {"clock_offset": {"offset_s": 0.05}},
    ],
    ids=["lag", "early", "late"],
)
def test_lag_and_shifted_clocks_leave_no_trace_at_rest(plain, effect):
    assert readings(stages(**effect)) == pytest.approx(readings(plain), abs=5e-3)


def test_a_leg_in_the_air_is_heavier_by_the_mass_at_its_tip():
    (state,) = simulate_static_stages(
        having(PAPER, tip_mass={"mass_g": 50.0}), NO_GROUND_M, [1.0], StageMoves(0.5, 0.05, 4.0)
    )
    assert state.fz_N == pytest.approx(0.37 * 9.81, abs=1e-3)
    assert set(state.touch) == {Touch.AIR}


def test_a_point_held_by_more_than_sliding_friction_is_stuck_not_sliding():
    states = stages(ground_stribeck={"rise_relative": 0.3, "speed_m_s": 0.05})
    shares = [state.tangential_N[-1] / state.normal_N[-1] for state in states]
    assert all(0.42 < share < 1.3 * 0.41 - 1e-4 for share in shares)
    assert all(state.touch[-1] is Touch.STUCK for state in states)


@pytest.mark.parametrize("id_", sorted(set(SMALL) & set(catalogue())))
def test_every_effect_finds_its_way_through_the_stages(id_):
    found = readings(stages(angles=STAGES[:2], **{id_: SMALL[id_]}))
    assert np.isfinite(found).all()
    assert found[1, 1] < found[0, 1] < 3.5
