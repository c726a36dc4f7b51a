"""The exam's simulator against closed forms, against itself at half the step, and its energy."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.exam.cases import sample_values
from rfca_rig.exam.nominal_world import nominal_world
from rfca_rig.exam.sampled_rig import EFFECTS, with_effect
from rfca_rig.exam.simulator.experiment import STEP_S, Traces, simulate, stroke_traces
from rfca_rig.exam.simulator.world import GRAVITY_M_S2, World, for_each_hinge

NO_FLOOR_M = 10.0
AT_REST = np.array([[0.0, 1.0], [0.0, 0.0]])


def hanging() -> World:
    return nominal_world(NO_FLOOR_M)


def stiff(world: World) -> World:
    hinges = replace(
        world.hinges,
        k0_Nm_per_rad=for_each_hinge(3e3),
        k2_per_rad2=for_each_hinge(0.0),
        damping_Nm_s_per_rad=for_each_hinge(1.0),
    )
    return replace(world, hinges=hinges)


def test_a_leg_at_rest_weighs_what_it_weighs_and_pulls_at_the_shaft():
    traces = simulate(hanging(), AT_REST, np.array([12.0]))
    weight = sum(hanging().links.mass_kg) * GRAVITY_M_S2
    angles = np.cumsum(traces.joint_angles_rad[0])
    length = np.array(hanging().links.length_m)
    mass = np.array(hanging().links.mass_kg)
    ends = np.cumsum(length * np.cos(angles))
    arm = GRAVITY_M_S2 * np.sum(mass * (ends - 0.5 * length * np.cos(angles)))
    assert -traces.force_d_N[0] == pytest.approx(weight, rel=1e-6)
    assert traces.force_y_N[0] == pytest.approx(0.0, abs=1e-6)
    assert traces.leg_torque_Nm[0] == pytest.approx(-arm, rel=1e-6)


def test_a_stiff_leg_on_a_soft_shaft_swings_as_one_rod():
    k = 3.0
    start = 1.2
    world = stiff(hanging())
    world = replace(world, drive=replace(world.drive, start_angle_rad=start, shaft_Nm_per_rad=k))
    length = np.array(world.links.length_m)
    mass = np.array(world.links.mass_kg)
    middle = np.concatenate([[0.0], np.cumsum(length)[:-1]]) + 0.5 * length
    inertia = np.sum(mass * (length**2 / 12.0 + middle**2))
    knots = np.array([[0.0, 0.002, 0.004, 0.006], [0.0, 5.0, 0.0, 0.0]])  # a nudge by 0.6 degrees
    t = np.arange(20, 2000) * 1e-3
    angle = simulate(world, knots, t, step_s=1e-5).joint_angles_rad[:, 0]
    rest = np.mean(angle)
    up = np.flatnonzero((angle[:-1] < rest) & (angle[1:] >= rest))
    at = t[up] + 1e-3 * (rest - angle[up]) / (angle[up + 1] - angle[up])
    pull = GRAVITY_M_S2 * np.sum(mass * middle) * np.sin(rest)
    assert 2.0 * np.pi / np.diff(at).mean() == pytest.approx(
        np.sqrt((k + pull) / inertia), rel=2e-3
    )


def energy_J(world: World, traces: Traces) -> np.ndarray:
    """Between samples: kinetic from the positions of the rods, of the springs, and of the
    weight.
    """
    length = np.array(world.links.length_m)
    mass = np.array(world.links.mass_kg)
    angle = np.cumsum(traces.joint_angles_rad, axis=1)
    step = np.stack([length * np.cos(angle), length * np.sin(angle)])
    centre = np.cumsum(step, axis=2) - 0.5 * step
    dt = np.diff(traces.t_s)[:, None]
    speed2 = (np.diff(centre, axis=1) ** 2).sum(axis=0) / dt**2
    kinetic = 0.5 * (mass * speed2).sum(axis=1) + 0.5 * (
        mass * length**2 / 12.0 * (np.diff(angle, axis=0) / dt) ** 2
    ).sum(axis=1)
    phi = traces.joint_angles_rad[:, 1:]
    k0 = np.array(world.hinges.k0_Nm_per_rad)
    k2 = np.array(world.hinges.k2_per_rad2)
    potential = (0.5 * k0 * phi**2 + 0.25 * k0 * k2 * phi**4).sum(axis=1) - GRAVITY_M_S2 * (
        mass * centre[1]
    ).sum(axis=1)
    return kinetic + 0.5 * (potential[1:] + potential[:-1])


def test_without_damping_a_swinging_leg_keeps_its_energy():
    world = hanging()
    soft = replace(
        world.hinges, k0_Nm_per_rad=for_each_hinge(1.0), damping_Nm_s_per_rad=for_each_hinge(0.0)
    )
    world = replace(world, hinges=soft)
    traces = simulate(world, AT_REST, np.arange(-5900, 14000) * 1e-4)
    energy = energy_J(world, traces)
    assert np.ptp(traces.force_d_N) > 2.0 and np.ptp(traces.joint_angles_rad) > 0.3  # it does swing
    assert np.ptp(energy) < 3e-7
    assert abs(energy[-2000:].mean() - energy[:2000].mean()) < 3e-8


def test_damping_takes_energy_away():
    traces = simulate(hanging(), AT_REST, np.arange(-5900, 5000) * 1e-4, step_s=5e-5)
    energy = energy_J(hanging(), traces)
    assert energy[-1] < energy[0] - 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("effect", [None, *EFFECTS])
def test_half_the_step_changes_nothing_that_a_sensor_could_see(effect):
    world = nominal_world(0.215)
    if effect:
        world = with_effect(world, effect, sample_values(effect, 1.0, np.random.default_rng(3)))
    once = stroke_traces(world, 3.3)
    twice = stroke_traces(world, 3.3, step_s=0.5 * STEP_S)
    pressed = once.t_s < once.t_s[np.argmin(-once.force_d_N)]
    change = np.abs(once.force_d_N - twice.force_d_N)[pressed]
    assert np.sqrt(np.mean(change**2)) < 0.03
    assert np.min(-once.force_d_N) == pytest.approx(np.min(-twice.force_d_N), rel=2e-3)


def test_error_falls_with_the_square_of_the_step():
    t = np.arange(-50, 40) * 1e-2
    fine = simulate(hanging(), AT_REST, t, step_s=1e-5).joint_angles_rad
    far, near = (
        np.abs(simulate(hanging(), AT_REST, t, step_s=h).joint_angles_rad - fine).max()
        for h in (4e-4, 2e-4)
    )
    assert far / near == pytest.approx(4.0, abs=0.2)


def test_a_rotor_behind_a_stiff_shaft_sags_as_one_on_a_rigid_shaft():
    rigid = with_effect(
        nominal_world(0.215), "motor_speed_droop", {"kp_Nm_s_per_rad": 5.0, "ki_Nm_per_rad": 40.0}
    )
    twisted = replace(
        rigid, drive=replace(rigid.drive, shaft_Nm_per_rad=3000.0, shaft_Nm_s_per_rad=3.0)
    )
    one = stroke_traces(rigid, 2.4)
    two = stroke_traces(twisted, 2.4)
    until = one.t_s < one.t_s[np.argmin(-one.force_d_N)]
    assert np.abs(one.motor_angle_rad - two.motor_angle_rad)[until].max() < 4e-3
    assert np.ptp(one.motor_speed_rad_s[until]) > 1.0
    late = until & (one.t_s > 0.5)
    assert np.sqrt(np.mean((one.motor_torque_Nm - two.motor_torque_Nm)[late] ** 2)) < 0.03


def test_a_twisted_shaft_bends_by_the_torque_over_its_stiffness():
    world = with_effect(
        nominal_world(NO_FLOOR_M), "shaft_compliance", {"stiffness_Nm_per_rad": 50.0}
    )
    traces = simulate(world, AT_REST, np.array([12.0]))
    assert traces.motor_angle_rad[0] - traces.joint_angles_rad[0, 0] == pytest.approx(
        traces.leg_torque_Nm[0] / 50.0, rel=1e-6
    )


@pytest.mark.slow
def test_a_frame_carries_the_leg_at_rest_where_it_is_told():
    values = {"frequency_Hz": 15.0, "moving_mass_kg": 3.0, "damping_ratio": 0.1}
    plain, yielding = (
        simulate(world, AT_REST, np.array([12.0]))
        for world in (hanging(), with_effect(hanging(), "frame_compliance", values))
    )
    assert yielding.force_d_N[0] == pytest.approx(plain.force_d_N[0], rel=1e-6)
    assert yielding.leg_torque_Nm[0] == pytest.approx(plain.leg_torque_Nm[0], rel=1e-6)
