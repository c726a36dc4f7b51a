"""Prescribed motion and prescribed torque mixed joint by joint, eq. (16), and chains of one or
two links without ground.
"""

import numpy as np
import pytest
from scipy.special import ellipk

from rfca_rig.errors import BadInput
from rfca_rig.model.chain import Tolerance, advance, allocate_samples, make_chain
from rfca_rig.model.kernel.state import Shaft, State
from rfca_rig.model.paper.dynamics import (
    PASSIVE,
    EndLoads,
    KnownMotion,
    KnownTorque,
    exchange_columns,
    joint_accelerations,
    joint_torques_Nm,
    link_chain_of,
    simulate_chain,
    solve_mixed,
)
from tests.model.legs import NO_GROUND_M, PAPER, pendulum

TIGHT = Tolerance(1e-9, 3e-6)


def a_moment(seed):
    random = np.random.default_rng(seed)
    loads = EndLoads(random.normal(0, 20, (2, 7)), random.normal(0, 0.1, 7))
    return (
        link_chain_of(PAPER.leg),
        random.normal(0, 0.5, 7),
        random.normal(0, 3, 7),
        random.normal(0, 2, 7),
        loads,
    )


def test_with_all_torques_known_it_is_forward_dynamics():
    chain, phi, dphi, tau, loads = a_moment(1)
    answer = solve_mixed(chain, phi, dphi, tau, np.zeros(7, dtype=bool), loads)
    assert answer.ddphi == pytest.approx(
        joint_accelerations(chain, phi, dphi, tau, loads), rel=1e-12
    )
    assert (answer.tau_Nm == tau).all()


def test_with_all_accelerations_known_it_is_inverse_dynamics():
    chain, phi, dphi, ddphi, loads = a_moment(2)
    answer = solve_mixed(chain, phi, dphi, 30.0 * ddphi, np.ones(7, dtype=bool), loads)
    assert answer.tau_Nm == pytest.approx(
        joint_torques_Nm(chain, phi, dphi, 30.0 * ddphi, loads), abs=1e-10
    )


@pytest.mark.parametrize("seed", range(8))
def test_any_mix_gives_a_motion_that_inverse_dynamics_confirms(seed):
    chain, phi, dphi, known, loads = a_moment(seed)
    exchange = np.random.default_rng(seed).random(7) < 0.5
    answer = solve_mixed(chain, phi, dphi, known, exchange, loads)
    assert joint_torques_Nm(chain, phi, dphi, answer.ddphi, loads) == pytest.approx(
        answer.tau_Nm, abs=1e-8
    )
    assert (answer.ddphi[exchange] == known[exchange]).all()
    assert (answer.tau_Nm[~exchange] == known[~exchange]).all()


def test_the_matrix_is_the_one_the_paper_prints():
    printed = exchange_columns(
        np.array([[1.0, 2.0, 3.0], [2.0, 5.0, 6.0], [3.0, 6.0, 9.0]]),
        np.array([False, True, False]),
    )
    assert printed.tolist() == [[1.0, 0.0, 3.0], [2.0, -1.0, 6.0], [3.0, 0.0, 9.0]]


def test_a_rod_swings_with_the_period_of_the_elliptic_integral():
    length = 0.5
    amplitude = 1.2
    period = 4.0 * ellipk(np.sin(amplitude / 2) ** 2) / np.sqrt(9.81 * 1.5 / length)
    there = np.array([np.pi / 2 + amplitude])
    t = np.array([0.25, 0.5, 1.0]) * period
    phi = (
        simulate_chain(
            link_chain_of(pendulum(1, length).leg), [PASSIVE], there, np.zeros(1), t
        ).phi[:, 0]
        - np.pi / 2
    )
    assert phi == pytest.approx([0.0, -amplitude, amplitude], abs=1e-7)


def compiled_motion(rig, shaft, q, w, t):
    samples = allocate_samples(t, q.size)
    state = State(q.copy(), w.copy(), np.zeros(q.size), np.zeros(q.size), np.zeros((0, q.size, 4)))
    advance(make_chain(rig, NO_GROUND_M), shaft, state, (0.0, float(t[-1])), 1e-6, TIGHT, samples)
    return samples


