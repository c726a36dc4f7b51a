"""MuJoCo's motion of a mechanism against an arm with equations of its own, and what happens to
commands and readings.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.mechanism.load import load_mechanism
from rfca_rig.mechanism.plant import add_point_mass, make_plant, update_constants
from rfca_rig.mechanism.rollout import CommandTrace, average_commands, simulate_plant
from tests.mechanism import hopper
from tests.mechanism.arm import Arm, Friction, _rate, mjcf

ARM = Arm()
START_RAD = np.array([0.9, -0.4, 0.7])
START_RAD_S = np.array([0.5, -1.0, 2.0])
T_S = np.linspace(0.005, 0.5, 100)
NO_COMMAND = CommandTrace(np.array([-0.1, 0.7]), np.empty((2, 0)))


def loaded(tmp_path, text):
    (tmp_path / "model.xml").write_text(text, encoding="utf-8")
    return load_mechanism(tmp_path / "model.xml")


def told(torque):
    """The same torques all the time."""
    return CommandTrace(np.array([-0.1, 0.7]), np.tile(torque, (2, 1)))


def of_scipy(arm, torque):
    """The arm's motion by its own equations, its bristles relaxed at first."""
    state = np.concatenate([START_RAD, START_RAD_S, np.zeros(3)])
    found = solve_ivp(
        lambda _, x: _rate(arm, x, np.array(torque)),
        (0.0, 0.5),
        state,
        t_eval=T_S,
        rtol=1e-9,
        atol=1e-11,
    )
    return found.y[:3].T, found.y[3:6].T


@pytest.mark.parametrize("step_s", [4e-3, 1e-3])
def test_a_rigid_arm_moves_as_its_equations_say(tmp_path, step_s):
    motion = simulate_plant(
        make_plant(loaded(tmp_path, mjcf(ARM)), step_s),
        told([2.0, -1.0, 0.3]),
        START_RAD,
        START_RAD_S,
        T_S,
    )
    position, speed = of_scipy(ARM, [2.0, -1.0, 0.3])
    assert np.abs(motion.position - position).max() < 1e-5
    assert np.abs(motion.speed - speed).max() < 0.05 * (step_s / 4e-3)


def test_dry_friction_brakes_as_bristles_do(tmp_path):
    """MuJoCo's is a constraint without bend; the bristles of the other arm bend by 2 mrad."""
    arm = replace(ARM, friction=Friction((0.6, 0.4, 0.15)))
    plant = make_plant(loaded(tmp_path, mjcf(ARM)), 2e-3)
    without = simulate_plant(plant, told([2.0, -1.0, 0.3]), START_RAD, START_RAD_S, T_S)
    plant.friction[:] = (0.6, 0.4, 0.15)
    motion = simulate_plant(plant, told([2.0, -1.0, 0.3]), START_RAD, START_RAD_S, T_S)
    position, _ = of_scipy(arm, [2.0, -1.0, 0.3])
    assert (
        np.abs(motion.position - position).max() < 0.06 * np.abs(without.position - position).max()
    )


def test_friction_of_a_load_is_a_share_of_the_torque(tmp_path):
    plant = make_plant(loaded(tmp_path, mjcf(ARM)), 1e-3)
    plant.load_loss[:] = 0.1
    lost = simulate_plant(plant, told([2.0, -1.0, 0.3]), START_RAD, START_RAD_S, T_S)
    plant.load_loss[:] = 0.0
    plant.friction[:] = (0.2, 0.1, 0.03)
    dry = simulate_plant(plant, told([2.0, -1.0, 0.3]), START_RAD, START_RAD_S, T_S)
    assert np.abs(lost.position - dry.position).max() < 1e-4


def test_stribeck_friction_is_dry_friction_at_high_speed_and_more_at_rest(tmp_path):
    plant = make_plant(loaded(tmp_path, mjcf(ARM)), 1e-3)
    plant.stribeck[0] = 0.2
    plant.stribeck[1] = 1.0
    plant.stribeck[2] = 1e-6
    falls_at_once = simulate_plant(plant, told([2.0, -1.0, 0.3]), START_RAD, START_RAD_S, T_S)
    plant.stribeck[2] = 1e6
    never_falls = simulate_plant(plant, told([2.0, -1.0, 0.3]), START_RAD, START_RAD_S, T_S)
    plant.stribeck[0] = 0.0
    for torque, other in ((0.2, falls_at_once), (0.4, never_falls)):
        plant.friction[:] = torque
        dry = simulate_plant(plant, told([2.0, -1.0, 0.3]), START_RAD, START_RAD_S, T_S)
        assert np.abs(dry.position - other.position).max() < 2e-3


