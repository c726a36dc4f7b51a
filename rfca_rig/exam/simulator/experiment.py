"""The exam's simulator: seven rods in relative angles, integrated by drift-kick-drift with a fixed
step.

A step is half a drift, one solve for the change of all rates with hinge damping half implicit, and
half a drift. It is second order. The step is fixed, so halving it is the whole convergence test.
The simulator shares no code, coordinates, integrator, friction law or memory law with the model
that the diagnosis uses.

The two experiments of a campaign run on it: a stroke, and a table of static stages. The sensor
model makes recorded columns of their true forces, with sensor faults and noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import SimulationFailed
from rfca_rig.exam.simulator.body import jit_cached
from rfca_rig.exam.simulator.step import FIRST_ANGLE, run
from rfca_rig.exam.simulator.world import GRAVITY_M_S2, HINGES, World

Floats = NDArray[np.float64]

FINE_STEP_S = 5e-5
# The leg is released before the recording starts, so that it hangs still when the command begins at
# t = 0.
RELEASED_S = -0.6

# Resolution of a recorded force and torque.
COUNT_N = 0.005
COUNT_NM = 5e-5
ENCODER_RAD = 2.0 * np.pi / 2**16
# Steps per sample for a sensor that lags or rings; 40 instead change a force by 1e-5 of itself.
PIECES = 20
NOISE_FX_N = 0.1
NOISE_TY_NM = 0.006
NOISE_ANGLE_RAD = 1e-4
NOISE_SPEED_RAD_S = 0.01
NOISE_MOTOR_NM = 0.05

# Half of this step changes a valley by less than 1e-4 of its force.
STEP_S = 1e-4
SAMPLE_S = 1e-3
# Time recorded before the command.
BEFORE_S = 0.1
# Angle through which the shaft turns in a stroke.
SWEEP_RAD = 3.23

LOADING_RAD = tuple(float(np.radians(angle)) for angle in (60.0, 75.0, 90.0, 105.0, 120.0, 135.0))
UNLOADING_RAD = tuple(float(np.radians(angle)) for angle in (133.0, 131.0))
STAGES = (
    *((angle, "loading") for angle in LOADING_RAD),
    *((angle, "unloading") for angle in UNLOADING_RAD),
)
MOVE_RAD_S = 1.0
HOLD_S = 0.8
READ_S = 0.1
# Standard deviation of a hinge angle read from a photo.
PHOTO_DEG = 0.15


@dataclass(frozen=True)
class Traces:
    """True signals of one simulation, before the sensor.

    All are (m,) at the times `t_s`, except `joint_angles_rad` (m, 7), the angles of the shaft and
    of the six hinges. `force_y_N` and `force_d_N` are the force of the mount on the leg, along y
    and d (downwards).
    """

    t_s: Floats
    force_y_N: Floats
    force_d_N: Floats
    leg_torque_Nm: Floats
    motor_torque_Nm: Floats
    motor_angle_rad: Floats
    motor_speed_rad_s: Floats
    joint_angles_rad: Floats


def simulate(
    world: World, knots: Floats, t_s: Floats, width_s: float = 1e-4, step_s: float = FINE_STEP_S
) -> Traces:
    """Simulate a leg that is released straight at -0.6 s and then driven.

    Parameters
    ----------
    world : World
        The rig.
    knots : (2, k) array
        Times in s and commanded speeds in rad/s, linear in between.
    t_s : (m,) array
        Sample times, ascending.
    width_s : float
        Each sample is the mean over this time around it, at least one step on either side.
    step_s : float
        Step of the integrator; the method is of second order.

    Returns
    -------
    Traces
        The true signals at `t_s`.

    Raises
    ------
    SimulationFailed
        Where the state is no longer finite.
    """
    rod = _rod(world)
    mount = _mount(world)
    drive = np.array([getattr(world.drive, name) for name in _DRIVE])
    phi, motor = _at_release(world, rod)
    middle = (t_s - RELEASED_S) / step_s
    half = max(round(0.5 * width_s / step_s), 1)
    # Step k covers k to k + 1 steps after the release. These 2 * half steps are therefore symmetric
    # about the sample.
    window = np.round(middle)[:, None] + np.array([-half, half - 1])
    out = np.zeros((len(t_s), FIRST_ANGLE + rod.shape[1]))
    steps = int(window[-1, 1]) + 1
    if not run(
        rod,
        _hinge(world),
        _floor(world),
        drive,
        mount,
        knots,
        phi,
        motor,
        RELEASED_S,
        step_s,
        steps,
        window,
        out,
    ):
        raise SimulationFailed(
            "the exam's simulator left the finite numbers "
            f"{1e3 * world.mount.height_m:.0f} mm above the ground"
        )
    fy, fd, leg, torque, angle, speed = out[:, :FIRST_ANGLE].T
    return Traces(t_s, fy, fd, leg, torque, angle, speed, out[:, FIRST_ANGLE:])


# The order is that of the entries of `drive` in engine_drive.
_DRIVE = (
    "start_angle_rad",
    "kp_Nm_s_per_rad",
    "ki_Nm_per_rad",
    "rotor_kg_m2",
    "shaft_Nm_per_rad",
    "shaft_Nm_s_per_rad",
    "shaft_gap_rad",
    "shaft_loss_s_per_rad",
    "ripple_share",
    "ripple_cycles",
    "ripple_phase_rad",
    "cable_Nm",
    "limit_Nm",
    "cogging_Nm",
    "cogging_cycles",
    "hose_Nm_per_rad",
)


def _rod(world: World) -> Floats:
    """Lengths, masses, centres of mass and moments of inertia about these, (4, 7); the tip mass
    is merged into the last rod.
    """
    length = np.array(world.links.length_m)
    mass = np.array(world.links.mass_kg)
    centre = length / 2.0
    inertia = mass * length**2 / 12.0
    tip = world.links.tip_mass_kg
    whole = mass[-1] + world.links.tip_mass_kg
    merged = (mass[-1] * centre[-1] + tip * length[-1]) / whole
    # Parallel axis theorem: rod and point mass about their common centre of mass.
    inertia[-1] += mass[-1] * (merged - centre[-1]) ** 2 + tip * (length[-1] - merged) ** 2
    centre[-1] = merged
    mass[-1] = whole
    return np.array([length, mass, centre, inertia])


def _hinge(world: World) -> Floats:
    # The fields of `Hinges` are in the order of the columns in engine_hinge. Row 0 is the shaft,
    # which has no spring.
    columns = [getattr(world.hinges, field.name) for field in fields(world.hinges)]
    return np.vstack([np.zeros(len(columns)), np.array(columns).T])


def _floor(world: World) -> Floats:
    # The fields of `Floor` are in the order of the entries in engine_floor. The last two hold how
    # far and how fast the floor shakes.
    return np.array(
        [float(getattr(world.floor, field.name)) for field in fields(world.floor)]
        + [world.mount.height_m, 0.0, 0.0]
    )


def _mount(world: World) -> Floats:
    mount = world.mount
    links = world.links
    pull = GRAVITY_M_S2 * np.array([np.sin(mount.lean_rad), np.cos(mount.lean_rad)])
    drag = links.drag_N_s2_per_m3, links.drag_power
    frame = (
        mount.frame_kg,
        mount.frame_N_per_m,
        mount.frame_N_s_per_m,
        mount.frame_lean_rad,
        mount.frame_felt_share,
    )
    return np.array([links.end_radius_m, *drag, *pull, *frame])


def _at_release(world: World, rod: Floats) -> tuple[Floats, Floats]:
    """Angles (n,) and motor state (4,) of the straight leg, with the drive's springs deflected
    so that they carry its weight.
    """
    drive = world.drive
    start = world.drive.start_angle_rad
    angles = np.zeros(rod.shape[1] + (world.mount.frame_kg > 0.0))
    along = rod[1] @ (np.concatenate([[0.0], np.cumsum(rod[0])[:-1]]) + rod[2])
    weight = GRAVITY_M_S2 * along * np.cos(start + world.mount.lean_rad)
    motor = start
    # The PI loop gives torque only for an angle error, so the motor starts below its command by
    # weight / ki.
    if drive.ki_Nm_per_rad > 0.0:
        motor += weight / drive.ki_Nm_per_rad
    angles[0] = motor
    # The shaft spring acts only beyond its play.
    if drive.shaft_Nm_per_rad > 0.0:
        angles[0] += weight / drive.shaft_Nm_per_rad + drive.shaft_gap_rad
    return angles, np.array([start, 0.0, motor, 0.0])


@dataclass(frozen=True)
class Noise:
    """Standard deviations of one sample."""

    fy_N: float = 0.10
    fz_N: float = 0.15
    tx_Nm: float = 0.006


def sense(world: World, traces: Traces) -> tuple[Floats, Floats, Floats]:
    """(fy, fz, tx), each (m,) in N and N m, as a sensor without noise reports them.

    fz points down: the leg's weight is positive. The faults act in the order that `Sensing` lists.
    """
    sensing = world.sensing
    t = traces.t_s
    fy = traces.force_y_N
    fz = -traces.force_d_N
    # The sensor's origin is below the shaft, so fy adds its moment.
    tx = traces.leg_torque_Nm + world.mount.below_shaft_m * fy
    turned = traces.motor_angle_rad - world.drive.start_angle_rad
    fz = fz + sensing.cogging_N * np.sin(sensing.cogging_cycles * turned)
    fy = sensing.gain * fy
    fz = sensing.gain * fz * (1.0 + sensing.curvature_per_N * np.abs(fz))
    tx = sensing.gain * tx
    fz = apply_play(fz, sensing.play_N)
    if sensing.creep_share != 0.0:
        fz = fz + sensing.creep_share * lag_first_order(t, fz, sensing.creep_s)
    fy, fz, tx = (
        fy + sensing.fy_per_fz * fz,
        fz + sensing.fz_per_fy * fy,
        tx + sensing.tx_per_fy_m * fy + sensing.tx_per_fz_m * fz,
    )
    # The torque tx rings with the direction y, in which it has its lever.
    across_Hz = sensing.ringing_Hz * sensing.y_frequency_ratio
    fy, fz, tx = (
        filter_second_order(t, x, frequency_Hz, sensing.ringing_ratio)
        for x, frequency_Hz in ((fy, across_Hz), (fz, sensing.ringing_Hz), (tx, across_Hz))
    )
    fy, fz, tx = (
        delay(
            t, lag_first_order(t, x, sensing.lag_s), sensing.clock_offset_s + sensing.clock_rate * t
        )
        for x in (fy, fz, tx)
    )
    fz = fz + sensing.drift_N_per_s * t + sensing.hum_N * np.sin(2.0 * np.pi * sensing.hum_Hz * t)
    fz = np.clip(fz, -sensing.clip_N, sensing.clip_N)
    fz = np.where(np.abs(fz) < sensing.dead_N, 0.0, fz)
    if sensing.digit_N > 0.0:
        fz = np.round(fz / sensing.digit_N) * sensing.digit_N
    return fy, fz, tx


def lag_first_order(t_s: Floats, x: Floats, tau_s: float) -> Floats:
    """First-order low-pass tau y' = x - y of x (m,) at times (m,), settled at the first sample."""
    if tau_s <= 0.0:
        return x
    y = x.copy()
    integrate_first_order(t_s, x, tau_s, y)
    return y


