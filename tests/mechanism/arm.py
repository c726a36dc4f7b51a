"""A planar arm with geared joints, simulated from its own equations: MuJoCo and the package's laws
have no part in it.

The joints turn in a vertical plane, driven towards a reference by a controller whose torques are
recorded. Friction is LuGre's: a bristle with a Stribeck curve that falls as a Gaussian, and a share
of the load. With a `Gear` the rotors are bodies of their own, behind springs with a dead zone, and
the encoders sit on them.
"""

from dataclasses import dataclass, field

import numba
import numpy as np

GRAVITY_M_S2 = 9.81
SAMPLE_S = 0.002
BRISTLE_RAD = 0.002  # bend of a bristle at the friction torque
# Computed torque: every joint follows its reference as an oscillator of this stiffness per s2 and
# damping per s. With a delay of 16 ms the phase margin is 30 deg. Rotors behind gears that yield
# are ten to twenty times lighter than the links that the controller knows.
STIFF = 400.0
DAMPED = 40.0
GEARED_STIFF = 64.0
GEARED_DAMPED = 12.0


@dataclass(frozen=True)
class Friction:
    """Dry friction at high speed per joint, its rise at rest as a share, the speed it falls
    with, a viscous part, a share of the load.
    """

    coulomb_Nm: tuple[float, ...]
    rise: float = 0.0
    falls_rad_s: float = 0.3
    viscous_Nm_s_per_rad: tuple[float, ...] = (0.0, 0.0, 0.0)
    of_load: float = 0.0


@dataclass(frozen=True)
class Gear:
    """Stiffness of each gear, its play in all, and the torque per speed that it loses while its
    teeth touch.
    """

    stiffness_Nm_per_rad: tuple[float, ...]
    play_rad: tuple[float, ...] = (0.0, 0.0, 0.0)
    damping_Nm_s_per_rad: tuple[float, ...] = (0.5, 0.2, 0.05)


@dataclass(frozen=True)
class Arm:
    """Links are rods. `rotor_kg_m2` is added to a joint's own inertia, or moves behind the
    `gear`; an encoder reads `zero_rad` too much.
    """

    length_m: tuple[float, ...] = (0.35, 0.3, 0.2)
    mass_kg: tuple[float, ...] = (2.0, 1.4, 0.7)
    friction: Friction = field(default_factory=lambda: Friction((0.0, 0.0, 0.0)))
    rotor_kg_m2: tuple[float, ...] = (0.0, 0.0, 0.0)
    zero_rad: tuple[float, ...] = (0.0, 0.0, 0.0)
    torque_factor: float = 1.0
    torque_delay_s: float = 0.0
    gear: Gear | None = None
    angle_error_rad: float = 1e-4
    speed_error_rad_s: float = 5e-3

    @property
    def joints(self):
        return len(self.length_m)


def mjcf(arm):
    """The rigid part of the arm for MuJoCo, without anything that dissipates."""
    body = ""
    tail = ""
    for number, (length, mass, rotor) in enumerate(
        zip(arm.length_m, arm.mass_kg, arm.rotor_kg_m2, strict=False), start=1
    ):
        at = -arm.length_m[number - 2] if number > 1 else 0.0
        inertia = mass * length**2 / 12.0
        body += (
            f'<body name="link{number}" pos="0 0 {at}"><joint name="joint{number}" '
            f'type="hinge" axis="0 -1 0" armature="{rotor}"/>'
            f'<inertial pos="0 0 {-length / 2}" mass="{mass}" diaginertia="{inertia} '
            f'{inertia} 1e-4"/>'
        )
        tail += "</body>"
    motors = "".join(
        f'<motor name="motor{j + 1}" joint="joint{j + 1}" gear="1"/>' for j in range(arm.joints)
    )
    return (
        '<mujoco model="arm"><option gravity="0 0 -9.81" timestep="0.001"/>'
        f"<worldbody>{body}{tail}</worldbody><actuator>{motors}</actuator></mujoco>"
    )


