"""Pendulums driven by torque, against closed forms and an independently written double pendulum."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipk

from rfca_rig.errors import BadInput
from rfca_rig.model.chain import Tolerance
from rfca_rig.model.effects.joint_torques import TorqueTrace, torque_trace
from rfca_rig.model.parameters import PresentEffect
from rfca_rig.model.pendulum import Pendulum, PendulumLink, make_driven_pendulum, simulate_pendulum

FIRST = PendulumLink(0.2, 0.6, 0.18, 0.022, joint_damping_Nm_s_per_rad=0.004)
SECOND = PendulumLink(0.3, 0.55, 0.25, 0.038, joint_damping_Nm_s_per_rad=0.002)
DOUBLE = Pendulum((FIRST, SECOND))
SINGLE = Pendulum((PendulumLink(0.5, 0.6, 0.4, 0.11),))
WEIGHT_Nm = 9.81 * 0.6 * 0.4
TIGHT = Tolerance(1e-7, 3e-4)
NO_TORQUE = TorqueTrace(1.0, np.zeros((2, 1)))


def having(**effects: dict[str, float]) -> tuple[PresentEffect, ...]:
    return tuple(PresentEffect(id_, tuple(values.items())) for id_, values in effects.items())


def let_go(pendulum, angle_rad, t_s, tolerance=TIGHT, **effects):
    joints = len(pendulum.links)
    trace = TorqueTrace(1.0, np.zeros((2, joints)))
    return simulate_pendulum(
        pendulum,
        trace,
        np.full(joints, angle_rad),
        np.zeros(joints),
        t_s,
        having(**effects),
        tolerance,
    )


@pytest.mark.parametrize("amplitude", [0.01, 1.2, 2.5])
def test_a_single_pendulum_has_the_period_of_its_closed_form(amplitude):
    period = 4.0 * ellipk(np.sin(amplitude / 2) ** 2) / np.sqrt(WEIGHT_Nm / 0.11)
    angle = let_go(SINGLE, amplitude, np.array([0.25, 0.5, 1.0]) * period).angle_rad[:, 0]
    assert angle == pytest.approx(np.array([0.0, -1.0, 1.0]) * amplitude, abs=2e-4 * amplitude)


def test_a_double_pendulum_without_losses_keeps_its_energy():
    free = Pendulum((PendulumLink(0.2, 0.6, 0.18, 0.022), PendulumLink(0.3, 0.55, 0.25, 0.038)))
    motion = let_go(free, 1.0, np.linspace(0.01, 3.0, 300))
    energy = energy_J(motion.angle_rad, motion.speed_rad_s)
    assert np.ptp(energy) < 2e-4 * 9.81 * (0.6 * 0.18 + 0.55 * 0.45)


def energy_J(angle, speed):
    """From the velocities of the mass centres."""
    q1 = angle[:, 0]
    q2 = angle.sum(axis=1)
    w1 = speed[:, 0]
    w2 = speed.sum(axis=1)
    x = 0.2 * np.cos(q1) * w1 + 0.25 * np.cos(q2) * w2
    z = 0.2 * np.sin(q1) * w1 + 0.25 * np.sin(q2) * w2
    kinetic = (
        0.5 * 0.022 * w1**2 + 0.5 * 0.55 * (x**2 + z**2) + 0.5 * (0.038 - 0.55 * 0.25**2) * w2**2
    )
    return kinetic - 9.81 * (
        0.6 * 0.18 * np.cos(q1) + 0.55 * (0.2 * np.cos(q1) + 0.25 * np.cos(q2))
    )


T = np.linspace(0.05, 1.5, 30)
FINE_T = np.arange(0.0, 1.501, 0.001)
START = np.array([0.3, -0.5])
SPEED = np.array([1.0, -2.0])


def torques(t):
    return np.stack([0.8 * np.sin(5 * t), 0.5 * np.cos(7 * t)])


def by_scipy(inertia=0.0, factor=1.0, tip=0.0, offset=0.0):
    """The textbook's double pendulum in relative angles, its joints driven and damped."""
    m1 = 0.6
    m2 = 0.55 + tip
    l1 = 0.2
    r1 = 0.18
    r2 = (0.55 * 0.25 + tip * 0.3) / (0.55 + tip)
    about2 = 0.038 + tip * 0.3**2

    def rhs(t, x):
        a, b, da, db = x
        c = np.cos(b)
        s = np.sin(b)
        mixed = about2 + m2 * l1 * r2 * c
        mass = np.array(
            [
                [0.022 + m2 * l1**2 + about2 + 2 * m2 * l1 * r2 * c + inertia, mixed],
                [mixed, about2 + inertia],
            ]
        )
        swirl = m2 * l1 * r2 * s * np.array([-(2 * da * db + db**2), da**2])
        weight = 9.81 * np.array(
            [(m1 * r1 + m2 * l1) * np.sin(a) + m2 * r2 * np.sin(a + b), m2 * r2 * np.sin(a + b)]
        )
        drive = factor * (torques(t) + np.array([offset, 0.0])) - [0.004 * da, 0.002 * db]
        return [da, db, *np.linalg.solve(mass, drive - swirl - weight)]

    return solve_ivp(rhs, (0.0, 1.5), [*START, *SPEED], "DOP853", T, rtol=1e-10, atol=1e-11).y.T


