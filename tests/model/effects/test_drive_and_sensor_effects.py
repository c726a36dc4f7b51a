"""Effects of the drive and of the sensor against other integrators and closed forms."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rfca_rig.model.catalogue import set_up
from rfca_rig.model.kernel.stage import drive_torque
from rfca_rig.model.motion import ramp_to_speed
from rfca_rig.model.setup import SensorOutput
from rfca_rig.model.stroke import simulate_stroke
from tests.model.effects.rigs import NO_GROUND_M, TIGHT, T, having, held, paper_stroke, through
from tests.model.legs import PAPER, pendulum

LENGTH = 0.5
MASS = 0.4
INERTIA = MASS * LENGTH**2 / 3
MOTION = ramp_to_speed(0.2, 2.0, 0.05, 3.0)
WEIGHT_Nm = MASS * 9.81 * LENGTH / 2


def commanded(t):
    if t < 0.05:
        return (0.2 + 20.0 * t**2, 40.0 * t)
    return (0.25 + 2.0 * (t - 0.05), 2.0)


def by_scipy(t, k_angle, k_speed, rotor, magnets=lambda _: 0.0):
    def rhs(now, x):
        angle, speed = commanded(now)
        torque = k_angle * (angle - x[0]) + k_speed * (speed - x[1]) + magnets(x[0])
        return [x[1], (torque + WEIGHT_Nm * np.cos(x[0])) / (INERTIA + rotor)]

    rest = 0.2
    for _ in range(100):
        rest = 0.2 + (WEIGHT_Nm * np.cos(rest) + magnets(rest)) / k_angle
    first = solve_ivp(rhs, (0.0, 0.05), [rest, 0.0], "Radau", t[t <= 0.05], rtol=1e-9, atol=1e-11)
    begun = solve_ivp(rhs, (0.0, 0.05), [rest, 0.0], "Radau", rtol=1e-9, atol=1e-11).y[:, -1]
    return np.concatenate(
        [
            first.y[0],
            solve_ivp(rhs, (0.05, t[-1]), begun, "Radau", t[t > 0.05], rtol=1e-9, atol=1e-11).y[0],
        ]
    )


def test_a_drooping_drive_turns_as_another_integrator_has_the_loop_on_its_rotor():
    t = np.linspace(0.01, 1.0, 100)
    rig = having(pendulum(1), motor_speed_droop={"kp_Nm_s_per_rad": 0.6, "ki_Nm_per_rad": 10.0})
    ours = simulate_stroke(rig, NO_GROUND_M, MOTION, t, TIGHT)
    expected = by_scipy(t, 10.0, 0.6, 0.006)
    assert np.abs(expected - [commanded(x)[0] for x in t]).max() > 0.03
    assert ours.q_rad[:, 0] == pytest.approx(expected, abs=2e-6)


def test_a_motor_that_cogs_turns_as_another_integrator_has_it():
    t = np.linspace(0.01, 1.0, 100)
    values = {
        "torque_Nm": 0.2,
        "cycles_per_turn": 12.0,
        "phase_cycles": 0.2,
        "kp_Nm_s_per_rad": 1.0,
        "ki_Nm_per_rad": 20.0,
    }
    ours = simulate_stroke(having(pendulum(1), motor_cogging=values), NO_GROUND_M, MOTION, t, TIGHT)
    expected = by_scipy(
        t, 20.0, 1.0, 0.006, lambda angle: 0.2 * np.sin(12.0 * (angle - 0.2) + 0.4 * np.pi)
    )
    assert np.abs(expected - by_scipy(t, 20.0, 1.0, 0.006)).max() > 5e-3
    assert ours.q_rad[:, 0] == pytest.approx(expected, abs=2e-6)


def test_a_motor_at_its_limit_gives_just_that_torque_and_falls_behind():
    """Told to lift the link faster than it can: the energy of link and rotor is the work of that
    torque and of the weight.
    """
    t = np.linspace(0.001, 0.25, 250)
    limit = 0.5 * WEIGHT_Nm
    kp = 50.0
    ki = 1000.0
    rig = having(
        pendulum(1),
        motor_torque_limit={"limit_Nm": limit, "kp_Nm_s_per_rad": kp, "ki_Nm_per_rad": ki},
    )
    ours = simulate_stroke(rig, NO_GROUND_M, through([0.0, 1.0], [1.2, 0.2]), t, TIGHT)
    assert 0.9 * limit < (-ours.shaft_torque_Nm).max() < limit  # the rotor takes a part of it
    angle = ours.q_rad[:, 0]
    speed = ours.w_rad_s[:, 0]
    kinetic = 0.5 * (INERTIA + 0.006) * speed**2
    late = t > 0.05  # at the limit
    done = kinetic - WEIGHT_Nm * np.sin(angle) + limit * angle
    assert done[late] == pytest.approx(done[late][0], abs=1e-5)
    assert angle[-1] > 1.2 - 0.25 + 0.02


def test_a_shaft_with_play_rests_with_the_play_taken_up_and_turns_back_through_it():
    gap = np.radians(1.0)
    rig = having(pendulum(1), shaft_play={"half_gap_deg": 1.0})
    t = np.array([0.0, 0.5, 9.9])
    hanging = simulate_stroke(rig, NO_GROUND_M, held(0.3), t)
    twist = WEIGHT_Nm * np.cos(0.3 + gap) / 2000.0
    assert hanging.q_rad[:, 0] - 0.3 == pytest.approx(gap + twist, abs=1e-6)
    # slowly over the top: past straight down the weight pulls the other way
    over = simulate_stroke(rig, NO_GROUND_M, through([0.0, 10.0], [1.3, 1.9]), t)
    assert over.q_rad[-1, 0] - (1.3 + 0.06 * 9.9) == pytest.approx(-gap, abs=1e-3)


@pytest.mark.slow
def test_a_shaft_with_play_gives_no_energy_back_in_closed_loops_and_never_pulls():
    random = np.random.default_rng(3)
    gap = np.radians(1.0)
    shaft = held(0.0).shaft()._replace(free=True, k_angle=2000.0, gap=gap, loss=0.3)
    turn = np.linspace(0.0, 2.0 * np.pi, 4001)
    for _ in range(100):
        size = random.uniform(0.0, 2.0 * gap, 3)
        phase = random.uniform(0.0, 2.0 * np.pi, 3)
        rate = random.uniform(0.1, 100.0)
        angle = sum(size[k] * np.sin((k + 1) * turn + phase[k]) for k in range(3))
        speed = rate * np.gradient(angle, turn)
        torque = np.array(
            [drive_torque(shaft, a, w, 0.0)[0] for a, w in zip(angle, speed, strict=True)]
        )
        assert np.trapezoid(torque, angle) >= -1e-3 * np.ptp(angle) * np.abs(torque).max()
        assert (torque * angle >= 0.0).all()
        assert (torque[np.abs(angle) < gap] == 0.0).all()


def test_friction_of_the_shaft_takes_its_torque_times_the_angle_out_of_the_motor():
    t = np.linspace(0.0, 1.0, 2001)
    plain, dragged = (
        simulate_stroke(
            having(PAPER, **effects), NO_GROUND_M, ramp_to_speed(0.2269, 2.4, 0.05, 1.0), t
        )
        for effects in ({}, {"shaft_friction": {"torque_Nm": 0.3}})
    )
    assert dragged.q_rad == pytest.approx(plain.q_rad, abs=1e-5)
    power = (dragged.shaft_torque_Nm - plain.shaft_torque_Nm) * plain.w_rad_s[:, 0]
    turned = plain.q_rad[-1, 0] - plain.q_rad[0, 0]
    assert np.sum(0.5 * (power[1:] + power[:-1]) * np.diff(t)) == pytest.approx(
        0.3 * turned, rel=5e-3
    )
    assert dragged.tx_Nm[t > 0.1] - plain.tx_Nm[t > 0.1] == pytest.approx(0.3, abs=2e-3)


def test_a_leg_behind_a_soft_shaft_moves_as_another_integrator_has_it():
    t = np.linspace(0.01, 1.0, 100)
    ours = simulate_stroke(
        having(pendulum(1), shaft_compliance={"stiffness_Nm_per_rad": 20.0}),
        NO_GROUND_M,
        MOTION,
        t,
        TIGHT,
    )
    assert ours.q_rad[:, 0] == pytest.approx(by_scipy(t, 20.0, 0.02, 0.0), abs=2e-6)


@pytest.mark.parametrize(
    "effect",
    [
        {"shaft_compliance": {"stiffness_Nm_per_rad": 20.0}},
        {"motor_speed_droop": {"kp_Nm_s_per_rad": 1.0, "ki_Nm_per_rad": 20.0}},
    ],
)
def test_at_rest_a_soft_drive_gives_way_by_torque_over_stiffness(effect):
    stroke = simulate_stroke(
        having(PAPER, **effect), NO_GROUND_M, held(0.3), np.array([-0.1, 0.0, 1.0])
    )
    assert stroke.shaft_torque_Nm[0] < -0.3
    assert 20.0 * (0.3 - stroke.shaft_angle_rad) == pytest.approx(stroke.shaft_torque_Nm, abs=1e-6)


@pytest.mark.parametrize(("amplitude", "cycles"), [(0.1, 6.0), (0.3, 40.0), (0.01, 1.0)])
def test_a_rippled_shaft_has_its_law_s_speed(amplitude, cycles):
    def rhs(now, x):
        return commanded(now)[1] * (1 + amplitude * np.cos(cycles * (x - 0.2)))

    t = np.linspace(0.0, 3.0, 301)
    ours = set_up(
        having(
            pendulum(1),
            motor_speed_ripple={"amplitude_relative": amplitude, "cycles_per_turn": cycles},
        ),
        1.0,
        MOTION,
    ).motion
    other = solve_ivp(rhs, (0.0, 3.0), [0.2], "DOP853", t, rtol=1e-10, atol=1e-11, max_step=0.01).y[
        0
    ]
    assert ours.angle_rad(t) == pytest.approx(other, abs=2e-6)
    assert set(MOTION.landings_s) <= set(ours.breaks_s)


def felt(t, **effects):
    setup = set_up(having(PAPER, **effects), 0.2, held(0.2))
    return setup.apply_sensor_changes(
        SensorOutput(t, np.sin(3 * t), np.maximum(t, 0.0) * 7.0 + 2.0, np.cos(3 * t), 0.0 * t)
    )


def test_a_lagging_sensor_follows_a_ramp_behind_by_its_time_constant():
    tau = 0.03
    t = np.sort(np.concatenate([[0.0], np.random.default_rng(1).uniform(-0.1, 0.4, 400)]))
    after = np.maximum(t, 0.0)
    expected = 2.0 + 7.0 * (after - tau * (1.0 - np.exp(-after / tau)))
    assert felt(t, sensor_lag={"time_constant_s": tau}).fz_N == pytest.approx(expected, abs=1e-9)


def test_a_lag_reaches_all_channels():
    t = np.linspace(-2.0, 2.0, 4001)
    late = felt(t, sensor_lag={"time_constant_s": 0.03})
    gain = 1 / np.hypot(1, 0.09)
    phase = np.arctan(0.09)
    assert late.fy_N[2000:] == pytest.approx(gain * np.sin(3 * t - phase)[2000:], abs=1e-6)
    assert late.tx_Nm[2000:] == pytest.approx(gain * np.cos(3 * t - phase)[2000:], abs=1e-6)


def test_a_ringing_sensor_answers_a_vibration_with_the_gain_and_phase_of_its_mode():
    t = np.linspace(-3.0, 3.0, 6001)
    for ratio in (1.0, 2.0):  # of the frequency along y
        swung = felt(
            t,
            sensor_ringing={"frequency_Hz": 1.5, "damping_ratio": 0.4, "y_frequency_ratio": ratio},
        )
        w = 2 * np.pi * 1.5 * ratio
        answer = w * w / (w * w - 9.0 + 0.8j * w * 3.0)
        late = slice(4000, None)
        assert swung.fy_N[late] == pytest.approx(np.imag(answer * np.exp(3j * t))[late], abs=1e-4)
        assert swung.tx_Nm[late] == pytest.approx(np.real(answer * np.exp(3j * t))[late], abs=1e-4)


def test_a_ringing_sensor_overshoots_a_step_and_settles_on_it():
    t = np.linspace(0.0, 3.0, 3001)
    setup = set_up(
        having(PAPER, sensor_ringing={"frequency_Hz": 10.0, "damping_ratio": 0.1}), 0.2, held(0.2)
    )
    step = setup.apply_sensor_changes(
        SensorOutput(t, 0.0 * t, np.where(t > 0.0, 5.0, 2.0), 0.0 * t, 0.0 * t)
    ).fz_N
    assert step.max() - 5.0 == pytest.approx(3.0 * np.exp(-np.pi * 0.1 / np.sqrt(0.99)), rel=2e-3)
    assert step[-1] == pytest.approx(5.0, abs=1e-6)


def test_a_saturated_sensor_cuts_fz_alone_off_either_way():
    t = np.linspace(-2.0, 2.0, 401)
    cut = felt(t, sensor_saturation={"limit_N": 9.0})
    whole = felt(t)
    assert (np.abs(cut.fz_N) <= 9.0).all() and cut.fz_N.max() == 9.0
    inside = np.abs(whole.fz_N) < 9.0
    assert (
        (cut.fz_N[inside] == whole.fz_N[inside]).all()
        and (cut.fy_N == whole.fy_N).all()
        and (cut.tx_Nm == whole.tx_Nm).all()
    )
    setup = set_up(having(PAPER, sensor_saturation={"limit_N": 9.0}), 0.2, held(0.2))
    assert setup.apply_sensor_changes(SensorOutput(t, t, -20.0 + t, t, t)).fz_N == pytest.approx(
        -9.0
    )


def test_a_fast_force_clock_is_later_the_longer_the_motion_lasts():
    t = np.linspace(-1.0, 1.0, 20001)
    late = felt(t, sensor_clock_rate={"rate_relative": 0.02})
    inside = slice(300, -300)
    assert late.fy_N[inside] == pytest.approx(np.sin(3 * 0.98 * t)[inside], abs=1e-7)
    assert late.fz_N[inside] == pytest.approx(
        (np.maximum(0.98 * t, 0.0) * 7.0 + 2.0)[inside], abs=1e-3
    )


def test_the_crosstalk_matrix_leaks_what_the_channels_are_before_any_leak():
    t = np.linspace(-1.0, 1.0, 101)
    plain = felt(t)
    leaked = felt(
        t,
        sensor_crosstalk_matrix={
            "fz_per_fy": 0.1,
            "fy_per_fz": 0.2,
            "tx_per_fy_mm": 3.0,
            "tx_per_fz_mm": -4.0,
        },
    )
    assert leaked.fy_N == pytest.approx(plain.fy_N + 0.2 * plain.fz_N, abs=1e-12)
    assert leaked.fz_N == pytest.approx(plain.fz_N + 0.1 * plain.fy_N, abs=1e-12)
    assert leaked.tx_Nm == pytest.approx(
        plain.tx_Nm + 3e-3 * plain.fy_N - 4e-3 * plain.fz_N, abs=1e-12
    )


@pytest.mark.parametrize("offset", [0.02, -0.02])
def test_a_clock_behind_shows_the_force_later(offset):
    t = np.linspace(-1.0, 1.0, 20001)
    late = felt(t, clock_offset={"offset_s": offset})
    inside = slice(300, -300)
    assert late.fy_N[inside] == pytest.approx(np.sin(3 * (t - offset))[inside], abs=1e-7)
    assert late.tx_Nm[inside] == pytest.approx(np.cos(3 * (t - offset))[inside], abs=1e-7)
    assert late.fz_N[inside] == pytest.approx(
        (np.maximum(t - offset, 0.0) * 7.0 + 2.0)[inside], abs=1e-3
    )


def test_crosstalk_drift_and_gain_act_in_the_order_they_are_given():
    plain = paper_stroke()
    leak = {"fz_per_fy": 0.1}
    drift = {"rate_N_per_s": 2.0}
    gain = {"factor": 1.1}
    stroke = paper_stroke(sensor_crosstalk=leak, sensor_drift=drift, sensor_gain=gain)
    assert stroke.fz_N == pytest.approx(1.1 * (plain.fz_N + 0.1 * plain.fy_N + 2.0 * T), abs=1e-9)
    assert stroke.fy_N == pytest.approx(1.1 * plain.fy_N, abs=1e-9)
    assert stroke.tx_Nm == pytest.approx(1.1 * plain.tx_Nm, abs=1e-9)
    assert stroke.shaft_torque_Nm == pytest.approx(
        plain.shaft_torque_Nm, abs=1e-12
    )  # the motor's, not the sensor's
    assert paper_stroke(sensor_gain=gain, sensor_drift=drift).fz_N == pytest.approx(
        1.1 * plain.fz_N + 2.0 * T, abs=1e-9
    )