def test_commands_act_late_by_the_delay_and_after_the_gain(tmp_path):
    mechanism = loaded(tmp_path, mjcf(ARM))
    t_s = np.arange(-0.1, 0.7, 0.001)
    wave = np.column_stack([np.sin(30.0 * (t_s - late)) for late in (0.0, 0.0, 0.0)])
    shifted = np.column_stack([np.sin(30.0 * (t_s - 0.02))] * 3)
    plant = make_plant(mechanism, 1e-3)
    plant.command_delay_s = 0.02
    plant.command_gain = np.full(3, 2.0)
    late = simulate_plant(plant, CommandTrace(t_s, wave), START_RAD, START_RAD_S, T_S)
    same = simulate_plant(
        make_plant(mechanism, 1e-3), CommandTrace(t_s, 2.0 * shifted), START_RAD, START_RAD_S, T_S
    )
    assert np.abs(late.position - same.position).max() < 1e-5
    plant.command_limit[:] = 0.5
    limited = simulate_plant(plant, CommandTrace(t_s, wave), START_RAD, START_RAD_S, T_S)
    clipped = simulate_plant(
        make_plant(mechanism, 1e-3),
        CommandTrace(t_s, np.clip(2.0 * shifted, -0.5, 0.5)),
        START_RAD,
        START_RAD_S,
        T_S,
    )
    assert np.abs(limited.position - clipped.position).max() < 1e-3


def test_a_lag_of_commands_and_of_speeds_follows_its_time_constant(tmp_path):
    mechanism = loaded(tmp_path, mjcf(ARM))
    t_s = np.arange(-0.4, 0.7, 0.001)
    plant = make_plant(mechanism, 1e-3)
    plant.command_lag_s = 0.03
    lagged = simulate_plant(
        plant,
        CommandTrace(t_s, np.sin(10.0 * t_s)[:, None] * np.ones(3)),
        START_RAD,
        START_RAD_S,
        T_S,
    )
    # the steady answer of a low-pass to a sine
    phase = np.arctan(10.0 * 0.03)
    share = 1.0 / np.hypot(1.0, 10.0 * 0.03)
    steady = share * np.sin(10.0 * t_s - phase)
    same = simulate_plant(
        make_plant(mechanism, 1e-3),
        CommandTrace(t_s, steady[:, None] * np.ones(3)),
        START_RAD,
        START_RAD_S,
        T_S,
    )
    assert np.abs(lagged.position - same.position).max() < 0.01
    plant = make_plant(mechanism, 1e-3)
    plain = simulate_plant(plant, told([0.0] * 3), START_RAD, START_RAD_S, T_S)
    plant.speed_lag_s = 0.02
    late = simulate_plant(plant, told([0.0] * 3), START_RAD, START_RAD_S, T_S)
    rate = np.gradient(late.speed, T_S, axis=0)
    # From the start on, as in a motion that began before.
    assert np.abs(0.02 * rate + late.speed - plain.speed)[2:-2].max() < 0.15
    assert np.array_equal(late.position, plain.position)


@pytest.mark.parametrize("lag", ["speed_lag_s", "reading_lag_s"])
def test_a_lag_of_readings_does_not_depend_on_the_step(tmp_path, lag):
    mechanism = loaded(tmp_path, mjcf(ARM))
    speeds = []
    for step_s in (5e-4, 4e-3):
        plant = make_plant(mechanism, step_s)
        plain = simulate_plant(plant, told([0.0] * 3), START_RAD, START_RAD_S, T_S)
        setattr(plant, lag, 0.01)
        late = simulate_plant(plant, told([0.0] * 3), START_RAD, START_RAD_S, T_S)
        speeds.append(late.speed)
    moved = np.abs(late.speed - plain.speed).max()
    assert np.abs(speeds[1] - speeds[0]).max() < 0.1 * moved


def test_a_zero_offset_is_read_and_does_not_act(tmp_path):
    plant = make_plant(loaded(tmp_path, mjcf(ARM)), 1e-3)
    plain = simulate_plant(plant, told([0.0] * 3), START_RAD, START_RAD_S, T_S)
    plant.zero_offset[:] = (0.1, -0.2, 0.3)
    shifted = simulate_plant(
        plant, told([0.0] * 3), START_RAD + plant.zero_offset, START_RAD_S, T_S
    )
    assert np.abs(shifted.position - plain.position - plant.zero_offset).max() < 1e-12


def test_a_simulation_that_diverges_is_said_so_and_leaves_no_log(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = mjcf(ARM).replace('name="joint3"', 'name="joint3" damping="1e6"')
    with pytest.raises(SimulationFailed, match="diverges"):
        simulate_plant(
            make_plant(loaded(tmp_path, text), 1e-3), told([0.0] * 3), START_RAD, START_RAD_S, T_S
        )
    assert [path.name for path in tmp_path.iterdir()] == ["model.xml"]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('type="hinge"', 'type="ball"', "neither a hinge nor a slide"),
        ('mass="2.0"', 'mass="-2.0"', "MuJoCo refuses the model"),
        ("<worldbody>", "<worldbody", "MuJoCo refuses the model"),
    ],
)
def test_a_model_that_cannot_be_used_is_refused_in_one_line(tmp_path, old, new, said):
    with pytest.raises(BadInput) as refused:
        loaded(tmp_path, mjcf(ARM).replace(old, new, 1))
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)
    assert str(tmp_path / "model.xml") in str(refused.value)


