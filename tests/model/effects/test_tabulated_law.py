"""A law given by its values does what the catalogue's formula with the same values does, and a
bad table is one clear line.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rfca_rig.analysis.fitting.result import make_fitted_sections
from rfca_rig.description.model_file import FoundEffect, nominal_model, read_model_file, write_model
from rfca_rig.description.rig_file import read_rig
from rfca_rig.errors import BadInput
from rfca_rig.model.parameters import LawTable, PresentEffect
from rfca_rig.model.stroke import simulate_stroke_at_speed
from tests.model.legs import PAPER

T_S = np.arange(-0.1, 1.4, 1e-3)
RATES = np.linspace(-60.0, 60.0, 3)
SLIPS = np.linspace(-4.0, 4.0, 161)
TWIN = Path(__file__).parents[3] / "calibration" / "twin.toml"


def table(place, argument, knots, values):
    return PresentEffect(
        "tabulated_law",
        table=LawTable(place, argument, tuple(map(float, knots)), tuple(map(float, values))),
    )


def formula(name, **values):
    return PresentEffect(name, tuple(values.items()))


def stroke(*effects, rig=PAPER):
    return simulate_stroke_at_speed(replace(rig, effects=effects), 0.215, 2.433, T_S)


@pytest.mark.parametrize(
    ("by_values", "by_formula", "within"),
    [
        (
            table("hinges", "rate_rad_s", RATES, 0.02 * RATES),
            formula("hinge_viscous_damping", coefficient_Nm_s_per_rad=0.02),
            0.02,
        ),
        (
            table("floor_friction", "slip_m_s", SLIPS, 0.5 * np.exp(-np.abs(SLIPS) / 0.3)),
            formula("ground_stribeck", rise_relative=0.5, speed_m_s=0.3),
            0.02,
        ),
        (
            table("floor_normal", "depth_m", [0.0, 1.0], [-5.0, -5.0]),
            formula("ground_adhesion", force_N=5.0),
            0.001,
        ),
        (
            table("fz_N", "time_s", [0.0, 2.0], [0.0, 4.0]),
            formula("sensor_drift", rate_N_per_s=2.0),
            0.02,
        ),
    ],
)
def test_it_does_what_the_formula_does(by_values, by_formula, within):
    plain = stroke()
    tabulated = stroke(by_values)
    known = stroke(by_formula)
    late = T_S > 0.0
    done = np.abs(known.fz_N - plain.fz_N)[late].max()
    assert done > 0.5
    assert np.abs(tabulated.fz_N - known.fz_N)[late].max() < within * done


def test_friction_by_load_is_the_coefficient_where_it_depends_on_nothing():
    rougher = replace(
        PAPER,
        ground=replace(PAPER.ground, friction_coefficient=1.2 * PAPER.ground.friction_coefficient),
    )
    by_load = stroke(table("floor_friction", "load_N", [0.0, 100.0], [0.2, 0.2]))
    assert by_load.fz_N == pytest.approx(stroke(rig=rougher).fz_N, abs=2e-3)


def test_friction_that_falls_with_load_does_so_in_few_steps():
    without_drag = replace(PAPER, ground=replace(PAPER.ground, drag_N_s_per_m=0.0))
    falling = stroke(table("floor_friction", "load_N", [0.0, 80.0], [0.3, -0.3]), rig=without_drag)
    load = falling.normal_N[:, -1]
    along = np.abs(falling.tangential_N[:, -1])
    sliding = load > 0.7 * load.max()
    share = along[sliding] / (PAPER.ground.friction_coefficient * load[sliding])
    assert share == pytest.approx(1.3 - 0.6 * load[sliding] / 80.0, abs=0.01)
    assert np.ptp(share) > 0.1
    assert falling.steps < 1.5 * stroke().steps


def test_a_single_hinge_is_the_one_that_people_count():
    third = stroke(table("hinge3", "angle_rad", [-1.0, 1.0], [-2.0, 2.0]))
    change = np.abs(np.diff(third.q_rad, axis=1) - np.diff(stroke().q_rad, axis=1)).max(axis=0)
    assert int(np.argmax(change)) == 1


KNOTS = "knots = [-1.0, 0.0, 2.5]\n"
LAW = (
    '\n[[effects]]\nid = "tabulated_law"\nplace = "hinges"\nargument = '
    f'"rate_rad_s"\n{KNOTS}values = [-0.02, 0.0, 0.08]\n'
)


def rig_with(tmp_path, text):
    path = tmp_path / "rig.toml"
    path.write_text(TWIN.read_text() + text)
    return read_rig(path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            LAW.replace(KNOTS, "knots = [-1.0, 0.0]\n"),
            "2 knots, but 3 values; give one value per knot",
        ),
        (
            LAW.replace(KNOTS, "knots = [-1.0, 2.5, 0.0]\n"),
            r"knot 3 \(0\) is not above the one before \(2.5\); sort them",
        ),
        (LAW.replace(KNOTS, ""), "knots missing; it takes place, argument, knots, values"),
        (LAW.replace("hinges", "knee"), "place 'knee' is not known; there are hinges"),
        (
            LAW.replace("rate_rad_s", "slip_m_s"),
            "at hinges a law cannot depend on 'slip_m_s'; it can on rate_rad_s, angle_rad",
        ),
        (LAW.replace("0.08", "nan"), "finite number"),
        (
            LAW.replace(KNOTS, "knots = [0.0]\n").replace("[-0.02, 0.0, 0.08]", "[0.1]"),
            "1 knots; give 2 to 200",
        ),
        (
            LAW.replace("hinges", "floor_friction")
            .replace("rate_rad_s", "slip_m_s")
            .replace("-0.02", "-1.5"),
            "-1.5 would turn friction",
        ),
        (LAW.replace('place = "hinges"', "parameters = { x = 1.0 }"), "leave parameters out"),
        (LAW.replace("tabulated_law", "tip_mass"), "place belongs to a tabulated_law"),
    ],
)
def test_a_bad_table_is_one_clear_line(tmp_path, text, said):
    with pytest.raises(BadInput, match=said) as raised:
        rig_with(tmp_path, text).model()
    assert "\n" not in str(raised.value)


def test_a_hinge_that_the_leg_lacks_is_refused():
    with pytest.raises(BadInput, match="hinge9 is not there; this rig has 2 to 7"):
        stroke(table("hinge9", "angle_rad", [0.0, 1.0], [0.0, 1.0]))


def test_it_comes_back_from_a_model_file_as_it_went_in(tmp_path):
    rig = rig_with(tmp_path, LAW)
    (effect,) = rig.model().effects
    assert effect.table == LawTable("hinges", "rate_rad_s", (-1.0, 0.0, 2.5), (-0.02, 0.0, 0.08))
    assert nominal_model(rig.nominal()) == rig.model()
    sections = make_fitted_sections(rig.nominal(), rig.model())
    law = LawTable("floor_friction", "slip_m_s", (0.0, 1.0), (0.3, 0.0))
    write_model(
        tmp_path / "model.toml",
        sections,
        {},
        ["two laws"],
        [FoundEffect("tabulated_law", {}, {"the value at 0": 0.1}, law)],
    )
    again = read_model_file(tmp_path / "model.toml").model()
    assert again.effects == (effect, PresentEffect("tabulated_law", table=law))
    assert "the value at 0 is known to 0.1" in (tmp_path / "model.toml").read_text()
