"""A stroke by the equations of docs/model.md, written a second time, for strokes of the model on a
floor with friction: with a plain shaft, a drive under PI control, and a sensor that rings.

It shares no code with the model, and nothing of its method: Runge and Kutta's fourth order in
constant steps, with friction and sensor as states beside the angles.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.optimize import root

from rfca_rig.model.parameters import RigModel

Floats = NDArray[np.float64]

GRAVITY_M_S2 = 9.81
ROTOR_KG_M2 = 0.006
FULL_DRAG_N = 1.0
STEP_S = 2e-5
# of the results
SAMPLE_S = 1e-3
CHANNELS = 3


class Rig(NamedTuple):
    """The leg, the floor, and the motion that is commanded."""

    length_m: Floats
    mass_kg: Floats
    radius_m: float
    height_m: float
    k0: float
    k2: float
    hinge_damping: float
    contact_stiffness: float
    contact_damping: float
    friction: float
    presliding_m: float
    drag: float
    start_rad: float
    speed_rad_s: float
    ramp_s: float


class Drive(NamedTuple):
    """PI control of a rotor; a shaft that follows its command exactly has `kp` 0."""

    kp: float = 0.0
    ki: float = 0.0
    limit_Nm: float = 1e9
    cogging_Nm: float = 0.0
    cycles_per_turn: float = 1.0
    phase_rad: float = 0.0


class Sensor(NamedTuple):
    """Frequency of each channel fy, fz, tx, and the damping ratio; 0 for a sensor that is stiff."""

    rate_rad_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ratio: float = 0.0


EXACT_DRIVE = Drive()
STIFF_SENSOR = Sensor()


@dataclass(frozen=True)
class TextbookStroke:
    """Readings (m,) of the sensor at every millisecond, the first 1 ms after the beginning."""

    t_s: Floats
    fy_N: Floats
    fz_N: Floats
    tx_Nm: Floats


def simulate_textbook_stroke(
    model: RigModel,
    height_m: float,
    speed_rad_s: float,
    end_s: float,
    drive: Drive = EXACT_DRIVE,
    sensor: Sensor = STIFF_SENSOR,
) -> TextbookStroke:
    """The stroke of `model` without its effects, from rest, up to `end_s`."""
    leg = model.leg
    ground = model.ground
    rig = Rig(
        np.array(leg.link_lengths_m),
        np.array(leg.link_masses_kg),
        leg.link_radius_m,
        height_m,
        leg.k0_Nm_per_rad,
        leg.k2_per_rad2,
        leg.hinge_damping_Nm_s_per_rad,
        ground.stiffness_N_per_m1p5,
        ground.damping_s_per_m,
        ground.friction_coefficient,
        ground.presliding_m,
        ground.drag_N_s_per_m,
        leg.start_angle_rad,
        speed_rad_s,
        model.drive.ramp_s,
    )
    samples = round(end_s / SAMPLE_S)
    readings = np.empty((samples, CHANNELS))
    below_m = model.sensor.below_shaft_m
    angles = _find_rest(rig, drive)
    _integrate(rig, drive, sensor, below_m, angles, round(SAMPLE_S / STEP_S), readings)
    return TextbookStroke(SAMPLE_S * np.arange(1, samples + 1), *readings.T)


def _find_rest(rig: Rig, drive: Drive) -> Floats:
    """Angles (n,) of the links that hang at rest before the motion."""
    beyond = np.cumsum(rig.mass_kg[::-1])[::-1] - rig.mass_kg
    moment = GRAVITY_M_S2 * rig.length_m * (0.5 * rig.mass_kg + beyond)

    def unbalanced(q: Floats) -> Floats:
        phi = np.diff(q)
        weight = np.cumsum((moment * np.cos(q))[::-1])[::-1]
        hinges = rig.k0 * phi * (1.0 + rig.k2 * phi**2) - weight[1:]
        if drive.kp == 0.0:
            return np.append(q[0] - rig.start_rad, hinges)
        behind = rig.start_rad - q[0]
        cogging = drive.cogging_Nm * np.sin(-drive.cycles_per_turn * behind + drive.phase_rad)
        return np.append(drive.ki * behind + cogging + weight[0], hinges)

    found = root(unbalanced, np.full(len(rig.length_m), rig.start_rad), tol=1e-13)
    assert np.abs(unbalanced(found.x)).max() < 1e-9
    return np.asarray(found.x)


@njit(cache=True)
def _command(rig, t, middle_s):
    """Commanded angle, speed and acceleration at t; that of the step around `middle_s` counts."""
    if middle_s < rig.ramp_s:
        acceleration = rig.speed_rad_s / rig.ramp_s
        return rig.start_rad + 0.5 * acceleration * t * t, acceleration * t, acceleration
    angle = rig.start_rad + rig.speed_rad_s * (t - 0.5 * rig.ramp_s)
    return angle, rig.speed_rad_s, 0.0


@njit(cache=True)
def _normal_force(rig, depth, rate):
    if depth <= 0.0:
        return 0.0
    return max(rig.contact_stiffness * depth**1.5 * (1.0 + rig.contact_damping * rate), 0.0)


@njit(cache=True)
def _assemble_leg(rig, q, w, M, F, moment):
    """Mass matrix `M` (n, n), forces `F` (n,) of weight, hinges and speeds, and the first `moment`
    of each link (n,), with the links beyond it at its end.
    """
    n = q.size
    beyond = 0.0
    for i in range(n - 1, -1, -1):
        moment[i] = rig.length_m[i] * (0.5 * rig.mass_kg[i] + beyond)
        M[i, i] = rig.length_m[i] ** 2 * (rig.mass_kg[i] / 3.0 + beyond)
        beyond += rig.mass_kg[i]
        F[i] = GRAVITY_M_S2 * moment[i] * np.cos(q[i])
    for i in range(n):
        for j in range(n):
            if i != j:
                coupled = rig.length_m[min(i, j)] * moment[max(i, j)]
                M[i, j] = coupled * np.cos(q[i] - q[j])
                F[i] -= coupled * np.sin(q[i] - q[j]) * w[j] ** 2
    for i in range(1, n):
        phi = q[i] - q[i - 1]
        torque = rig.k0 * phi * (1.0 + rig.k2 * phi**2)
        torque += rig.hinge_damping * (w[i] - w[i - 1])
        F[i] -= torque
        F[i - 1] += torque


@njit(cache=True)
def _add_contacts(rig, q, w, held, contact, F):
    """Add the floor's forces to `F` (n,), with the sticking friction `held` (n,).

    `contact` (5, n) becomes depth, its rate, normal force, speed of the lowest point, and friction.
    """
    depth = rig.radius_m - rig.height_m
    sinking = 0.0
    sliding = 0.0
    for k in range(q.size):
        depth += rig.length_m[k] * np.sin(q[k])
        sinking += rig.length_m[k] * np.cos(q[k]) * w[k]
        sliding -= rig.length_m[k] * np.sin(q[k]) * w[k]
        normal = _normal_force(rig, depth, sinking)
        slip = sliding - rig.radius_m * w[k]
        limit = rig.friction * normal
        sticking = min(max(held[k], -limit), limit)
        along = sticking - rig.drag * min(normal / FULL_DRAG_N, 1.0) * slip
        contact[0, k] = depth
        contact[1, k] = sinking
        contact[2, k] = normal
        contact[3, k] = slip
        contact[4, k] = along
        for j in range(k + 1):
            F[j] -= normal * rig.length_m[j] * np.cos(q[j])
            F[j] -= along * rig.length_m[j] * np.sin(q[j])
        F[k] -= along * rig.radius_m


@njit(cache=True)
def _accelerate(rig, drive, q, w, held, command, contact, a, force):
    """Accelerations `a` (n,) of the links under friction `held` (n,), and the `force` (3,) of the
    leg on its mount: fy, fz down, and the torque that turns the leg. `contact` as above.
    """
    n = q.size
    M = np.zeros((n, n))
    F = np.zeros(n)
    moment = np.zeros(n)
    _assemble_leg(rig, q, w, M, F, moment)
    _add_contacts(rig, q, w, held, contact, F)
    angle, speed, acceleration = command
    if drive.kp == 0.0:
        a[0] = acceleration
        a[1:] = np.linalg.solve(M[1:, 1:], F[1:] - M[1:, 0] * acceleration)
        force[2] = M[0] @ a - F[0]
    else:
        control = drive.kp * (speed - w[0]) + drive.ki * (angle - q[0])
        motor = min(max(control, -drive.limit_Nm), drive.limit_Nm)
        turned = drive.cycles_per_turn * (q[0] - rig.start_rad)
        motor += drive.cogging_Nm * np.sin(turned + drive.phase_rad)
        M[0, 0] += ROTOR_KG_M2
        F[0] += motor
        a[:] = np.linalg.solve(M, F)
        force[2] = motor - ROTOR_KG_M2 * a[0]
    force[0] = -contact[4].sum()
    force[1] = GRAVITY_M_S2 * rig.mass_kg.sum() - contact[2].sum()
    for j in range(n):
        force[0] -= moment[j] * (np.sin(q[j]) * a[j] + np.cos(q[j]) * w[j] ** 2)
        force[1] -= moment[j] * (np.cos(q[j]) * a[j] - np.sin(q[j]) * w[j] ** 2)


@njit(cache=True)
def _load_friction(rig, q, w, a, contact, held, rate):
    """Write the change with time of the sticking friction `held` (n,) into `rate` (n,)."""
    sinking_rate = 0.0
    for k in range(q.size):
        sinking_rate += rig.length_m[k] * (np.cos(q[k]) * a[k] - np.sin(q[k]) * w[k] ** 2)
        depth, sinking, normal, slip, _ = contact[:, k]
        rate[k] = 0.0
        if normal > 0.0:
            rate[k] = -rig.friction * normal / rig.presliding_m * slip
            loading = rig.contact_stiffness * depth**0.5
            growing = 1.5 * loading * (1.0 + rig.contact_damping * sinking) * sinking
            growing += loading * depth * rig.contact_damping * sinking_rate
            if growing < 0.0:
                limit = rig.friction * normal
                rate[k] += min(max(held[k], -limit), limit) * growing / normal


@njit(cache=True)
def _integrate(rig, drive, sensor, below_m, angles, steps_per_sample, readings):
    """Fill `readings` (m, 3) with fy, fz and tx, from the leg at rest at `angles` (n,)."""
    n = angles.size
    # angles, speeds, sticking friction, then position and speed of the sensor for each channel
    y = np.zeros(3 * n + 2 * CHANNELS)
    y[:n] = angles
    slopes = np.zeros((4, y.size))
    places = (0.0, 0.5, 0.5, 1.0)
    contact = np.zeros((5, n))
    a = np.zeros(n)
    force = np.zeros(CHANNELS)
    command = (rig.start_rad, 0.0, 0.0)
    _accelerate(rig, drive, y[:n], y[n : 2 * n], y[2 * n : 3 * n], command, contact, a, force)
    force[2] += below_m * force[0]
    y[3 * n : 3 * n + CHANNELS] = force
    for step in range(steps_per_sample * readings.shape[0]):
        t = step * STEP_S
        begin = y.copy()
        for stage in range(4):
            later_s = places[stage] * STEP_S
            if stage > 0:
                y[:] = begin + later_s * slopes[stage - 1]
            command = _command(rig, t + later_s, t + 0.5 * STEP_S)
            if drive.kp == 0.0:
                y[0] = command[0]
                y[n] = command[1]
            q = y[:n]
            w = y[n : 2 * n]
            held = y[2 * n : 3 * n]
            _accelerate(rig, drive, q, w, held, command, contact, a, force)
            force[2] += below_m * force[0]
            slopes[stage, :n] = w
            slopes[stage, n : 2 * n] = a
            _load_friction(rig, q, w, a, contact, held, slopes[stage, 2 * n : 3 * n])
            for c in range(CHANNELS):
                felt = y[3 * n + c]
                moving = y[3 * n + CHANNELS + c]
                pull = sensor.rate_rad_s[c] ** 2 * (force[c] - felt)
                slopes[stage, 3 * n + c] = moving
                slopes[stage, 3 * n + CHANNELS + c] = (
                    pull - 2.0 * sensor.ratio * sensor.rate_rad_s[c] * moving
                )
        mean = (slopes[0] + 2.0 * slopes[1] + 2.0 * slopes[2] + slopes[3]) / 6.0
        y[:] = begin + STEP_S * mean
        # The command of this step at its end, so that a jump counts for the next sample.
        command = _command(rig, t + STEP_S, t + 0.5 * STEP_S)
        if drive.kp == 0.0:
            y[0] = command[0]
            y[n] = command[1]
        held = y[2 * n : 3 * n]
        _accelerate(rig, drive, y[:n], y[n : 2 * n], held, command, contact, a, force)
        force[2] += below_m * force[0]
        # A point that slides keeps no more than the limit, one in the air nothing.
        for k in range(n):
            limit = rig.friction * contact[2, k]
            held[k] = min(max(held[k], -limit), limit)
        if (step + 1) % steps_per_sample == 0:
            for c in range(CHANNELS):
                rings = sensor.rate_rad_s[c] > 0.0
                sample = (step + 1) // steps_per_sample - 1
                readings[sample, c] = y[3 * n + c] if rings else force[c]
