"""Torques that a recorded motion needs: of a simulated motion, none is missing in its own model."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rfca_rig.mechanism.effects import list_effects
from rfca_rig.mechanism.laws import make_tabulated_effect
from rfca_rig.mechanism.load import load_mechanism
from rfca_rig.mechanism.needed_torque import RecordedStates, compute_missing_torque
from rfca_rig.mechanism.plant import make_plant, update_constants
from rfca_rig.mechanism.rollout import CommandTrace, simulate_plant
from rfca_rig.mechanism.usual_motion import measure_usual_motion
from rfca_rig.model.parameters import LawTable
from tests.mechanism import arm

STEP_S = 0.01
STEPS = 150
SIMULATED_STEP_S = 0.0005
# A motion from which speeds and accelerations are differences over this time.
FINE_S = 0.001
ARM = arm.Arm()
# A size for each parameter where the middle of its range would stop the arm, or do nothing.
SIZES = {
    "delay_s": 0.015,
    "time_constant_s": 0.02,
    "limit_relative": 0.7,
    "rate_relative": 0.004,
    "loss_relative": 0.1,
}
VISIBLE = (
    "joint_friction",
    "joint_stribeck",
    "joint_hysteresis",
    "joint_load_friction",
    "joint_damping",
    "joint_drag",
    "joint_inertia",
    "joint_spring",
    "torque_scale",
    "torque_delay",
    "torque_lag",
    "torque_saturation",
    "torque_dead_band",
    "torque_falls_with_speed",
    "clock_rate",
    "gravity_tilt",
    "added_mass",
)


@pytest.fixture(scope="module")
def mechanism(tmp_path_factory):
    path = Path(tmp_path_factory.mktemp("arm")) / "model.xml"
    path.write_text(arm.mjcf(ARM), encoding="utf-8")
    return load_mechanism(path)


@pytest.fixture(scope="module")
def trace():
    t_s = np.arange(-0.2, STEP_S * STEPS + 0.2, 0.002)
    waves = np.sin(np.outer(t_s, (3.0, 4.0, 5.0)) + np.arange(3.0))
    return CommandTrace(t_s, waves * (3.0, 0.8, 0.15))


@pytest.fixture(scope="module")
def effects(mechanism, trace):
    random = np.random.default_rng(1)
    usual = measure_usual_motion(
        mechanism,
        position=random.uniform(-0.6, 0.6, (20, 3)),
        speed=random.uniform(-3.0, 3.0, (20, 3)),
        commands=[trace.command] * 20,
        seconds=1.0,
        has_speeds=True,
        sensors={},
    )
    return {effect.id: effect for effect in list_effects(mechanism, usual)}


def middle(parameter):
    """A plausible size: the stated one, or the geometric middle of its range."""
    for ending, size in SIZES.items():
        if parameter.name.endswith(ending):
            return size
    if parameter.low > 0.0:
        return float(np.sqrt(parameter.low * parameter.high))
    return 0.3 * parameter.high


def make_changed(mechanism, effect):
    plant = make_plant(mechanism, SIMULATED_STEP_S)
    parameters = (*effect.parameters, *effect.shape, *effect.begins)
    plant = effect.apply(plant, {parameter.name: middle(parameter) for parameter in parameters})
    update_constants(plant)
    return plant


def record(plant, trace):
    """The motion of a plant in the middle of each step, with differences as its derivatives."""
    middles_s = STEP_S * (0.5 + np.arange(STEPS))
    times_s = np.sort(np.concatenate([middles_s - FINE_S, middles_s, middles_s + FINE_S]))
    motion = simulate_plant(plant, trace, np.array([0.3, -0.2, 0.2]), np.zeros(3), times_s)
    before, at, after = (motion.speed[k::3] for k in range(3))
    return RecordedStates(
        step_s=STEP_S,
        since_s=0.0,
        position=motion.position[1::3],
        speed=at,
        acceleration=(after - before) / (2.0 * FINE_S),
        speed_std=np.full(3, 1e-3),
        trace=trace,
    )


def compare(mechanism, plant, trace):
    """Rms of the torques (n,) that the plant's own motion lacks in it, and in the nominal model."""
    states = record(plant, trace)
    nominal, _ = compute_missing_torque(make_plant(mechanism, STEP_S), states)
    own, _ = compute_missing_torque(plant, states)
    # Where any joint turns round near a step, or sticks, friction jumps, and all accelerations do.
    moves = np.abs(states.speed) > np.abs(states.acceleration) * STEP_S + 0.02
    moves = np.repeat(moves.all(axis=1)[:, None], 3, axis=1)
    return (
        np.sqrt(np.mean(own**2, axis=0, where=moves)),
        np.sqrt(np.mean(nominal**2, axis=0, where=moves)),
    )


@pytest.mark.parametrize("name", VISIBLE)
def test_nothing_is_missing_in_a_models_own_motion(mechanism, effects, trace, name):
    own, nominal = compare(mechanism, make_changed(mechanism, effects[name]), trace)
    shown = nominal > 0.05 * nominal.max()
    assert (own[shown] < 0.15 * nominal[shown]).all()
    assert own.max() < 0.1 * nominal.max()


def test_a_table_over_the_speed_is_a_torque_too(mechanism, trace):
    table = LawTable("joint2", "speed", (-4.0, -1.0, 0.0, 1.0, 4.0), (-0.5, -0.2, 0.0, 0.4, 0.6))
    effect = make_tabulated_effect(mechanism, table)
    plant = effect.apply(make_plant(mechanism, SIMULATED_STEP_S), {})
    own, nominal = compare(mechanism, plant, trace)
    assert own[1] < 0.1 * nominal[1]


def test_a_reading_that_is_off_is_taken_back(mechanism, trace):
    plant = make_plant(mechanism, SIMULATED_STEP_S)
    plant.zero_offset[0] = 0.1
    own, nominal = compare(mechanism, plant, trace)
    assert own[0] < 0.05 * nominal[0]


@pytest.mark.parametrize(("is_powered", "offset_Nm"), [(True, 1.0), (False, 0.0)])
def test_motors_have_an_offset_while_they_are_on(mechanism, trace, is_powered, offset_Nm):
    plant = make_plant(mechanism, SIMULATED_STEP_S)
    states = record(plant, trace)
    states = replace(states, trace=replace(trace, is_powered=is_powered))
    before, _ = compute_missing_torque(plant, states)
    plant.torque_offset[0] = 1.0
    after, _ = compute_missing_torque(plant, states)
    np.testing.assert_allclose((before - after)[:, 0], offset_Nm, atol=1e-12)
