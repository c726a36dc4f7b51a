"""A position servo that swings a weight on an arm, simulated from its own equations.

MuJoCo and the package's laws have no part in it. A DC motor drives the joint through a rigid gear.
The motor's torque falls with speed by its back-EMF. The gear loses torque in four ways:

- dry friction, a bristle whose full torque falls with speed as a Gaussian
- a share of the torque that the output shaft transmits, smaller or larger where the load drives
- viscous friction
- a part that grows with a power of the speed, zero unless a case asks for it

A proportional-derivative controller on the servo sets the duty, the share of the supply voltage.
It reads the angle in counts and the speed late. Counts, speed and duty are what is recorded.
Angles count from the hanging pose.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numba
import numpy as np

GRAVITY_M_S2 = 9.81
COUNTS_PER_TURN = 4096
COUNT_RAD = 2.0 * np.pi / COUNTS_PER_TURN
# A uniform error within a count has this standard deviation.
COUNT_STD = 12.0**-0.5
# Bristles slip at up to 6 rad/s over 2 mrad, so that Runge-Kutta needs less than 0.7 ms.
STEP_S = 5e-5
# The controller holds the first reference for so long before the recording begins.
SETTLING_S = 0.6
# Inertia of the arm about its own axis: MuJoCo asks for one, and no motion depends on it.
LENGTHWISE_KG_M2 = 1e-5

Reference = Callable[[float], float]


@dataclass(frozen=True)
class Motor:
    """A DC motor behind a gear, with the supply voltage that its data sheet states.

    Parameters
    ----------
    ratio
        Turns of the rotor per turn of the joint.
    torque_constant_Nm_per_A
        It is the constant of the back-EMF in V s/rad, too.
    resistance_ohm
        Of the windings.
    supply_V
        Nominal supply voltage.
    rotor_kg_m2
        Inertia of the rotor, before the gear.
    """

    ratio: float = 225.0
    torque_constant_Nm_per_A: float = 0.0113
    resistance_ohm: float = 3.6
    supply_V: float = 12.0
    rotor_kg_m2: float = 2.5e-7

    @property
    def stall_Nm(self) -> float:
        """Torque in the joint at rest and full duty."""
        return self.ratio * self.torque_constant_Nm_per_A * self.supply_V / self.resistance_ohm

    @property
    def back_emf_Nm_s_per_rad(self) -> float:
        """Torque in the joint that back-EMF takes off, per speed of the joint."""
        return (self.ratio * self.torque_constant_Nm_per_A) ** 2 / self.resistance_ohm

    @property
    def reflected_kg_m2(self) -> float:
        """Inertia of the rotor as the joint feels it."""
        return self.ratio**2 * self.rotor_kg_m2


@dataclass(frozen=True)
class GearFriction:
    """What the gear loses, all as torques in the joint.

    Parameters
    ----------
    dry_Nm
        Dry friction at high speed without load.
    rise, falls_rad_s
        Share by which dry friction is larger at rest, and the speed that this rise falls with.
    viscous_Nm_s_per_rad
        Torque per speed.
    driving_share, back_driving_share
        Share of the transmitted torque that is lost: where the motor drives, where the load does.
    power_Nm, power
        Torque at 1 rad/s of a part that grows with this power of the speed.
    bristle_rad
        Angle over which friction builds up after a reversal.
    bristle_damping_s
        Torque of a bristle that bends, over its full torque, per rate of its bend.
    """

    dry_Nm: float = 0.0
    rise: float = 0.0
    falls_rad_s: float = 0.3
    viscous_Nm_s_per_rad: float = 0.0
    driving_share: float = 0.0
    back_driving_share: float = 0.0
    power_Nm: float = 0.0
    power: float = 1.5
    bristle_rad: float = 0.003
    bristle_damping_s: float = 0.001


@dataclass(frozen=True)
class Controller:
    """Duty from the angle in counts and a late speed, at `rate_Hz`."""

    rate_Hz: float = 125.0
    duty_per_rad: float = 6.0
    duty_s_per_rad: float = 0.1
    speed_filter_s: float = 0.015


@dataclass(frozen=True)
class Servo:
    """A servo with a rod and a weight at its end.

    `zero_rad` is what the encoder reads too much. With `windings_open` a motor that is off turns
    freely; otherwise its windings are shorted and its back-EMF brakes.
    """

    weight_kg: float = 0.6
    arm_m: float = 0.15
    rod_kg: float = 0.05
    motor: Motor = field(default_factory=Motor)
    friction: GearFriction = field(default_factory=GearFriction)
    controller: Controller = field(default_factory=Controller)
    zero_rad: float = 0.0
    windings_open: bool = False

    @property
    def mass_kg(self) -> float:
        """Mass of rod and weight together."""
        return self.rod_kg + self.weight_kg

    @property
    def centre_m(self) -> float:
        """Distance of their centre of mass from the joint."""
        return (0.5 * self.rod_kg + self.weight_kg) * self.arm_m / self.mass_kg

    @property
    def gravity_Nm(self) -> float:
        """Torque of the weight in the joint with the arm horizontal."""
        return GRAVITY_M_S2 * self.mass_kg * self.centre_m

    @property
    def inertia_kg_m2(self) -> float:
        """Inertia of a thin rod and a point mass about the joint."""
        return (self.rod_kg / 3.0 + self.weight_kg) * self.arm_m**2


@dataclass(frozen=True)
class Recording:
    """Rows at the controller's rate: counts of the encoder, the servo's speed reading, the duty.

    Angles and speeds without reading errors stand beside them, for tests.
    """

    condition: str
    t_s: np.ndarray
    counts: np.ndarray
    speed_rad_s: np.ndarray
    duty: np.ndarray
    driven: bool
    true_rad: np.ndarray
    true_rad_s: np.ndarray


def mjcf(servo: Servo) -> str:
    """The servo for MuJoCo as a user would write it: no friction, back-EMF as damping."""
    motor = servo.motor
    centre_m = servo.centre_m
    across_kg_m2 = servo.inertia_kg_m2 - servo.mass_kg * centre_m**2
    inertia = f"{across_kg_m2:.12g} {across_kg_m2:.12g} {min(LENGTHWISE_KG_M2, across_kg_m2):.12g}"
    joint = f'damping="{motor.back_emf_Nm_s_per_rad:.12g}" armature="{motor.reflected_kg_m2:.12g}"'
    return f"""<mujoco model="servo">
 <option gravity="0 0 {-GRAVITY_M_S2}" timestep="0.001"/>
 <worldbody>
  <body name="arm">
   <joint name="joint" type="hinge" axis="0 -1 0" {joint}/>
   <inertial pos="0 0 {-centre_m:.12g}" mass="{servo.mass_kg:.12g}" diaginertia="{inertia}"/>
  </body>
 </worldbody>
 <actuator><motor name="motor" joint="joint" gear="{motor.stall_Nm:.12g}"/></actuator>
