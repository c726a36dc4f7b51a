"""The Python functions beside an amended model: MuJoCo's own loop with them moves as our
simulation does.
"""

import importlib.util

import mujoco
import numpy as np
import pytest

from rfca_rig.mechanism.laws_file import PARTS, write_laws
from rfca_rig.mechanism.load import load_mechanism
from rfca_rig.mechanism.model_files import write_amended_model
from rfca_rig.mechanism.plant import JointLaw, make_plant
from rfca_rig.mechanism.rollout import CommandTrace, simulate_plant
from tests.mechanism.arm import Arm, mjcf

STEP_S = 1e-3
STEPS = 400
START_RAD = np.array([0.9, -0.4, 0.7])
START_RAD_S = np.array([0.5, -1.0, 2.0])
TRACE_S = -0.2 + np.arange(800) * STEP_S
TRACE = np.column_stack(
    [3.0 * np.sin(9.0 * TRACE_S), 1.5 * np.cos(13.0 * TRACE_S), 0.3 * np.sin(17.0 * TRACE_S + 1.0)]
)
KNOTS = np.array([-4.0, -0.5, 0.0, 0.5, 4.0])


def plant_of(tmp_path):
    (tmp_path / "arm.xml").write_text(mjcf(Arm()), encoding="utf-8")
    return make_plant(load_mechanism(tmp_path / "arm.xml"), STEP_S)


def written(plant, tmp_path):
    """The amended model and its functions, as a user loads them."""
    beyond = write_amended_model(plant, tmp_path / "model.xml")
    assert write_laws(plant, beyond, tmp_path / "laws.py", ["what was stated"], "model.xml")
    spec = importlib.util.spec_from_file_location("laws", tmp_path / "laws.py")
    laws = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(laws)
    assert "rfca_rig" not in (tmp_path / "laws.py").read_text(encoding="utf-8")
    return mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml")), laws


def stepped(model, laws):
    """Positions and speeds (k, n) of MuJoCo's own loop, as the head of the file shows it."""
    model.opt.timestep = STEP_S
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    data = mujoco.MjData(model)
    if hasattr(laws, "shape_commands"):
        ctrl = laws.shape_commands(TRACE_S, TRACE, STEP_S, STEPS)
    else:
        ctrl = 0.5 * (TRACE[:-1] + TRACE[1:])[round(-TRACE_S[0] / STEP_S) :][:STEPS]
    data.qpos[:] = START_RAD
    data.qvel[:] = START_RAD_S
    data.ctrl[:] = ctrl[0]
    mujoco.mj_forward(model, data)
    state = laws.start(model) if hasattr(laws, "act") else None
    path = [(data.qpos.copy(), data.qvel.copy())]
    for command in ctrl:
        data.ctrl[:] = command
        if state is not None:
            laws.act(model, data, state)
        mujoco.mj_step(model, data)
        path.append((data.qpos.copy(), data.qvel.copy()))
    return np.moveaxis(np.array(path), 1, 0)


def rolled(plant):
    t_s = np.arange(1, STEPS + 1) * STEP_S
    return simulate_plant(
        plant, CommandTrace(TRACE_S, TRACE), START_RAD + plant.zero_offset, START_RAD_S, t_s
    )


def stribeck(plant):
    plant.stribeck[:] = [[0.3, 0.2, 0.0], [0.8, 0.5, 0.0], [0.4, 0.3, 1.0]]


def load_loss(plant):
    plant.load_loss[:] = 0.1, 0.2, 0.05


def hysteresis(plant):
    plant.hysteresis[:] = [[0.4, 0.0, 0.1], [0.05, 1.0, 0.1]]


def steady(plant):
    plant.torque_offset[:] = 0.3, -0.2, 0.05


def tables(plant):
    brakes = JointLaw(1, True, KNOTS, np.array([-0.4, -0.5, 0.0, 0.5, 0.4]), np.zeros(5))
    drives = JointLaw(2, True, KNOTS, np.array([0.05, 0.02, 0.0, -0.02, -0.05]), np.zeros(5))
    spring = JointLaw(0, False, KNOTS, 3.0 * KNOTS, np.zeros(5))
    plant.friction[1] = 0.1
    plant.laws = (brakes, drives, spring)


def commands(plant):
    plant.command_gain[:] = 1.1, 0.9, 1.0
    plant.command_limit[:] = 2.0, np.inf, 0.25
    plant.command_dead_band[:] = 0.1, 0.05, 0.0
    plant.command_delay_s = 0.011
    plant.command_lag_s = 0.013
    plant.command_clock_rate = 0.002


CHANGES = (stribeck, load_loss, hysteresis, steady, tables, commands)


@pytest.mark.parametrize(
    "changes",
    [*((each,) for each in CHANGES), CHANGES],
    ids=lambda each: "_".join(one.__name__ for one in each),
)
def test_mujoco_s_own_loop_with_the_functions_moves_as_the_amended_simulation(tmp_path, changes):
    plant = plant_of(tmp_path)
    nominal = rolled(plant).position
    for change in changes:
        change(plant)
    ours = rolled(plant)
    model, laws = written(plant, tmp_path)
    position, speed = stepped(model, laws)
    assert np.abs(ours.position - nominal).max() > 3e-3
    assert np.abs(position[1:] - ours.position).max() < 1e-6
    assert np.abs(speed[1:] - ours.speed).max() < 1e-4