def test_every_joint_needs_a_name(tmp_path):
    text = (
        '<mujoco><worldbody><body><joint axis="0 1 0"/><geom type="sphere" size="0.1" pos="0 '
        '0 1"/></body></worldbody></mujoco>'
    )
    with pytest.raises(BadInput, match="a joint has no name"):
        loaded(tmp_path, text)


def test_a_model_that_is_not_there_is_said_so(tmp_path):
    with pytest.raises(BadInput, match="is not there"):
        load_mechanism(tmp_path / "none.xml")


def fallen(tmp_path, **changes):
    """What the sole of a hopper reads that falls from 0.02 m above its rest, with a change of
    its readings.
    """
    plant = make_plant(loaded(tmp_path, hopper.mjcf(hopper.Hopper())), 5e-4, reads_sensors=True)
    for name, value in changes.items():
        setattr(plant, name, value)
    trace = CommandTrace(np.array([-0.1, 0.4]), np.full((2, 1), 15.0))
    return simulate_plant(
        plant, trace, np.array([0.29, 0.25]), np.zeros(2), np.arange(1, 601) * 5e-4
    )


def test_a_sensor_reads_the_force_that_moves_the_mechanism(tmp_path):
    """Newton's law of the whole hopper: the mean force on the sole is its weight and the gain of
    its momentum.
    """
    motion = fallen(tmp_path)
    model = hopper.Hopper()
    trunk = motion.speed[:, 0]
    foot = motion.speed[:, 0] - motion.speed[:, 1]
    momentum = model.trunk_kg * trunk + model.foot_kg * foot
    expected = (momentum[-1] - momentum[0]) / (599 * 5e-4) + hopper.GRAVITY_M_S2 * (
        model.trunk_kg + model.foot_kg
    )
    assert motion.sensors[0, 0] == 0.0
    assert motion.sensors[:, 0].max() > 20.0
    assert np.mean(motion.sensors[:, 0]) == pytest.approx(expected, rel=0.02)


def test_readings_of_a_sensor_are_late_scaled_and_off_as_stated(tmp_path):
    plain = fallen(tmp_path).sensors[:, 0]
    late = fallen(tmp_path, sensor_delay_s=0.01).sensors[:, 0]
    assert late[20:] == pytest.approx(plain[:-20])
    off = fallen(tmp_path, sensor_gain=np.array([1.2]), sensor_offset=np.array([3.0])).sensors[:, 0]
    assert off == pytest.approx(1.2 * plain + 3.0)
    slow = fallen(tmp_path, sensor_lag_s=0.01).sensors[:, 0]
    rate = np.gradient(slow, 5e-4)
    assert np.abs(0.01 * rate + slow - plain)[20:].mean() < 0.03 * plain.max()


def test_sensors_are_computed_only_where_they_are_read(tmp_path):
    plant = make_plant(loaded(tmp_path, hopper.mjcf(hopper.Hopper())), 1e-3)
    assert not plant.reads_sensors
    motion = simulate_plant(
        plant,
        CommandTrace(np.array([-0.1, 0.4]), np.full((2, 1), 15.0)),
        np.array([0.29, 0.25]),
        np.zeros(2),
        T_S[:10],
    )
    assert motion.sensors.shape == (10, 0)


def test_hysteresis_returns_what_a_spring_of_the_same_slope_does_and_loses_its_loop(tmp_path):
    """Dahl's friction of a swinging rod against the same law in a solver of its own."""
    torque_Nm = 0.2
    bend_rad = 0.05
    one = Arm(
        length_m=(0.35,),
        mass_kg=(2.0,),
        friction=Friction((0.0,)),
        rotor_kg_m2=(0.0,),
        zero_rad=(0.0,),
    )
    plant = make_plant(loaded(tmp_path, mjcf(one)), 1e-3)
    plant.hysteresis[:] = [[torque_Nm], [bend_rad]]
    trace = CommandTrace(np.array([-0.1, 2.1]), np.zeros((2, 1)))
    t_s = np.linspace(0.01, 2.0, 100)
    motion = simulate_plant(plant, trace, np.array([0.5]), np.zeros(1), t_s)
    inertia = 2.0 * 0.35**2 / 3.0

    def rate(_, x):
        return [
            x[1],
            (-9.81 * 2.0 * 0.175 * np.sin(x[0]) - torque_Nm * x[2]) / inertia,
            x[1] / bend_rad * (1.0 - x[2] * np.sign(x[1])),
        ]

    expected = solve_ivp(
        rate, (0.0, 2.0), [0.5, 0.0, 0.0], t_eval=t_s, rtol=1e-9, atol=1e-11, max_step=1e-3
    ).y[0]
    assert np.abs(motion.position[:, 0] - expected).max() < 2e-3
    assert np.abs(motion.position[-30:]).max() < 0.35


