"""Joints that follow a given motion, and starts at rest in equilibrium, against equations of
their own.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

from rfca_rig.errors import SimulationFailed
from rfca_rig.mechanism.load import load_mechanism
from rfca_rig.mechanism.nuisances import NUISANCES, find_places
from rfca_rig.mechanism.plant import make_plant
from rfca_rig.mechanism.prescribed import fit_trajectory
from rfca_rig.mechanism.rollout import CommandTrace, simulate_plant
from tests.mechanism.arm import Arm, mjcf

TWO = Arm(length_m=(0.35, 0.3), mass_kg=(2.0, 1.4))
STILL = CommandTrace(np.array([-0.1, 2.1]), np.zeros((2, 2)))
T_S = np.linspace(0.005, 2.0, 400)


def loaded(tmp_path, text):
    path = tmp_path / "model.xml"
    path.write_text(text, encoding="utf-8")
    return load_mechanism(path)


def passive(text):
    """Without the motor of the first joint."""
    return text.replace('<motor name="motor1" joint="joint1" gear="1"/>', "")


def second_rod(q1, w1, a1):
    """The acceleration of the second rod's joint angle where the first joint moves as told; both
    hang down at 0.
    """
    length, own = TWO.length_m

    def rate(t, x):
        first = q1(t)
        second = q1(t) + x[0]
        # of the rod about its joint, which moves on a circle: I a = -m g c sin - m c (acceleration
        # of the joint along the rod's normal)
        along = length * (a1(t) * np.cos(first - second) + w1(t) ** 2 * -np.sin(first - second))
        pull = -(9.81 * np.sin(second) + along) * own / 2.0 / (own**2 / 3.0)
        return [x[1], pull - a1(t)]

    return rate


@pytest.mark.parametrize("integrator", ["RK4", "implicitfast"])
def test_a_prescribed_joint_moves_the_others_as_it_is_told(tmp_path, integrator):
    text = passive(mjcf(TWO)).replace(
        'timestep="0.001"', f'timestep="0.001" integrator="{integrator}"'
    )
    mechanism = replace(loaded(tmp_path, text), prescribed=(0,))
    read_s = np.arange(0.0, 2.05, 0.001)
    motion = fit_trajectory(read_s, 0.6 * np.sin(4.0 * read_s)[:, None] ** 2, [0.0])
    found = simulate_plant(
        make_plant(mechanism, 5e-4),
        replace(STILL, command=np.zeros((2, 1))),
        np.zeros(2),
        np.zeros(2),
        T_S,
        0.0,
        motion,
    )
    rate = second_rod(
        lambda t: 0.6 * np.sin(4.0 * t) ** 2,
        lambda t: 2.4 * np.sin(8.0 * t),
        lambda t: 19.2 * np.cos(8.0 * t),
    )
    own = solve_ivp(rate, (0.0, 2.0), [0.0, 0.0], t_eval=T_S, rtol=1e-10, atol=1e-12).y
    assert np.abs(found.position[:, 0] - 0.6 * np.sin(4.0 * T_S) ** 2).max() < 1e-6
    assert np.abs(own[0]).max() > 0.5
    assert np.abs(found.position[:, 1] - own[0]).max() < 2e-3 * np.abs(own[0]).max()


def test_no_load_moves_a_prescribed_joint(tmp_path):
    mechanism = replace(loaded(tmp_path, passive(mjcf(TWO))), prescribed=(0,))
    read_s = np.arange(0.0, 2.05, 0.01)
    motion = fit_trajectory(read_s, np.full((len(read_s), 1), 1.2), [0.02])
    plant = make_plant(mechanism, 1e-3)
    plant.torque_offset[0] = 50.0
    plant.zero_offset[0] = 0.1
    found = simulate_plant(
        plant, replace(STILL, command=np.zeros((2, 1))), np.zeros(2), np.zeros(2), T_S, 0.0, motion
    )
    assert found.position[:, 0] == pytest.approx(1.2, abs=1e-6)
    # the zero offset of its reading is taken off: the second rod swings about the vertical, seen
    # from 1.1 rad
    assert np.mean(found.position[:, 1]) == pytest.approx(-1.1, abs=0.15)


def test_noise_of_a_reading_is_smoothed_and_a_command_is_not():
    t_s = np.arange(0.0, 1.0, 0.001)
    clean = np.sin(5.0 * t_s)
    noise = 1e-3 * np.random.default_rng(3).standard_normal(len(t_s))
    smooth = fit_trajectory(t_s, (clean + noise)[:, None], [0.05])
    exact = fit_trajectory(t_s, (clean + noise)[:, None], [0.0])
    inner = t_s[50:-50]
    assert np.std(smooth.sample(inner)[1][:, 0] - 5.0 * np.cos(5.0 * inner)) < 0.05
    assert exact.sample(t_s)[0][:, 0] == pytest.approx(clean + noise, abs=1e-12)
    late = smooth.since(0.3)
    assert late.sample(np.array([0.1]))[0] == pytest.approx(smooth.sample(np.array([0.4]))[0])


def test_a_start_at_rest_is_the_equilibrium_of_weight_and_springs(tmp_path):
    text = passive(mjcf(TWO)).replace('name="joint1"', 'name="joint1" stiffness="6" springref="1"')
    text = text.replace('name="joint2"', 'name="joint2" stiffness="2" frictionloss="0.5"')
    mechanism = loaded(tmp_path, text.replace("<option", '<compiler angle="radian"/><option'))
    plant = make_plant(mechanism, 1e-3)
    plant.torque_offset[1] = 0.4
    trace = CommandTrace(np.array([-0.1, 2.1]), np.full((2, 1), 0.7))
    found = simulate_plant(plant, trace, None, None, T_S)

    def unbalanced(q):
        (one, two) = TWO.length_m
        (m1, m2) = TWO.mass_kg
        second = 9.81 * m2 * two / 2.0 * np.sin(q[0] + q[1])
        first = 9.81 * (m1 / 2.0 + m2) * one * np.sin(q[0]) + second
        return [first + 6.0 * (q[0] - 1.0), second + 2.0 * q[1] - 0.4 - 0.7]

    assert found.position[-1] == pytest.approx(fsolve(unbalanced, [0.0, 0.0]), abs=1e-5)
    assert np.abs(found.speed).max() < 1e-6


def test_a_start_may_swing_and_springs_may_be_stiffer(tmp_path):
    """A weight on a spring: it hangs by m g / k, begins by the stated share nearer to its free
    length, and swings about its rest.
    """
    text = (
        '<mujoco><option gravity="0 0 -9.81"/><worldbody><body><joint name="x" type="slide" '
        'axis="0 0 1" stiffness="50"/>'
    )
    mechanism = loaded(tmp_path, f'{text}<geom size="0.1" mass="0.5"/></body></worldbody></mujoco>')
    plant = make_plant(mechanism, 5e-4)
    for key, value in {
        "joint_stiffness_relative": 0.2,
        "start_swing_relative": 0.3,
        "start_swing_rate_per_s": 2.0,
    }.items():
        (place,) = find_places(mechanism, NUISANCES[key].objects).values()
        NUISANCES[key].shift(plant, place, value)
    found = simulate_plant(
        plant, CommandTrace(np.array([-0.1, 2.1]), np.zeros((2, 0))), None, None, T_S
    )
    sag = 0.5 * 9.81 / 60.0
    w = np.sqrt(60.0 / 0.5)
    own = -sag + sag * (0.3 * np.cos(w * T_S) + 2.0 / w * np.sin(w * T_S))
    assert found.position[:, 0] == pytest.approx(own, abs=1e-5)


def test_what_falls_has_no_rest(tmp_path):
    text = (
        '<mujoco><worldbody><body><joint name="fall" type="slide" axis="0 0 1"/><geom '
        'size="0.1"/></body></worldbody></mujoco>'
    )
    plant = make_plant(loaded(tmp_path, text), 1e-3)
    with pytest.raises(SimulationFailed, match="no rest pose found"):
        simulate_plant(
            plant, CommandTrace(np.array([-0.1, 2.1]), np.zeros((2, 0))), None, None, T_S
        )


def test_play_keeps_a_spring_away_until_it_engages(tmp_path):
    text = (
        '<mujoco><option gravity="0 0 0"/><worldbody><body><joint name="x" type="slide" '
        'axis="1 0 0" stiffness="40 0 900"/>'
    )
    plant = make_plant(
        loaded(tmp_path, f'{text}<geom size="0.1" mass="0.5"/></body></worldbody></mujoco>'), 2e-4
    )
    plant.spring_half_gap[0] = 0.05
    t_s = np.linspace(0.01, 2.0, 200)
    found = simulate_plant(
        plant,
        CommandTrace(np.array([-0.1, 2.1]), np.zeros((2, 0))),
        np.array([0.2]),
        np.zeros(1),
        t_s,
    )

    def rate(_, x):
        engaged = np.sign(x[0]) * max(abs(x[0]) - 0.05, 0.0)
        return [x[1], -(40.0 * engaged + 900.0 * engaged**3) / 0.5]

    own = solve_ivp(
        rate, (0.0, 2.0), [0.2, 0.0], t_eval=t_s, rtol=1e-9, atol=1e-11, max_step=1e-3
    ).y[0]
    assert np.abs(found.position[:, 0] - own).max() < 2e-3
