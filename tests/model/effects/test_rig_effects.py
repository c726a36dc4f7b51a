"""Effects of the rig, the tip and the surroundings against closed forms and balances of
momentum.
"""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.model.catalogue import set_up
from rfca_rig.model.chain import find_rest_state
from rfca_rig.model.motion import ramp_to_speed
from rfca_rig.model.parameters import Swing
from rfca_rig.model.stroke import simulate_stroke
from tests.model.effects.rigs import (
    NO_GROUND_M,
    T,
    Tolerance,
    having,
    held,
    paper_stroke,
    released,
    resting,
)
from tests.model.legs import PAPER, pendulum

LENGTHS = np.array(PAPER.leg.link_lengths_m)
MASSES = np.array(PAPER.leg.link_masses_kg)
FINE = Tolerance(1e-6, 3e-3)


def across(stroke, w):
    """Speed of the middle of every link across it, and its unit vectors along y and down."""
    sin = np.sin(stroke.q_rad)
    cos = np.cos(stroke.q_rad)
    v_y = np.cumsum(-LENGTHS * sin * w, axis=1)
    v_d = np.cumsum(LENGTHS * cos * w, axis=1)
    v_y = v_y + 0.5 * LENGTHS * sin * w
    v_d = v_d - 0.5 * LENGTHS * cos * w
    return -sin * v_y + cos * v_d, -sin, cos


def momentum_rates(stroke, extra_tip_kg=0.0):
    """(along y, down) of the leg's momentum, by second differences of places."""
    sin = np.sin(stroke.q_rad)
    cos = np.cos(stroke.q_rad)
    ends = np.cumsum(LENGTHS * cos, axis=1), np.cumsum(LENGTHS * sin, axis=1)
    places = (
        (end - 0.5 * LENGTHS * part) @ MASSES + extra_tip_kg * end[:, -1]
        for end, part in zip(ends, (cos, sin), strict=True)
    )
    return tuple(np.gradient(np.gradient(place, T), T) for place in places)


@pytest.mark.parametrize("ratio", [0.02, 0.3])
def test_a_frame_rings_down_at_its_frequency_and_damping(ratio):
    """With the leg hanging straight down it sinks with the frame: its mass adds to the moving
    one, no moment turns it.
    """
    frequency = 8.0
    mass = 5.0
    leg = 0.4
    effect = {"frequency_Hz": frequency, "moving_mass_kg": mass, "damping_ratio": ratio}
    t = np.linspace(1e-3, 0.6, 600)
    samples = released(
        having(pendulum(1), frame_compliance=effect), [np.pi / 2, 1e-3], t, gravity=9.81
    )
    rate = 2 * np.pi * frequency
    decay = ratio * rate * mass / (mass + leg)
    own = rate * np.sqrt(mass / (mass + leg))
    turning = np.sqrt(own**2 - decay**2)
    expected = (
        1e-3 * np.exp(-decay * t) * (np.cos(turning * t) + decay / turning * np.sin(turning * t))
    )
    assert samples.q[:, 1] == pytest.approx(expected, abs=1e-6)
    accelerated = -(own**2) * samples.q[:, 1] - 2 * decay * samples.w[:, 1]
    assert samples.force[:, 1] == pytest.approx(leg * (9.81 - accelerated), abs=2e-3)


@pytest.mark.parametrize("lean_deg", [0.0, -50.0])
def test_a_frame_is_driven_by_just_what_the_sensor_feels(lean_deg):
    m = 0.5
    rate = 2 * np.pi * 12.0
    ratio = 0.1
    cos = np.cos(np.radians(lean_deg))
    sin = np.sin(np.radians(lean_deg))
    effect = {
        "frequency_Hz": 12.0,
        "moving_mass_kg": m,
        "damping_ratio": ratio,
        "lean_deg": lean_deg,
    }
    stroke = paper_stroke(FINE, frame_compliance=effect)
    sunk = [0.0, 0.0]
    traced = []
    push = (stroke.fz_N - 0.32 * 9.81) * cos - stroke.fy_N * sin
    h = T[1] - T[0]
    for k in range(1, len(T)):
        for part in range(20):  # semi-implicit Euler on a fine grid
            force = push[k - 1] + (part + 0.5) / 20 * (push[k] - push[k - 1])
            sunk[1] += h / 20 * (force / m - 2 * ratio * rate * sunk[1] - rate**2 * sunk[0])
            sunk[0] += h / 20 * sunk[1]
        traced.append(sunk[0])
    y_dd, d_dd = momentum_rates(stroke)
    leg = 0.32 * np.gradient(np.gradient(np.array([0.0, *traced]), T), T)
    part = (T > 0.45) & (T < 0.9)
    felt = 0.32 * 9.81 - stroke.normal_N.sum(axis=1) - d_dd - leg * cos
    assert stroke.fz_N[part] == pytest.approx(felt[part], abs=0.02)
    assert np.abs(leg[part]).max() > 0.3
    assert stroke.fy_N[part] == pytest.approx(
        (y_dd + leg * sin - stroke.tangential_N.sum(axis=1))[part], abs=0.02
    )


