"""Calibration files of ATI DAQ F/T transducers."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rfca_rig.codecs.force_sensors import (
    force_code,
    force_unit,
    newton_metres_per,
    newtons_per,
    torque_code,
    torque_unit,
)
from rfca_rig.devices.ati_daq.codec import GAGES, TransducerCalibration, parse_calibration
from rfca_rig.errors import BadInput, MalformedFrame

MADE_UP = (Path(__file__).parents[2] / "calibration" / "made-up-gamma.cal").read_text()

# six gages that each feel one axis, in the file's own units
PLAIN = """\
<FTSensor Serial="FT1" BodyStyle="Nano17" Family="DAQ" NumGages="6" CalFileVersion="1.1">
<Calibration PartNumber="SI-25-0.25" CalDate="3/5/2014" ForceUnits="lbf" TorqueUnits="N-mm"
 DistUnits="mm" OutputRange="10" OutputBipolar="False">
<Axis Name="Fx" values="9 9 9 9 9 9" max="1" scale="3"/>
<UserAxis Name="Tx" values="0 7 0 2000 0 0" max="250"/>
<UserAxis Name="Ty" values="0 0 0 0 3000 0" max="250"/>
<UserAxis Name="Tz" values="0 0 0 0 0 4000" max="250"/>
<UserAxis Name="Fx" values="1 0 0 0 0 0" max="25"/>
<UserAxis Name="Fy" values=" 0  2\t0 0 0 0 " max="25"/>
<UserAxis Name="Fz" values="0 0 -3e0 0 0 0" max="35"/>
</Calibration>
</FTSensor>
"""
COMPENSATION = (
    '<BiasSlope values="1 2 3 4 5 6"/><GainSlope values="0 0 0 0 0 .5"/><Thermistor '
    'value="2.5"/></Calibration>'
)


def parsed(text: str) -> TransducerCalibration:
    return parse_calibration(text.encode(), "x.cal")


def refusal(old: str, new: str, text: str = PLAIN) -> str:
    assert old in text
    with pytest.raises(BadInput) as caught:
        parsed(text.replace(old, new))
    said = str(caught.value)
    assert "\n" not in said
    assert said.startswith("x.cal: ")
    return said


def test_the_users_matrix_is_read_in_si_whatever_the_files_units_and_order() -> None:
    calibration = parsed(PLAIN)
    lbf_N = 4.4482216152605
    expected = np.diag([lbf_N, 2 * lbf_N, -3 * lbf_N, 2.0, 3.0, 4.0])
    expected[3, 1] = 7e-3
    assert calibration.matrix == pytest.approx(expected, rel=1e-12)
    assert calibration.limits == pytest.approx(
        [25 * lbf_N, 25 * lbf_N, 35 * lbf_N, 0.25, 0.25, 0.25]
    )
    assert (calibration.serial_number, calibration.part_number, calibration.date) == (
        "FT1",
        "SI-25-0.25",
        "3/5/2014",
    )
    assert (calibration.force_unit, calibration.torque_unit) == ("lbf", "N-mm")


def test_the_rails_follow_range_and_polarity() -> None:
    assert parsed(PLAIN).rails_V == (0.0, 10.0)
    assert parsed(MADE_UP).rails_V == (-10.0, 10.0)


def test_our_own_file_is_a_calibration_that_carries_its_rated_loads() -> None:
    calibration = parsed(MADE_UP)
    assert calibration.serial_number == "MADE-UP-1"
    assert calibration.compensated_in_hardware
    assert np.linalg.cond(calibration.matrix) < 100.0
    assert np.abs(calibration.volts(np.diag(calibration.limits), np.zeros(6))).max() < 10.0


def test_volts_and_wrench_are_inverse() -> None:
    calibration = parsed(MADE_UP)
    unloaded = np.linspace(-0.5, 0.5, 6)
    wrench = np.random.default_rng(1).normal(0.0, 50.0, (20, 6))
    assert calibration.wrench(calibration.volts(wrench, unloaded), unloaded) == pytest.approx(
        wrench, abs=1e-9
    )


def test_no_compensation_is_done_that_the_file_does_not_have() -> None:
    assert parsed(PLAIN).temperature is None
    assert parsed(PLAIN).channels == GAGES
    assert not parsed(PLAIN).compensated_in_hardware


def test_compensation_follows_the_formula_of_the_library() -> None:
    calibration = parsed(PLAIN.replace("</Calibration>", COMPENSATION))
    assert calibration.channels == GAGES + 1
    unloaded = np.array([0.0] * 6 + [2.5])
    volts = np.array([[1.0] * 6 + [2.7]])
    # (G + bias slope * (T - reference)) / (1 - gain slope * (T - reference)), by hand
    expected = np.array([1.2, 1.4, 1.6, 1.8, 2.0, 2.2 / 0.9])
    assert calibration.wrench(volts, unloaded)[0] == pytest.approx(calibration.matrix @ expected)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("<FTSensor ", "<NetFTSensor ", "not XML"),
        ("FTSensor", "Sensor", "begins with <Sensor>"),
        ('NumGages="6"', 'NumGages="7"', "NumGages is '7'"),
        ('Serial="FT1"', "", "<FTSensor> lacks Serial"),
        ('ForceUnits="lbf"', 'ForceUnits="pound"', "'pound' is no known unit of force"),
        ('ForceUnits="lbf"', "", "lacks ForceUnits"),
        ('TorqueUnits="N-mm"', 'TorqueUnits="N"', "'N' is no known unit of torque"),
        ('OutputRange="10"', 'OutputRange="-10"', "OutputRange is -10, must be above 0"),
        (
            'OutputBipolar="False"',
            'OutputBipolar="no"',
            "OutputBipolar is 'no', must be True or False",
        ),
        ('Name="Tz"', 'Name="Tx"', "names the axes Tx, Ty, Tx"),
        ("UserAxis", "Axis", "only ATI's internal <Axis> matrix"),
        (
            '"1 0 0 0 0 0"',
            '"1 0 0 0 0"',
            "values of <UserAxis> holds '1 0 0 0 0', expected 6 finite numbers",
        ),
        ('"1 0 0 0 0 0"', '"1 0 0 0 0 nan"', "expected 6 finite numbers"),
        ('"1 0 0 0 0 0"', '"1,0,0,0,0,0"', "expected numbers"),
        ('"1 0 0 0 0 0"', '"0 2 0 0 0 0"', "cannot be inverted"),
        ('max="35"', 'max="0"', "max is 0, must be above 0"),
        ("<FTSensor", '<!DOCTYPE x [<!ENTITY a "b">]><FTSensor', "document type"),
        ("</Calibration>", COMPENSATION.replace("GainSlope", "Gain"), "lacks <GainSlope>"),
        ("</Calibration>", COMPENSATION.replace('"2.5"', '"warm"'), "value of <Thermistor>"),
    ],
)
def test_a_file_that_is_not_whole_and_clear_is_refused_in_one_line(
    old: str, new: str, said: str
) -> None:
    assert said in refusal(old, new)


def test_two_calibrations_in_a_file_are_not_chosen_between() -> None:
    (element,) = re.findall(r"<Calibration.*</Calibration>", PLAIN, re.S)
    assert "holds 2 <Calibration> elements" in refusal(element, element + element)


@given(st.binary(max_size=400))
def test_no_bytes_make_the_reader_raise_anything_but_its_own_error(content: bytes) -> None:
    with pytest.raises(BadInput, match=r"x\.cal: "):
        parse_calibration(content, "x.cal")


@given(st.integers(0, len(PLAIN) - 1), st.integers(1, 40), st.binary(max_size=8))
@settings(max_examples=300)
def test_a_damaged_file_is_refused_or_still_a_calibration(
    at: int, length: int, instead: bytes
) -> None:
    content = PLAIN.encode()
    try:
        calibration = parse_calibration(content[:at] + instead + content[at + length :], "x.cal")
    except BadInput as error:
        assert "\n" not in str(error)
    else:
        assert np.isfinite(calibration.matrix).all()


@pytest.mark.parametrize(
    ("unit", "newtons"),
    [
        ("N", 1.0),
        ("kN", 1e3),
        ("lbf", 4.4482216152605),
        ("lb", 4.4482216152605),
        ("kg", 9.80665),
        ("gf", 9.80665e-3),
    ],
)
def test_a_unit_of_force_in_newtons(unit: str, newtons: float) -> None:
    assert newtons_per(unit) == pytest.approx(newtons, rel=1e-12)


@pytest.mark.parametrize(
    ("unit", "newton_metres"),
    [
        ("N-m", 1.0),
        ("Nmm", 1e-3),
        ("kNm", 1e3),
        ("in-lbf", 0.1129848290276167),
        ("ft-lb", 1.3558179483314),
        ("kgf-cm", 0.0980665),
    ],
)
def test_a_unit_of_torque_in_newton_metres(unit: str, newton_metres: float) -> None:
    assert newton_metres_per(unit) == pytest.approx(newton_metres, rel=1e-12)


def test_codes_of_units_are_those_of_the_manual() -> None:
    assert [force_unit(code) for code in range(1, 7)] == ["lbf", "N", "klbf", "kN", "kgf", "gf"]
    assert [torque_unit(code) for code in range(1, 7)] == [
        "lbf-in",
        "lbf-ft",
        "Nm",
        "Nmm",
        "kgf-cm",
        "kNm",
    ]
    assert [force_code(force_unit(code)) for code in range(1, 7)] == [
        torque_code(torque_unit(code)) for code in range(1, 7)
    ]
    for code in (0, 7, 255):
        with pytest.raises(MalformedFrame, match=f"{code} is no known code"):
            force_unit(code)
