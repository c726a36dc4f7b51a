"""Other spring pieces in the leg: what scales, what breaks, and what is said where nothing can
be computed.
"""

import json

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from rfca_rig.analysis.prediction import predict_stroke
from rfca_rig.analysis.strips import Strain, compare_strips
from rfca_rig.cli.commands.predict import strip
from tests.model.legs import PAPER


@pytest.fixture(scope="module")
def comparison():
    return compare_strips(PAPER, 0.215, 2.433)


@pytest.fixture(scope="module")
def rows(comparison):
    return {(row.material.name, round(1e3 * row.thickness_m, 3)): row for row in comparison.rows}


def test_the_four_materials_stand_at_both_thicknesses(rows):
    assert set(rows) == {
        (name, thickness) for name in ("VMQ", "PA12", "CFRP", "CFSP") for thickness in (0.8, 0.3)
    }


def test_the_leg_s_own_strip_gives_the_leg_s_own_stroke(rows):
    own = rows["CFSP", 0.8]
    expected = predict_stroke(PAPER, 0.215, 2.433, 200.0)
    assert own.k0_Nm_per_rad == pytest.approx(10.98)
    assert own.stroke.valley_fz_N == pytest.approx(expected.summary()["valley_fz_N"], abs=1e-3)
    assert own.stroke.largest_angle_rad == pytest.approx(
        np.abs(np.diff(expected.stroke.q_rad, axis=1)).max()
    )


def test_stiffness_goes_with_the_modulus_and_the_cube_of_the_thickness(rows):
    for (name, thickness), row in rows.items():
        modulus_GPa = {"VMQ": 0.006, "PA12": 2.75, "CFRP": 125.46, "CFSP": 120.0}[name]
        scale = modulus_GPa / 120.0 * (thickness / 0.8) ** 3
        assert row.k0_Nm_per_rad == pytest.approx(10.98 * scale)
        assert row.hinge_Nm_per_rad == pytest.approx(
            120e9 * 2 * 0.0254 * 0.0008**3 / 12 / 0.039333 * scale, rel=1e-6
        )


def test_a_stiffer_strip_presses_harder_in_proportion_nearly(rows):
    ratio = rows["CFRP", 0.8].stroke.valley_fz_N / rows["CFSP", 0.8].stroke.valley_fz_N
    assert 1.04 < ratio < 125.46 / 120.0 + 0.01


def test_strain_is_half_the_thickness_times_angle_over_length(rows, comparison):
    row = rows["CFSP", 0.8]
    angle = row.stroke.largest_angle_rad
    strain = row.strain
    assert strain.strain_spread == pytest.approx(0.0004 * angle / 0.039333)
    assert strain.share_spread == pytest.approx(120e9 * strain.strain_spread / 651e6)
    assert strain.share_concentrated == pytest.approx(
        strain.share_spread * 0.039333 / comparison.concentrated_m
    )
    assert strain.share_torque == pytest.approx(
        10.98 * (angle + 4.56 * angle**3) / 3.5276, rel=1e-3
    )


def test_a_strip_that_would_break_is_said_so(rows):
    assert (
        rows["CFSP", 0.8].verdict()
        == "breaks where it bends over less than 30.2 mm, cannot carry the hinge torque alone"
    )
    assert rows["PA12", 0.8].verdict() == "holds"
    assert (
        Strain(0.02, 2e9, 0.8, 1.1, 0.9, 0.025).verdict()
        == "breaks where it bends over less than 25.0 mm"
    )
    assert Strain(0.02, 2e9, 1.2, 1.9, 1.3, 0.05).verdict() == "breaks"


def test_a_limp_leg_keeps_its_row_and_says_why(rows):
    limp = rows["VMQ", 0.8]
    lying = rows["PA12", 0.8]
    assert "no rest pose" in limp.stroke.no_valley
    assert limp.verdict() == "strain not known"
    assert "lies on the ground" in lying.stroke.no_valley


def typed(*words):
    app = typer.Typer()
    app.command()(strip)
    return CliRunner().invoke(app, words)


def test_the_table_has_a_line_for_every_strip():
    lines = typed("--height", "235", "--speed", "2.478").stdout.splitlines()
    assert "stroke of 235 mm, 2.478 rad/s:" in lines
    named = [
        line.split()[:2] for line in lines if line[:4].strip() in ("VMQ", "PA12", "CFRP", "CFSP")
    ]
    assert named == 3 * [[m, t] for t in ("0.8", "0.3") for m in ("VMQ", "PA12", "CFRP", "CFSP")]
    assert max(map(len, lines)) <= 80


def test_json_is_plain_and_whole():
    rows = json.loads(typed("--json").stdout, parse_constant=pytest.fail)["rows"]
    assert len(rows) == 8
    assert all(row["verdict"] for row in rows)