CASES = [
    ({}, {}, 2e-4),
    ({"torque_scale": {"factor": 0.7}}, {"factor": 0.7}, 2e-4),
    ({"added_mass": {"mass_kg": 0.3}}, {"tip": 0.3}, 1e-3),
    ({"joint_inertia": {"inertia_kg_m2": 0.003}}, {"inertia": 0.003}, 2e-4),
    ({"joint_inertia": {"inertia_kg_m2": 0.1}}, {"inertia": 0.1}, 2e-4),
]


@pytest.mark.parametrize(("effects", "other", "within"), CASES)
def test_a_driven_double_pendulum_swings_as_another_integrator_has_it(effects, other, within):
    ours = simulate_pendulum(
        DOUBLE, torque_trace(FINE_T, torques(FINE_T).T), START, SPEED, T, having(**effects), TIGHT
    )
    expected = by_scipy(**other)
    assert ours.angle_rad == pytest.approx(expected[:, :2], abs=within)
    assert ours.speed_rad_s == pytest.approx(expected[:, 2:], abs=10 * within)
    if other:
        assert np.abs(expected - by_scipy()).max() > 0.1


def test_a_torque_offset_adds_to_the_recorded_torque_and_is_scaled_with_it():
    offset = Pendulum((PendulumLink(0.2, 0.6, 0.18, 0.022, 0.004, torque_offset_Nm=0.2), SECOND))
    trace = torque_trace(FINE_T, torques(FINE_T).T)
    ours = simulate_pendulum(
        offset, trace, START, SPEED, T, having(torque_scale={"factor": 0.8}), TIGHT
    )
    assert ours.angle_rad == pytest.approx(by_scipy(factor=0.8, offset=0.2)[:, :2], abs=2e-4)


@pytest.mark.parametrize("inertia", [0.0, 0.005])
def test_the_steps_that_are_used_by_default_are_fine_enough_for_an_encoder(inertia):
    if inertia:
        effects = having(joint_inertia={"inertia_kg_m2": inertia})
    else:
        effects = ()
    ours = simulate_pendulum(
        DOUBLE, torque_trace(FINE_T, torques(FINE_T).T), START, SPEED, T, effects
    )
    assert ours.angle_rad == pytest.approx(by_scipy(inertia)[:, :2], abs=1e-3)


def test_a_pendulum_that_nothing_drives_or_brakes_swings_too():
    free = Pendulum((PendulumLink(0.5, 0.6, 0.4, 0.11, driven=False),))
    t = np.linspace(0.1, 2.0, 20)
    assert let_go(free, 1.0, t).angle_rad == pytest.approx(
        let_go(SINGLE, 1.0, t).angle_rad, abs=1e-9
    )


def test_one_scale_of_the_torque_multiplies_another():
    trace = torque_trace(FINE_T, torques(FINE_T).T)
    twice = having(torque_scale={"factor": 0.5}) + having(torque_scale={"factor": 1.4})
    once = simulate_pendulum(
        DOUBLE, trace, START, SPEED, T, having(torque_scale={"factor": 0.7})
    ).angle_rad
    assert simulate_pendulum(DOUBLE, trace, START, SPEED, T, twice).angle_rad == pytest.approx(
        once, abs=1e-9
    )


@pytest.mark.parametrize("nominal", [True, False], ids=["believed", "as an effect"])
def test_dry_friction_takes_twice_its_torque_over_the_weight_off_each_swing(nominal):
    friction = 0.01
    start = 0.1
    period = 2 * np.pi * np.sqrt(0.11 / WEIGHT_Nm)
    if nominal:
        pendulum = Pendulum((PendulumLink(0.5, 0.6, 0.4, 0.11, joint_friction_Nm=friction),))
        effects = {}
    else:
        pendulum = SINGLE
        effects = {"joint_friction": {"torque_Nm": friction}}
    angle = let_go(pendulum, start, np.arange(1, 10) * period / 2, **effects).angle_rad[:, 0]
    peaks = [
        (-1) ** swings * (start - 2 * swings * friction / WEIGHT_Nm) for swings in (1, 2, 3, 4, 5)
    ]
    assert angle[:5] == pytest.approx(peaks, abs=1.5e-3)


