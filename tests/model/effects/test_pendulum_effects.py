"""Effects and nominal values of pendulums, against the same pendulum written down again and
integrated by scipy.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rfca_rig.errors import BadInput
from rfca_rig.model.chain import Tolerance
from rfca_rig.model.effects import joint_torques, joints
from rfca_rig.model.effects.joint_torques import (
    BEGIN,
    CLOCK,
    COUNT,
    STEP,
    TRACE,
    TorqueTrace,
    torque_at,
    torque_trace,
)
from rfca_rig.model.parameters import PresentEffect
from rfca_rig.model.pendulum import Pendulum, PendulumLink, simulate_pendulum
from tests.model.effects.rigs import paper_stroke

LINK = {"length_m": 0.5, "mass_kg": 0.6, "centre_of_mass_m": 0.4, "inertia_kg_m2": 0.11}
TIGHT = Tolerance(1e-7, 3e-4)
RECORDED = np.arange(-0.3, 1.501, 0.001)
T = np.linspace(0.05, 1.4, 28)
BEFORE_S = 0.3  # the same motion from here on gives a lagged reading its past


def command(t):
    return 1.5 * np.sin(6.0 * t) + 0.5 * np.sin(17.0 * t)


def lagged(tau_s):
    """The command after a first-order lag, in the steady state."""
    parts = [(1.5, 6.0), (0.5, 17.0)]
    return lambda t: sum(a * np.imag(np.exp(1j * w * t) / (1.0 + 1j * w * tau_s)) for a, w in parts)


def by_scipy(torque=command, friction=lambda *_: 0.0, inertia=0.0, read_s=0.0):
    """Angles and speeds at T from 0.8 rad at rest, and readings through a lag of `read_s`; the
    readings at t = 0 come first.
    """

    def rhs(t, x):
        a, w, read_a, read_w = x
        tau = torque(t)
        acceleration = (tau - friction(w, tau) - 9.81 * 0.24 * np.sin(a)) / (0.11 + inertia)
        if read_s:
            late = [(a - read_a) / read_s, (w - read_w) / read_s]
        else:
            late = [0.0, 0.0]
        return [w, acceleration, *late]

    found = solve_ivp(
        rhs,
        (-BEFORE_S, 1.5),
        [0.8, 0.0, 0.8, 0.0],
        "LSODA",
        np.append(0.0, T),
        rtol=1e-8,
        atol=1e-9,
        max_step=2e-3,
    )
    return found.y


def ours(start, effects=(), **nominal):
    pendulum = Pendulum((PendulumLink(**LINK, **nominal),))
    present = tuple(
        PresentEffect(id_, tuple(values.items())) for id_, values in dict(effects).items()
    )
    trace = torque_trace(RECORDED, command(RECORDED)[:, None])
    return simulate_pendulum(
        pendulum, trace, np.array([start[0]]), np.array([start[1]]), T, present, TIGHT
    )


def smooth_stribeck(w, tau):
    return 0.15 * np.tanh(w / 2e-3) * (1.0 + 0.8 * np.exp(-abs(w) / 0.6))


def smooth_loss(w, tau):
    return 0.3 * abs(tau) * np.tanh(w / 2e-3)


CASES = {
    "torque_delay": ({"delay_s": 0.02}, {"torque": lambda t: command(t - 0.02)}, 2e-4),
    "torque recorded late": ({"delay_s": -0.02}, {"torque": lambda t: command(t + 0.02)}, 2e-4),
    "torque_lag": ({"time_constant_s": 0.02}, {"torque": lagged(0.02)}, 3e-4),
    "joint_stribeck": (
        {"torque_Nm": 0.15, "rise_relative": 0.8, "speed_rad_s": 0.6},
        {"friction": smooth_stribeck},
        1e-2,
    ),
    "joint_load_friction": ({"loss_relative": 0.3}, {"friction": smooth_loss}, 1e-2),
}


@pytest.mark.parametrize("case", CASES)
def test_an_effect_does_what_its_law_says(case):
    values, other, within = CASES[case]
    expected = by_scipy(**other)
    plain = by_scipy()
    id_ = "torque_delay" if " " in case else case
    found = ours(expected[:2, 0], {id_: values})
    assert found.angle_rad[:, 0] == pytest.approx(expected[0, 1:], abs=within)
    assert found.speed_rad_s[:, 0] == pytest.approx(expected[1, 1:], abs=10 * within)
    assert np.abs(expected[0] - plain[0]).max() > 20 * within


def test_a_lag_of_the_readings_is_that_of_a_filter_in_the_steady_state():
    motion = by_scipy(read_s=0.015)
    found = ours(motion[2:, 0], {"angle_lag": {"time_constant_s": 0.015}})
    assert found.angle_rad[:, 0] == pytest.approx(motion[2, 1:], abs=2e-3)
    assert np.abs(motion[2] - motion[0]).max() > 0.02


def test_a_lag_of_the_speed_leaves_the_angle_alone():
    motion = by_scipy(read_s=0.015)
    found = ours(motion[:2, 0], {"speed_lag": {"time_constant_s": 0.015}})
    assert found.angle_rad[:, 0] == pytest.approx(motion[0, 1:], abs=2e-4)
    assert found.speed_rad_s[:, 0] == pytest.approx(motion[3, 1:], abs=2e-2)
    assert np.abs(motion[3] - motion[1]).max() > 0.1


def test_nominal_values_of_drive_and_encoder_act_as_their_names_say():
    late = by_scipy(torque=lambda t: command(t - 0.01))
    heavy = by_scipy(inertia=0.02)
    assert ours(late[:2, 0], torque_delay_s=0.01).angle_rad[:, 0] == pytest.approx(
        late[0, 1:], abs=2e-4
    )
    assert ours(heavy[:2, 0], rotor_inertia_kg_m2=0.02).angle_rad[:, 0] == pytest.approx(
        heavy[0, 1:], abs=2e-4
    )
    plain = by_scipy()
    read = ours(plain[:2, 0] + [0.1, 0.0], zero_offset_rad=0.1)
    assert read.angle_rad[:, 0] == pytest.approx(plain[0, 1:] + 0.1, abs=2e-4)


def test_with_the_motors_off_the_offset_of_the_torque_does_not_act():
    pendulum = Pendulum((PendulumLink(**LINK, torque_offset_Nm=0.3),))
    start = np.array([0.5]), np.zeros(1), T
    off, on = (
        simulate_pendulum(
            pendulum, TorqueTrace(1.0, np.zeros((2, 1)), powered=powered), *start
        ).angle_rad
        for powered in (False, True)
    )
    without = simulate_pendulum(
        Pendulum((PendulumLink(**LINK),)), TorqueTrace(1.0, np.zeros((2, 1))), *start
    ).angle_rad
    assert off == pytest.approx(without, abs=1e-12)
    assert np.abs(on - without).max() > 0.05


NEUTRAL = {
    "torque_delay": {"delay_s": 0.0},
    "torque_lag": {"time_constant_s": 0.0},
    "angle_lag": {"time_constant_s": 0.0},
    "speed_lag": {"time_constant_s": 0.0},
    "joint_load_friction": {"loss_relative": 0.0},
    "joint_stribeck": {"torque_Nm": 0.0, "rise_relative": 1.0, "speed_rad_s": 0.5},
    "joint_friction_of_one": {"joint": 1.0, "torque_Nm": 0.0},
}


@pytest.mark.parametrize("id_", NEUTRAL)
def test_at_no_strength_an_effect_leaves_the_swing_alone(id_):
    start = by_scipy()[:2, 0]
    assert ours(start, {id_: NEUTRAL[id_]}).angle_rad == pytest.approx(
        ours(start).angle_rad, abs=1e-9
    )


def load_row(loss):
    parameter = np.zeros(TRACE + 3)
    parameter[:3] = loss, joint_torques.PRESLIDING_RAD, joint_torques.DAMPING_S
    parameter[STEP] = 0.1
    parameter[COUNT] = 3
    parameter[BEGIN] = 0.0
    parameter[TRACE:] = 1.0, -2.0, 0.5
    return parameter


STRIBECK_ROW = np.array([0.15, 0.8, 0.6, joints.PRESLIDING_RAD, joints.DAMPING_S, 0.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("phi", "rate"), [(1e-4, 0.01), (-2e-4, 0.02), (0.01, 0.5), (-0.01, -0.05), (0.02, -0.001)]
)
@pytest.mark.parametrize(
    ("law", "row"),
    [
        (joints.joint_stribeck_torque, STRIBECK_ROW),
        (joint_torques.joint_load_friction_torque, load_row(0.3)),
    ],
)
def test_the_slopes_of_a_law_are_its_derivatives(law, row, phi, rate):
    memory = np.zeros(4)
    memory[CLOCK] = 0.03

    def at(phi, rate):
        return law(phi, rate, 0.01, 0.0, 0.0, memory, row)

    _, by_phi, by_rate = at(phi, rate)
    step = 1e-8
    assert by_phi == pytest.approx(
        (at(phi + step, rate)[0] - at(phi - step, rate)[0]) / (2 * step), rel=1e-4, abs=1e-6
    )
    assert by_rate == pytest.approx(
        (at(phi, rate + step)[0] - at(phi, rate - step)[0]) / (2 * step), rel=1e-4, abs=1e-6
    )


def test_the_torque_is_read_by_straight_lines_and_held_at_the_ends():
    row = load_row(0.3)
    assert [torque_at(t, row) for t in (-1.0, 0.0, 0.05, 0.1, 0.15, 0.2, 9.0)] == pytest.approx(
        [1.0, 1.0, -0.5, -2.0, -0.75, 0.5, 0.5]
    )


def test_friction_of_one_joint_acts_on_that_joint():
    double = Pendulum((PendulumLink(0.2, 0.6, 0.18, 0.022), PendulumLink(0.3, 0.55, 0.25, 0.038)))
    still = np.zeros((2, 2))

    def slowed(joint):
        effect = (PresentEffect("joint_friction_of_one", (("joint", joint), ("torque_Nm", 0.1))),)
        t = np.array([2e-3])
        return simulate_pendulum(
            double, TorqueTrace(1.0, still), np.zeros(2), np.array([0.0, 1.0]), t, effect
        ).speed_rad_s[0, 1]

    assert slowed(1.0) == pytest.approx(1.0, abs=3e-2)
    assert slowed(2.0) < slowed(1.0) - 1e-3
    with pytest.raises(BadInput, match="joint 3: there are joints 1 to 2"):
        slowed(3.0)


@pytest.mark.parametrize(
    "id_", ["torque_delay", "torque_lag", "joint_load_friction", "angle_lag", "speed_lag"]
)
def test_an_effect_of_joint_torques_or_angles_is_refused_for_a_leg(id_):
    with pytest.raises(BadInput, match=rf"{id_}: .*leave it out"):
        paper_stroke(**{id_: {name: value or 0.01 for name, value in NEUTRAL[id_].items()}})