def test_a_mass_at_the_tip_weighs_and_is_carried_along():
    stroke = paper_stroke(FINE, tip_mass={"mass_g": 50.0})
    y_dd, d_dd = momentum_rates(stroke, 0.05)
    assert stroke.fz_N[T < 0] == pytest.approx(0.37 * 9.81)
    part = (T > 0.45) & (T < 0.95)
    assert stroke.fz_N[part] == pytest.approx(
        (0.37 * 9.81 - stroke.normal_N.sum(axis=1) - d_dd)[part], abs=3e-4
    )
    assert stroke.fy_N[part] == pytest.approx(
        (y_dd - stroke.tangential_N.sum(axis=1))[part], abs=1e-3
    )


@pytest.mark.parametrize("link", [1, 4, 7])
def test_a_heavier_link_is_a_leg_with_that_mass(link):
    """Of uniform rods again, so that energy and momentum are those of the plain chain."""
    masses = MASSES.copy()
    masses[link - 1] *= 2.5
    leg = replace(PAPER.leg, link_masses_kg=tuple(masses))
    mine, theirs = (
        set_up(rig, NO_GROUND_M, held(0.2)).chain()
        for rig in (
            having(PAPER, heavier_link={"link": float(link), "mass_factor": 2.5}),
            replace(PAPER, leg=leg),
        )
    )
    assert mine.moment == pytest.approx(theirs.moment, rel=1e-12)
    assert mine.first_moment == pytest.approx(theirs.first_moment, rel=1e-12)
    assert mine.total_mass == pytest.approx(theirs.total_mass, rel=1e-12)


def test_a_tip_mass_weighs_and_pulls_where_it_turns():
    t = np.linspace(0.01, 0.3, 30)
    loaded = simulate_stroke(
        having(pendulum(1), tip_mass={"mass_g": 100.0}),
        NO_GROUND_M,
        ramp_to_speed(0.2, 2.0, 0.05, 1.0),
        t,
    )
    w = 2.0
    angle = loaded.shaft_angle_rad
    turning = t > 0.06
    assert loaded.fz_N[turning] == pytest.approx(
        (0.5 * 9.81 + (0.4 * 0.25 + 0.1 * 0.5) * w**2 * np.sin(angle))[turning], rel=3e-5
    )


@pytest.mark.parametrize("speed", [2.0, -2.0])
def test_a_link_turning_in_a_fluid_needs_the_power_of_its_drag(speed):
    c = 3.0
    length = 0.5
    mass = 0.4
    t = np.linspace(0.1, 0.5, 30)
    rig = having(pendulum(1), fluid_drag={"coefficient_N_s2_per_m3": c})
    stroke = simulate_stroke(
        rig, NO_GROUND_M, ramp_to_speed(0.2, speed, 0.05, 1.0), t, Tolerance(1e-8, 3e-5)
    )
    angle = stroke.shaft_angle_rad
    v = speed * length / 2
    weight_Nm = mass * 9.81 * length / 2 * np.cos(angle)
    assert (stroke.shaft_torque_Nm + weight_Nm) * speed == pytest.approx(
        c * length * abs(v) ** 3, rel=3e-5
    )
    drag = -c * length * v * abs(v)
    assert stroke.fz_N == pytest.approx(
        mass * 9.81 + drag * np.cos(angle) + mass * length / 2 * speed**2 * np.sin(angle), rel=3e-5
    )
    assert stroke.fy_N == pytest.approx(
        drag * np.sin(angle) - mass * length / 2 * speed**2 * np.cos(angle), rel=3e-5
    )


