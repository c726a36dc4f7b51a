"""Every effect at no strength leaves the stroke alone, at a plausible one it does not; in any
combination it runs.
"""

import numpy as np
import pytest

from rfca_rig.errors import BadInput
from rfca_rig.model.catalogue import catalogue
from rfca_rig.model.chain import Tolerance
from tests.model.effects.rigs import paper_stroke

FINE = Tolerance(1e-6, 3e-3)
OTHER_STEPS = {  # other equations, other steps: their error, rms of fz
    "shaft_compliance": 5e-3,
    "motor_torque_limit": 2e-2,
    "shaft_friction": 2e-4,
    "frame_compliance": 2e-4,
    "ground_compliance": 2e-4,
    "ground_exponent": 2e-4,
    "hinge_backlash": 2e-4,
    "motor_speed_droop": 2e-4,
    "motor_speed_ripple": 2e-4,
}

NEUTRAL = {
    "hinge_coulomb_friction": {"torque_Nm": 0.0},
    "hinge_viscous_damping": {"coefficient_Nm_s_per_rad": 0.0},
    "hinge_quadratic_damping": {"coefficient_Nm_s2_per_rad2": 0.0},
    "hinge_backlash": {"half_gap_deg": 0.0},
    "hinge_stop": {"angle_deg": 170.0, "stiffness_Nm_per_rad": 100.0},
    "spring_hysteresis": {"strength_relative": 0.0, "saturation_deg": 5.0},
    "spring_relaxation": {"strength_relative": 0.0, "time_constant_s": 0.2},
    "damaged_hinge": {"hinge": 3.0, "stiffness_factor": 1.0},
    "stiffness_hardening": {"k2_per_rad2": 4.56},
    "stiffness_fading": {"loss_per_decade_relative": 0.0},
    "hinge_rest_angle": {"angle_deg": 0.0},
    "hinge_rest_angle_of_one": {"hinge": 3.0, "angle_deg": 0.0},
    "tip_mass": {"mass_g": 0.0},
    "heavier_link": {"link": 3.0, "mass_factor": 1.0},
    "ground_stribeck": {"rise_relative": 0.0, "speed_m_s": 0.1},
    "ground_compliance": {"stiffness_N_per_m1p5": 1e18},
    "ground_exponent": {"exponent": 1.5},
    "ground_tilt": {"slope": 0.0},
    "ground_adhesion": {"force_N": 0.0},
    "ground_bump": {"height_mm": 0.0, "at_mm": 80.0, "width_mm": 20.0},
    "motor_speed_droop": {"kp_Nm_s_per_rad": 1e8, "ki_Nm_per_rad": 1e9},
    "motor_speed_ripple": {"amplitude_relative": 0.0, "cycles_per_turn": 10.0},
    "motor_cogging": {"torque_Nm": 0.0, "cycles_per_turn": 14.0},
    "motor_torque_limit": {"limit_Nm": 1e9, "kp_Nm_s_per_rad": 1e8, "ki_Nm_per_rad": 1e9},
    "shaft_compliance": {"stiffness_Nm_per_rad": 1e10},
    "shaft_play": {"half_gap_deg": 0.0},
    "shaft_friction": {"torque_Nm": 0.0},
    "frame_compliance": {"frequency_Hz": 100.0, "moving_mass_kg": 1e9, "damping_ratio": 0.1},
    "height_offset": {"offset_mm": 0.0},
    "gravity_tilt": {"angle_rad": 0.0},
    "fluid_drag": {"coefficient_N_s2_per_m3": 0.0},
    "sensor_lag": {"time_constant_s": 1e-9},
    "sensor_ringing": {"frequency_Hz": 1e9, "damping_ratio": 0.7},
    "clock_offset": {"offset_s": 0.0},
    "sensor_clock_rate": {"rate_relative": 0.0},
    "sensor_crosstalk": {"fz_per_fy": 0.0},
    "sensor_crosstalk_matrix": {
        "fz_per_fy": 0.0,
        "fy_per_fz": 0.0,
        "tx_per_fy_mm": 0.0,
        "tx_per_fz_mm": 0.0,
    },
    "sensor_saturation": {"limit_N": 1e9},
    "sensor_drift": {"rate_N_per_s": 0.0},
    "sensor_gain": {"factor": 1.0},
}

