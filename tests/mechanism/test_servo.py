"""The simulated servo against laws of mechanics, and against MuJoCo where it has no friction."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from rfca_rig.campaign.experiment import read_experiment
from tests.mechanism.servo import (
    COUNT_RAD,
    GRAVITY_M_S2,
    TRAJECTORIES,
    GearFriction,
    Motor,
    Servo,
    advance,
    follow,
    mjcf,
    record,
    write_campaign,
)

TICK_S = 0.008
ROUGH = GearFriction(dry_Nm=0.15, rise=0.4, driving_share=0.2, back_driving_share=0.1)


def positions(servo, state, seconds, duty=0.0, is_on=True):
    """States (k, 3) at every tick."""
    states = [np.array(state)]
    for _ in range(round(seconds / TICK_S)):
        states.append(advance(servo, states[-1], duty, TICK_S, is_on))
    return np.array(states)


def test_energy_stays_without_friction_and_motor():
    servo = Servo(windings_open=True)
    states = positions(servo, [2.0, 0.0, 0.0], 4.0, is_on=False)
    inertia_kg_m2 = servo.inertia_kg_m2 + servo.motor.reflected_kg_m2
    lever_kg_m = 0.5 * servo.rod_kg * servo.arm_m + servo.weight_kg * servo.arm_m
    kinetic_J = 0.5 * inertia_kg_m2 * states[:, 1] ** 2
    height_J = -GRAVITY_M_S2 * lever_kg_m * np.cos(states[:, 0])
    energy_J = kinetic_J + height_J
    assert kinetic_J.max() > 0.5 * np.ptp(height_J)
    assert np.abs(energy_J - energy_J[0]).max() < 1e-9


def test_static_friction_holds_the_arm_until_the_weight_is_larger():
    friction = GearFriction(dry_Nm=0.3, rise=0.4)
    servo = Servo(friction=friction, windings_open=True)
    largest_Nm = friction.dry_Nm * (1.0 + friction.rise)
    # The bristle bears the weight already; a sudden release would overshoot.
    held_rad = np.arcsin(0.95 * largest_Nm / servo.gravity_Nm)
    held = positions(servo, [held_rad, 0.0, -0.95], 4.0, is_on=False)
    assert np.abs(held[:, 0] - held_rad).max() < 3.0 * friction.bristle_rad
    assert np.abs(held[-1, 1]) < 1e-4
    slips_rad = np.arcsin(1.05 * largest_Nm / servo.gravity_Nm)
    slipped = positions(servo, [slips_rad, 0.0, -1.0], 4.0, is_on=False)
    assert slipped[-1, 0] < slips_rad - 0.1


def test_back_emf_limits_the_speed():
    motor = Motor()
    no_load_rad_s = motor.supply_V / (motor.ratio * motor.torque_constant_Nm_per_A)
    servo = Servo(weight_kg=1e-6, rod_kg=1e-6, motor=motor)
    for supply_share in (1.0, 0.5):
        fastest = positions(servo, [0.0, 0.0, 0.0], 1.0, duty=supply_share)[-1, 1]
        assert fastest == pytest.approx(supply_share * no_load_rad_s, rel=1e-4)


def test_a_motor_that_is_off_brakes_only_with_shorted_windings():
    shorted = positions(Servo(), [1.5, 0.0, 0.0], 0.4, is_on=False)
    open_ = positions(Servo(windings_open=True), [1.5, 0.0, 0.0], 0.4, is_on=False)
    assert np.abs(shorted[:, 1]).max() < 0.2 * np.abs(open_[:, 1]).max()


@pytest.mark.parametrize("shares", [(0.0, 0.0), (0.25, 0.1)])
def test_lifting_takes_the_driving_share_and_lowering_saves_the_other(shares):
    """At 0.1 rad/s inertia is negligible; back-EMF is taken off the duty's torque."""
    driving, back_driving = shares
    friction = GearFriction(driving_share=driving, back_driving_share=back_driving)
    servo = Servo(friction=friction)
    rate_rad_s = 0.1

    def torque_at_horizontal(rate):
        moved = follow(servo, "sweep", lambda t_s: np.pi / 2.0 + rate * (t_s - 4.0), 6.0)
        late = moved.t_s > 2.0
        near = np.argmin(np.abs(moved.true_rad[late] - np.pi / 2.0))
        around = slice(max(near - 60, 0), near + 60)
        torque_Nm = servo.motor.stall_Nm * moved.duty[late][around]
        back_emf_Nm = servo.motor.back_emf_Nm_s_per_rad * moved.true_rad_s[late][around]
        return np.mean(torque_Nm - back_emf_Nm)

    weight_Nm = servo.gravity_Nm
    assert torque_at_horizontal(rate_rad_s) == pytest.approx((1.0 + driving) * weight_Nm, rel=0.01)
    lowering_Nm = (1.0 - back_driving) * weight_Nm
    assert torque_at_horizontal(-rate_rad_s) == pytest.approx(lowering_Nm, rel=0.01)