@jit_cached
def integrate_first_order(t_s: Floats, x: Floats, tau_s: float, y: Floats) -> None:
    """Integrate y' = (x - y) / tau into y (m,), with x (m,) linear between samples at t_s (m,)
    and PIECES bilinear steps for each.
    """
    now = x[0]
    for i in range(1, x.size):
        half = 0.5 * (t_s[i] - t_s[i - 1]) / (PIECES * tau_s)
        for piece in range(PIECES):
            middle = x[i - 1] + (x[i] - x[i - 1]) * (piece + 0.5) / PIECES
            now = ((1.0 - half) * now + 2.0 * half * middle) / (1.0 + half)
        y[i] = now


def delay(t_s: Floats, x: Floats, offset_s: float | Floats) -> Floats:
    """x (m,) at times (m,) as it was `offset_s` before, linear between samples; `offset_s` is
    one number or (m,). The ends are held.
    """
    if np.any(offset_s):
        return np.interp(t_s - offset_s, t_s, x)
    return x


def filter_second_order(t_s: Floats, x: Floats, frequency_Hz: float, ratio: float) -> Floats:
    """x (m,) filtered by a mass on a spring with damping ratio `ratio`, in short
    drift-kick-drift steps; at rest at the first sample.
    """
    if frequency_Hz <= 0.0:
        return x
    y = x.copy()
    integrate_second_order(t_s, x, 2.0 * np.pi * frequency_Hz, ratio, y)
    return y


