"""What the figures of a sweep show, on sweeps whose outputs are plain functions of what is
varied.
"""

import re
from zlib import crc32

import numpy as np
import pytest

from rfca_rig.reports.sweep.page import page
from rfca_rig.reports.sweep.pictures import (
    compute_sensitivities,
    formula,
    name_and_unit,
    sample_groups,
    views,
)
from rfca_rig.sweep.result import SweepResult
from rfca_rig.sweep.sweep_file import plan_from_options
from tests.model.legs import PAPER
from tests.report.outline import Outline


def result_of(*vary, samples=None, value=lambda *point: float(sum(point))) -> SweepResult:
    plan = plan_from_options(PAPER, vary, (), "energy_J", samples, "sobol", 1)
    values = np.array([[value(*plan.point(case))] for case in range(plan.count)])
    return SweepResult(
        plan,
        values,
        tuple("" if np.isfinite(each) else "no rest pose found at 3 mm" for each in values[:, 0]),
    )


@pytest.mark.parametrize(
    ("vary", "x", "second", "is_map", "facets"),
    [
        (("k0=8:12:5",), "k0_Nm_per_rad", None, False, 1),
        (("k0=8:12:5", "height_mm=200,220"), "k0_Nm_per_rad", "height_mm", False, 1),
        (("k0=8:12:5", "height_mm=200:240:9"), "height_mm", "k0_Nm_per_rad", True, 1),
        (
            ("strip.material=CFSP,PA12", "height_mm=200,220"),
            "strip.material",
            "height_mm",
            False,
            1,
        ),
        (
            ("strip.material=CFSP,PA12", "height_mm=200:240:9"),
            "height_mm",
            "strip.material",
            False,
            1,
        ),
        (
            ("links=5,6,7", "k0=8:12:5", "friction=0.1:0.9:7", "k2=1,2"),
            "friction",
            "k0_Nm_per_rad",
            True,
            6,
        ),
    ],
)
def test_curves_maps_and_facets(vary, x, second, is_map, facets):
    """Each view shows the value of its own case, wherever the axes stand in the plan."""
    result = result_of(
        *vary,
        value=lambda *point: float(
            sum(3.7**place * (crc32(str(v).encode()) % 97) for place, v in enumerate(point))
        ),
    )
    shown, there_are = views(result.plan)
    assert len(shown) == there_are == facets
    for view in shown:
        assert (view.x.name, view.second.name if view.second else None, view.is_map) == (
            x,
            second,
            is_map,
        )
        drawn = view.values(result, "energy_J")
        for place, values in enumerate(drawn):
            for at, value in zip(view.x.values, values, strict=True):
                point = (
                    dict(view.facet)
                    | {x: at}
                    | ({second: view.second.values[place]} if second else {})
                )
                case = [result.plan.point(case) for case in range(result.plan.count)].index(
                    tuple(point[name] for name in result.plan.varied)
                )
                assert value == result.values[case, 0]


def test_a_page_tells_what_is_missing_and_stays_the_same():
    def none_above(k0, height_mm):
        if k0 > 11.5:
            return np.nan
        return k0 * height_mm

    result = result_of("k0=8:12:5", "height_mm=200:240:9", value=none_above)
    html = page(result, [], "rfca-rig sweep --vary ...")
    text = Outline(html).text
    assert html == page(result, [], "rfca-rig sweep --vary ...")
    assert "45 cases: 5 values of k0 times 9 values of height. 9 cases failed." in text
    assert "9 times: no rest pose found at … mm" in text and "Crosses: no value." in text
    assert (
        "Without any value: Energy per stroke."
        in Outline(page(result_of("k0=8,9", value=lambda _: np.nan), [], "")).text
    )


def test_samples_beside_a_grid_are_told_apart():
    result = result_of(
        "height_mm=200,220",
        "k0=8:12",
        "friction=0.1:0.9",
        samples=64,
        value=lambda h, k0, mu: k0 if h < 210 else mu,
    )
    assert [group.at[0][1] for group in sample_groups(result.plan)] == [200.0, 220.0]
    found = compute_sensitivities(result)
    assert [(each.at[0][1], each.name, round(each.found.index)) for each in found] == [
        (200.0, "k0_Nm_per_rad", 1),
        (200.0, "friction", 0),
        (220.0, "k0_Nm_per_rad", 0),
        (220.0, "friction", 1),
    ]
    html = page(result, found, "")
    assert html.count("<figure ") == 2 and len(re.findall(r"explains 1\.00 ± 0\.00", html)) == 2
    assert "What it depends on" in Outline(html).text


def test_names_and_formulas_as_a_reader_wants_them():
    assert name_and_unit("strip.thickness_mm") == ("strip thickness", "mm")
    assert name_and_unit("static_torque_Nm@60deg") == ("static torque at 60°", "N m")
    assert name_and_unit("hinge_backlash.half_gap_deg") == ("hinge backlash half gap", "deg")
    assert (
        formula("W - integral of c sum (dphi_i/dt)^2 dt") == "W \N{MINUS SIGN} ∫ c Σ (dφᵢ/dt)² dt"
    )