def test_the_model_file_has_inertia_and_weight_of_rod_weight_and_rotor():
    servo = Servo(weight_kg=0.6, arm_m=0.15, rod_kg=0.05, motor=Motor(rotor_kg_m2=2e-7))
    model = mujoco.MjModel.from_xml_string(mjcf(servo))
    data = mujoco.MjData(model)
    data.qpos[0] = np.pi / 2.0
    mujoco.mj_forward(model, data)
    inertia_kg_m2 = np.empty((1, 1))
    mujoco.mj_fullM(model, data, inertia_kg_m2)
    expected_kg_m2 = 0.6 * 0.15**2 + 0.05 * 0.15**2 / 3.0 + 225.0**2 * 2e-7
    assert inertia_kg_m2[0, 0] == pytest.approx(expected_kg_m2, rel=1e-9)
    assert data.qfrc_bias[0] == pytest.approx(9.81 * 0.15 * (0.6 + 0.025), rel=1e-9)


@pytest.mark.parametrize("condition", TRAJECTORIES)
def test_without_friction_it_moves_as_the_model_does_in_mujoco(condition):
    """Both integrate the same equations with duty held over a tick: they agree to 1e-6 rad."""
    servo = Servo()
    recording = record(servo, condition, 4.0, seed=2, supply_factor=1.02)
    model = mujoco.MjModel.from_xml_string(mjcf(servo))
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    data = mujoco.MjData(model)
    data.qpos[0] = recording.true_rad[0]
    data.qvel[0] = recording.true_rad_s[0]
    path_rad = np.empty(len(recording.t_s))
    for tick, duty in enumerate(recording.duty):
        path_rad[tick] = data.qpos[0]
        data.ctrl[0] = 1.02 * duty
        mujoco.mj_step(model, data, nstep=round(TICK_S / model.opt.timestep))
    assert np.ptp(recording.true_rad) > 0.5
    assert np.abs(path_rad - recording.true_rad).max() < 1e-6


def test_readings_are_counts_a_late_speed_and_a_limited_duty():
    servo = Servo(friction=ROUGH, zero_rad=0.02)
    recording = record(servo, "sines", 6.0, seed=5)
    assert np.array_equal(recording.counts, np.round(recording.counts))
    error_rad = recording.counts * COUNT_RAD - servo.zero_rad - recording.true_rad
    assert np.abs(error_rad).max() <= 0.5 * COUNT_RAD * (1.0 + 1e-9)
    assert np.abs(recording.duty).max() <= 1.0
    lags_s = np.arange(0, 10) * TICK_S
    scores = []
    for lag in range(len(lags_s)):
        earlier = recording.true_rad_s[: len(recording.t_s) - lag]
        scores.append(np.corrcoef(recording.speed_rad_s[lag:], earlier)[0, 1])
    assert 0.01 < lags_s[np.argmax(scores)] < 0.03


def test_a_recording_repeats_itself():
    first = record(Servo(friction=ROUGH), "steps", 3.0, seed=8)
    second = record(Servo(friction=ROUGH), "steps", 3.0, seed=8)
    assert np.array_equal(first.counts, second.counts)
    other = record(Servo(friction=ROUGH), "steps", 3.0, seed=9)
    assert not np.array_equal(first.counts, other.counts)


def test_the_written_folder_is_read_in_si_units(tmp_path):
    servo = replace(Servo(), friction=ROUGH)
    recordings = [record(servo, condition, 3.0, seed=1) for condition in TRAJECTORIES]
    folder = tmp_path / "servo"
    write_campaign(folder, mjcf(servo), recordings, {"mass_relative": 0.02})
    experiment = read_experiment(folder)
    assert [run.driven for run in experiment.runs] == [True, True, True, False]
    for run, recording in zip(experiment.runs, recordings, strict=True):
        read_rad = run.signals[:, 0]
        assert read_rad == pytest.approx(recording.counts * COUNT_RAD, abs=1e-7)
    assert experiment.known_to == {"mass_relative": 0.02}
