from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.model.parameters import TorqueSpline
from rfca_rig.reports.page_units import page_name, text_in_degrees
from rfca_rig.reports.strokes.page import parameter_lines
from rfca_rig.reports.text import count_noun, in_thousands, keep_units_together, number, spread
from tests.model.legs import PAPER


@pytest.mark.parametrize(
    ("value", "said"), [(-1.25, "\u22121.25"), (-0.001, "0.00"), (None, "\u2013"), (3.0, "3.00")]
)
def test_numbers_have_a_true_minus_and_no_minus_nothing(value, said):
    assert number(value, 2) == said


def test_spread_and_counts():
    assert spread(1.0, 0.02, 2) == "1.00 ± 0.02"
    assert spread(1.0, None, 2) == "1.00"
    assert (count_noun(1, "stroke"), count_noun(27, "stroke")) == ("1 stroke", "27 strokes")


def test_units_stay_with_their_numbers():
    assert (
        keep_units_together("rms 0.29 N, at 2.433 rad/s (N m), 3 not")
        == "rms 0.29\u00a0N, at 2.433\u00a0rad/s (N\u00a0m), 3 not"
    )


def test_parameters_are_shown_in_a_labs_units_and_none_is_left_out():
    shown = {(q.section, q.name): (q.value, q.unit) for q in parameter_lines(PAPER)}
    assert shown["leg", "link radius"] == ("3", "mm")
    assert shown["leg", "k0"] == ("10.98", "N m/rad")
    assert shown["ground", "friction coefficient"] == ("0.41", "")
    assert shown["drive", "ramp"] == ("0.05", "s")
    assert shown["leg", "link lengths"][0].startswith("54, 39.333, ")
    assert shown["ground", "tangential damping"] == ("2", "N s/m")
    assert len(shown) == 7 + 7 + 1 + 1


@pytest.mark.parametrize("curves", [1, 6])
def test_a_measured_curve_is_shown_by_its_points(curves):
    splines = (TorqueSpline((0.0, np.radians(10.0), np.radians(20.0)), (0.0, 0.2, 0.5)),) * curves
    leg = replace(PAPER.leg, k0_Nm_per_rad=10.0, k2_per_rad2=0.0, torque_splines=splines)
    lines = parameter_lines(replace(PAPER, leg=leg))
    assert [line.section for line in lines].index("ground") == 6 + curves
    torques = {
        line.name: (line.value, line.unit) for line in lines if line.name.startswith("torque")
    }
    assert torques["torque" if curves == 1 else "torque of hinge 7"] == (
        "2 at 10, 5 at 20",
        "N m at deg",
    )
    assert len(torques) == curves
    assert "k2" not in {line.name for line in lines}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1000303", "1\u202f000\u202f303"),
        ("-12470", "-12\u202f470"),
        ("9999", "9999"),
        ("12345.6789", "12\u202f345.6789"),
        ("0.123456", "0.123456"),
    ],
)
def test_long_numbers_stand_in_groups_of_three(text, said):
    assert in_thousands(text) == said


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("zero of 0.0200 ± 0.0010 rad", "zero of 1.146 ± 0.057 deg"),
        ("\u22120.1 rad, then 0.25\u00a0rad", "\u22125.7 deg, then 14\u00a0deg"),
        (
            "at 2.433 rad/s, k0 11 N m/rad, 3 rad² and 5 radii",
            "at 2.433 rad/s, k0 11 N m/rad, 3 rad² and 5 radii",
        ),
        ("1.2e-05 rad", "1.2e-05 rad"),
    ],
)
def test_angles_in_sentences_are_in_degrees(text, said):
    assert text_in_degrees(text) == said


def test_names_in_degrees_are_those_of_angles_only():
    assert page_name("mass_relative") == ("mass_pct", 100.0)
    names = ["joint1_position_rad", "k0_Nm_per_rad", "speed_rad_s", "rms_shaft_angle_rad"]
    assert [page_name(name)[0] for name in names] == [
        "joint1_position_deg",
        "k0_Nm_per_rad",
        "speed_rad_s",
        "rms_shaft_angle_deg",
    ]
