"""Effects of pendulums concealed in data that another integrator made, with friction laws
smoother than ours, and found again.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rfca_rig.campaign.pendulum import PendulumCampaign, PendulumRun
from rfca_rig.diagnosis.pendulums.diagnose import diagnose_pendulum
from rfca_rig.model.pendulum import Pendulum, PendulumLink

NOMINAL = Pendulum((PendulumLink(0.5, 0.6, 0.4, 0.11, 0.004),))
KNOWN_TO = {
    "mass_relative": 0.02,
    "joint_damping_Nm_s_per_rad": 0.005,
    "torque_offset_Nm": 0.02,
    "zero_offset_rad": 0.003,
}
NOISE = {"angle_rad": 5e-4, "speed_rad_s": 0.02}


def made(seed, friction, late_s, read_s, powered=True):
    """A run of 5 s; `late_s` is the drive's lag, `read_s` that of the speed's reading. 2 % more
    mass and 10 mN m of offset than nominal.
    """
    command = (
        (lambda t: 1.4 * np.sin((3.0 + seed) * t + seed) + 0.5 * np.sin(11.0 * t))
        if powered
        else (lambda t: 0.0 * t)
    )

    def rhs(t, x):
        a, w, tau, read = x
        drive = tau + (0.01 if powered else 0.0)
        acceleration = (drive - 0.004 * w - friction(w, drive) - 9.81 * 0.2448 * np.sin(a)) / 0.1122
        return [
            w,
            acceleration,
            (command(t) - tau) / max(late_s, 1e-4),
            (w - read) / max(read_s, 1e-4),
        ]

    t_s = np.arange(0.0, 5.0, 0.004)
    start = [2.0 if not powered else 0.8, 0.0, command(0.0), 0.0]
    x = solve_ivp(rhs, (0.0, 5.0), start, "LSODA", t_s, rtol=1e-7, atol=1e-8, max_step=2e-3).y
    random = np.random.default_rng(seed)
    angle = x[0] + random.normal(0, NOISE["angle_rad"], t_s.size)
    speed = x[3] + random.normal(0, NOISE["speed_rad_s"], t_s.size)
    label = f"{'driven' if powered else 'released'} {seed}"
    torque = np.asarray(command(t_s))
    return PendulumRun(
        f"{label}, repeat 1",
        label,
        1,
        t_s,
        angle[:, None],
        speed[:, None],
        torque[:, None],
        powered,
    )


def diagnosed(*runs):
    return diagnose_pendulum(
        PendulumCampaign("made by scipy", NOMINAL, KNOWN_TO, NOISE, runs), lambda *_: None
    )


def stribeck(w, tau):
    return 2.0 / np.pi * np.arctan(w / 5e-3) * (0.12 + 0.12 * np.exp(-((w / 0.8) ** 2)))


def loss(w, tau):
    return 0.25 * abs(tau) * np.tanh(w / 1e-2)


def none(w, tau):
    return 0.0


@pytest.mark.long
@pytest.mark.parametrize(
    ("id_", "parameter", "low", "high", "runs"),
    [
        (
            "joint_stribeck",
            "torque_Nm",
            0.09,
            0.16,
            [(1, stribeck, 0.0, 0.0), (2, stribeck, 0.0, 0.0)],
        ),
        (
            "joint_load_friction",
            "loss_relative",
            0.2,
            0.3,
            [(1, loss, 0.0, 0.0), (2, loss, 0.0, 0.0)],
        ),
        (
            "torque_lag",
            "time_constant_s",
            0.015,
            0.025,
            [(1, none, 0.02, 0.0), (2, none, 0.02, 0.0)],
        ),
        (
            "speed_lag",
            "time_constant_s",
            0.008,
            0.012,
            [(1, none, 0.0, 0.01), (2, none, 0.0, 0.01)],
        ),
    ],
)
def test_what_was_concealed_is_stated_or_one_that_cannot_be_told_from_it_or_its_family(
    id_, parameter, low, high, runs
):
    found = diagnosed(*(made(*run) for run in runs))
    if found.grade == "family":
        assert id_ in found.family.members
        return
    assert found.grade in ("identified", "mostly")
    (effect,) = found.effects
    assert id_ in (effect.id, *effect.cannot_tell_from)
    if effect.id == id_:
        assert low < effect.parameters[parameter].value < high


@pytest.mark.long
def test_runs_with_the_motors_off_and_on_are_one_campaign():
    found = diagnosed(made(1, stribeck, 0.0, 0.0), made(2, stribeck, 0.0, 0.0, powered=False))
    named = {name for effect in found.effects for name in (effect.id, *effect.cannot_tell_from)}
    assert "joint_stribeck" in (named or found.family.members)
    assert named <= {"joint_friction", "joint_stribeck"}


def test_without_a_driven_run_no_effect_of_the_torque_is_looked_for():
    found = diagnosed(
        made(1, none, 0.0, 0.0, powered=False), made(2, none, 0.0, 0.0, powered=False)
    )
    assert found.verdict == "nothing missing"
    tried = set(found.settings["effects_tried"])
    assert "joint_friction" in tried
    assert not tried & {
        "torque_scale",
        "torque_delay",
        "torque_lag",
        "joint_load_friction",
        "angle_lag",
        "joint_friction_of_one",
    }
