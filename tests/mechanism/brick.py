"""A brick that is thrown, simulated from Euler's equations: MuJoCo has no part in it."""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

SAMPLE_S = 0.004
SIZE_M = (0.10, 0.16, 0.24)
MASS_KG = 1.2
POSITION_STD_M = 2e-4
ANGLE_STD_RAD = 1e-3
MOST_BOUNCES = 3


@dataclass(frozen=True)
class Throw:
    """What acts: gravity, in flight a force against the velocity and its square, and the same of a
    torque against the rate. A corner that hits the floor jumps back, without friction.
    """

    gravity_m_s2: tuple[float, float, float] = (0.0, 0.0, -9.81)
    drag_N_s2_per_m2: float = 0.0
    turning_drag_Nm_s2_per_rad2: float = 0.0
    restitution: float = 0.5


def inertia_kg_m2():
    x, y, z = SIZE_M
    return MASS_KG / 12.0 * np.array([y**2 + z**2, x**2 + z**2, x**2 + y**2])


def mjcf():
    half = " ".join(f"{0.5 * size:g}" for size in SIZE_M)
    inertia = " ".join(f"{value:.9g}" for value in inertia_kg_m2())
    return (
        '<mujoco model="brick"><option gravity="0 0 -9.81" timestep="0.001"/><worldbody>'
        '<geom name="floor" type="plane" size="5 5 0.1"/>'
        '<body name="brick" pos="0 0 1"><freejoint name="flight"/>'
        f'<inertial pos="0 0 0" mass="{MASS_KG}" diaginertia="{inertia}"/>'
        f'<geom name="hull" type="box" size="{half}"/></body></worldbody></mujoco>'
    )


def record(throw, seconds, seed, height_m=1.0):
    """Times (m,), positions (m, 3) and quaternions (m, 4), w first, as recorded from a throw."""
    random = np.random.default_rng(seed)
    velocity = np.array([*random.uniform(-1.5, 1.5, 2), random.uniform(3.0, 4.0)])
    rate = random.uniform(2.0, 5.0) * random.choice([-1.0, 1.0], 3) * (0.3, 1.0, 0.5)
    start = Rotation.random(random_state=int(random.integers(2**31))).as_quat()
    t_s = np.arange(0.0, seconds, SAMPLE_S)
    inertia = inertia_kg_m2()
    gravity = np.array(throw.gravity_m_s2)

    def rates(_, state):
        velocity = state[3:6]
        rotation = Rotation.from_quat(state[6:10])
        rate = state[10:13]
        speed = np.linalg.norm(velocity)
        pushed = gravity - throw.drag_N_s2_per_m2 / MASS_KG * speed * velocity
        braked = -throw.turning_drag_Nm_s2_per_rad2 * np.linalg.norm(rate) * rate
        turned = (braked - np.cross(rate, inertia * rate)) / inertia
        x, y, z, w = rotation.as_quat()
        p, q, r = rate
        quaternion = 0.5 * np.array(
            [
                w * p + y * r - z * q,
                w * q + z * p - x * r,
                w * r + x * q - y * p,
                -x * p - y * q - z * r,
            ]
        )
        return np.concatenate([velocity, pushed, quaternion, turned])

    def lowest(_, state):
        return _corners(state)[:, 2].min()

    lowest.terminal = True
    lowest.direction = -1.0
    state = np.concatenate([[0.0, 0.0, height_m], velocity, start, rate])
    begin_s = 0.0
    path = [state[None]]
    # Between ever smaller bounces the brick comes to rest; the recording ends before.
    for _ in range(MOST_BOUNCES):
        later = t_s[t_s > begin_s]
        if not later.size:
            break
        flight = solve_ivp(
            rates, (begin_s, t_s[-1]), state, "DOP853", later, events=lowest, rtol=1e-10, atol=1e-12
        )
        if len(flight.t):
            path.append(flight.y.T)
        if not flight.t_events[0].size:
            break
        begin_s = float(flight.t_events[0][0])
        state = _bounce(flight.y_events[0][0], throw.restitution, inertia)
    path = np.concatenate(path)
    t_s = t_s[: len(path)]
    noise = Rotation.from_rotvec(ANGLE_STD_RAD * random.standard_normal((t_s.size, 3)))
    read = (Rotation.from_quat(path[:, 6:10]) * noise).as_quat()
    position = path[:, :3] + POSITION_STD_M * random.standard_normal((t_s.size, 3))
    return t_s, position, read[:, [3, 0, 1, 2]]


def _corners(state):
    """Places (8, 3) of the corners."""
    signs = np.array([(a, b, c) for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)])
    return state[:3] + Rotation.from_quat(state[6:10]).apply(0.5 * signs * np.array(SIZE_M))


def _bounce(state, restitution, inertia):
    """The state after an impulse along the vertical at the lowest corner."""
    corners = _corners(state)
    rotation = Rotation.from_quat(state[6:10])
    arm = corners[np.argmin(corners[:, 2])] - state[:3]
    up = np.array([0.0, 0.0, 1.0])
    turned = rotation.apply(rotation.inv().apply(np.cross(arm, up)) / inertia)
    approach = state[5] + np.cross(rotation.apply(state[10:13]), arm)[2]
    impulse = -(1.0 + restitution) * approach / (1.0 / MASS_KG + np.cross(turned, arm)[2])
    after = state.copy()
    after[2] += 1e-9
    after[5] += impulse / MASS_KG
    after[10:13] += rotation.inv().apply(impulse * turned)
    return after


def write_campaign(folder, recordings, more=""):
    """A folder with experiment.toml, the model and a CSV file of each recording."""
    folder.mkdir(parents=True)
    (folder / "model.xml").write_text(mjcf(), encoding="utf-8")
    runs = []
    for number, (t_s, position, quaternion) in enumerate(recordings, start=1):
        np.savetxt(
            folder / f"throw{number}.csv",
            np.column_stack([t_s, position, quaternion]),
            delimiter=",",
            header="t,x,y,z,qw,qx,qy,qz",
            comments="",
            fmt="%.9g",
        )
        runs.append(f'{{ file = "throw{number}.csv", condition = "throw {number}" }}')
    (folder / "experiment.toml").write_text(
        f"""format = "rfca-experiment/1"
title = "brick"
model = "model.xml"
time = {{ column = "t", unit = "s" }}
recordings = [{", ".join(runs)}]
{more}
[[free]]
joint = "flight"
position = ["x", "y", "z"]
unit = "m"
orientation = ["qw", "qx", "qy", "qz"]
""",
        encoding="utf-8",
    )
    return folder