def test_the_sensor_feels_the_drag_on_every_link():
    stroke = paper_stroke(FINE, fluid_drag={"coefficient_N_s2_per_m3": 50.0})
    v, along_y, down = across(stroke, np.gradient(stroke.q_rad, T, axis=0))
    drag = -50.0 * LENGTHS * v * np.abs(v)
    y_dd, d_dd = momentum_rates(stroke)
    part = (T > 0.45) & (T < 0.95)
    fz = 0.32 * 9.81 - stroke.normal_N.sum(axis=1) + (drag * down).sum(axis=1) - d_dd
    fy = y_dd - stroke.tangential_N.sum(axis=1) - (drag * along_y).sum(axis=1)
    assert np.abs((drag * down).sum(axis=1)[part]).max() > 0.2
    assert stroke.fz_N[part] == pytest.approx(fz[part], abs=1e-3)
    assert stroke.fy_N[part] == pytest.approx(fy[part], abs=1e-3)


def test_drag_takes_its_power_out_of_a_swinging_leg():
    t = np.linspace(0.001, 0.4, 400)
    rig = having(pendulum(2, 0.3, 0.2, k0=1e-9), fluid_drag={"coefficient_N_s2_per_m3": 5.0})
    samples = released(rig, [0.0, 0.0], t, speed_rad_s=8.0)
    energy = 0.5 * 0.2 * 0.3**2 / 3 * samples.w[:, 1] ** 2
    power = 5.0 * 0.3 * np.abs(0.15 * samples.w[:, 1]) ** 3
    assert np.diff(energy).sum() == pytest.approx(-np.trapezoid(power, t), rel=1e-4)


@pytest.mark.parametrize("angle", [0.05, -0.05])
def test_out_of_plumb_the_weight_pulls_along_y_too(angle):
    setup, state = resting(having(PAPER, gravity_tilt={"angle_rad": angle}), 0.3)
    stroke = simulate_stroke(setup.rig, NO_GROUND_M, held(0.3), np.array([-0.1, 0.0, 0.5]))
    assert stroke.fy_N == pytest.approx(
        -0.32 * 9.81 * np.sin(angle), rel=1e-6
    )  # the sensor's y points against the plane's
    assert stroke.fz_N == pytest.approx(0.32 * 9.81 * np.cos(angle), rel=1e-6)
    plumb = set_up(PAPER, NO_GROUND_M, held(0.3 + angle)).chain()
    assert find_rest_state(plumb, 0.3 + angle).q - angle == pytest.approx(state.q, abs=1e-9)


def test_a_frame_that_rings_when_the_recording_begins_rings_from_there():
    """Sunk by its own sag under the leg and let go: the sensor feels the leg's inertia at the
    frame's frequency, dying away.
    """
    frame = {"frequency_Hz": 15.0, "moving_mass_kg": 4.0, "damping_ratio": 0.03}
    t_s = np.arange(-0.35, 0.0, 1e-3)
    stiff = replace(PAPER, leg=replace(PAPER.leg, k0_Nm_per_rad=1e4, start_angle_rad=0.2))
    rigs = [
        replace(having(stiff, frame_compliance=frame | begins), swing=Swing(0.36, 0.0, 0.0))
        for begins in (
            {},
            {"swing_sags": 1.0, "swing_sags_per_s": 0.0},
            {"swing_sags": 0.0, "swing_sags_per_s": 90.0},
        )
    ]
    motion = ramp_to_speed(0.2, 2.0, 0.05, 1.0)
    still, sunk, pushed = (simulate_stroke(rig, NO_GROUND_M, motion, t_s).fz_N for rig in rigs)
    assert np.ptp(still) < 1e-3
    leg = MASSES.sum()
    rate = 2.0 * np.pi * 15.0 * np.sqrt(4.0 / (4.0 + MASSES.sum()))
    amplitude = leg * leg * 9.81 / (4.0 + leg)  # leg mass times own^2 times sag m g / k
    begin_s = t_s < -0.28
    later_s = t_s > -0.08
    assert np.ptp(sunk[begin_s]) == pytest.approx(
        2.0 * amplitude, rel=0.15
    )  # less what has died away
    assert np.ptp(sunk[later_s]) < np.ptp(sunk[begin_s]) * np.exp(-0.03 * rate * 0.15)
    assert (
        abs(np.corrcoef(sunk[begin_s] - still[begin_s], pushed[begin_s] - still[begin_s])[0, 1])
        < 0.4
    )