@jit_cached
def integrate_second_order(t_s: Floats, x: Floats, rate: float, ratio: float, y: Floats) -> None:
    """Integrate y'' = w^2 (x - y) - 2 d w y' into y (m,), with x (m,) linear between samples at t_s
    (m,) and PIECES steps for each.

    w is `rate` in rad/s, d is `ratio`. Second order: half a drift, a kick with half-implicit
    damping, half a drift.
    """
    position = x[0]
    speed = 0.0
    for i in range(1, x.size):
        h = (t_s[i] - t_s[i - 1]) / PIECES
        for piece in range(PIECES):
            position += 0.5 * h * speed
            now = x[i - 1] + (x[i] - x[i - 1]) * (piece + 0.5) / PIECES
            speed = (speed * (1.0 - h * ratio * rate) + h * rate * rate * (now - position)) / (
                1.0 + h * ratio * rate
            )
            position += 0.5 * h * speed
        y[i] = position


def apply_play(x: Floats, half_width: float) -> Floats:
    """x (m,) behind a play of this half width: the output stays until it is dragged."""
    if half_width == 0.0:
        return x
    y = x.copy()
    for i in range(1, len(x)):
        y[i] = min(max(y[i - 1], x[i] - half_width), x[i] + half_width)
    return y


def record_columns(
    world: World, traces: Traces, noise: Noise, random: np.random.Generator
) -> dict[str, Floats]:
    """Columns (m,) of a dynamic recording, with noise and finite resolution."""
    m = len(traces.t_s)
    fy, fz, tx = sense(world, traces)

    def noisy(x: Floats | float, std: float, digit: float) -> Floats:
        return np.asarray(np.round((x + random.normal(0.0, std, m)) / digit) * digit)

    return {
        # The order of the columns is the order of the random draws: another one would change every
        # recording of a seed.
        "t_s": traces.t_s,
        "shaft_angle_rad": noisy(traces.motor_angle_rad, NOISE_ANGLE_RAD, ENCODER_RAD),
        "shaft_speed_rad_s": noisy(traces.motor_speed_rad_s, NOISE_SPEED_RAD_S, 1e-4),
        "motor_torque_Nm": noisy(traces.motor_torque_Nm, NOISE_MOTOR_NM, 1e-3),
        "fx_N": noisy(0.0, NOISE_FX_N, COUNT_N),
        "fy_N": noisy(fy, noise.fy_N, COUNT_N),
        "fz_N": noisy(fz, noise.fz_N, COUNT_N),
        "tx_Nm": noisy(tx, noise.tx_Nm, COUNT_NM),
        "ty_Nm": noisy(0.0, NOISE_TY_NM, COUNT_NM),
        "tz_Nm": noisy(0.0, NOISE_TY_NM, COUNT_NM),
    }