def record(arm, seconds, seed, pose_rad=0.8, size_rad=0.5, noise_seed=None):
    """Times (m,), angles, speeds and torques (m, n) as recorded under a controller that follows
    sines in every joint; repeats of one motion have noise seeds of their own.
    """
    random = np.random.default_rng(seed)
    n = arm.joints
    rates = random.uniform(2.0, 7.0, (n, 3))
    phases = random.uniform(0.0, 2.0 * np.pi, (n, 3))
    middle = random.uniform(-pose_rad, pose_rad, n)
    t_s = np.arange(0.0, seconds, SAMPLE_S)
    length = np.array(arm.length_m)
    mass = np.array(arm.mass_kg)
    stiff, damped = (STIFF, DAMPED) if arm.gear is None else (GEARED_STIFF, GEARED_DAMPED)
    # the controller is sampled, and its torque is held: what is recorded is what was told
    state = np.concatenate([middle, np.zeros(n), np.zeros(n)])
    if arm.gear is not None:
        state = np.concatenate(
            [state, middle + _deflection(arm, _weight(arm, np.cumsum(middle))), np.zeros(n)]
        )
    read = slice(0, 2 * n) if arm.gear is None else slice(3 * n, 5 * n)
    angles = np.empty((t_s.size, n))
    speeds = np.empty((t_s.size, n))
    torques = np.empty((t_s.size, n))
    late = round(arm.torque_delay_s / SAMPLE_S)
    for k, t in enumerate(t_s):
        wave = (size_rad / 3.0) * np.sin(rates * t + phases)
        rate = (size_rad / 3.0) * rates * np.cos(rates * t + phases)
        angles[k], speeds[k] = state[read].reshape(2, n)
        wanted = stiff * (middle + wave.sum(axis=1) - angles[k]) + damped * (
            rate.sum(axis=1) - speeds[k]
        )
        torques[k] = _inertia(angles[k], length, mass)[0] @ wanted + _weight(
            arm, np.cumsum(angles[k])
        )
        told = torques[max(k - late, 0)] * arm.torque_factor
        state = _advance(arm, state, told)
    noise = np.random.default_rng([seed, 1] if noise_seed is None else noise_seed)
    return (
        t_s,
        angles + np.array(arm.zero_rad) + arm.angle_error_rad * noise.standard_normal(angles.shape),
        speeds + arm.speed_error_rad_s * noise.standard_normal(speeds.shape),
        torques,
    )


def _advance(arm, state, torque):
    """The state a sample later, by Runge-Kutta steps of 0.1 ms; bristles at 5 rad/s need less
    than 1 ms.
    """
    if arm.gear is not None:
        return _geared_runge_kutta(
            state, torque, *_numbers(arm), *_numbers_of_gear(arm), 5e-5, round(SAMPLE_S / 5e-5)
        )
    return _runge_kutta(state, torque, *_numbers(arm), 1e-4, round(SAMPLE_S / 1e-4))


def _numbers(arm):
    law = arm.friction
    n = arm.joints
    of_joints = (
        arm.length_m,
        arm.mass_kg,
        arm.rotor_kg_m2[:n],
        law.coulomb_Nm[:n],
        law.viscous_Nm_s_per_rad[:n],
    )
    return (
        *(np.array(values) for values in of_joints),
        np.array([law.rise, law.falls_rad_s, law.of_load]),
    )


# Reach of the four stages of a step as shares of it, and their weights.
STAGES = ((0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0))


# Loops over numbers: expressions of arrays, and BLAS, take four times as long to compile.
@numba.njit(cache=True)
def _runge_kutta(x, torque, length, mass, rotor, dry, viscous, shape, h, steps):
    x = x.copy()
    at = np.zeros(x.size)
    rate = np.zeros(x.size)
    total = np.zeros(x.size)
    for _ in range(steps):
        total[:] = 0.0
        for reach, weight in STAGES:
            for i in range(x.size):
                at[i] = x[i] + reach * h * rate[i]
            rate = _rates(at, torque, length, mass, rotor, dry, viscous, shape)
            for i in range(x.size):
                total[i] += weight * rate[i]
        for i in range(x.size):
            x[i] += h / 6.0 * total[i]
    return x


def _numbers_of_gear(arm):
    gear = arm.gear
    n = arm.joints
    return tuple(
        np.array(values[:n])
        for values in (gear.stiffness_Nm_per_rad, gear.play_rad, gear.damping_Nm_s_per_rad)
    )


