"""Gears that yield, against arms whose rotors are bodies of their own, and other effects against
equations of their own.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.diagnosis.mechanisms.nuisances import MechanismInput
from rfca_rig.diagnosis.mechanisms.prepared import prepare_mechanism
from rfca_rig.mechanism.effects import list_effects
from rfca_rig.mechanism.load import load_mechanism
from rfca_rig.mechanism.model_files import write_amended_model
from rfca_rig.mechanism.nuisances import NUISANCES
from rfca_rig.mechanism.plant import make_plant, update_constants
from rfca_rig.mechanism.rollout import CommandTrace, simulate_plant
from rfca_rig.mechanism.usual_motion import UsualMotion
from rfca_rig.model.catalogue import families_of
from rfca_rig.model.parameters import PresentEffect
from tests.mechanism.arm import Arm, Gear, _rate, mjcf, record, write_campaign

GEARED = Arm(rotor_kg_m2=(0.06, 0.02, 0.004))
START_RAD = np.array([0.9, -0.4, 0.7])
START_RAD_S = np.array([0.5, -1.0, 2.0])
T_S = np.linspace(0.005, 0.5, 100)
WAVE_S = np.arange(-0.2, 0.8, 0.002)
LARGEST_NM = np.array([4.0, 2.0, 1.0])
BALANCE = """<mujoco><worldbody><body name="post"><site name="base"/>
<body name="rod"><joint name="pivot" axis="0 -1 0"/><inertial pos="0 0 -0.15" mass="2" diaginertia="0.02 0.02 0.001"/></body></body>
</worldbody><actuator><motor name="push" joint="pivot"/></actuator>
<sensor><force name="post" site="base"/></sensor></mujoco>"""


def waves(t):
    """Torques (k, 3) at these times."""
    return np.sin(np.multiply.outer(t, [12.0, 15.0, 9.0])) * LARGEST_NM


TRACE = CommandTrace(WAVE_S, waves(WAVE_S))
USUAL = UsualMotion(
    torque=np.array([5.0, 2.0, 0.7]),
    speed=np.array([1.0, 1.0, 1.0]),
    travel=np.array([0.3, 0.3, 0.3]),
    inertia=np.array([0.6, 0.1, 0.01]),
    lowest=np.array([0.0, -1.0, 0.0]),
    highest=np.array([1.2, 0.5, 1.0]),
    command=LARGEST_NM,
    has_speeds=True,
    sensors={},
)


def loaded(folder, text):
    (folder / "model.xml").write_text(text, encoding="utf-8")
    return load_mechanism(folder / "model.xml")


@pytest.fixture(scope="module")
def geared(tmp_path_factory):
    return loaded(tmp_path_factory.mktemp("geared"), mjcf(GEARED))


@pytest.fixture(scope="module")
def balance(tmp_path_factory):
    return loaded(tmp_path_factory.mktemp("balance"), BALANCE)


def with_effect(mechanism, usual, effect_id, values, reads_sensors=False):
    """A plant with an effect, whose sizes that are not in `values` are 0."""
    effect = {one.id: one for one in list_effects(mechanism, usual)}[effect_id]
    plant = effect.apply(
        make_plant(mechanism, 1e-3, reads_sensors),
        dict.fromkeys((p.name for p in effect.parameters), 0.0) | values,
    )
    update_constants(plant)
    return plant


def moved(plant, position=START_RAD, speed=START_RAD_S):
    motion = simulate_plant(plant, TRACE, position, speed, T_S)
    return np.stack([motion.position, motion.speed])


@pytest.mark.parametrize(
    ("effect_id", "whole", "size"),
    [
        ("gear_compliance", {}, {"joint2_compliance_rad_per_Nm": 0.01}),
        ("gear_compliance_of_one", {"joint": 2.0}, {"compliance_rad_per_Nm": 0.01}),
        ("gear_backlash", {}, {"joint2_play_rad": 0.03}),
        ("gear_backlash_of_one", {"joint": 2.0}, {"play_rad": 0.03}),
        ("centre_of_mass", {"body": 2.0}, {"shift_m": 0.02}),
        ("torque_falls_with_speed", {}, {"fall_relative": 0.3}),
    ],
)
def test_an_effect_without_size_is_the_plain_model_and_with_it_another(
    geared, effect_id, whole, size
):
    plain = moved(make_plant(geared, 1e-3))
    assert np.abs(moved(with_effect(geared, USUAL, effect_id, whole)) - plain).max() < 1e-12
    assert np.abs(moved(with_effect(geared, USUAL, effect_id, whole | size)) - plain).max() > 3e-3
    assert np.array_equal(moved(make_plant(geared, 1e-3)), plain)


def test_an_elastic_gear_is_read_by_what_it_transmits_at_the_start_too(geared):
    """The arm's own equations, with the deflection of a spring that carries the torque less what
    accelerates the rotor.
    """
    compliance = np.array([0.004, 0.008, 0.02])
    rotor = np.array(GEARED.rotor_kg_m2)
    state = np.concatenate([START_RAD, START_RAD_S, np.zeros(3)])
    found = solve_ivp(
        lambda t, x: _rate(GEARED, x, waves(t)),
        (0.0, 0.6),
        state,
        t_eval=np.append(0.0, T_S),
        rtol=1e-9,
        atol=1e-11,
        dense_output=True,
    )

    def transmitted(t):
        return waves(t) - rotor * _rate(GEARED, found.sol(t), waves(t))[3:6]

    ahead = compliance * np.array([transmitted(t) for t in found.t])
    grows = compliance * np.array(
        [(transmitted(t + 1e-4) - transmitted(t - 1e-4)) / 2e-4 for t in found.t]
    )
    position = found.y[:3].T + ahead
    speed = found.y[3:6].T + grows
    values = {f"joint{j + 1}_compliance_rad_per_Nm": size for j, size in enumerate(compliance)}
    read = moved(with_effect(geared, USUAL, "gear_compliance", values), position[0], speed[0])
    rigid = moved(make_plant(geared, 1e-3), position[0], speed[0])
    assert np.abs(rigid[0] - position[1:]).max() > 0.03
    assert np.abs(read[0] - position[1:]).max() < 1e-3
    assert np.abs(read[1] - speed[1:]).max() < 0.01


def misses(problem, effects=()):
    """Of all windows by the rig with these effects: rms of each signal in units of noise and
    usual model error.
    """
    plant = problem.simulator.plant(MechanismInput(effects=effects))
    windows = [each for condition in problem.conditions for each in condition.windows]
    off = [
        (each.window.measured - problem.simulator.predict(plant, each))
        / np.hypot(each.window.sensor_std, 0.01 * each.scale)
        for each in windows
    ]
    return np.sqrt(np.mean(np.square(off), axis=(0, 2)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gear", "effect_id", "size", "sizes"),
    [
        (
            Gear((300.0, 120.0, 40.0), damping_Nm_s_per_rad=(2.0, 0.8, 0.2)),
            "gear_compliance",
            "compliance_rad_per_Nm",
            (1 / 300, 1 / 120, 1 / 40),
        ),
        (
            Gear((2e4, 8e3, 2e3), (0.03,) * 3, (5.0, 2.0, 0.5)),
            "gear_backlash",
            "play_rad",
            (0.03,) * 3,
        ),
    ],
)
def test_the_laws_of_gears_follow_rotors_behind_springs(tmp_path, gear, effect_id, size, sizes):
    """Of what separate rotors do to the readings the laws leave less than two fifths, and a
    quarter of joint 1.
    """
    recordings = [record(replace(GEARED, gear=gear), 3.0, seed) for seed in (0, 1)]
    experiment = read_experiment(
        write_campaign(tmp_path / "arm", GEARED, recordings, {"mass_relative": 0.02})
    )
    problem = prepare_mechanism(experiment, load_mechanism(experiment.model))
    values = tuple((f"joint{j + 1}_{size}", value) for j, value in enumerate(sizes))
    rigid = misses(problem)
    follows = misses(problem, (PresentEffect(effect_id, values),))
    assert rigid[0] > 0.7
    assert np.sqrt(np.mean(follows**2)) < 0.4 * np.sqrt(np.mean(rigid**2))
    assert follows[0] < 0.25 * rigid[0]


def test_a_rotor_crosses_its_play_as_fast_as_its_inertia_lets_it(geared):
    """The joint's equations, and a rotor that falls freely through the play under what the gear
    would transmit, solved with events.
    """
    play = 0.05
    inertia = GEARED.rotor_kg_m2[0]
    torque = CommandTrace(
        np.array([-0.2, 0.1, 0.1001, 0.9]), np.outer([4.0, 4.0, -8.0, -8.0], [1.0, 0.0, 0.0])
    )
    plant = with_effect(geared, USUAL, "gear_backlash_of_one", {"joint": 1.0, "play_rad": play})
    ahead = np.array([0.5 * play, 0.0, 0.0])
    read = simulate_plant(plant, torque, np.zeros(3) + ahead, np.zeros(3), T_S).position[:, 0]
    joint = simulate_plant(make_plant(geared, 1e-3), torque, np.zeros(3), np.zeros(3), T_S)
    state = np.concatenate([joint.position[20], joint.speed[20], np.zeros(3)])
    acceleration = _rate(GEARED, state, np.array([-8.0, 0.0, 0.0]))[3]
    crossing_s = np.sqrt(2.0 * play * inertia / (8.0 + inertia * acceleration))
    lead = read - joint.position[:, 0]
    assert np.abs(lead[T_S < 0.1] - 0.5 * play).max() < 1e-4
    within = T_S[np.abs(lead) < 0.49 * play]
    assert within.max() - within.min() == pytest.approx(crossing_s, abs=0.008)
    assert np.abs(lead[T_S > 0.15] + 0.5 * play).max() < 1e-4


def test_a_torque_that_falls_with_speed_is_the_line_of_the_motor(geared):
    """Pushed with the largest command, and braked against the motion, where the line does not
    limit.
    """
    fall = 0.25

    def limited(w, torque):
        return np.clip(
            torque,
            -LARGEST_NM * np.maximum(0.0, 1.0 + fall * w),
            LARGEST_NM * np.maximum(0.0, 1.0 - fall * w),
        )

    torque = np.array([4.0, -2.0, -1.0])
    state = np.concatenate([START_RAD, START_RAD_S, np.zeros(3)])
    expected, full = (
        solve_ivp(
            lambda _, x, by=by: _rate(GEARED, x, by(x[3:6], torque)),
            (0.0, 0.5),
            state,
            t_eval=T_S,
            rtol=1e-8,
            atol=1e-10,
        )
        .y[:3]
        .T
        for by in (limited, lambda _, told: told)
    )
    told = CommandTrace(np.array([-0.1, 0.7]), np.tile(torque, (2, 1)))
    plant = with_effect(geared, USUAL, "torque_falls_with_speed", {"fall_relative": fall})
    read = simulate_plant(plant, told, START_RAD, START_RAD_S, T_S).position
    assert np.abs(full - expected).max() > 0.1
    assert np.abs(read - expected).max() < 3e-3
    plant.command_gain[:] = 1.3  # the line scales with it: a gear, or a torque constant
    scaled = simulate_plant(
        plant, CommandTrace(told.t_s, told.command), START_RAD, START_RAD_S, T_S
    ).position
    plant.command_gain[:] = 1.0
    plant.torque_speed[0] *= 1.3
    assert scaled == pytest.approx(
        simulate_plant(
            plant, CommandTrace(told.t_s, 1.3 * told.command), START_RAD, START_RAD_S, T_S
        ).position
    )


def swung(mechanism, plant):
    """A rod that falls from 0.5 rad."""
    still = CommandTrace(np.array([-0.1, 0.7]), np.zeros((2, 1)))
    return simulate_plant(plant, still, np.array([0.5]), np.zeros(1), T_S)


def test_a_centre_of_mass_elsewhere_swings_as_a_pendulum_of_that_length(balance):
    usual = UsualMotion(*(np.ones(1) for _ in range(6)), np.ones(1), True, {})
    read = swung(
        balance, with_effect(balance, usual, "centre_of_mass", {"body": 1.0, "shift_m": 0.05})
    ).position[:, 0]

    def expected(distance):
        inertia = 0.02 + 2.0 * distance**2
        rate = lambda _, x: [x[1], -2.0 * 9.81 * distance * np.sin(x[0]) / inertia]  # noqa: E731
        return solve_ivp(rate, (0.0, 0.5), [0.5, 0.0], t_eval=T_S, rtol=1e-9, atol=1e-11).y[0]

    assert np.abs(read - expected(0.2)).max() < 1e-4
    assert np.abs(expected(0.15) - expected(0.2)).max() > 0.01


def test_the_effect_of_a_centre_of_mass_is_the_nuisance_parameter_of_any_size(geared):
    plant = make_plant(geared, 1e-3)
    NUISANCES["centre_of_mass_m"].shift(plant, 1, 0.02)
    update_constants(plant)
    effect = {one.id: one for one in list_effects(geared, USUAL)}["centre_of_mass"]
    assert np.array_equal(
        moved(plant),
        moved(with_effect(geared, USUAL, "centre_of_mass", {"body": 2.0, "shift_m": 0.02})),
    )
    assert effect.parameters[1].low == pytest.approx(-0.5 * GEARED.length_m[0] / 2.0)
    assert effect.same_as == ""  # as of added_mass beside mass_relative


def test_crosstalk_adds_a_share_of_another_value_of_the_sensors(balance):
    """Axial and lateral force on a post that carries a swinging rod."""
    rms = {"post_x": 3.0, "post_z": 20.0}
    usual = UsualMotion(*(np.ones(1) for _ in range(6)), np.ones(1), True, rms)
    plain = swung(balance, make_plant(balance, 1e-3, reads_sensors=True)).sensors
    none = swung(
        balance, with_effect(balance, usual, "sensor_crosstalk", {"pair": 1.0}, True)
    ).sensors
    assert np.array_equal(none, plain)
    leaks = swung(
        balance,
        with_effect(balance, usual, "sensor_crosstalk", {"pair": 1.0, "share_relative": 0.2}, True),
    ).sensors
    assert np.abs(plain[:, 2]).min() > 10.0
    assert leaks[:, 0] == pytest.approx(plain[:, 0] + 0.2 * 3.0 / 20.0 * plain[:, 2])
    assert np.array_equal(leaks[:, 1:], plain[:, 1:])
    other = swung(
        balance,
        with_effect(balance, usual, "sensor_crosstalk", {"pair": 2.0, "share_relative": 0.2}, True),
    ).sensors
    assert other[:, 2] == pytest.approx(plain[:, 2] + 0.2 * 20.0 / 3.0 * plain[:, 0])
    alone = {one.id for one in list_effects(balance, replace(usual, sensors={"post_x": 3.0}))}
    assert "sensor_gain" in alone
    assert "sensor_crosstalk" not in alone


def test_gears_and_motors_are_looked_into_only_where_a_recording_is_driven(geared):
    of_motors = {
        "gear_compliance",
        "gear_compliance_of_one",
        "gear_backlash",
        "gear_backlash_of_one",
        "torque_falls_with_speed",
    }
    assert of_motors <= {one.id for one in list_effects(geared, USUAL)}
    assert not of_motors & {
        one.id for one in list_effects(geared, replace(USUAL, command=np.zeros(3)))
    }


def test_elasticity_and_play_are_one_family_and_the_places_of_mass_another():
    assert families_of("gear_backlash") == families_of("gear_compliance_of_one")
    assert {family.id for family in families_of("centre_of_mass")} < {
        family.id for family in families_of("added_mass")
    }


def test_an_amended_model_says_that_it_lacks_gears_and_has_the_centre_of_mass(geared, tmp_path):
    plant = with_effect(geared, USUAL, "centre_of_mass", {"body": 1.0, "shift_m": 0.03})
    expected = moved(plant)
    plant.gear_play[0, 0] = 0.01
    plant.torque_speed[1, 0] = 0.1
    beyond = write_amended_model(plant, tmp_path / "model.xml")
    assert beyond == ("elasticity or play of the gears", "largest commands that fall with speed")
    assert (
        np.abs(moved(make_plant(load_mechanism(tmp_path / "model.xml"), 1e-3)) - expected).max()
        < 1e-3
    )
