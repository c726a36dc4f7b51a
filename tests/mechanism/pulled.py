"""A double pendulum on a motor with torque, whose second joint has no encoder, simulated from
its own equations, from rest.
"""

import numpy as np

from tests.mechanism.arm import SAMPLE_S, _advance, mjcf

SECONDS = 1.5


def record(arm, seed):
    """Times (m,), angles and speeds of the first joint (m,), and the torque of its motor (m,),
    from rest under the weight.
    """
    random = np.random.default_rng(seed)
    rates = random.uniform(3.0, 9.0, 3)
    phases = random.uniform(0.0, 2.0 * np.pi, 3)
    sizes = random.uniform(2.0, 4.0, 3)
    t_s = np.arange(0.0, SECONDS, SAMPLE_S)
    torque = sizes @ (np.sin(rates[:, None] * t_s + phases[:, None]) - np.sin(phases)[:, None])
    state = np.zeros(6)
    angle = np.empty(t_s.size)
    speed = np.empty(t_s.size)
    for k in range(t_s.size):
        angle[k] = state[0]
        speed[k] = state[2]
        state = _advance(arm, state, np.array([torque[k], 0.0]))
    noise = np.random.default_rng([seed, 1])
    angle = angle + arm.angle_error_rad * noise.standard_normal(angle.shape)
    return t_s, angle, speed + arm.speed_error_rad_s * noise.standard_normal(speed.shape), torque


def write_campaign(folder, nominal, recordings, known_to, start='state = "at rest"'):
    """A folder with experiment.toml, model.xml of the nominal arm with one motor, and a CSV file
    of each recording.
    """
    folder.mkdir(parents=True)
    text = mjcf(nominal).replace('<motor name="motor2" joint="joint2" gear="1"/>', "")
    (folder / "model.xml").write_text(text, encoding="utf-8")
    for number, rows in enumerate(recordings, start=1):
        np.savetxt(
            folder / f"run{number}.csv",
            np.column_stack(rows),
            delimiter=",",
            header="t,q1,w1,tau1",
            comments="",
            fmt="%.8g",
        )
    runs = [
        f'{{ file = "run{k}.csv", condition = "pulls {k}" }}' for k in range(1, len(recordings) + 1)
    ]
    text = f"""format = "rfca-experiment/1"
title = "pulled double pendulum"
model = "model.xml"
time = {{ column = "t", unit = "s" }}
signals = [
  {{ joint = "joint1", quantity = "position", column = "q1", unit = "rad", noise_std = {nominal.angle_error_rad} }},
  {{ joint = "joint1", quantity = "speed", column = "w1", unit = "rad/s", noise_std = {nominal.speed_error_rad_s} }},
]
commands = [{{ actuator = "motor1", column = "tau1", unit = "N m" }}]
recordings = [{", ".join(runs)}]
[start]
{start}
[known_to]
"""
    (folder / "experiment.toml").write_text(
        text + "".join(f"{k} = {v}\n" for k, v in known_to.items()), encoding="utf-8"
    )
    return folder
