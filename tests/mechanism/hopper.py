"""A hopper on a vertical rail, simulated from its own equations: MuJoCo and the package's laws have
no part in it.

A trunk slides on the rail, and a foot slides below it, driven by a controller whose force is
recorded. The sole is Hunt and Crossley's, N = k d^1.5 (1 + c d'), or has other exponents. Dry
friction rises at low speed as a Gaussian. A force plate is under the floor.
"""

from dataclasses import dataclass

import numba
import numpy as np

GRAVITY_M_S2 = 9.81
SAMPLE_S = 0.002
STEP_S = 1e-5
SOLE_M = 0.02
STIFFNESS_N_PER_M1P5 = 2e5
DAMPING_S_PER_M = 0.4
# MuJoCo's contact that follows such a sole under a foot of 0.3 kg to 0.1 mm rms of the leg's
# length: solref, solimp
CONTACT = ("-134900 -54", "0.02 0.1 0.0245 0.5 1")
REST_M = 0.25
USUAL_N = 50.0


@dataclass(frozen=True)
class Hopper:
    """Dry and viscous friction of the rail and of the leg; `rise` is what dry friction gains at
    rest, as a share.

    The sole is N = k d^1.5 ((d / d0)^p + c d' (d / d0)^r) with `other_powers` p and r, 0 for Hunt
    and Crossley's, and the depth d0 at 50 N.
    """

    trunk_kg: float = 1.5
    foot_kg: float = 0.3
    stiffness_N_per_m1p5: float = STIFFNESS_N_PER_M1P5
    damping_s_per_m: float = DAMPING_S_PER_M
    other_powers: tuple[float, float] = (0.0, 0.0)
    dry_N: tuple[float, float] = (0.0, 0.0)
    rise: float = 0.3
    viscous_N_s_per_m: tuple[float, float] = (0.0, 0.0)
    force_factor: float = 1.0
    force_delay_s: float = 0.0
    plate_factor: float = 1.0
    plate_lag_s: float = 0.0
    zero_m: tuple[float, float] = (0.0, 0.0)
    position_error_m: float = 5e-5
    plate_error_N: float = 0.3


def mjcf(hopper, own_contact=False):
    """The hopper for MuJoCo, without friction; the plate's force is a sensor. With `own_contact`
    no contact is MuJoCo's.
    """
    solref, solimp = CONTACT
    floor = f'''type="box" size="0.2 0.2 0.01" pos="0 0 -0.01" mass="1" solref="{solref}" solimp="{solimp}" priority="1" condim="1"'''
    sensor = '<touch name="plate_force" site="sole_site"/>'
    if own_contact:
        floor = 'type="plane" size="0.2 0.2 0.01" contype="0" conaffinity="0"'
        sensor = '<force name="plate_force" site="plate"/>'
    return f"""<mujoco model="hopper"><option gravity="0 0 -9.81"/><worldbody>
<body name="plate"><site name="plate"/><geom name="floor" {floor}/></body>
<body name="trunk"><joint name="rail" type="slide" axis="0 0 1"/>
<inertial pos="0 0 0" mass="{hopper.trunk_kg}" diaginertia="0.01 0.01 0.01"/>
<body name="foot"><joint name="leg" type="slide" axis="0 0 -1"/>
<inertial pos="0 0 0" mass="{hopper.foot_kg}" diaginertia="0.001 0.001 0.001"/><geom name="sole" type="sphere" size="{SOLE_M}" mass="0"/>
</body></body></worldbody><actuator><motor name="leg_motor" joint="leg"/></actuator>
<sensor>{sensor}</sensor></mujoco>""".replace(
        '<geom name="sole"', f'<site name="sole_site" size="{1.5 * SOLE_M}"/><geom name="sole"'
    )


@numba.njit(cache=True)
def _advance(x, force, values, steps):
    """The state (height, leg, their speeds) after so many steps, and the force on the floor
    before them.
    """
    trunk, foot, k, c, power, damping_power, dry_rail, dry_leg, rise, viscous_rail, viscous_leg = (
        values
    )
    usual_depth = (USUAL_N / k) ** (2.0 / 3.0)
    pressed = 0.0
    for step in range(steps):
        height, leg, climb, extend = x
        depth = SOLE_M - (height - leg)
        rate = extend - climb
        deep = max(depth, 0.0) / usual_depth
        if depth > 0.0:
            N = max(
                0.0,
                k * (usual_depth * deep) ** 1.5 * (deep**power + c * rate * deep**damping_power),
            )
        else:
            N = 0.0
        pressed = N if step == 0 else pressed
        on_rail = (
            dry_rail * (1.0 + rise * np.exp(-((climb / 0.05) ** 2))) * np.tanh(climb / 0.002)
            + viscous_rail * climb
        )
        in_leg = (
            dry_leg * (1.0 + rise * np.exp(-((extend / 0.05) ** 2))) * np.tanh(extend / 0.002)
            + viscous_leg * extend
        )
        of_trunk = (force - in_leg - on_rail) / trunk - GRAVITY_M_S2
        of_foot = (N - force + in_leg) / foot - GRAVITY_M_S2
        rates = np.array([of_trunk, of_trunk - of_foot])
        x = np.concatenate(
            (x[:2] + STEP_S * x[2:] + 0.5 * STEP_S**2 * rates, x[2:] + STEP_S * rates)
        )
    return x, pressed


