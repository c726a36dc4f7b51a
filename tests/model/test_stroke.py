"""A whole stroke: what the sensor feels, contact, friction, accuracy, robustness."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.errors import SimulationFailed
from rfca_rig.model import stroke as stroke_module
from rfca_rig.model.catalogue import set_up
from rfca_rig.model.chain import Tolerance, advance, allocate_samples, find_rest_state, make_chain
from rfca_rig.model.kernel.integrator import FIRST_STEP_S
from rfca_rig.model.kernel.stage import allocate_workspace
from rfca_rig.model.motion import ShaftMotion, follow, ramp_to_speed
from rfca_rig.model.parameters import PresentEffect
from rfca_rig.model.stroke import (
    Job,
    StrokeRequest,
    recall_stroke,
    simulate_stroke,
    simulate_stroke_at_speed,
    simulate_strokes,
    simulate_variations,
)
from tests.model.legs import PAPER
from tests.model.scipy_stroke import ICE, solve_stroke

T = np.arange(-100, 1250) * 1e-3


@pytest.fixture(scope="module")
def stroke():
    return simulate_stroke_at_speed(PAPER, 0.215, 2.433, T)


def with_lever(lever_m):
    return replace(PAPER, ground=replace(PAPER.ground, friction_lever_m=lever_m))


def test_at_rest_the_sensor_feels_the_weight_and_the_motor_holds_it(stroke):
    resting = T < 0
    assert stroke.fz_N[resting] == pytest.approx(0.32 * 9.81)
    assert stroke.fy_N[resting] == pytest.approx(0.0, abs=1e-9)
    assert -0.46 < stroke.shaft_torque_Nm[0] < -0.42


def test_force_on_the_mount_is_weight_and_ground_less_the_change_of_momentum(stroke):
    lengths = np.array(PAPER.leg.link_lengths_m)
    masses = np.array(PAPER.leg.link_masses_kg)
    y = np.cumsum(lengths * np.cos(stroke.q_rad), axis=1)
    depth = np.cumsum(lengths * np.sin(stroke.q_rad), axis=1)
    y = y - 0.5 * lengths * np.cos(stroke.q_rad)
    depth = depth - 0.5 * lengths * np.sin(stroke.q_rad)
    up_to_the_valley = slice(
        450, 1100
    )  # smooth there, so that second differences of 1 ms samples are worth something
    for place, weight, ground, felt in (
        (depth, 0.32 * 9.81, -stroke.normal_N.sum(axis=1), stroke.fz_N),
        (-y, 0.0, -stroke.tangential_N.sum(axis=1), stroke.fy_N),
    ):
        momentum_rate = np.gradient(np.gradient(place @ masses, T), T)
        assert np.abs((weight + ground - momentum_rate - felt)[up_to_the_valley]).max() < 0.05


@pytest.mark.parametrize("lever_m", [0.003, -0.004])
def test_power_of_the_motor_goes_into_springs_and_motion_and_is_lost_in_damping_and_ground(lever_m):
    stroke = simulate_stroke_at_speed(with_lever(lever_m), 0.215, 2.433, T)
    lengths = np.array(PAPER.leg.link_lengths_m)
    w = np.gradient(stroke.q_rad, T, axis=0)
    phi = np.diff(stroke.q_rad, axis=1)
    rate = np.diff(w, axis=1)
    spring = (0.5 * 10.98 * phi**2 + 0.25 * 10.98 * 4.56 * phi**4).sum(axis=1)
    masses = np.array(PAPER.leg.link_masses_kg)
    v_y = np.cumsum(-lengths * np.sin(stroke.q_rad) * w, axis=1)
    v_d = np.cumsum(lengths * np.cos(stroke.q_rad) * w, axis=1)
    c_y = v_y + 0.5 * lengths * np.sin(stroke.q_rad) * w
    c_d = v_d - 0.5 * lengths * np.cos(stroke.q_rad) * w
    kinetic = (0.5 * masses * (c_y**2 + c_d**2) + masses * lengths**2 / 24 * w**2).sum(axis=1)
    ground = -(stroke.normal_N * v_d).sum(axis=1) + (stroke.tangential_N * (v_y - lever_m * w)).sum(
        axis=1
    )
    supplied = (
        stroke.shaft_torque_Nm * w[:, 0]
        + 9.81 * c_d @ masses
        + ground
        - 0.088 * (rate**2).sum(axis=1)
    )
    part = slice(450, 1100)
    gained = (spring + kinetic)[part][-1] - (spring + kinetic)[part][0]
    assert np.trapezoid(supplied[part], T[part]) == pytest.approx(gained, rel=2e-3)


def test_friction_acts_at_the_tip_s_lowest_point_unless_another_lever_is_given(stroke):
    assert np.array_equal(
        simulate_stroke_at_speed(with_lever(0.003), 0.215, 2.433, T).fz_N, stroke.fz_N
    )
    other = simulate_stroke_at_speed(with_lever(-0.004), 0.215, 2.433, T)
    assert 0.5 < np.abs(other.fz_N - stroke.fz_N)[450:1100].max() < 5.0


def test_sliding_friction_is_mu_times_the_normal_force_and_the_floor_s_drag(stroke):
    sliding = slice(700, 1100)
    w = np.gradient(stroke.q_rad, T, axis=0)
    slip = (-np.array(PAPER.leg.link_lengths_m) * np.sin(stroke.q_rad) * w).sum(axis=1) - 0.003 * w[
        :, -1
    ]
    expected = 0.41 * stroke.normal_N[:, -1] - 2.0 * slip
    assert stroke.tangential_N[sliding, -1] == pytest.approx(expected[sliding], abs=0.01)


def test_the_valley_does_not_depend_on_the_tolerance(stroke):
    tight = simulate_stroke_at_speed(PAPER, 0.215, 2.433, T, Tolerance(1e-8, 3e-5))
    assert stroke.fz_N.min() == pytest.approx(tight.fz_N.min(), rel=2e-4)
    assert T[stroke.fz_N.argmin()] == pytest.approx(T[tight.fz_N.argmin()], abs=1.1e-3)


def test_the_same_stroke_twice_is_the_same_to_the_last_bit(stroke):
    again = simulate_stroke_at_speed(PAPER, 0.215, 2.433, T)
    assert again.fz_N.tobytes() == stroke.fz_N.tobytes()


def recalled(effects, height_m):
    motion = ramp_to_speed(PAPER.leg.start_angle_rad, 2.433, PAPER.drive.ramp_s, float(T[-1]))
    return recall_stroke(
        StrokeRequest(set_up(replace(PAPER, effects=effects), height_m, motion), T, Tolerance())
    )


def test_effects_of_the_sensor_use_the_motion_that_is_known_and_others_do_not(monkeypatch):
    gain = (PresentEffect("sensor_gain", (("factor", 1.03),)),)
    plain = recalled((), 0.2151)
    # Whoever gets a stroke may change it; the next one must not notice.
    plain.q_rad[:] = 0.0
    with monkeypatch.context() as context:
        context.setattr(stroke_module, "advance", None)  # an integration would end in a TypeError
        felt = recalled(gain, 0.2151)
        for effects, height_m in (
            ((PresentEffect("shaft_friction", (("torque_Nm", 0.1),)),), 0.2151),
            (gain, 0.2152),
        ):
            with pytest.raises(TypeError):
                recalled(effects, height_m)
    anew = simulate_stroke_at_speed(replace(PAPER, effects=gain), 0.2151, 2.433, T)
    for name in ("fz_N", "fy_N", "tx_Nm", "q_rad", "normal_N"):
        assert np.array_equal(getattr(felt, name), getattr(anew, name))
    assert not np.array_equal(felt.fz_N, plain.fz_N)


RINGING = PresentEffect("sensor_ringing", (("frequency_Hz", 40.0), ("damping_ratio", 0.06)))
LAGGING = PresentEffect("sensor_lag", (("time_constant_s", 1e-3),))
LATE = PresentEffect("clock_offset", (("offset_s", 0.7e-3),))
DRIFTING = PresentEffect("sensor_clock_rate", (("rate_relative", 1e-3),))


@pytest.mark.parametrize("effect", [RINGING, LAGGING, LATE, DRIFTING], ids=lambda one: one.id)
def test_a_sensor_that_mixes_times_reads_the_same_however_rarely_it_is_sampled(effect):
    rig = replace(PAPER, effects=(effect,))
    rarely = simulate_stroke_at_speed(rig, 0.215, 2.433, T[::2])
    often = simulate_stroke_at_speed(rig, 0.215, 2.433, np.arange(-2000, 24961) * 5e-5)
    for name in ("fy_N", "fz_N", "tx_Nm"):
        expected = getattr(often, name)[::40]
        off = getattr(rarely, name) - expected
        assert np.sqrt(np.mean(off**2)) < 1e-3 * np.sqrt(np.mean(expected**2))


def test_a_sensor_that_mixes_times_leaves_the_leg_and_its_samples_as_they_are(stroke):
    ringing = simulate_stroke_at_speed(replace(PAPER, effects=(RINGING,)), 0.215, 2.433, T)
    for name in ("t_s", "q_rad", "w_rad_s", "normal_N", "tangential_N", "shaft_torque_Nm"):
        assert np.array_equal(getattr(ringing, name), getattr(stroke, name))


def test_however_a_ringing_sensor_is_simulated_it_reads_the_same():
    motion = ramp_to_speed(PAPER.leg.start_angle_rad, 2.433, PAPER.drive.ramp_s, float(T[-1]))
    ringing = replace(PAPER, effects=(RINGING,))
    alone = simulate_stroke(ringing, 0.215, motion, T)
    remembered = recalled((RINGING,), 0.215)
    (of_job,) = simulate_strokes([Job(ringing, 0.215, motion, T)])
    here = StrokeRequest(set_up(PAPER, 0.215, motion), T, Tolerance())
    varied = StrokeRequest(set_up(ringing, 0.215, motion), T, Tolerance())
    ((beside, plain),) = simulate_variations(here, [varied])
    for stroke in (remembered, of_job, beside):
        assert np.array_equal(stroke.fz_N, alone.fz_N)
    assert np.array_equal(plain.fz_N, recalled((), 0.215).fz_N)


def test_used_working_memory_gives_the_same_bits_as_new_memory():
    # A bump, over which a step needs the slope where it began.
    chain = make_chain(PAPER, 0.215)._replace(bump_height=2e-3, bump_at=0.15, bump_width=0.02)
    shaft = ramp_to_speed(PAPER.leg.start_angle_rad, 2.433, 0.05, 1.5).shaft()
    states = [find_rest_state(chain, PAPER.leg.start_angle_rad) for _ in range(2)]
    work = allocate_workspace(7, 7)
    # Into the ground in spans of 10 ms.
    for n in range(100):
        for state, used in zip(states, (None, work), strict=True):
            span_s = (0.01 * n, 0.01 * (n + 1))
            advance(
                chain,
                shaft,
                state,
                span_s,
                FIRST_STEP_S,
                Tolerance(),
                allocate_samples(np.empty(0), 7),
                work=used,
            )
    assert all(np.array_equal(new, used) for new, used in zip(*states, strict=True))


def pressed_and_held() -> tuple[np.ndarray, ShaftMotion]:
    """Down to 80 degrees in a second, a little back, and then held for a minute."""
    angles = np.radians([14.1, 80.0, 79.0, 79.0])
    breaks = np.array([0.0, 1.0, 1.5, 62.0])
    speeds = np.diff(angles) / np.diff(breaks)
    coefficients = np.array(
        [[angle, speed, 0.0, 0.0] for angle, speed in zip(angles[:-1], speeds, strict=True)]
    )
    return np.linspace(2.0, 62.0, 601), ShaftMotion(breaks, coefficients, breaks[:-1])


def test_a_leg_held_under_load_for_a_minute_keeps_its_tangential_force():
    t, motion = pressed_and_held()
    held = simulate_stroke(
        replace(PAPER, ground=replace(PAPER.ground, friction_coefficient=0.6)), 0.215, motion, t
    )
    late = held.tangential_N.sum(axis=1)[t > 4.0]
    assert abs(late[0]) > 0.2
    assert (
        abs(late[0]) < 0.99 * 0.6 * held.normal_N.sum(axis=1)[-1]
    )  # inside the cone: stuck, not about to slide
    assert np.ptp(late) < 1e-3 * abs(late[0])


def test_an_end_at_rest_on_the_ground_sinks_as_deep_as_hertz_says():
    t, motion = pressed_and_held()
    held = simulate_stroke(PAPER, 0.215, motion, t)
    depth = (np.array(PAPER.leg.link_lengths_m) * np.sin(held.q_rad[-1])).sum() + 0.003 - 0.215
    assert held.normal_N[-1, -1] == pytest.approx(1e5 * depth**1.5, rel=1e-6)


def test_following_a_noisy_record_of_the_shaft_gives_the_commanded_stroke(stroke):
    noise = np.random.default_rng(3).normal(0.0, 1e-4, len(T))
    followed = simulate_stroke(PAPER, 0.215, follow(T, stroke.shaft_angle_rad + noise), T)
    assert followed.fz_N.min() == pytest.approx(stroke.fz_N.min(), rel=2e-3)
    assert np.sqrt(np.mean((followed.fz_N - stroke.fz_N)[T < 1.0] ** 2)) < 0.1


def test_values_no_leg_has_end_in_one_clear_line_not_in_nan():
    broken = replace(PAPER, leg=replace(PAPER.leg, k0_Nm_per_rad=float("nan")))
    with pytest.raises(SimulationFailed, match=r"rest pose|no step"):
        simulate_stroke_at_speed(broken, 0.215, 2.433, T)


def test_a_stroke_that_would_take_hours_is_given_up_after_so_many_steps():
    bounded = Tolerance(most_steps=200)
    with pytest.raises(
        SimulationFailed, match=r"stopped after 200 steps .* steps are down to \d\S* s; look for"
    ):
        simulate_stroke_at_speed(PAPER, 0.215, 2.433, T, bounded)


@pytest.mark.parametrize("case", range(24))
def test_wide_parameters_neither_fail_nor_depend_on_the_tolerance(case):
    random = np.random.default_rng(case)
    leg = replace(
        PAPER.leg,
        k0_Nm_per_rad=10.98 * 10 ** random.uniform(-0.5, 0.5),
        hinge_damping_Nm_s_per_rad=0.088 * 10 ** random.uniform(-0.5, 0.5),
    )
    ground = replace(
        PAPER.ground,
        friction_coefficient=random.uniform(0.2, 1.3),
        stiffness_N_per_m1p5=10 ** random.uniform(4.5, 6.5),
    )
    rig = replace(PAPER, leg=leg, ground=ground)
    motion = ramp_to_speed(PAPER.leg.start_angle_rad, 3.0, 0.05, 1.0)
    t = np.arange(1, 700) * 1e-3
    plain, tight = (
        simulate_stroke(rig, 0.215, motion, t, tolerance)
        for tolerance in (Tolerance(), Tolerance(1e-6, 3e-3))
    )
    late = slice(300, None)  # the touchdown's spikes are chaotic on a hard floor; loading is not
    assert np.isfinite(plain.fz_N).all()
    assert (
        np.sqrt(np.mean((plain.fz_N - tight.fz_N)[late] ** 2))
        < 5e-3 * np.abs(tight.fz_N[late]).max()
    )


def test_another_integrator_gives_the_same_stroke_on_ice():
    t = np.arange(1, 700) * 1e-3
    other = solve_stroke(ICE, 0.215, 3.0, t, 1e-8).fz_N
    ours = simulate_stroke_at_speed(ICE, 0.215, 3.0, t).fz_N
    touching = t > 0.3
    assert np.sqrt(np.mean((ours - other)[touching] ** 2)) < 2e-3 * np.ptp(other)
    assert ours.min() == pytest.approx(other.min(), rel=1e-3)
