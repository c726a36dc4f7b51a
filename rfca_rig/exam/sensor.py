"""From the forces of a simulated stroke to what the sensor reports: its faults, and its noise."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.exam.engine import Traces
from rfca_rig.exam.world import World

Floats = NDArray[np.float64]

COUNT_N, COUNT_NM = 0.005, 5e-5  # last digit of force and torque
ENCODER_RAD = 2.0 * np.pi / 2**16
NOISE_FX_N, NOISE_TY_NM = 0.1, 0.006
NOISE_ANGLE_RAD, NOISE_SPEED_RAD_S, NOISE_MOTOR_NM = 1e-4, 0.01, 0.05


@dataclass(frozen=True)
class Noise:
    """One standard deviation of a sample."""

    fy_N: float = 0.10
    fz_N: float = 0.15
    tx_Nm: float = 0.006


def felt(world: World, traces: Traces) -> tuple[Floats, Floats, Floats]:
    """(fy, fz, tx) as a sensor without noise reports them. fz points down: the leg's weight is positive."""
    sensing, t = world.sensing, traces.t_s
    fy, fz = traces.force_y_N, -traces.force_d_N
    tx = traces.leg_torque_Nm + world.mount.below_shaft_m * fy
    turned = traces.motor_angle_rad - world.drive.start_angle_rad
    fz = fz + sensing.cogging_N * np.sin(sensing.cogging_cycles * turned)
    fy, fz, tx = sensing.gain * fy, sensing.gain * fz * (1.0 + sensing.curvature_per_N * np.abs(fz)), sensing.gain * tx
    fz = fz + sensing.fz_per_fy * fy
    fy, fz, tx = (delayed(t, lagged(t, x, sensing.lag_s), sensing.clock_offset_s) for x in (fy, fz, tx))
    return fy, np.clip(fz + sensing.drift_N_per_s * t, -sensing.clip_N, sensing.clip_N), tx


def lagged(t_s: Floats, x: Floats, tau_s: float) -> Floats:
    """First-order low-pass, bilinear: tau y' = x - y, settled at the first sample."""
    if tau_s <= 0.0:
        return x
    y = x.copy()
    for i in range(1, len(x)):
        share = (t_s[i] - t_s[i - 1]) / tau_s
        y[i] = ((1.0 - 0.5 * share) * y[i - 1] + 0.5 * share * (x[i] + x[i - 1])) / (1.0 + 0.5 * share)
    return y


def delayed(t_s: Floats, x: Floats, offset_s: float) -> Floats:
    """x as it was `offset_s` before; the ends are held."""
    return x if offset_s == 0.0 else np.interp(t_s - offset_s, t_s, x)


def recorded(world: World, traces: Traces, noise: Noise, random: np.random.Generator) -> dict[str, Floats]:
    """The columns of a dynamic recording, noise and last digits included."""
    m = len(traces.t_s)
    fy, fz, tx = felt(world, traces)

    def noisy(x: Floats | float, std: float, digit: float) -> Floats:
        return np.asarray(np.round((x + random.normal(0.0, std, m)) / digit) * digit)

    return {
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