def record(hopper, seconds, seed, noise_seed=None):
    """Times (m,), height and leg's length (m, 2), the plate's force (m,) and the commanded force
    (m,); repeats of one motion have noise seeds of their own.
    """
    random = np.random.default_rng(seed)
    rates = random.uniform((1.6, 2.6), (2.2, 3.4)) * 2.0 * np.pi
    phases = random.uniform(0.0, 2.0 * np.pi, 2)
    swing_m = np.array([0.03, 0.015]) * random.uniform(0.8, 1.2)
    values = np.array(
        [
            hopper.trunk_kg,
            hopper.foot_kg,
            hopper.stiffness_N_per_m1p5,
            hopper.damping_s_per_m,
            *hopper.other_powers,
            *hopper.dry_N,
            hopper.rise,
            *hopper.viscous_N_s_per_m,
        ]
    )
    t_s = np.arange(0.0, seconds, SAMPLE_S)
    state = np.array([REST_M + SOLE_M, REST_M, 0.0, 0.0])
    read = np.empty((t_s.size, 2))
    plate = np.empty(t_s.size)
    force = np.empty(t_s.size)
    late = round(hopper.force_delay_s / SAMPLE_S)
    filtered = 0.0
    if hopper.plate_lag_s > 0.0:
        share = 1.0 - np.exp(-SAMPLE_S / hopper.plate_lag_s)
    else:
        share = 1.0
    for k, t in enumerate(t_s):
        read[k] = state[:2]
        wanted = REST_M + swing_m @ np.sin(rates * t + phases)
        force[k] = np.clip(
            1500.0 * (wanted - state[1]) - 25.0 * state[3] + GRAVITY_M_S2 * hopper.trunk_kg,
            -30.0,
            120.0,
        )
        state, pressed = _advance(
            state, force[max(k - late, 0)] * hopper.force_factor, values, round(SAMPLE_S / STEP_S)
        )
        filtered += share * (pressed - filtered)
        plate[k] = hopper.plate_factor * filtered
    noise = np.random.default_rng([seed, 1] if noise_seed is None else noise_seed)
    read = (
        read + np.array(hopper.zero_m) + hopper.position_error_m * noise.standard_normal(read.shape)
    )
    return t_s, read, plate + hopper.plate_error_N * noise.standard_normal(plate.shape), force


def _state_contact(hopper):
    return (
        "[[contacts]]",
        'spheres = ["sole"]',
        'plane = "floor"',
        f"stiffness_N_per_m1p5 = {hopper.stiffness_N_per_m1p5}",
        f"damping_s_per_m = {hopper.damping_s_per_m}",
        "friction = 0.5",
        "presliding_mm = 0.1",
    )


def write_campaign(folder, nominal, recordings, known_to, own_contact=False):
    """A folder with experiment.toml, model.xml of the nominal hopper, and a CSV file of each
    recording.

    With `own_contact` the experiment states the sole's law; else MuJoCo's contact stands for it.
    """
    folder.mkdir(parents=True)
    (folder / "model.xml").write_text(mjcf(nominal, own_contact), encoding="utf-8")
    for number, (t_s, read, plate, force) in enumerate(recordings, start=1):
        rows = np.column_stack([t_s, 1e3 * read, plate, force])
        np.savetxt(
            folder / f"run{number}.csv",
            rows,
            delimiter=",",
            header="t,rail,leg,plate,force",
            comments="",
            fmt="%.8g",
        )
    lines = [
        'format = "rfca-experiment/1"',
        'title = "hopper"',
        'model = "model.xml"',
        'time = { column = "t", unit = "s" }',
        "signals = [",
        '  { joint = "rail", quantity = "position", column = "rail", unit = "mm" },',
        '  { joint = "leg", quantity = "position", column = "leg", unit = "mm" },',
        '  { sensor = "plate_force_z", column = "plate", unit = "N" },'
        if own_contact
        else '  { sensor = "plate_force", column = "plate", unit = "N" },',
        "]",
        'commands = [{ actuator = "leg_motor", column = "force", unit = "N", held = true }]',
        "windows = { length_s = 0.3, bin_s = 0.02 }",
        *(_state_contact(nominal) if own_contact else ()),
        "[known_to]",
        *(f"{key} = {value}" for key, value in known_to.items()),
        "",
        *(
            f'[[recordings]]\nfile = "run{k}.csv"\ncondition = "run {k}"'
            for k in range(1, len(recordings) + 1)
        ),
    ]
    (folder / "experiment.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
