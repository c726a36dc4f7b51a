"""The chain at rest: under a force at its tip (9), back from its angles to the force (10), and
held on the ground.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq, root

from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.model.paper.statics import (
    equilibrium_under_tip_force,
    imbalance_Nm,
    is_stable,
    potential_energy_J,
    tangent_stiffness,
    tip_chain_of,
    tip_force,
    tip_force_weighing_angles,
    tip_jacobian,
    tip_place_m,
    touching_point_jacobian,
)
from rfca_rig.model.parameters import PresentEffect, TorqueSpline
from rfca_rig.model.static_stages import (
    STILL_AFTER_S,
    StageMoves,
    Touch,
    make_stage_motion,
    simulate_static_stages,
)
from rfca_rig.model.statics_contact import follow_static_path
from tests.model.legs import NO_GROUND_M, PAPER, pendulum

CHAIN = tip_chain_of(PAPER.leg)
PUSH = np.array([8.0, -30.0])
CREEPING = StageMoves(2e-3, 0.05)
UP_AND_BACK = np.radians([60, 75, 90, 105, 120, 135, 133, 131, 134, 140])


@pytest.fixture(scope="module")
def path():
    return follow_static_path(PAPER, 0.215, UP_AND_BACK)


def test_the_jacobian_is_how_the_tip_moves():
    phi = np.linspace(0.2, -0.3, 7)
    for n, step in enumerate(1e-6 * np.eye(7)):
        moved = (tip_place_m(CHAIN, phi + step) - tip_place_m(CHAIN, phi - step)) / 2e-6
        assert tip_jacobian(CHAIN, phi)[:, n] == pytest.approx(moved, abs=1e-9)


def test_the_lowest_point_of_the_tip_moves_as_part_of_the_last_link():
    phi = np.linspace(0.2, -0.3, 7)

    def point(moved):
        turned = moved.sum() - phi.sum()
        lever = CHAIN.tip_radius_m * np.array([-np.sin(turned), np.cos(turned)])
        return tip_place_m(CHAIN, moved) + lever

    for n, step in enumerate(1e-6 * np.eye(7)):
        moved = (point(phi + step) - point(phi - step)) / 2e-6
        assert touching_point_jacobian(CHAIN, phi)[:, n] == pytest.approx(moved, abs=1e-9)


def test_the_imbalance_is_the_derivative_of_the_energy():
    spline = TorqueSpline((0.1, 0.3, 0.6, 1.0), (0.1, 0.33, 0.75, 1.5))
    rest = (0.02, -0.03, 0.01, 0.0, 0.04, -0.02)
    curved = replace(PAPER.leg, torque_splines=(spline,), rest_angles_rad=rest)
    phi = np.linspace(1.0, -0.3, 7)
    for chain in (CHAIN, tip_chain_of(curved)):
        for n, step in enumerate(1e-6 * np.eye(7)):
            higher = potential_energy_J(chain, phi + step, PUSH)
            lower = potential_energy_J(chain, phi - step, PUSH)
            assert imbalance_Nm(chain, phi, PUSH)[n] == pytest.approx(
                (higher - lower) / 2e-6, abs=1e-7
            )


def test_the_tangent_stiffness_is_the_derivative_of_the_imbalance():
    phi = np.linspace(1.0, -0.3, 7)
    for n, step in enumerate(1e-6 * np.eye(7)):
        change = (
            imbalance_Nm(CHAIN, phi + step, PUSH) - imbalance_Nm(CHAIN, phi - step, PUSH)
        ) / 2e-6
        assert tangent_stiffness(CHAIN, phi, PUSH)[:, n] == pytest.approx(change, abs=1e-7)


def test_one_hinge_bends_until_its_spring_carries_weight_and_force():
    rig = pendulum(2, 0.2, 0.3, k0=8.0)
    found = equilibrium_under_tip_force(tip_chain_of(rig.leg), 0.4, np.array([3.0, -12.0]))

    def moment(phi):
        down = 0.3 * 9.81 * 0.1 - 12.0 * 0.2
        along = -3.0 * 0.2
        return down * np.cos(0.4 + phi) + along * np.sin(0.4 + phi) - 8.0 * phi

    assert found.phi[1] == pytest.approx(brentq(moment, -1.5, 1.5), abs=1e-10)
    assert found.snapped_at is None


def test_a_small_force_bends_two_hinges_as_linear_theory_has_it():
    chain = replace(tip_chain_of(pendulum(3, 0.1, 0.1, k0=5.0).leg), gravity_m_s2=0.0)
    found = equilibrium_under_tip_force(chain, 0.0, np.array([0.0, 1e-3]))
    assert found.phi[1:] == pytest.approx([1e-3 * 0.2 / 5.0, 1e-3 * 0.1 / 5.0], rel=1e-6)
    assert found.shaft_torque_Nm == pytest.approx(-1e-3 * 0.3, rel=1e-6)


def test_every_hinge_carries_what_acts_beyond_it():
    found = equilibrium_under_tip_force(CHAIN, 1.2, PUSH)
    varphi = np.cumsum(found.phi)
    lengths = np.array(PAPER.leg.link_lengths_m)
    masses = np.array(PAPER.leg.link_masses_kg)
    x = np.cumsum(lengths * np.cos(varphi))
    y = np.cumsum(lengths * np.sin(varphi))
    centre = x - 0.5 * lengths * np.cos(varphi)
    for hinge in range(1, 7):
        x0 = x[hinge - 1]
        y0 = y[hinge - 1]
        weight = (9.81 * masses[hinge:] * (centre[hinge:] - x0)).sum()
        force = (x[-1] - x0) * PUSH[1] - (y[-1] + 0.003 - y0) * PUSH[0]
        phi = found.phi[hinge]
        assert 10.98 * (phi + 4.56 * phi**3) == pytest.approx(weight + force, abs=1e-9)


def test_a_column_pushed_beyond_its_critical_load_snaps_to_one_side():
    rig = pendulum(2, 0.2, 0.3, k0=8.0)
    chain = replace(tip_chain_of(rig.leg), gravity_m_s2=0.0)
    critical = 8.0 / 0.2
    straight = equilibrium_under_tip_force(chain, 0.0, np.array([-0.99 * critical, 0.0]))
    assert straight.snapped_at is None and not straight.phi.any()
    for share in (1.01, 1.5):
        force = np.array([-share * critical, 0.0])
        assert not is_stable(chain, np.zeros(2), force)
        buckled = equilibrium_under_tip_force(chain, 0.0, force)
        # 8 N m/rad phi = F 0.2 m sin phi
        phi = brentq(lambda phi, share=share: phi - share * np.sin(phi), 0.1, 3.0)
        assert abs(buckled.phi[1]) == pytest.approx(phi, abs=1e-9)
        assert buckled.snapped_at == pytest.approx(1.0 / share, abs=1e-4)


@pytest.mark.parametrize(
    ("shaft_deg", "along_N", "down_N", "unstable_J", "least_J"),
    [
        (-50.0, -21.0, 34.0, 12.063, 8.112),
        (-90.0, 0.0, 40.0, 12.055, 9.579),
        # Half a newton aside: a long load step jumps to the minimum on the other side, 9.673 J.
        (-90.0, 0.5, 40.0, 12.054, 9.481),
        (-75.0, -10.0, 40.0, 12.439, 9.504),
    ],
)
def test_a_leg_pushed_along_itself_bends_to_where_its_energy_is_least(
    shaft_deg, along_N, down_N, unstable_J, least_J
):
    """The equilibrium that is nearly straight has more energy, and is unstable. The least energies
    are scipy's, from 300 random shapes each.
    """
    force = np.array([along_N, down_N])
    found = equilibrium_under_tip_force(CHAIN, np.radians(shaft_deg), force)
    assert np.abs(imbalance_Nm(CHAIN, found.phi, force)[1:]).max() < 1e-9
    assert is_stable(CHAIN, found.phi, force)
    energy_J = potential_energy_J(CHAIN, found.phi, force)
    assert energy_J == pytest.approx(least_J, abs=1e-3)

    def unbalanced(hinges):
        return imbalance_Nm(CHAIN, np.append(found.phi[0], hinges), force)[1:]

    straight = np.append(found.phi[0], root(unbalanced, np.zeros(6)).x)
    assert not is_stable(CHAIN, straight, force)
    assert potential_energy_J(CHAIN, straight, force) == pytest.approx(unstable_J, abs=1e-3)


def test_values_no_leg_has_are_refused_with_the_load_they_were_to_carry():
    chain = tip_chain_of(replace(PAPER.leg, k0_Nm_per_rad=float("nan")))
    with pytest.raises(
        SimulationFailed,
        match=(
            r"no equilibrium found beyond 0.0 % of weight and tip force \(0.0 N along, -4.0 N "
            r"down\)"
        ),
    ):
        equilibrium_under_tip_force(chain, 0.5, np.array([0.0, -4.0]))


@pytest.mark.parametrize("estimator", [tip_force, tip_force_weighing_angles])
def test_exact_angles_give_back_the_force(estimator):
    phi = equilibrium_under_tip_force(CHAIN, 1.2, PUSH).phi
    estimate = estimator(CHAIN, phi, 1e-3)
    assert estimate.force_N == pytest.approx(PUSH, abs=1e-8)
    assert np.abs(estimate.residual_Nm).max() < 1e-10
    assert estimate.condition_number == pytest.approx(
        estimate.singular_values[0] / estimate.singular_values[1]
    )


@pytest.mark.slow
@pytest.mark.parametrize("estimator", [tip_force, tip_force_weighing_angles])
def test_the_standard_errors_are_the_scatter_of_noisy_photographs(estimator):
    random = np.random.default_rng(11)
    noise = np.radians(0.05)
    phi = equilibrium_under_tip_force(CHAIN, 1.2, PUSH).phi
    photographs = [phi + noise * np.append(0.0, random.normal(size=6)) for _ in range(1500)]
    forces = np.array([estimator(CHAIN, photograph, noise).force_N for photograph in photographs])
    assert estimator(CHAIN, phi, noise).standard_errors_N == pytest.approx(
        forces.std(axis=0, ddof=1), rel=0.08
    )
    scale = np.outer(forces.std(axis=0), forces.std(axis=0))
    assert estimator(CHAIN, phi, noise).covariance_N2 / scale == pytest.approx(
        np.cov(forces.T) / scale, abs=0.08
    )


def test_weighing_the_angles_never_costs_accuracy():
    phi = equilibrium_under_tip_force(CHAIN, 1.2, PUSH).phi
    plain, weighed = (
        estimator(CHAIN, phi, 1e-3).standard_errors_N
        for estimator in (tip_force, tip_force_weighing_angles)
    )
    assert (weighed <= plain * (1.0 + 1e-9)).all()


def test_one_hinge_does_not_determine_a_force():
    with pytest.raises(BadInput, match="1 hinge angles do not determine"):
        tip_force(tip_chain_of(pendulum(2, k0=5.0).leg), np.array([0.3, 0.1]), 1e-3)


@pytest.mark.parametrize(
    "ground",
    [{}, {"stiffness_N_per_m1p5": 1.2e4, "friction_rise_share": 1.0}],
    ids=["paper", "soft, friction high"],
)
def test_the_dynamic_model_moved_slowly_and_held_still_comes_to_the_same_states(ground):
    rig = replace(PAPER, ground=replace(PAPER.ground, **ground))
    stages = simulate_static_stages(rig, 0.215, UP_AND_BACK, CREEPING)
    for state, held in zip(follow_static_path(rig, 0.215, UP_AND_BACK), stages, strict=True):
        assert state.fy_N == pytest.approx(held.fy_N, abs=5e-3)
        assert state.fz_N == pytest.approx(held.fz_N, abs=5e-3)
        assert state.tx_Nm == pytest.approx(held.tx_Nm, abs=5e-4)
        assert state.q_rad == pytest.approx(held.q_rad, abs=2e-5)


def test_brisk_moves_leave_the_tip_inside_the_cone_of_friction(path):
    brisk = simulate_static_stages(PAPER, 0.215, UP_AND_BACK[:6], StageMoves(1.0, 0.005))
    for creeping, state in zip(path, brisk, strict=False):
        assert state.touch[-1] is Touch.STUCK
        assert state.tangential_N[-1] < creeping.tangential_N[-1] - 0.3


def test_stages_end_where_they_are_told_and_take_the_time_they_need():
    motion, read_s = make_stage_motion(0.2, [1.0, 1.0, 0.99, 0.5], StageMoves(0.5, 0.05, 2.0))
    assert motion.angle_rad(read_s) == pytest.approx([1.0, 1.0, 0.99, 0.5])
    takes_s = np.array(
        [0.8 / 0.5 + 0.05, STILL_AFTER_S, 0.1 + STILL_AFTER_S, 0.49 / 0.5 + 0.05 + STILL_AFTER_S]
    )
    assert np.diff(read_s, prepend=0.0) == pytest.approx(takes_s + 2.0, abs=0.031)
    for later_s in (0.5 * STILL_AFTER_S, STILL_AFTER_S):
        assert motion.angle_rad(read_s + later_s) == pytest.approx([1.0, 1.0, 0.99, 0.5])
    t = np.linspace(0.0, read_s[-1], 20001)
    assert np.abs(np.diff(motion.angle_rad(t)) / np.diff(t)).max() == pytest.approx(0.5, rel=1e-6)


def test_stages_without_speed_are_bad_input():
    with pytest.raises(BadInput, match=r"ramp_s 0\.05, hold_s 1: each must be above 0"):
        StageMoves(0.0, 0.05)


def test_forces_of_the_ground_and_springs_are_in_balance_at_every_hinge(path):
    for state in path:
        end = np.cumsum(
            np.array(PAPER.leg.link_lengths_m)
            * np.array([np.cos(state.q_rad), np.sin(state.q_rad)]),
            axis=1,
        )
        assert (
            np.count_nonzero(state.normal_N[:-1]) == 0
        )  # the tip alone touches, so that (10) holds with its force
        force = np.array([state.tangential_N[-1], -state.normal_N[-1]])
        phi = np.diff(state.q_rad, prepend=0.0)
        assert imbalance_Nm(CHAIN, phi, force)[1:] == pytest.approx(0.0, abs=1e-8)
        assert imbalance_Nm(CHAIN, phi, force)[0] == pytest.approx(state.shaft_torque_Nm, abs=1e-8)
        assert state.normal_N[-1] == pytest.approx(
            1e5 * (end[1, -1] + 0.003 - 0.215) ** 1.5, rel=1e-9
        )


def test_the_sensor_feels_ground_and_weight(path):
    for state in path:
        assert state.fz_N == pytest.approx(0.32 * 9.81 - state.normal_N.sum())
        assert state.fy_N == pytest.approx(-state.tangential_N.sum())
        assert state.tx_Nm == pytest.approx(state.shaft_torque_Nm + 0.045 * state.fy_N)


def test_photographed_angles_on_the_ground_give_the_force_the_sensor_feels(path):
    for state in path:
        force = tip_force(CHAIN, np.diff(state.q_rad, prepend=0.0), 1e-3).force_N
        assert force == pytest.approx([state.tangential_N[-1], -state.normal_N[-1]], abs=1e-6)


def test_a_loading_tip_slides_at_the_limit_of_friction_and_sticks_when_turned_back(path):
    touch = [state.touch[-1] for state in path]
    assert touch == [Touch.SLIDING] * 6 + [Touch.STUCK] * 3 + [Touch.SLIDING]
    for state in path[:6]:
        assert state.tangential_N[-1] == pytest.approx(0.41 * state.normal_N[-1], rel=1e-9)
    assert all(end is Touch.AIR for end in path[0].touch[:-1])


def test_a_stuck_tip_comes_back_to_nearly_the_same_state_and_a_slid_one_does_not():
    there = follow_static_path(PAPER, 0.215, np.radians([120, 119.5, 119, 119.5]))
    assert there[3].fz_N == pytest.approx(
        there[1].fz_N, abs=0.02
    )  # the normal force fell and rose again, which dissipates
    slid = follow_static_path(PAPER, 0.215, np.radians([90, 120, 90]))
    assert abs(slid[2].fy_N - slid[0].fy_N) > 1.0


def test_the_state_does_not_depend_on_the_stages_in_between(path):
    direct = follow_static_path(PAPER, 0.215, [UP_AND_BACK[5]])[0]
    assert direct.fz_N == pytest.approx(path[5].fz_N, abs=1e-6)
    assert direct.fy_N == pytest.approx(path[5].fy_N, abs=1e-6)


def test_a_leg_in_the_air_feels_its_weight_only():
    state = follow_static_path(PAPER, NO_GROUND_M, [1.0])[0]
    assert (state.fy_N, state.fz_N) == pytest.approx((0.0, 0.32 * 9.81))
    assert set(state.touch) == {Touch.AIR}


def test_one_stiff_link_pressed_on_the_ground_obeys_the_lever():
    """A single hinge: the moment of N and F about it is that of spring and weight, whatever the
    ground.
    """
    rig = replace(
        pendulum(2, 0.2, 0.3, k0=40.0), ground=replace(PAPER.ground, friction_coefficient=0.3)
    )
    state = follow_static_path(rig, 0.3, [1.0], begin_angle_rad=0.5)[0]
    phi = state.hinge_angles_rad[0]
    q = state.q_rad[1]
    N = state.normal_N[1]
    F = state.tangential_N[1]
    assert N > 1.0
    assert pytest.approx(F) == 0.3 * N
    assert 40.0 * phi == pytest.approx(
        0.3 * 9.81 * 0.1 * np.cos(q) - 0.2 * (N * np.cos(q) + F * np.sin(q)), abs=1e-9
    )


def test_past_the_end_of_a_path_the_leg_jumps_to_another_rest():
    states = follow_static_path(PAPER, 0.215, np.radians(np.arange(60, 260, 10)))
    assert any(state.jumped for state in states)
    assert states[-1].fz_N == pytest.approx(0.32 * 9.81)


def test_a_leg_without_any_damping_that_jumps_finds_no_rest_and_says_where():
    undamped = replace(
        PAPER,
        leg=replace(PAPER.leg, hinge_damping_Nm_s_per_rad=0.0),
        ground=replace(PAPER.ground, drag_N_s_per_m=0.0),
    )
    with pytest.raises(
        SimulationFailed,
        match=r"finds no rest with the shaft held at 16\d\.\d\d degrees, 215.0 mm above",
    ):
        follow_static_path(undamped, 0.215, np.radians([170.0]))


def test_a_path_with_effects_is_refused_rather_than_treated_as_plain():
    rig = replace(PAPER, effects=(PresentEffect("tip_mass", (("mass_g", 5.0),)),))
    with pytest.raises(BadInput, match="plain leg and ground only"):
        follow_static_path(rig, 0.215, [1.0])