# A reading averages a tenth of a second, so its noise is smaller than that of a sample.
STATIC_NOISE = Noise(fy_N=0.01, fz_N=0.015, tx_Nm=6e-4)


@dataclass(frozen=True)
class ExamStage:
    """One row of a static table, as in its CSV file; `hinge_deg` is (6,), from the shaft
    outwards.
    """

    height_mm: float
    stage: int
    direction: str
    shaft_angle_rad: float
    hinge_deg: tuple[float, ...]
    fy_N: float
    fz_N: float
    tx_Nm: float


def stroke_traces(world: World, speed_rad_s: float, step_s: float = STEP_S) -> Traces:
    """True signals of one stroke, without the sensor, from 0.1 s before the command to the end
    of the sweep.
    """
    end_s = SWEEP_RAD / speed_rad_s + world.drive.ramp_s
    t_s: Floats = (
        np.arange(-round(BEFORE_S / SAMPLE_S), int(end_s / SAMPLE_S) + 1, dtype=np.float64)
        * SAMPLE_S
    )
    late_s = world.drive.late_s
    # The command goes on for 1 s beyond the last sample, so that a late drive does not stop within
    # the recording.
    knots = np.array(
        [
            [late_s, late_s + world.drive.ramp_s, late_s + end_s + 1.0],
            [0.0, speed_rad_s, speed_rad_s],
        ]
    )
    return simulate(world, knots, t_s, step_s=step_s)