def test_readings_are_those_of_the_amended_simulation(tmp_path):
    sensors = '<sensor><velocimeter name="tip" site="tip"/></sensor></mujoco>'
    text = mjcf(Arm()).replace(
        "</body></body></body>", '<site name="tip" pos="0 0 -0.2"/></body></body></body>'
    )
    (tmp_path / "arm.xml").write_text(text.replace("</mujoco>", sensors), encoding="utf-8")
    plant = make_plant(load_mechanism(tmp_path / "arm.xml"), STEP_S, reads_sensors=True)
    plain = rolled(plant)
    plant.zero_offset[:] = 0.01, -0.02, 0.03
    plant.speed_lag_s = 0.01
    plant.sensor_lag_s = 0.007
    plant.sensor_delay_s = 0.004
    plant.sensor_gain[:] = 1.2
    plant.sensor_offset[:] = 0.1
    plant.sensor_drift_per_s[:] = (0.2, 0.0, -0.1)
    plant.sensor_crosstalk[0, 2] = 0.05
    read = rolled(plant)
    _, laws = written(plant, tmp_path)
    assert laws.read_positions(plain.position) == pytest.approx(read.position, abs=1e-6)
    speeds = laws.read_speeds(np.vstack([START_RAD_S, plain.speed]), STEP_S)
    assert speeds[1:] == pytest.approx(read.speed, abs=1e-6)
    assert plain.sensors.shape == (STEPS, 3)
    sensors = laws.read_sensors(np.vstack([plain.sensors[:1], plain.sensors]), STEP_S)
    assert sensors[100:] == pytest.approx(
        read.sensors[99:], abs=1e-5
    )  # by then the value at time 0 counts no more


def test_late_readings_are_those_of_a_motion_that_began_before(tmp_path):
    """From readings within a motion, the motion behind them is found again: the joints have moved
    on by then.
    """
    plant = plant_of(tmp_path)
    plain = rolled(plant)
    plant.reading_lag_s = 0.006
    _, laws = written(plant, tmp_path)
    position = laws.read_states_late(np.vstack([START_RAD, plain.position]), STEP_S)
    speed = laws.read_states_late(np.vstack([START_RAD_S, plain.speed]), STEP_S)
    begin = 100
    trace = CommandTrace(TRACE_S - begin * STEP_S, TRACE)
    t_s = np.arange(1, STEPS - begin + 1) * STEP_S
    late = simulate_plant(plant, trace, position[begin], speed[begin], t_s)
    for motion, read, simulated in (
        (plain.position, position, late.position),
        (plain.speed, speed, late.speed),
    ):
        moved = np.abs(motion[begin:] - read[begin + 1 :]).max()
        assert np.abs(simulated - read[begin + 1 :]).max() < 0.1 * moved


def test_every_law_that_mjcf_does_not_hold_has_a_function(tmp_path):
    plant = plant_of(tmp_path)
    for change in CHANGES:
        change(plant)
    plant.zero_offset[:] = 0.01
    plant.reading_lag_s = 0.01
    plant.speed_lag_s = 0.01
    plant.sensor_lag_s = 0.01
    beyond = write_amended_model(plant, tmp_path / "model.xml")
    assert set(beyond) <= set(PARTS)
    assert set(PARTS) - set(beyond) == {
        "scales and zeros of the sensors",
        "crosstalk of the sensors",
    }  # this arm has none


def test_what_has_no_function_is_said_in_the_file_and_an_old_file_goes(tmp_path):
    plant = plant_of(tmp_path)
    assert write_laws(plant, ["a law of tomorrow"], tmp_path / "laws.py", [], "model.xml")
    assert "NOT in this file: a law of tomorrow" in (tmp_path / "laws.py").read_text(
        encoding="utf-8"
    )
    assert not write_laws(plant, (), tmp_path / "laws.py", [], "model.xml")
    assert not (tmp_path / "laws.py").exists()


def test_an_amended_gain_scales_the_command_and_not_what_the_actuator_feeds_back(tmp_path):
    kp_Nm_per_rad = 40.0
    kv_Nm_s_per_rad = 4.0
    text = mjcf(Arm())
    joints = [f"joint{number}" for number in (1, 2, 3)]
    servos = "".join(
        f'<position name="servo{n}" joint="{joint}" kp="{kp_Nm_per_rad}" kv="{kv_Nm_s_per_rad}"/>'
        for n, joint in enumerate(joints)
    )
    begin = text.index("<actuator>") + len("<actuator>")
    end = text.index("</actuator>")
    (tmp_path / "arm.xml").write_text(text[:begin] + servos + text[end:], encoding="utf-8")
    plant = make_plant(load_mechanism(tmp_path / "arm.xml"), STEP_S)
    unscaled = rolled(plant).position
    plant.command_gain[:] = 1.3, 0.7, 1.1
    expected = rolled(plant).position
    assert np.abs(expected - unscaled).max() > 0.1
    write_amended_model(plant, tmp_path / "model.xml")
    amended = make_plant(load_mechanism(tmp_path / "model.xml"), STEP_S)
    assert np.abs(rolled(amended).position - expected).max() < 1e-6