def test_a_free_double_pendulum_swings_like_the_compiled_chain():
    rig = pendulum(2, 0.3, 0.5, hinge_damping=0.002, k0=0.4)
    t = np.linspace(0.05, 1.0, 20)
    nothing = np.empty(0)
    free = Shaft(nothing, np.empty((0, 4)), nothing, True, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    theirs = compiled_motion(rig, free, np.array([0.3, 1.1]), np.zeros(2), t)
    ours = simulate_chain(
        link_chain_of(rig.leg), [PASSIVE, PASSIVE], np.array([0.3, 0.8]), np.zeros(2), t
    )
    assert np.cumsum(ours.phi, axis=1) == pytest.approx(theirs.q, abs=2e-5)


def test_a_driven_double_pendulum_swings_like_the_compiled_chain_and_needs_the_same_torque():
    rig = pendulum(2, 0.3, 0.5, hinge_damping=0.002, k0=0.4)
    t = np.linspace(0.05, 0.8, 16)
    cubic = np.array([[0.3, 0.5, 4.0, -2.0]])
    shaft = Shaft(np.array([0.0, 1.0]), cubic, np.empty(0), False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    theirs = compiled_motion(rig, shaft, np.array([0.3, 1.1]), np.array([0.5, 0.5]), t)
    driven = KnownMotion(
        lambda t: 0.3 + 0.5 * t + 4.0 * t**2 - 2.0 * t**3,
        lambda t: 0.5 + 8.0 * t - 6.0 * t**2,
        lambda t: 8.0 - 12.0 * t,
    )
    ours = simulate_chain(
        link_chain_of(rig.leg), [driven, PASSIVE], np.array([0.0, 0.8]), np.zeros(2), t
    )
    assert np.cumsum(ours.phi, axis=1) == pytest.approx(theirs.q, abs=2e-5)
    assert ours.tau_Nm[:, 0] == pytest.approx(theirs.force[:, 2], abs=5e-3)


@pytest.mark.slow
def test_power_of_all_drives_goes_into_motion_height_and_springs_and_is_lost_in_the_hinges():
    rig = pendulum(3, 0.2, 0.3, hinge_damping=0.01, k0=1.5)
    drives = [
        KnownMotion(
            lambda t: 0.5 * np.sin(3 * t),
            lambda t: 1.5 * np.cos(3 * t),
            lambda t: -4.5 * np.sin(3 * t),
        )
    ]
    drives += [KnownTorque(lambda t: 0.4 * np.sin(5 * t)), PASSIVE]
    t = np.linspace(0.0, 1.0, 801)
    motion = simulate_chain(
        link_chain_of(rig.leg), drives, np.array([0.0, 0.2, -0.1]), np.zeros(3), t
    )
    supplied = (motion.tau_Nm * motion.dphi).sum(axis=1) - 0.01 * (motion.dphi[:, 1:] ** 2).sum(
        axis=1
    )
    energy = energy_J(motion, 0.2, 0.3, 1.5)
    assert np.ptp(energy) > 0.3
    assert np.trapezoid(supplied, t) == pytest.approx(energy[-1] - energy[0], abs=1e-5)


def energy_J(motion, length, mass, k0):
    """From places and velocities of the mass centres."""
    q = np.cumsum(motion.phi, axis=1)
    w = np.cumsum(motion.dphi, axis=1)
    run = length * np.cos(q)
    fall = length * np.sin(q)
    depth = np.cumsum(fall, axis=1) - fall / 2
    v_x = np.cumsum(-fall * w, axis=1) + fall * w / 2
    v_y = np.cumsum(run * w, axis=1) - run * w / 2
    kinetic = 0.5 * mass * (v_x**2 + v_y**2) + mass * length**2 / 24 * w**2
    return (kinetic - 9.81 * mass * depth).sum(axis=1) + (0.5 * k0 * motion.phi[:, 1:] ** 2).sum(
        axis=1
    )


def test_drives_and_joints_must_be_as_many():
    with pytest.raises(BadInput, match="1 drives for a chain of 2 joints"):
        simulate_chain(
            link_chain_of(pendulum(2).leg),
            [PASSIVE],
            np.zeros(2),
            np.zeros(2),
            np.linspace(0, 1, 3),
        )