def test_a_stuck_joint_stays_where_it_is_and_slips_beyond_its_friction():
    friction = {"torque_Nm": 0.5}
    t = np.linspace(0.01, 2.0, 200)
    low = np.arcsin(0.6 * 0.5 / WEIGHT_Nm)
    high = np.arcsin(1.1 * 0.5 / WEIGHT_Nm)
    stuck = let_go(SINGLE, low, t, joint_friction=friction)
    assert np.abs(stuck.angle_rad - low).max() < 1.5e-3
    assert np.abs(stuck.speed_rad_s[-50:]).max() < 1e-3
    assert let_go(SINGLE, high, t, joint_friction=friction).angle_rad[-1, 0] < high - 0.02


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_friction_is_fully_there_from_the_start_in_a_joint_that_moves(sign):
    t = np.array([1e-3, 2e-3])
    motion = simulate_pendulum(
        SINGLE,
        NO_TORQUE,
        np.zeros(1),
        np.array([sign]),
        t,
        having(joint_friction={"torque_Nm": 0.5}),
    )
    assert motion.speed_rad_s[:, 0] == pytest.approx(sign * (1.0 - 0.5 / 0.11 * t), abs=1e-4)


def test_a_joint_that_is_not_driven_does_not_feel_the_torque():
    passive = Pendulum((FIRST, PendulumLink(0.3, 0.55, 0.25, 0.038, 0.002, driven=False)))
    trace = torque_trace(FINE_T, torques(FINE_T).T)
    silent = TorqueTrace(trace.step_s, trace.torque_Nm * [1.0, 0.0])
    assert (
        simulate_pendulum(passive, trace, START, SPEED, T).angle_rad
        == simulate_pendulum(DOUBLE, silent, START, SPEED, T).angle_rad
    ).all()


def test_a_trace_keeps_its_shape_between_uneven_times_and_its_last_value_beyond():
    trace = torque_trace(np.array([0.0, 0.1, 0.2, 0.35]), np.array([[0.0], [1.0], [2.0], [3.5]]))
    assert trace.torque_Nm[:, 0] == pytest.approx([0.0, 1.0, 2.0, 3.0, 3.5])
    heavy = Pendulum((PendulumLink(0.5, 1e-6, 0.0, 2.0),))
    rising = torque_trace(np.array([0.0, 1.0]), np.array([[0.0], [2.0]]))
    speed = simulate_pendulum(
        heavy, rising, np.zeros(1), np.zeros(1), np.array([1.0, 2.0])
    ).speed_rad_s
    assert speed[:, 0] == pytest.approx(
        [0.5, 1.5], abs=5e-6
    )  # a step across the kink at 1 s errs by its square


FOREIGN = {
    "ground_adhesion": {"force_N": 1.0},
    "ground_tilt": {"slope": 0.1},
    "height_offset": {"offset_mm": 1.0},
    "sensor_gain": {"factor": 1.1},
    "motor_speed_ripple": {"amplitude_relative": 0.1, "cycles_per_turn": 4.0},
    "shaft_compliance": {"stiffness_Nm_per_rad": 20.0},
}


@pytest.mark.parametrize("id_", FOREIGN)
def test_an_effect_that_a_pendulum_has_no_place_for_is_refused_rather_than_ignored(id_):
    with pytest.raises(BadInput, match=f"{id_}: acts on"):
        make_driven_pendulum(DOUBLE, having(**{id_: FOREIGN[id_]}))


@pytest.mark.parametrize(
    ("id_", "values"),
    [
        ("torque_scale", {"factor": 1.0}),
        ("added_mass", {"mass_kg": 0.0}),
        ("joint_inertia", {"inertia_kg_m2": 0.0}),
    ],
)
def test_at_no_strength_an_effect_leaves_the_swing_alone(id_, values):
    trace = torque_trace(FINE_T, torques(FINE_T).T)
    plain, other = (
        simulate_pendulum(DOUBLE, trace, START, SPEED, T, effects).angle_rad
        for effects in ((), having(**{id_: values}))
    )
    assert other == pytest.approx(plain, abs=1e-9)


def test_an_inertia_about_the_centre_of_mass_is_refused():
    with pytest.raises(BadInput, match=r"link 1: .*about the joint"):
        Pendulum((PendulumLink(0.5, 0.6, 0.4, 0.01),))


def test_torques_of_another_number_of_joints_are_refused():
    with pytest.raises(BadInput, match="2 joints"):
        simulate_pendulum(DOUBLE, NO_TORQUE, START, SPEED, T)