def _deflection(arm, torque):
    """How far the rotors are ahead of the joints at rest under a torque."""
    stiffness, play, _ = _numbers_of_gear(arm)
    return torque / stiffness + 0.5 * play * np.sign(torque)


@numba.njit(cache=True)
def _geared_rates(x, torque, length, mass, rotor, dry, viscous, shape, stiffness, play, damping):
    """Links with their bristles, then angles and speeds of the rotors; a gear pushes, and never
    pulls its teeth together.
    """
    n = length.size
    passed = np.zeros(n)
    rates = np.zeros(5 * n)
    for i in range(n):
        lead = x[3 * n + i] - x[i]
        lead_rate = x[4 * n + i] - x[n + i]
        bend = max(abs(lead) - 0.5 * play[i], 0.0) * np.sign(lead)
        if bend != 0.0:
            passed[i] = stiffness[i] * bend + damping[i] * lead_rate
            if play[i] > 0.0 and passed[i] * bend < 0.0:
                passed[i] = 0.0
    links = _rates(x[: 3 * n], passed, length, mass, np.zeros(n), dry, viscous, shape)
    for i in range(n):
        for part in range(3):
            rates[part * n + i] = links[part * n + i]
        rates[3 * n + i] = x[4 * n + i]
        rates[4 * n + i] = (torque[i] - passed[i]) / rotor[i]
    return rates


@numba.njit(cache=True)
def _geared_runge_kutta(
    x, torque, length, mass, rotor, dry, viscous, shape, stiffness, play, damping, h, steps
):
    x = x.copy()
    at = np.zeros(x.size)
    rate = np.zeros(x.size)
    total = np.zeros(x.size)
    for _ in range(steps):
        total[:] = 0.0
        for reach, weight in STAGES:
            for i in range(x.size):
                at[i] = x[i] + reach * h * rate[i]
            rate = _geared_rates(
                at, torque, length, mass, rotor, dry, viscous, shape, stiffness, play, damping
            )
            for i in range(x.size):
                total[i] += weight * rate[i]
        for i in range(x.size):
            x[i] += h / 6.0 * total[i]
    return x


def _weight(arm, absolute):
    """The torque (n,) in each joint that holds the arm against its weight."""
    length = np.array(arm.length_m)
    mass = np.array(arm.mass_kg)
    beyond = np.append(np.cumsum(mass[::-1])[::-1][1:], 0.0)
    own = GRAVITY_M_S2 * (mass * length / 2.0 + beyond * length) * np.sin(absolute)
    return np.cumsum(own[::-1])[::-1]


def _rate(arm, state, torque):
    return _rates(state, torque, *_numbers(arm))


@numba.njit(cache=True)
def _rates(state, torque, length, mass, rotor, dry, viscous, shape):
    n = length.size
    q = state[:n]
    w = state[n : 2 * n]
    bristle = state[2 * n :]
    friction, bend = _friction(w, bristle, torque, dry, viscous, shape)
    in_joints, moment, heavy = _inertia(q, length, mass)
    right = np.zeros(n)
    rates = np.zeros(3 * n)
    angle_i = inner = 0.0
    for i in range(n):
        angle_i += q[i]
        angle_j = turning_j = 0.0
        whirl = GRAVITY_M_S2 * heavy[i] * np.sin(angle_i)
        for j in range(n):
            angle_j += q[j]
            turning_j += w[j]
            whirl += moment[i, j] * np.sin(angle_i - angle_j) * turning_j**2
        right[i] = whirl
    for i in range(n - 1, -1, -1):
        # a torque in absolute angles acts in all joints before it
        inner += right[i]
        right[i] = torque[i] - friction[i] - inner
        in_joints[i, i] += rotor[i]
    _solve(in_joints, right)
    for i in range(n):
        rates[i] = w[i]
        rates[n + i] = right[i]
        rates[2 * n + i] = bend[i]
    return rates


@numba.njit(cache=True)
def _solve(a, b):
    """Puts the solution of a x = b into b; `a` is positive definite, and needs no pivots."""
    for k in range(b.size):
        for i in range(k + 1, b.size):
            share = a[i, k] / a[k, k]
            b[i] -= share * b[k]
            for j in range(k, b.size):
                a[i, j] -= share * a[k, j]
    for i in range(b.size - 1, -1, -1):
        for j in range(i + 1, b.size):
            b[i] -= a[i, j] * b[j]
        b[i] /= a[i, i]