</mujoco>
"""


def lift_and_lower(random: np.random.Generator, seconds: float) -> Reference:
    """Slowly from about hanging to above horizontal and back, to either side."""
    side = random.choice([-1.0, 1.0])
    top_rad = side * random.uniform(1.7, 2.2)
    bottom_rad = side * random.uniform(0.1, 0.3)

    def reference(t_s: float) -> float:
        lifted = 0.5 - 0.5 * np.cos(2.0 * np.pi * t_s / seconds)
        return bottom_rad + (top_rad - bottom_rad) * lifted

    return reference


def sines(random: np.random.Generator, seconds: float) -> Reference:
    """Three sines between 0.2 and 1.2 Hz about a pose beside hanging."""
    middle_rad = random.uniform(-0.5, 0.5)
    amplitudes_rad = np.array([0.8, 0.4, 0.2]) * random.uniform(0.8, 1.2, 3)
    rates_rad_s = 2.0 * np.pi * np.array([0.25, 0.6, 1.1]) * random.uniform(0.8, 1.2, 3)
    phases_rad = random.uniform(0.0, 2.0 * np.pi, 3)

    def reference(t_s: float) -> float:
        return middle_rad + float(amplitudes_rad @ np.sin(rates_rad_s * t_s + phases_rad))

    return reference


def steps(random: np.random.Generator, seconds: float) -> Reference:
    """A new pose every second, held until the next one."""
    poses_rad = random.uniform(-1.8, 1.8, int(np.ceil(seconds)) + 1)

    def reference(t_s: float) -> float:
        return float(poses_rad[int(max(t_s, 0.0))])

    return reference


def release(random: np.random.Generator, seconds: float) -> Reference:
    """One raised pose, from which the arm falls when the motor is switched off."""
    pose_rad = random.choice([-1.0, 1.0]) * random.uniform(1.4, 2.4)

    def reference(t_s: float) -> float:
        return pose_rad

    return reference


# By the name of the condition; the motor is on in all but the last.
TRAJECTORIES: Mapping[str, Callable[[np.random.Generator, float], Reference]] = {
    "lift and lower": lift_and_lower,
    "sines": sines,
    "steps": steps,
    "release": release,
}


def record(
    servo: Servo,
    condition: str,
    seconds: float,
    seed: int,
    supply_factor: float = 1.0,
) -> Recording:
    """What the servo records in a motion of `TRAJECTORIES`.

    Parameters
    ----------
    servo
        The servo with its arm and weight.
    condition
        Name of the motion.
    seconds
        Length of the recording.
    seed
        Of the motion.
    supply_factor
        Supply voltage over the nominal one.
    """
    reference = TRAJECTORIES[condition](np.random.default_rng(seed), seconds)
    return follow(servo, condition, reference, seconds, supply_factor, condition != "release")


def follow(
    servo: Servo,
    condition: str,
    reference: Reference,
    seconds: float,
    supply_factor: float = 1.0,
    driven: bool = True,
) -> Recording:
    """The recording of a motion towards a reference. Without `driven` the motor is off from 0 s."""
    controller = servo.controller
    tick_s = 1.0 / controller.rate_Hz
    settling = round(SETTLING_S * controller.rate_Hz)
    ticks = round(seconds * controller.rate_Hz)
    share = 1.0 - np.exp(-tick_s / controller.speed_filter_s)
    state = np.array([reference(0.0), 0.0, 0.0])
    counts_before = _read_counts(servo, state[0])
    speed_rad_s = 0.0
    rows = np.empty((ticks, 5))
    for tick in range(-settling, ticks):
        counts = _read_counts(servo, state[0])
        raw_rad_s = (counts - counts_before) * COUNT_RAD / tick_s
        speed_rad_s += share * (raw_rad_s - speed_rad_s)
        counts_before = counts
        error_rad = reference(tick * tick_s) - counts * COUNT_RAD
        wanted = controller.duty_per_rad * error_rad - controller.duty_s_per_rad * speed_rad_s
        is_on = driven or tick < 0
        duty = float(np.clip(wanted, -1.0, 1.0)) if is_on else 0.0
        if tick >= 0:
            rows[tick] = counts, speed_rad_s, duty, state[0], state[1]
        state = advance(servo, state, duty * supply_factor, tick_s, is_on)
    t_s = tick_s * np.arange(ticks)
    counts, speed, duty, true_rad, true_rad_s = rows.T
    return Recording(condition, t_s, counts, speed, duty, driven, true_rad, true_rad_s)


def _read_counts(servo: Servo, angle_rad: float) -> float:
    return float(np.round((angle_rad + servo.zero_rad) / COUNT_RAD))


def advance(
    servo: Servo,
    state: np.ndarray,
    duty: float,
    seconds: float,
    is_on: bool = True,
) -> np.ndarray:
    """The state (angle, speed, bend of the bristle as a share) after a time at constant duty.

    `duty` is relative to the nominal supply voltage.
    """
    motor = servo.motor
    friction = servo.friction
    is_connected = is_on or not servo.windings_open
    numbers = np.array(
        [
            motor.stall_Nm * duty if is_on else 0.0,
            motor.back_emf_Nm_s_per_rad if is_connected else 0.0,
            motor.reflected_kg_m2,
            servo.inertia_kg_m2,
            servo.gravity_Nm,
            friction.dry_Nm,
            friction.rise,
            friction.falls_rad_s,
            friction.viscous_Nm_s_per_rad,
            friction.driving_share,
            friction.back_driving_share,
            friction.power_Nm,
            friction.power,
            friction.bristle_rad,
            friction.bristle_damping_s,
        ]
    )
    angle, speed, bend = _runge_kutta(*state, numbers, STEP_S, round(seconds / STEP_S))
    return np.array([angle, speed, bend])


@numba.njit(cache=True)
def _runge_kutta(angle, speed, bend, numbers, h, steps_taken):
    """Steps of fourth order over scalars, which compile faster than arrays."""
    for _ in range(steps_taken):
        a1, s1, b1 = _rates(angle, speed, bend, numbers)
        half = 0.5 * h
        a2, s2, b2 = _rates(angle + half * a1, speed + half * s1, bend + half * b1, numbers)
        a3, s3, b3 = _rates(angle + half * a2, speed + half * s2, bend + half * b2, numbers)
        a4, s4, b4 = _rates(angle + h * a3, speed + h * s3, bend + h * b3, numbers)
        angle += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        speed += h / 6.0 * (s1 + 2.0 * s2 + 2.0 * s3 + s4)
        bend += h / 6.0 * (b1 + 2.0 * b2 + 2.0 * b3 + b4)
    return angle, speed, bend


@numba.njit(cache=True)
def _rates(angle, speed, bend, numbers):
    """Rates of angle, speed and bend.

    The output shaft transmits T = I a + G sin q, and the rotor obeys J a = tau - loss - T. The loss
    depends on |T|, so both are solved for T, whose sign is that of the right-hand side.
    """
    (
        driven_Nm,
        back_emf,
        rotor,
        inertia,
        gravity_Nm,
        dry_Nm,
        rise,
        falls_rad_s,
        viscous,
        driving_share,
        back_driving_share,
        power_Nm,
        power,
        bristle_rad,
        bristle_damping_s,
    ) = numbers
    bend_rate = (speed - abs(speed) * bend) / bristle_rad
    # The damping of the bristle fades with speed, or a fast reversal would be a blow.
    fading = np.exp(-((speed / falls_rad_s) ** 2))
    pull = bend + bristle_damping_s * fading * bend_rate
    smooth_Nm = (back_emf + viscous) * speed + power_Nm * np.sign(speed) * abs(speed) ** power
    dry_now_Nm = dry_Nm * (1.0 + rise * np.exp(-((speed / falls_rad_s) ** 2)))
    weight_Nm = gravity_Nm * np.sin(angle)
    right_Nm = driven_Nm - smooth_Nm - dry_now_Nm * pull + rotor / inertia * weight_Nm
    if right_Nm * pull > 0.0:
        load_share = driving_share
    else:
        load_share = back_driving_share
    load_sign = 1.0 if right_Nm > 0.0 else -1.0
    transmitted_Nm = right_Nm / (1.0 + rotor / inertia + load_share * pull * load_sign)
    return speed, (transmitted_Nm - weight_Nm) / inertia, bend_rate


def write_campaign(
    folder: Path,
    nominal_model: str,
    recordings: Sequence[Recording],
    known_to: Mapping[str, float],
    title: str = "servo",
) -> Path:
    """Write experiment.toml, model.xml and a CSV file of each recording into a new folder.

    The speed column is in the files but not in the experiment: the servo's speed reading is late,
    which its maker states.

    Parameters
    ----------
    folder
        It must not exist.
    nominal_model
        MJCF with a joint `joint` and an actuator `motor` whose command is the duty.
    recordings
        Of one servo.
    known_to
        Standard uncertainties of the nominal values.
    title
        Of the experiment.
    """
    folder.mkdir(parents=True)
    (folder / "model.xml").write_text(nominal_model, encoding="utf-8")
    lines = [
        'format = "rfca-experiment/1"',
        f'title = "{title}"',
        'model = "model.xml"',
        'time = { column = "t", unit = "s" }',
        "",
        "[[signals]]",
        'joint = "joint"',
        'quantity = "position"',
        'column = "counts"',
        'unit = "count"',
        f"counts_per_turn = {COUNTS_PER_TURN}",
        f"noise_std = {COUNT_STD:.3f}",
        "",
        "[[commands]]",
        'actuator = "motor"',
        'column = "duty"',
        'unit = "1"',
        "held = true",
        "",
        "[known_to]",
    ]
    for key, value in known_to.items():
        lines.append(f"{key} = {value:.6g}")
    for number, recording in enumerate(recordings, start=1):
        name = f"run{number}.csv"
        columns = (recording.t_s, recording.counts, recording.speed_rad_s, recording.duty)
        _write_csv(folder / name, np.column_stack(columns))
        lines += ["", "[[recordings]]", f'file = "{name}"']
        lines.append(f'condition = "{recording.condition}"')
        if not recording.driven:
            lines.append("driven = false")
    (folder / "experiment.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder


def _write_csv(path: Path, rows: np.ndarray) -> None:
    names = "t,counts,speed,duty"
    np.savetxt(path, rows, delimiter=",", header=names, comments="", fmt="%.8g")
