"""The catalogue: its names are fixed, as reports and diagnoses use them."""

import pytest

from rfca_rig.errors import BadInput
from rfca_rig.model.bench_tests import BENCH_TESTS
from rfca_rig.model.catalogue import catalogue, declarations
from rfca_rig.model.families import FAMILIES
from tests.model.effects.rigs import paper_stroke

PARAMETERS = {
    "hinge_coulomb_friction": ("torque_Nm",),
    "hinge_viscous_damping": ("coefficient_Nm_s_per_rad",),
    "hinge_quadratic_damping": ("coefficient_Nm_s2_per_rad2",),
    "hinge_backlash": ("half_gap_deg",),
    "hinge_stop": ("angle_deg", "stiffness_Nm_per_rad"),
    "spring_hysteresis": ("strength_relative", "saturation_deg"),
    "spring_relaxation": ("strength_relative", "time_constant_s"),
    "damaged_hinge": ("hinge", "stiffness_factor"),
    "stiffness_hardening": ("k2_per_rad2",),
    "hinge_rest_angle": ("angle_deg",),
    "hinge_rest_angle_of_one": ("hinge", "angle_deg"),
    "tip_mass": ("mass_g",),
    "heavier_link": ("link", "mass_factor"),
    "ground_stribeck": ("rise_relative", "speed_m_s"),
    "ground_compliance": ("stiffness_N_per_m1p5",),
    "ground_exponent": ("exponent",),
    "ground_tilt": ("slope",),
    "stiffness_fading": ("loss_per_decade_relative",),
    "ground_bump": ("height_mm", "at_mm", "width_mm"),
    "ground_adhesion": ("force_N",),
    "motor_speed_droop": ("kp_Nm_s_per_rad", "ki_Nm_per_rad"),
    "motor_speed_ripple": ("amplitude_relative", "cycles_per_turn"),
    "motor_torque_limit": ("limit_Nm",),
    "motor_cogging": ("torque_Nm", "cycles_per_turn"),
    "shaft_compliance": ("stiffness_Nm_per_rad",),
    "shaft_play": ("half_gap_deg",),
    "shaft_friction": ("torque_Nm",),
    "frame_compliance": ("frequency_Hz", "moving_mass_kg", "damping_ratio"),
    "height_offset": ("offset_mm",),
    "gravity_tilt": ("angle_rad",),
    "fluid_drag": ("coefficient_N_s2_per_m3",),
    "sensor_lag": ("time_constant_s",),
    "sensor_ringing": ("frequency_Hz", "damping_ratio"),
    "clock_offset": ("offset_s",),
    "sensor_clock_rate": ("rate_relative",),
    "sensor_crosstalk": ("fz_per_fy",),
    "sensor_crosstalk_matrix": ("fz_per_fy", "fy_per_fz", "tx_per_fy_mm", "tx_per_fz_mm"),
    "sensor_saturation": ("limit_N",),
    "sensor_drift": ("rate_N_per_s",),
    "sensor_gain": ("factor",),
}


def test_what_is_declared_of_an_effect_is_there():
    families = {family for effect in declarations() for family in effect.families}
    assert families == {family.id for family in FAMILIES}
    kinds = {effect.bench_test for effect in declarations()} - {""}
    assert kinds == {kind for kind, *_ in BENCH_TESTS}
    known = {effect.id for effect in declarations()}
    assert {effect.variant_of for effect in declarations()} <= {"", *known}


def test_every_name_of_the_table_is_there():
    assert set(PARAMETERS) <= set(catalogue())


@pytest.mark.parametrize("id_", sorted(catalogue()))
def test_an_entry_has_its_names_a_range_and_words(id_):
    effect = catalogue()[id_]
    assert id_ == effect.id
    assert tuple(parameter.name for parameter in effect.parameters) == PARAMETERS[id_]
    assert all(parameter.low < parameter.high for parameter in effect.parameters)
    assert all(
        (effect.where.strip(), effect.left_out.strip(), effect.law.strip(), effect.source.strip())
    )


def test_an_effect_that_is_not_there_is_refused_in_one_line_with_those_that_are():
    with pytest.raises(BadInput) as refused:
        paper_stroke(moonlight={})
    message = str(refused.value)
    assert message.count("\n") == 0
    assert "moonlight" in message
    assert "hinge_backlash" in message


@pytest.mark.parametrize("values", [{}, {"half_gap_rad": 0.1}, {"half_gap_deg": 1.0, "more": 2.0}])
def test_other_parameters_than_its_own_are_refused_in_one_line(values):
    with pytest.raises(BadInput, match="hinge_backlash: takes half_gap_deg") as refused:
        paper_stroke(hinge_backlash=values)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("hinge", [0.0, 1.0, 8.0, float("nan")])
def test_a_hinge_the_leg_does_not_have_is_refused_in_one_line(hinge):
    with pytest.raises(BadInput, match=r"damaged_hinge: hinge .* 2 to 7"):
        paper_stroke(damaged_hinge={"hinge": hinge, "stiffness_factor": 0.5})


@pytest.mark.parametrize("link", [0.0, 8.0])
def test_a_link_the_leg_does_not_have_is_refused_in_one_line(link):
    with pytest.raises(BadInput, match=r"heavier_link: link .* 1 to 7"):
        paper_stroke(heavier_link={"link": link, "mass_factor": 2.0})


def test_two_effects_that_soften_the_drive_are_refused_by_name():
    with pytest.raises(BadInput, match="shaft_compliance and shaft_play both soften the drive"):
        paper_stroke(
            shaft_compliance={"stiffness_Nm_per_rad": 80.0, "relaxation_ms": 0.0},
            shaft_play={"half_gap_deg": 1.0},
        )