def test_clock_and_drift_count_from_the_beginning_of_the_recording(tmp_path):
    plant = make_plant(loaded(tmp_path, hopper.mjcf(hopper.Hopper())), 1e-3, reads_sensors=True)
    wave = np.arange(-0.2, 0.5, 1e-3)
    trace = CommandTrace(wave, 15.0 + 5.0 * np.sin(30.0 * wave)[:, None])
    start = np.array([0.275, 0.25])
    t_s = np.arange(1, 251) * 1e-3

    def read(since_s, **changes):
        for name, value in {
            "command_clock_rate": 0.0,
            "command_delay_s": 0.0,
            "sensor_drift_per_s": np.zeros(1),
            **changes,
        }.items():
            setattr(plant, name, value)
        return simulate_plant(plant, trace, start, np.zeros(2), t_s, since_s)

    late = read(10.0, command_clock_rate=0.002).position
    assert late == pytest.approx(read(0.0, command_delay_s=0.02).position, abs=1e-4)
    assert np.abs(late - read(0.0).position).max() > 1e-3
    drifted = read(10.0, sensor_drift_per_s=np.array([0.5])).sensors - read(10.0).sensors
    assert drifted[:, 0] == pytest.approx(0.5 * (10.0 + t_s))


def test_small_commands_have_no_effect(tmp_path):
    plant = make_plant(loaded(tmp_path, mjcf(ARM)), 1e-3)
    plant.command_dead_band[:] = (0.5, 0.5, 0.5)
    dead = simulate_plant(plant, told([2.0, -1.0, 0.3]), START_RAD, START_RAD_S, T_S).position
    plant.command_dead_band[:] = 0.0
    assert dead == pytest.approx(
        simulate_plant(plant, told([1.5, -0.5, 0.0]), START_RAD, START_RAD_S, T_S).position
    )


def test_a_step_reads_no_clock(tmp_path):
    """MuJoCo's timers would take half the time of a step of a pendulum."""
    mujoco = pytest.importorskip("mujoco")
    model = loaded(tmp_path, mjcf(ARM)).model
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 100)
    timer = data.timer[mujoco.mjtTimer.mjTIMER_STEP]
    assert timer.number == 100
    assert timer.duration == 0.0


def test_a_motion_does_not_depend_on_the_one_before_it(tmp_path):
    """The lag of the readings makes the start depend on the acceleration, and so on friction."""
    plant = make_plant(loaded(tmp_path, mjcf(ARM)), 4e-3)
    plant.friction[:] = 0.3
    plant.load_loss[:] = 0.1
    plant.reading_lag_s = 0.01
    first, second = (
        simulate_plant(plant, told([2.0, -1.0, 0.3]), START_RAD, START_RAD_S, T_S) for _ in range(2)
    )
    assert np.array_equal(first.position, second.position)
    assert np.array_equal(first.speed, second.speed)


def test_the_mean_of_commands_continues_their_end_values():
    t_s = np.array([0.0, 1.0, 3.0])
    command = np.array([[1.0], [3.0], [3.0]])
    trace = CommandTrace(t_s, command)
    edges = np.array([-2.0, -0.5, 0.5, 1.0, 2.5, 3.5, 7.0])
    mean = np.empty((6, 1))
    average_commands(t_s, command, trace.total, edges, mean)
    # Within a span of the trace its mean acts.
    assert mean[:, 0] == pytest.approx([1.0, 1.5, 2.0, 3.0, 3.0, 3.0])


def test_the_centre_of_mass_moves_off_the_axis(tmp_path):
    """MuJoCo refuses that of a body that it compiled with a shortcut."""
    text = """<mujoco><worldbody><body name="disc"><joint name="axis" axis="0 1 0"/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/></body></worldbody></mujoco>"""
    plant = make_plant(loaded(tmp_path, text), 4e-3)
    add_point_mass(plant, 1, np.array([0.1, 0.0, 0.0]), 0.5)
    update_constants(plant)
    # Gravity turns the disc towards its mass: torque over inertia about the axis.
    motion = simulate_plant(plant, NO_COMMAND, np.zeros(1), np.zeros(1), np.array([0.01]))
    rate_rad_s2 = 0.5 * 9.81 * 0.1 / (0.1 + 0.5 * 0.1**2)
    assert motion.speed[0, 0] == pytest.approx(rate_rad_s2 * 0.01, rel=1e-3)