def record_stroke(
    world: World, speed_rad_s: float, noise: Noise, random: np.random.Generator
) -> dict[str, Floats]:
    """One recorded stroke, as columns (m,) by name."""
    return record_columns(world, stroke_traces(world, speed_rad_s), noise, random)


def static_table(
    world: World,
    stated_height_mm: float,
    ramp_s: float,
    random: np.random.Generator,
    stages: Sequence[tuple[float, str]] = STAGES,
) -> list[ExamStage]:
    """Simulate the `stages` (shaft angle in rad, direction) at one height, one after the other.

    Each row is the mean of the last tenth of a second of its hold. The shaft moves between stages
    at 1 rad/s and accelerates and brakes within `ramp_s`; the shorter this is, the more the tip
    overshoots.

    The sensor is tared at each stage and averages for a while, so lag, ringing, clock, drift and
    hum do not show.
    """
    angles = tuple(angle for angle, _ in stages)
    knots, read_s = plan_stages(world.drive.start_angle_rad, angles, ramp_s)
    traces = simulate(world, knots, read_s, width_s=READ_S, step_s=STEP_S)
    steady = replace(
        world,
        sensing=replace(
            world.sensing,
            lag_s=0.0,
            clock_offset_s=0.0,
            clock_rate=0.0,
            ringing_Hz=0.0,
            drift_N_per_s=0.0,
            hum_N=0.0,
        ),
    )
    fy, fz, tx = sense(steady, traces)
    return [
        ExamStage(
            height_mm=stated_height_mm,
            stage=i + 1,
            direction=stages[i][1],
            shaft_angle_rad=float(traces.motor_angle_rad[i] + random.normal(0.0, 1e-4)),
            hinge_deg=tuple(
                np.degrees(traces.joint_angles_rad[i, 1:]) + random.normal(0.0, PHOTO_DEG, HINGES)
            ),
            fy_N=float(fy[i] + random.normal(0.0, STATIC_NOISE.fy_N)),
            fz_N=float(fz[i] + random.normal(0.0, STATIC_NOISE.fz_N)),
            tx_Nm=float(tx[i] + random.normal(0.0, STATIC_NOISE.tx_Nm)),
        )
        for i in range(len(angles))
    ]


def plan_stages(
    start_rad: float, angles_rad: tuple[float, ...], ramp_s: float
) -> tuple[Floats, Floats]:
    """Knots (2, m) of times and speeds of a shaft that goes from angle to angle and rests at
    each, and mid-times of the readings (k,).
    """
    times = [0.0]
    speeds = [0.0]
    read_s = []
    now = 0.0
    shaft_rad = start_rad
    for angle in angles_rad:
        for seconds, reached in (*_moves(angle - shaft_rad, ramp_s), (HOLD_S, 0.0)):
            now += seconds
            times.append(now)
            speeds.append(float(reached))
        read_s.append(now - 0.5 * READ_S)
        shaft_rad = angle
    return np.array([times, speeds]), np.array(read_s)


def _moves(way: float, ramp_s: float) -> list[tuple[float, float]]:
    """Durations in s with the speed in rad/s reached after each, for a move from rest to rest;
    empty where the shaft stays.
    """
    if way == 0.0:
        return []
    # A short move never reaches full speed: two ramps of ramp_s cover speed * ramp_s.
    speed = float(np.sign(way)) * min(MOVE_RAD_S, abs(way) / ramp_s)
    even_s = way / speed - ramp_s
    moves = [(ramp_s, speed)]
    if even_s > 1e-9:
        moves.append((even_s, speed))
    return [*moves, (ramp_s, 0.0)]
