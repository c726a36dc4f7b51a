"""Recordings as a campaign or a twin would make them, from the model itself with noise."""

from functools import cache

import numpy as np

from rfca_rig.description.model_file import nominal_model
from rfca_rig.model.stroke import simulate_stroke_at_speed
from rfca_rig.recording.model import Recording, StaticStage, Stroke
from tests.analysis import traces

BELIEVED = {
    "leg": {
        "link_lengths_mm": [54.0, *[39.333] * 6],
        "link_masses_g": [59.586, *[43.402] * 6],
        "link_radius_mm": 3.0,
        "hinge_torque_Nm": "k0*phi + k0*k2*phi**3",
        "k0_Nm_per_rad": 11.0,
        "k2_per_rad2": 4.2,
        "hinge_damping_Nm_s_per_rad": 0.05,
        "start_angle_rad": 0.226893,
    },
    "ground": {
        "contact_stiffness_N_per_m1p5": 1.0e5,
        "contact_damping_s_per_m": 1.0,
        "friction_coefficient": 0.45,
    },
    "sensor": {"below_shaft_mm": 45.0},
    "drive": {"ramp_s": 0.05, "mode": "speed"},
}
KNOWN_TO = {"height_mm": 0.2, "k0_relative": 0.03}
CONDITIONS = ((0.215, 2.433), (0.235, 3.25))


@cache
def strokes(repeats: int = 2, rate_Hz: float = 1000.0) -> tuple[Stroke, ...]:
    t_s = traces.even(rate_Hz, end_s=1.38)
    return tuple(
        _stroke(t_s, height_m, speed_rad_s, repeat)
        for height_m, speed_rad_s in CONDITIONS
        for repeat in range(1, repeats + 1)
    )


def _stroke(t_s: np.ndarray, height_m: float, speed_rad_s: float, repeat: int) -> Stroke:
    simulated = simulate_stroke_at_speed(nominal_model(BELIEVED), height_m, speed_rad_s, t_s)
    noise_N = np.random.default_rng(repeat).normal(0.0, 0.15, len(t_s))
    fz_N = simulated.fz_N + noise_N
    angle_rad = simulated.shaft_angle_rad
    return traces.stroke(
        t_s,
        fz_N,
        height_m=height_m,
        speed_rad_s=speed_rad_s,
        repeat=repeat,
        shaft_angle_rad=angle_rad,
    )


def stages(hinge: float = -5.25) -> tuple[StaticStage, ...]:
    return tuple(
        StaticStage(0.215, stage, "loading", 1.0472, (hinge,) * 6, -1.4977, -3.1541, 1.1848)
        for stage in (1, 2)
    )


def recording(
    strokes=(), static=(), title="A <bold> campaign & more", source="IMPORT", provenance=None
) -> Recording:
    return Recording(
        title, source, BELIEVED, KNOWN_TO, tuple(strokes), tuple(static), provenance or {}
    )
