"""Sizes of hidden effects: from hardly visible to gross, relative to the noise of one sample.

The ranges shift the trace of fz before the valley by about 2 to 50 times the noise of a sample, 0.15 N, at 215 mm and 2.4 rad/s. They stay
within what is plausible on a leg of 0.3 kg and 0.3 m. Strength 0 is the first value, 1 the second, geometric in between. `either_sign`
draws a sign; `around` is a nominal value to which the amount is added.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rfca_rig.exam.simulator.world import HINGES


@dataclass(frozen=True)
class SizeRange:
    """One parameter from `faint` to `strong`. A `free` one does not follow the strength but is drawn between the two."""

    faint: float
    strong: float
    free: bool = False
    either_sign: bool = False
    around: float = 0.0

    def at(self, strength: float, random: np.random.Generator) -> float:
        """A value at strength 0 to 1."""
        share = random.random() if self.free else strength
        size = float(self.faint * (self.strong / self.faint) ** share)
        sign = random.choice([-1.0, 1.0]) if self.either_sign else 1.0
        # Four digits, so that the truth states exactly the value that was simulated.
        return float(f"{self.around + sign * size:.4g}")


SIZE_RANGES: Mapping[str, Mapping[str, SizeRange]] = {
    "hinge_coulomb_friction": {"torque_Nm": SizeRange(0.01, 0.3)},
    "hinge_viscous_damping": {"coefficient_Nm_s_per_rad": SizeRange(0.02, 0.4)},
    "hinge_backlash": {"half_gap_deg": SizeRange(0.05, 2.0)},
    "hinge_stop": {"angle_deg": SizeRange(24.0, 18.0), "stiffness_Nm_per_rad": SizeRange(10.0, 30.0)},
    "spring_hysteresis": {"strength_relative": SizeRange(0.02, 0.5), "saturation_deg": SizeRange(2.0, 12.0, free=True)},
    "spring_relaxation": {"strength_relative": SizeRange(0.02, 0.5), "time_constant_s": SizeRange(0.03, 3.0, free=True)},
    "damaged_hinge": {"stiffness_factor": SizeRange(0.95, 0.5)},
    "stiffness_hardening": {"k2_per_rad2": SizeRange(0.15, 2.5, either_sign=True, around=4.2)},
    "hinge_rest_angle": {"angle_deg": SizeRange(0.8, 5.0, either_sign=True)},
    "hinge_rest_angle_of_one": {"angle_deg": SizeRange(1.0, 6.0, either_sign=True)},
    "tip_mass": {"mass_g": SizeRange(3.0, 60.0)},
    "fluid_drag": {"coefficient_N_s2_per_m3": SizeRange(1.0, 30.0)},
    "ground_stribeck": {"rise_relative": SizeRange(0.15, 1.0), "speed_m_s": SizeRange(0.05, 0.6, free=True)},
    "ground_compliance": {"stiffness_N_per_m1p5": SizeRange(1.5e5, 8e3)},
    "ground_tilt": {"slope": SizeRange(0.002, 0.04, either_sign=True)},
    "ground_adhesion": {"force_N": SizeRange(0.5, 12.0)},
    "motor_speed_droop": {"kp_Nm_s_per_rad": SizeRange(45.0, 2.0), "ki_Nm_per_rad": SizeRange(450.0, 12.0)},
    "motor_speed_ripple": {"amplitude_relative": SizeRange(0.01, 0.2), "cycles_per_turn": SizeRange(2.0, 30.0, free=True)},
    "shaft_compliance": {"stiffness_Nm_per_rad": SizeRange(1000.0, 50.0)},
    "frame_compliance": {
        "frequency_Hz": SizeRange(30.0, 6.0),
        "moving_mass_kg": SizeRange(1.0, 8.0, free=True),
        "damping_ratio": SizeRange(0.02, 0.1, free=True),
    },
    "height_offset": {"offset_mm": SizeRange(0.5, 5.0, either_sign=True)},
    "gravity_tilt": {"angle_rad": SizeRange(0.01, 0.08, either_sign=True)},
    "sensor_lag": {"time_constant_s": SizeRange(0.001, 0.02)},
    "clock_offset": {"offset_s": SizeRange(0.001, 0.02, either_sign=True)},
    "sensor_crosstalk": {"fz_per_fy": SizeRange(0.005, 0.1, either_sign=True)},
    "sensor_drift": {"rate_N_per_s": SizeRange(0.15, 4.0, either_sign=True)},
    "sensor_gain": {"factor": SizeRange(0.005, 0.08, either_sign=True, around=1.0)},
    "hinge_quadratic_damping": {"coefficient_Nm_s2_per_rad2": SizeRange(0.01, 0.1)},
    "heavier_link": {"mass_factor": SizeRange(1.3, 3.0)},
    "ground_exponent": {"exponent": SizeRange(0.05, 0.5, either_sign=True, around=1.5)},
    "sensor_saturation": {"limit_N": SizeRange(40.0, 15.0)},
    "sensor_ringing": {"frequency_Hz": SizeRange(60.0, 12.0), "damping_ratio": SizeRange(0.03, 0.3, free=True)},
    "sensor_clock_rate": {"rate_relative": SizeRange(0.001, 0.02, either_sign=True)},
    "shaft_friction": {"torque_Nm": SizeRange(0.01, 0.5)},
    "shaft_play": {"half_gap_deg": SizeRange(0.3, 2.0)},
    "motor_cogging": {"torque_Nm": SizeRange(0.1, 2.0), "cycles_per_turn": SizeRange(6.0, 40.0, free=True)},
    "motor_torque_limit": {"limit_Nm": SizeRange(8.0, 5.0)},
    "stiffness_fading": {"loss_per_decade_relative": SizeRange(0.01, 0.15)},
    "ground_bump": {
        "height_mm": SizeRange(0.3, 4.0, either_sign=True),
        "at_mm": SizeRange(40.0, 150.0, free=True),
        "width_mm": SizeRange(10.0, 40.0, free=True),
    },
    "sensor_crosstalk_matrix": {
        "fz_per_fy": SizeRange(0.005, 0.1, either_sign=True),
        "fy_per_fz": SizeRange(0.005, 0.1, either_sign=True),
        "tx_per_fy_mm": SizeRange(0.2, 5.0, either_sign=True),
        "tx_per_fz_mm": SizeRange(0.2, 5.0, either_sign=True),
    },
}

UNKNOWN_FAULT_RANGES: Mapping[str, Mapping[str, SizeRange]] = {
    "force_cogging": {"force_N": SizeRange(0.4, 3.0), "cycles_per_turn": SizeRange(12.0, 48.0, free=True)},
    "hinge_asymmetry": {"share": SizeRange(0.08, 0.4, either_sign=True)},
    "floor_magnet": {"force_N": SizeRange(1.0, 8.0), "reach_mm": SizeRange(5.0, 25.0, free=True)},
    "friction_by_direction": {"backward_share": SizeRange(1.15, 2.0)},
    "sensor_curvature": {"per_N": SizeRange(0.0006, 0.005, either_sign=True)},
    "stiffness_falls_with_repeats": {"share_per_repeat": SizeRange(0.015, 0.06)},
    "sensor_play": {"half_width_N": SizeRange(0.4, 3.0)},
    "sensor_creep": {"share": SizeRange(0.02, 0.2), "time_s": SizeRange(0.2, 1.0, free=True)},
    "mains_hum": {"amplitude_N": SizeRange(0.3, 3.0), "frequency_Hz": SizeRange(50.0, 100.0, free=True)},
    "sensor_dead_band": {"below_N": SizeRange(1.5, 8.0)},
    "coarse_digits": {"digit_N": SizeRange(1.0, 6.0)},
    "hinge_detents": {"torque_Nm": SizeRange(0.08, 0.6), "per_turn": SizeRange(30.0, 90.0, free=True)},
    "tendon": {"stiffness_Nm_per_rad": SizeRange(0.1, 1.0)},
    "slick_patch": {
        "friction_factor": SizeRange(0.8, 0.3),
        "at_mm": SizeRange(40.0, 120.0, free=True),
        "width_mm": SizeRange(30.0, 80.0, free=True),
    },
    "soft_patch": {
        "stiffness_factor": SizeRange(0.7, 0.2),
        "at_mm": SizeRange(40.0, 120.0, free=True),
        "width_mm": SizeRange(30.0, 80.0, free=True),
    },
    "shaking_floor": {"amplitude_mm": SizeRange(0.1, 0.8), "frequency_Hz": SizeRange(8.0, 40.0, free=True)},
    "hose_at_the_shaft": {"stiffness_Nm_per_rad": SizeRange(0.02, 0.3)},
}


def sample_values(effect_id: str, strength: float, random: np.random.Generator) -> dict[str, float]:
    """Parameters of a catalogue effect at a strength from 0 to 1."""
    values = {name: span.at(strength, random) for name, span in SIZE_RANGES[effect_id].items()}
    if effect_id == "heavier_link":
        values["link"] = float(random.integers(2, HINGES + 1))
    if effect_id in ("damaged_hinge", "hinge_rest_angle_of_one"):
        # Not the last hinge: it bends too little to be distinguished.
        values["hinge"] = float(random.integers(2, HINGES + 1))
    return values


def sample_unknown_fault(name: str, strength: float, random: np.random.Generator) -> dict[str, float]:
    """Parameters of an effect outside the catalogue at a strength from 0 to 1."""
    return {key: span.at(strength, random) for key, span in UNKNOWN_FAULT_RANGES[name].items()}
