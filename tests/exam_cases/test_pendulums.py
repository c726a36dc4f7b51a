"""The exam's pendulums: an independent simulator, checked against the package's model; cases,
campaigns and truths.
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rfca_rig.campaign.pendulum import (
    LinkSection,
    read_pendulum,
    read_pendulum_file,
    write_pendulum_mjcf,
)
from rfca_rig.exam.cases import draw_cases
from rfca_rig.exam.pendulums.campaign import truth_of_pendulum, write_pendulum_campaign
from rfca_rig.exam.pendulums.cases import (
    PENDULUM_KINDS,
    PENDULUM_NOTHING,
    PENDULUM_PAIR,
    PENDULUM_SINGLE,
    SPANS,
    PendulumCase,
    SamplingErrors,
    _values,
    torque_scale_Nm,
)
from rfca_rig.exam.pendulums.world import Friction, PendulumWorld, Tones, swing
from rfca_rig.mechanism.effects import list_effects
from rfca_rig.mechanism.load import make_mechanism
from rfca_rig.mechanism.plant import make_plant, update_constants
from rfca_rig.mechanism.rollout import CommandTrace, simulate_plant
from rfca_rig.mechanism.usual_motion import UsualMotion

RIG = PendulumWorld((0.4, 0.3), (0.6, 0.4), (0.3, 0.2), (0.06, 0.018), (0.004, 0.003))
ONE = PendulumWorld((0.4,), (0.6,), (0.3,), (0.06,), (0.004,))
CASE = PendulumCase(
    "case",
    PENDULUM_SINGLE,
    1,
    RIG,
    RIG,
    SamplingErrors(),
    (True,),
    friction=Friction(sign_rad_s=5e-4),
)


def tones(world):
    random = np.random.default_rng(3)
    shape = (3, world.joints)
    return Tones(
        0.3 * torque_scale_Nm(world) * random.random(shape),
        random.uniform(3.0, 12.0, shape),
        random.uniform(0.0, 6.0, shape),
    )


def links_of(world):
    return [
        LinkSection(
            length_m=length_m,
            mass_kg=mass_kg,
            centre_of_mass_m=centre_m,
            inertia_kg_m2=inertia_kg_m2,
            joint_damping_Nm_s_per_rad=damping,
        )
        for length_m, mass_kg, centre_m, inertia_kg_m2, damping in zip(
            world.length_m,
            world.mass_kg,
            world.centre_m,
            world.inertia_kg_m2,
            world.damping_Nm_s_per_rad,
            strict=True,
        )
    ]


def values_of_mechanism(effect, values, joints):
    """The same values under the names of an effect of a mechanism, whose usual speed is 1 rad/s."""
    named = {
        "angle_rad": "about_y_rad",
        "speed_rad_s": "speed_relative",
    }
    by_parameter = {named.get(name, name): value for name, value in values.items()}
    if effect.id == "added_mass":
        # The tip is the site after the bodies.
        by_parameter["body"] = joints + 1.0
    result = {}
    for parameter in effect.parameters:
        endings = [name for name in by_parameter if parameter.name.endswith(name)]
        result[parameter.name] = by_parameter[max(endings, key=len)] if endings else 0.0
    return result


def by_model(world, start, command, t_s, effect_id, values):
    """The same motion by MuJoCo, from the readings `start`: angles and speeds (m, 2 n)."""
    n = world.joints
    mechanism = make_mechanism(Path("pendulum.toml"), write_pendulum_mjcf(links_of(world)))
    ones = np.ones(n)
    usual = UsualMotion(ones, ones, ones, ones, -ones, ones, ones, True, {})
    plant = make_plant(mechanism, 1e-4)
    if effect_id is not None:
        (effect,) = (one for one in list_effects(mechanism, usual) if one.id == effect_id)
        plant = effect.apply(plant, values_of_mechanism(effect, values, n))
        update_constants(plant)
    before_s = np.arange(-0.2, t_s[-1] + 0.01, 1e-3)
    trace = CommandTrace(before_s, np.array([command.at(t) for t in before_s]))
    motion = simulate_plant(plant, trace, start[:n], start[n:], t_s[1:])
    return np.column_stack([motion.position, motion.speed])


# MuJoCo takes the drag of a box, the exam that of a rod.
OTHER_FORM = ("fluid_drag",)


@pytest.mark.slow
@pytest.mark.parametrize("world", [ONE, RIG], ids=["one link", "two links"])
@pytest.mark.parametrize("effect", [None, *(name for name in SPANS if name not in OTHER_FORM)])
def test_both_simulators_agree_on_what_an_effect_does(world, effect):
    if effect == "joint_friction_of_one" and world is ONE:
        return
    start = np.array([0.5, -0.4, 2.0, 1.5]) if world is RIG else np.array([0.5, 2.0])
    values = {} if effect is None else _values(effect, 0.7, world, np.random.default_rng(1))
    case = replace(CASE, world=world, effects={} if effect is None else {effect: values})
    t_s = np.arange(0.0, 0.4, 1e-3)
    command = tones(world)
    ours, plain = (
        swing(each, start, command, t_s)
        for each in (case.concealed, replace(case, effects={}).concealed)
    )
    # the model begins from readings, but from the true speed where speeds alone are late
    if effect == "speed_lag":
        speed = ours.state[:, world.joints :]
    else:
        speed = ours.speed_rad_s
    began = np.concatenate([ours.angle_rad[0], speed[0]])
    model = by_model(world, began, command, t_s, effect, values)
    read = np.column_stack([ours.angle_rad, ours.speed_rad_s])
    off = np.abs(model - read[1:]).max()
    shift = np.abs(read - np.column_stack([plain.angle_rad, plain.speed_rad_s])).max()
    # laws differ a little on purpose: how a joint begins to slide, a power of the motor's torque
    assert off < (2e-3 if effect is None else 0.15 * shift + 2e-3)


def test_a_delay_and_a_lag_move_the_tones_as_they_move_a_signal():
    command = tones(ONE)
    late = command.later(0.01, 0.02)
    t_s = np.arange(0.0, 1.0, 1e-4)
    lagged = np.array([command.at(t) for t in t_s - 0.01])[:, 0]
    slow = np.array([late.at(t) for t in t_s])[:, 0]
    assert np.allclose(slow + 0.02 * np.gradient(slow, t_s), lagged, atol=2e-3)


def test_cases_of_every_kind_are_drawn_the_same_again():
    numbers = dict.fromkeys(PENDULUM_KINDS, 3)
    cases = draw_cases(7, numbers)
    assert cases == draw_cases(7, numbers)
    assert sorted(case.kind for case in cases) == sorted(3 * PENDULUM_KINDS)
    sizes = {case.kind: len(case.effects) + len(case.strangers) for case in cases}
    assert sizes == dict(zip(PENDULUM_KINDS, (0, 1, 2, 1), strict=True))


def test_a_campaign_is_read_as_believed_and_tells_nothing_of_what_is_concealed(tmp_path):
    case = draw_cases(7, {PENDULUM_PAIR: 1})[0]
    write_pendulum_campaign(case, tmp_path / "one")
    found = read_pendulum(tmp_path / "one")
    assert len(found.runs) == 3 and [run.driven for run in found.runs] == list(case.driven)
    assert (
        read_pendulum_file(tmp_path / "one").link1.mass_kg
        == pytest.approx(case.nominal.mass_kg[0], rel=1e-5)
        != case.world.mass_kg[0]
    )
    text = (tmp_path / "one" / "pendulum.toml").read_text(encoding="utf-8")
    assert not any(re.search(rf"\b{name}\b", text) for name in case.effects)


@pytest.mark.slow
def test_the_truth_says_how_much_shows():
    case = replace(draw_cases(7, {PENDULUM_NOTHING: 1})[0], kind=PENDULUM_SINGLE, driven=(True,))
    sizes = []
    for share in (0.01, 0.1):
        values = {"torque_Nm": share * torque_scale_Nm(case.world)}
        truth = truth_of_pendulum(replace(case, effects={"joint_friction": values}))
        sizes.append(truth["size"]["left_over_noise"])
        assert (
            truth["left_of_each"]["joint_friction"]
            == sizes[-1]
            <= truth["size"]["shift_over_noise"]
        )
    assert sizes[1] > 5.0 * sizes[0] > 0.0