@numba.njit(cache=True)
def _inertia(q, length, mass):
    """The inertia (n, n) of the links in joint angles; c (n, n) of 1/2 sum c_ij cos(theta_i -
    theta_j) theta_i' theta_j'; moments of mass.

    The kinetic energy is that sum, in absolute angles theta.
    """
    n = length.size
    heavy = np.zeros(n)
    moment = np.zeros((n, n))
    inertia = np.zeros((n, n))
    beyond = 0.0
    for i in range(n - 1, -1, -1):
        heavy[i] = mass[i] * length[i] / 2.0 + beyond * length[i]
        moment[i, i] = mass[i] * length[i] ** 2 / 3.0 + beyond * length[i] ** 2
        beyond += mass[i]
    for i in range(n):
        between = 0.0
        for j in range(i, n):
            between += q[j] if j > i else 0.0
            if j > i:
                moment[i, j] = moment[j, i] = length[i] * heavy[j]
            inertia[i, j] = inertia[j, i] = moment[i, j] * np.cos(between)
    # Absolute angles are sums of joint angles: each element is summed with all behind it, in both
    # directions.
    for i in range(n - 1, -1, -1):
        for j in range(n - 1, -1, -1):
            if i + 1 < n:
                inertia[i, j] += inertia[i + 1, j]
    for i in range(n):
        for j in range(n - 2, -1, -1):
            inertia[i, j] += inertia[i, j + 1]
    return inertia, moment, heavy


@numba.njit(cache=True)
def _friction(w, bristle, torque, dry, viscous, shape):
    rise, falls, of_load = shape
    friction = np.zeros(w.size)
    bend = np.zeros(w.size)
    for i in range(w.size):
        friction[i] = viscous[i] * w[i]
        full = dry[i] * (1.0 + rise * np.exp(-((w[i] / falls) ** 2))) + of_load * abs(torque[i])
        if full > 0.0:
            stiffness = full / BRISTLE_RAD
            bend[i] = w[i] - abs(w[i]) * bristle[i] / BRISTLE_RAD
            friction[i] += stiffness * bristle[i] + 0.005 * np.sqrt(stiffness) * bend[i]
    return friction, bend


def write_campaign(folder, nominal, recordings, known_to):
    """A folder with experiment.toml, model.xml of the nominal arm, and a CSV file of each
    recording.
    """
    folder.mkdir(parents=True)
    (folder / "model.xml").write_text(mjcf(nominal), encoding="utf-8")
    joints = range(1, nominal.joints + 1)
    names = [
        "t",
        *(f"q{j}" for j in joints),
        *(f"w{j}" for j in joints),
        *(f"tau{j}" for j in joints),
    ]
    for number, (t_s, angle, speed, torque) in enumerate(recordings, start=1):
        rows = np.column_stack([t_s, np.degrees(angle), speed, torque])
        np.savetxt(
            folder / f"run{number}.csv",
            rows,
            delimiter=",",
            header=",".join(names),
            comments="",
            fmt="%.8g",
        )
    signals = [
        f'{{ joint = "joint{j}", quantity = "position", column = "q{j}", unit = "deg" }}'
        for j in joints
    ]
    signals += [
        f'{{ joint = "joint{j}", quantity = "speed", column = "w{j}", unit = "rad/s" }}'
        for j in joints
    ]
    commands = [
        f'{{ actuator = "motor{j}", column = "tau{j}", unit = "N m", held = true }}' for j in joints
    ]
    runs = [
        f'{{ file = "run{k}.csv", condition = "sines {k}" }}' for k in range(1, len(recordings) + 1)
    ]
    text = f"""format = "rfca-experiment/1"
title = "arm"
model = "model.xml"
time = {{ column = "t", unit = "s" }}
signals = [{", ".join(signals)}]
commands = [{", ".join(commands)}]
recordings = [{", ".join(runs)}]
[known_to]
"""
    (folder / "experiment.toml").write_text(
        text + "".join(f"{k} = {v}\n" for k, v in known_to.items()), encoding="utf-8"
    )
    return folder
