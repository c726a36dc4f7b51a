"""Sensor model of the exam: from the true forces of a simulated stroke to recorded columns, with sensor faults and noise."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.exam.simulator.compiled import jit_cached
from rfca_rig.exam.simulator.engine import Traces
from rfca_rig.exam.simulator.world import World

Floats = NDArray[np.float64]

# Resolution of a recorded force and torque.
COUNT_N, COUNT_NM = 0.005, 5e-5
ENCODER_RAD = 2.0 * np.pi / 2**16
# Steps per sample for a ringing sensor; 40 instead change a force by 1e-5 of itself.
PIECES = 20
NOISE_FX_N, NOISE_TY_NM = 0.1, 0.006
NOISE_ANGLE_RAD, NOISE_SPEED_RAD_S, NOISE_MOTOR_NM = 1e-4, 0.01, 0.05


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
    sensing, t = world.sensing, traces.t_s
    fy, fz = traces.force_y_N, -traces.force_d_N
    # The sensor's origin is below the shaft, so fy adds its moment.
    tx = traces.leg_torque_Nm + world.mount.below_shaft_m * fy
    turned = traces.motor_angle_rad - world.drive.start_angle_rad
    fz = fz + sensing.cogging_N * np.sin(sensing.cogging_cycles * turned)
    fy, fz, tx = sensing.gain * fy, sensing.gain * fz * (1.0 + sensing.curvature_per_N * np.abs(fz)), sensing.gain * tx
    fz = apply_play(fz, sensing.play_N)
    fz = fz + sensing.creep_share * lag_first_order(t, fz, sensing.creep_s) if sensing.creep_share != 0.0 else fz
    fy, fz, tx = fy + sensing.fy_per_fz * fz, fz + sensing.fz_per_fy * fy, tx + sensing.tx_per_fy_m * fy + sensing.tx_per_fz_m * fz
    # The torque tx rings with the direction y, in which it has its lever.
    across_Hz = sensing.ringing_Hz * sensing.y_frequency_ratio
    fy, fz, tx = (
        filter_second_order(t, x, frequency_Hz, sensing.ringing_ratio)
        for x, frequency_Hz in ((fy, across_Hz), (fz, sensing.ringing_Hz), (tx, across_Hz))
    )
    fy, fz, tx = (delay(t, lag_first_order(t, x, sensing.lag_s), sensing.clock_offset_s + sensing.clock_rate * t) for x in (fy, fz, tx))
    fz = fz + sensing.drift_N_per_s * t + sensing.hum_N * np.sin(2.0 * np.pi * sensing.hum_Hz * t)
    fz = np.clip(fz, -sensing.clip_N, sensing.clip_N)
    fz = np.where(np.abs(fz) < sensing.dead_N, 0.0, fz)
    return fy, np.round(fz / sensing.digit_N) * sensing.digit_N if sensing.digit_N > 0.0 else fz, tx


def lag_first_order(t_s: Floats, x: Floats, tau_s: float) -> Floats:
    """First-order low-pass tau y' = x - y of x (m,) at times (m,), bilinear (second order); settled at the first sample."""
    if tau_s <= 0.0:
        return x
    y = x.copy()
    for i in range(1, len(x)):
        share = (t_s[i] - t_s[i - 1]) / tau_s
        y[i] = ((1.0 - 0.5 * share) * y[i - 1] + 0.5 * share * (x[i] + x[i - 1])) / (1.0 + 0.5 * share)
    return y


def delay(t_s: Floats, x: Floats, offset_s: float | Floats) -> Floats:
    """x (m,) at times (m,) as it was `offset_s` before, linear between samples; `offset_s` is one number or (m,). The ends are held."""
    return np.interp(t_s - offset_s, t_s, x) if np.any(offset_s) else x


def filter_second_order(t_s: Floats, x: Floats, frequency_Hz: float, ratio: float) -> Floats:
    """x (m,) filtered by a mass on a spring with damping ratio `ratio`, in short drift-kick-drift steps; at rest at the first sample."""
    if frequency_Hz <= 0.0:
        return x
    y = x.copy()
    integrate_second_order(t_s, x, 2.0 * np.pi * frequency_Hz, ratio, y)
    return y


@jit_cached
def integrate_second_order(t_s: Floats, x: Floats, rate: float, ratio: float, y: Floats) -> None:
    """Integrate y'' = w^2 (x - y) - 2 d w y' into y (m,), with x (m,) linear between samples at t_s (m,) and PIECES steps for each.

    w is `rate` in rad/s, d is `ratio`. Second order: half a drift, a kick with half-implicit damping, half a drift.
    """
    place, speed = x[0], 0.0
    for i in range(1, x.size):
        h = (t_s[i] - t_s[i - 1]) / PIECES
        for piece in range(PIECES):
            place += 0.5 * h * speed
            now = x[i - 1] + (x[i] - x[i - 1]) * (piece + 0.5) / PIECES
            speed = (speed * (1.0 - h * ratio * rate) + h * rate * rate * (now - place)) / (1.0 + h * ratio * rate)
            place += 0.5 * h * speed
        y[i] = place


def apply_play(x: Floats, half_width: float) -> Floats:
    """x (m,) behind a play of this half width: the output stays until it is dragged."""
    if half_width == 0.0:
        return x
    y = x.copy()
    for i in range(1, len(x)):
        y[i] = min(max(y[i - 1], x[i] - half_width), x[i] + half_width)
    return y


def record_columns(world: World, traces: Traces, noise: Noise, random: np.random.Generator) -> dict[str, Floats]:
    """Columns (m,) of a dynamic recording, with noise and finite resolution."""
    m = len(traces.t_s)
    fy, fz, tx = sense(world, traces)

    def noisy(x: Floats | float, std: float, digit: float) -> Floats:
        return np.asarray(np.round((x + random.normal(0.0, std, m)) / digit) * digit)

    return {
        # The order of the columns is the order of the random draws: another one would change every recording of a seed.
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
