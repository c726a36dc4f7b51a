"""Strokes in closed form, whose valley is known."""

import numpy as np

from rfca_rig.recording.model import Column, Stream, Stroke

REST_N = 3.1
TOUCHDOWN_S = 0.25
VALLEY_S = 1.0803
VALLEY_N = -50.7
LIFT_OFF_S = VALLEY_S + 0.05


def even(rate_Hz: float, end_s: float = 1.4) -> np.ndarray:
    return np.arange(round(-0.1 * rate_Hz), round(end_s * rate_Hz)) / rate_Hz


def uneven(rng: np.random.Generator, samples: int = 3000) -> np.ndarray:
    return np.sort(rng.uniform(-0.1, 1.4, samples))


CURVATURE = 6000.0  # N/s^2, about that of the paper's leg


def fz(
    t_s: np.ndarray,
    valley_s: float = VALLEY_S,
    valley_N: float = VALLEY_N,
    spike_N: float = 0.0,
    rebound_N: float = -60.0,
) -> np.ndarray:
    """Rest; from touchdown a straight fall that rounds off into a parabola, the valley; a whip
    up to +45 N; a rebound, maybe deeper.
    """
    fall = -valley_N / (valley_s - TOUCHDOWN_S)
    straight_until = valley_s - fall / CURVATURE
    parabola = valley_N + 0.5 * CURVATURE * (t_s - valley_s) ** 2
    straight = valley_N + 0.5 * fall**2 / CURVATURE - fall * (t_s - straight_until)
    lift_off_s = valley_s + 0.05
    whip = 45.0 * np.exp(-(((t_s - lift_off_s - 0.015) / 0.008) ** 2))
    rebound = (rebound_N - REST_N) * np.exp(-(((t_s - lift_off_s - 0.07) / 0.012) ** 2))
    after = np.where(
        t_s >= lift_off_s,
        REST_N + whip + rebound,
        np.where(t_s < straight_until, straight, parabola),
    )
    return np.where(t_s < TOUCHDOWN_S, REST_N, after) + spike_N * np.exp(
        -(((t_s - TOUCHDOWN_S - 0.002) / 0.001) ** 2)
    )


def stroke(
    t_s: np.ndarray,
    fz_N: np.ndarray | None,
    *,
    height_m: float = 0.215,
    speed_rad_s: float = 2.433,
    repeat: int = 1,
    **shaft: np.ndarray,
) -> Stroke:
    """`shaft` are further channels by their names."""
    values = {**({} if fz_N is None else {"fz_N": fz_N}), **shaft}
    columns = {name: Column(np.asarray(value), "") for name, value in values.items()}
    return Stroke(height_m, speed_rad_s, repeat, {"table": Stream(t_s, columns)})