SMALL = {
    "hinge_coulomb_friction": {"torque_Nm": 0.02},
    "hinge_viscous_damping": {"coefficient_Nm_s_per_rad": 0.02},
    "hinge_quadratic_damping": {"coefficient_Nm_s2_per_rad2": 0.01},
    "hinge_backlash": {"half_gap_deg": 0.3},
    "hinge_stop": {"angle_deg": 15.0, "stiffness_Nm_per_rad": 20.0},
    "spring_hysteresis": {"strength_relative": 0.05, "saturation_deg": 3.0},
    "spring_relaxation": {"strength_relative": 0.05, "time_constant_s": 0.2},
    "damaged_hinge": {"hinge": 3.0, "stiffness_factor": 0.9},
    "stiffness_hardening": {"k2_per_rad2": 6.0},
    "stiffness_fading": {"loss_per_decade_relative": 0.03},
    "hinge_rest_angle": {"angle_deg": 0.2},
    "hinge_rest_angle_of_one": {"hinge": 3.0, "angle_deg": 1.0},
    "tip_mass": {"mass_g": 5.0},
    "heavier_link": {"link": 3.0, "mass_factor": 1.3},
    "ground_stribeck": {"rise_relative": 0.2, "speed_m_s": 0.1},
    "ground_compliance": {"stiffness_N_per_m1p5": 2e5},
    "ground_exponent": {"exponent": 1.3},
    "ground_tilt": {"slope": 0.01},
    "ground_adhesion": {"force_N": 0.5},
    "ground_bump": {"height_mm": 1.0, "at_mm": 80.0, "width_mm": 20.0},
    "motor_speed_droop": {"kp_Nm_s_per_rad": 20.0, "ki_Nm_per_rad": 200.0},
    "motor_speed_ripple": {"amplitude_relative": 0.01, "cycles_per_turn": 8.0},
    "motor_torque_limit": {"limit_Nm": 6.1},
    "motor_cogging": {"torque_Nm": 0.3, "cycles_per_turn": 14.0},
    "shaft_compliance": {"stiffness_Nm_per_rad": 500.0},
    "shaft_play": {"half_gap_deg": 0.5},
    "shaft_friction": {"torque_Nm": 0.05},
    "frame_compliance": {"frequency_Hz": 20.0, "moving_mass_kg": 5.0, "damping_ratio": 0.05},
    "height_offset": {"offset_mm": 0.5},
    "gravity_tilt": {"angle_rad": 0.01},
    "fluid_drag": {"coefficient_N_s2_per_m3": 1.0},
    "sensor_lag": {"time_constant_s": 0.002},
    "sensor_ringing": {"frequency_Hz": 30.0, "damping_ratio": 0.1},
    "clock_offset": {"offset_s": 0.003},
    "sensor_clock_rate": {"rate_relative": 0.003},
    "sensor_crosstalk": {"fz_per_fy": 0.02},
    "sensor_crosstalk_matrix": {
        "fz_per_fy": 0.01,
        "fy_per_fz": -0.01,
        "tx_per_fy_mm": 1.0,
        "tx_per_fz_mm": -1.0,
    },
    "sensor_saturation": {"limit_N": 45.0},
    "sensor_drift": {"rate_N_per_s": 0.2},
    "sensor_gain": {"factor": 1.02},
}


@pytest.fixture(scope="module")
def plain():
    return paper_stroke(FINE)


def test_the_tables_of_this_test_miss_no_effect():
    assert set(NEUTRAL) == set(SMALL) == set(catalogue())


@pytest.mark.parametrize("id_", sorted(NEUTRAL))
def test_at_no_strength_an_effect_leaves_the_stroke_alone(id_, plain):
    stroke = paper_stroke(FINE, **{id_: NEUTRAL[id_]})
    for name in ("fy_N", "fz_N", "tx_Nm", "q_rad"):
        assert np.sqrt(
            np.mean((getattr(stroke, name) - getattr(plain, name)) ** 2)
        ) < OTHER_STEPS.get(id_, 1e-6), name


@pytest.mark.parametrize("id_", sorted(SMALL))
def test_at_a_plausible_strength_an_effect_shows_in_the_force(id_, plain):
    stroke = paper_stroke(FINE, **{id_: SMALL[id_]})
    if id_ == "shaft_friction":  # of a shaft that turns as told only the torque tells
        assert 0.01 < np.sqrt(np.mean((stroke.tx_Nm - plain.tx_Nm) ** 2)) < 1.0
    else:
        assert 0.01 < np.sqrt(np.mean((stroke.fz_N - plain.fz_N) ** 2)) < 10.0


SOFT_DRIVES = (
    "motor_cogging",
    "motor_torque_limit",
    "shaft_compliance",
    "shaft_play",
)  # beside motor_speed_droop
TOGETHER = {name: values for name, values in SMALL.items() if name not in SOFT_DRIVES}


def test_all_effects_at_once_run():
    stroke = paper_stroke(**TOGETHER)
    assert np.isfinite(stroke.fz_N).all()
    assert -100.0 < stroke.fz_N.min() < -15.0


@pytest.mark.parametrize("case", range(20))
def test_any_two_effects_run_together_and_give_the_same_bytes_again(case):
    random = np.random.default_rng(case)
    names = random.choice(sorted(TOGETHER), 2, replace=False)
    pair = {str(name): TOGETHER[name] for name in names}
    first = paper_stroke(**pair)
    again = paper_stroke(**pair)
    assert np.isfinite(first.fz_N).all()
    assert first.fz_N.tobytes() == again.fz_N.tobytes()
    assert first.q_rad.tobytes() == again.q_rad.tobytes()


def test_two_soft_drives_in_series_are_refused_rather_than_one_forgotten():
    with pytest.raises(BadInput, match="one at a time"):
        paper_stroke(**SMALL)
