"""Angles that are written in degrees: read as radians, refused beside radians, reported as they
were written.
"""

import math

import pytest

from rfca_rig.campaign.layout import KnownToMechanism
from rfca_rig.campaign.pendulum import ColumnsSection, LinkSection, NoiseSection
from rfca_rig.description.sections import LegSection
from rfca_rig.devices.cubemars.section import CubemarsMitSection
from rfca_rig.errors import BadInput
from rfca_rig.toml import degrees_keys, validate
from tests.description.test_sections import refusal, sections

RADIANS = "start_angle_rad = 0.226893"


def leg_with(**keys):
    leg = {key: value for key, value in sections()["leg"].items() if key != "start_angle_rad"}
    return validate({**leg, **keys}, LegSection, "leg")


@pytest.mark.parametrize("degrees", [14.1, 14, -90.0, 180])
def test_degrees_are_read_as_radians_and_stored_as_radians(degrees):
    leg = leg_with(start_angle_deg=degrees)
    assert leg.start_angle_rad == pytest.approx(math.radians(degrees), rel=1e-15)
    assert leg == leg_with(start_angle_rad=math.radians(degrees))
    assert "start_angle_deg" not in leg.model_dump()


@pytest.mark.parametrize(
    ("section", "keys"),
    [
        (LegSection, {"start_angle_rad": "start_angle_deg"}),
        (CubemarsMitSection, {"zero_rad": "zero_deg"}),
        (KnownToMechanism, {"zero_offset_rad": "zero_offset_deg"}),
        (LinkSection, {"zero_offset_rad": "zero_offset_deg"}),
        (NoiseSection, {"angle_rad": "angle_deg"}),
        # The value is the name of a column whose numbers are in radians.
        (ColumnsSection, {}),
    ],
)
def test_every_angle_of_the_files_takes_degrees_and_nothing_else(section, keys):
    assert degrees_keys(section) == keys


def test_both_units_are_refused(tmp_path):
    said = refusal(tmp_path, RADIANS, f"{RADIANS}\nstart_angle_deg = 13.0")
    assert said == (
        "rig.toml:1: leg: start_angle_rad and start_angle_deg both state one angle; "
        "leave one of them out"
    )


def test_a_limit_and_the_value_are_reported_in_degrees_with_the_line(tmp_path):
    said = refusal(tmp_path, RADIANS, "start_angle_deg = 400.0")
    assert said == "rig.toml:9: leg.start_angle_deg: should be less than or equal to 180, not 400.0"


@pytest.mark.parametrize("value", ['"13"', "true"])
def test_what_is_no_number_is_refused_under_its_own_key(tmp_path, value):
    assert refusal(tmp_path, RADIANS, f"start_angle_deg = {value}").startswith(
        "rig.toml:9: leg.start_angle_deg: should be a number"
    )


def test_a_number_that_is_no_angle_is_refused(tmp_path):
    assert refusal(tmp_path, RADIANS, "start_angle_deg = inf").startswith(
        "rig.toml:9: leg.start_angle_deg: should be a finite number"
    )


def test_a_misspelt_key_in_degrees_is_suggested(tmp_path):
    assert "did you mean start_angle_deg?" in refusal(tmp_path, RADIANS, "start_angel_deg = 13.0")


def test_a_column_of_radians_takes_no_degrees():
    with pytest.raises(BadInput, match="angle1_deg: unknown key"):
        validate({"t_s": "t", "angle1_deg": "a"}, ColumnsSection, "columns")
