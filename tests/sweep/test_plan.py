"""Grids and samples as specified, in files and on the command line, and what is refused, in one
line.
"""

import pickle

import numpy as np
import pytest
from scipy.stats import qmc

from rfca_rig.errors import BadInput
from rfca_rig.model.parameters import RigModel
from rfca_rig.sweep.plan import SweepPlan, make_grid, points, shares
from rfca_rig.sweep.quantities import find_quantity, list_quantities
from rfca_rig.sweep.sweep_file import make_plan, plan_from_options, read_sweep
from tests.model.legs import PAPER

FILE = """
title = "all of it"
outputs = ["valley_fz_N", "equivalent_stiffness_Nm_per_rad@20"]

[fixed]
speed_rad_s = 3
strip.thickness_mm = 0.5
hinge_backlash = { half_gap_deg = 1.0 }

[[vary]]
name = "strip.material"
values = ["CFSP", "PA12"]

[[vary]]
name = "height_mm"
from = 200
to = 220
steps = 3

[samples]
method = "sobol"
n = 8
seed = 5

[[samples.vary]]
name = "friction"
from = 0.2
to = 0.6

[[samples.vary]]
name = "k0"
from = 1
to = 100
log = true
"""


def in_file(tmp_path, text=FILE, rig: RigModel = PAPER) -> SweepPlan:
    path = tmp_path / "sweep.toml"
    path.write_text(text)
    return make_plan(read_sweep(path), rig, path)


def typed(*vary, fixed=(), outputs="", samples=None, method="sobol", seed=0) -> SweepPlan:
    return plan_from_options(PAPER, vary, fixed, outputs, samples, method, seed)


def test_every_combination_comes_once_samples_fastest_and_the_first_axis_slowest(tmp_path):
    plan = in_file(tmp_path)
    assert plan.count == 2 * 3 * 8
    assert plan.varied == ("strip.material", "height_mm", "friction", "k0_Nm_per_rad")
    cases = [plan.point(case) for case in range(plan.count)]
    assert [case[:2] for case in cases[::8]] == [
        (m, h) for m in ("CFSP", "PA12") for h in (200.0, 210.0, 220.0)
    ]
    assert len(set(cases)) == plan.count
    assert [case[2:] for case in cases[:8]] == [case[2:] for case in cases[8:16]]


def test_a_case_is_the_design_of_its_values(tmp_path):
    plan = in_file(tmp_path)
    design = plan.design(11)
    material, height_mm, friction, k0 = plan.point(11)
    assert (material, height_mm, design.height_m, design.speed_rad_s) == (
        "CFSP",
        210.0,
        pytest.approx(0.21),
        3.0,
    )
    assert design.rig.ground.friction_coefficient == friction and design.rig.leg.k0_Nm_per_rad == k0
    assert design.strip.thickness_m == 0.0005 and design.strip.material.name == "CFSP"
    assert design.rig.effects[0].id == "hinge_backlash" and dict(design.rig.effects[0].values) == {
        "half_gap_deg": 1.0
    }
    assert design.model().leg.k0_Nm_per_rad == pytest.approx(k0 * (0.5 / 0.8) ** 3)
    there = pickle.loads(pickle.dumps(plan))
    assert there == plan and there.design(11) == design


def test_samples_are_those_of_scipy_with_the_recorded_seed(tmp_path):
    samples = in_file(tmp_path).samples
    with_scipy = qmc.Sobol(2, seed=np.random.default_rng(5)).random(8)
    assert shares(samples) == pytest.approx(with_scipy, abs=0)
    assert points(samples)[:, 0] == pytest.approx(0.2 + 0.4 * with_scipy[:, 0])
    assert points(samples)[:, 1] == pytest.approx(100.0 ** with_scipy[:, 1])


def test_a_hypercube_has_one_point_in_every_stratum_and_another_seed_is_another_one():
    one, other = (
        typed("k0=5:20", "friction=0.1:0.9", samples=50, method="latin", seed=seed).samples
        for seed in (1, 2)
    )
    for share in shares(one).T:
        assert sorted(np.floor(50 * share)) == list(range(50))
    assert (points(one) != points(other)).all()


def test_grids_step_evenly_or_in_ratios_both_ends_included():
    assert make_grid(0.0, 0.3, 4, False) == (0.0, 0.1, 0.2, 0.3)
    assert make_grid(1.0, 16.0, 5, True) == (1.0, 2.0, 4.0, 8.0, 16.0)
    plan = typed("height_mm=195:255:13", "speed_rad_s=1:4:3:log", "strip.material=CFSP,CFRP")
    assert [len(axis.values) for axis in plan.axes] == [13, 3, 2] and [
        axis.log for axis in plan.axes
    ] == [False, True, False]
    assert plan.axes[0].values[:2] == (195.0, 200.0)


def test_names_of_fit_and_of_model_files_are_known_and_every_quantity_can_be_written():
    assert find_quantity("k0") is find_quantity("k0_Nm_per_rad") and find_quantity(
        "friction_coefficient"
    ) is find_quantity("friction")
    design = typed("start_angle=10:20:2", "ramp_s=0.05,0.1").design(3)
    assert (
        np.degrees(design.rig.leg.start_angle_rad) == pytest.approx(20.0)
        and design.rig.drive.ramp_s == 0.1
    )
    base = typed("k0=9,10").design(0)
    for each in list_quantities().values():
        possible = [
            some for some in each.choices or (0.01, 0.5, 2.0, 3.0) if each.why_not(some) is None
        ]
        assert any(each.write(base, some) != base for some in possible), each.name


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            ("height_mm", "hight_mm"),
            r"sweep.toml:15: 'hight_mm' cannot be varied; did you mean height_mm\?",
        ),
        (
            ("valley_fz_N", "valley_fz"),
            r"sweep.toml:3: 'valley_fz' is no output; did you mean valley_fz_N\?",
        ),
        (
            ("steps = 3", "step = 3"),
            r"sweep.toml:18: vary\[2\].step: unknown key; did you mean steps\?",
        ),
        (
            ("from = 200", "form = 200"),
            r"sweep.toml:16: vary\[2\].form: unknown key; did you mean from\?",
        ),
        (("steps = 3", "values = [3]"), r"takes either values, or all of from, to and steps"),
        (
            ("steps = 3", "steps = 1"),
            r"vary\[2\].steps: should be greater than or equal to 2, not 1",
        ),
        (("n = 8", "n = 100"), r"Sobol points are balanced in powers of two only; take 64 or 128"),
        (('"PA12"', '"nylon"'), r"strip.material = nylon: must be one of VMQ, PA12, CFRP, CFSP"),
        (("to = 220", "to = 2000"), r"height_mm = 1100: must be 1 to 1000"),
        (("from = 1\n", "from = 0\n"), r"samples.vary\[2\]: log = true needs from and to above 0"),
        (("to = 0.6", "to = 0.1"), r"from = 0.2 must be below to = 0.1"),
        (("speed_rad_s = 3", "height_mm = 3"), r"height_mm is set twice"),
        (
            ("speed_rad_s = 3", "start_angle = 3\nstart_angle_rad = 0.1"),
            r"start_angle_deg and start_angle_rad set the same",
        ),
        (
            ("backlash = { half_gap_deg = 1.0 }", "stop = { angle_deg = 25 }"),
            r"effect hinge_stop: takes angle_deg, stiffness.*--set",
        ),
        (
            ("half_gap_deg = 1.0", "half_gap_deg = -1.0"),
            r"hinge_backlash.half_gap_deg = -1: must be 0 or more",
        ),
        (
            ('title = "all', 'rig = "twin"\nmodel = "m.toml"\ntitle = "all'),
            r"rig and model are both given",
        ),
    ],
)
def test_a_wrong_file_is_one_line(tmp_path, change, said):
    assert change[0] in FILE
    with pytest.raises(BadInput, match=said) as refused:
        in_file(tmp_path, FILE.replace(*change, 1))
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({}, "nothing is varied; name what, as in --vary"),
        ({"vary": ["height_mm"]}, "--vary height_mm: should be NAME=FROM:TO:STEPS"),
        ({"vary": ["height_mm=1:2"]}, "a range is for --samples N; for a grid say how many steps"),
        (
            {"vary": ["height_mm=200:220:3"], "samples": 8},
            "--samples 8: name the ranges to draw from",
        ),
        ({"vary": ["height_mm=200:220:2.5"]}, "--vary height_mm=200:220:2.5: should be"),
        ({"vary": ["height_mm=two"]}, "height_mm=two: should be a number"),
        ({"vary": ["k0=0:9:3:log"]}, "equal ratios need both ends above 0"),
        ({"vary": ["k0=9:8"], "samples": 8}, "9 must be below 8"),
        ({"vary": ["k0=8:9"], "samples": 9}, "take 8 or 16, or --method latin"),
        (
            {"vary": ["k0=8:9"], "samples": 8, "method": "lhs"},
            "--method lhs: should be sobol or latin",
        ),
        ({"vary": ["links=1:8:8"]}, "links = 1: must be a whole number of 2 to 60"),
        (
            {"vary": ["links=2:12"], "samples": 8},
            r"links = 5\.81966: must be a whole number of 2 to 60",
        ),
        ({"vary": ["k0=1:2:100000", "k2=1:2:1000"]}, "at most 10000000 in one sweep"),
        (
            {"vary": ["k2=-0.2,1"]},
            (
                "k2_per_rad2 = -0.2: must be -0.135 or more: below, the torque of a hinge "
                "falls before 90 degrees"
            ),
        ),
        ({"vary": ["height=1,2"]}, "did you mean height_mm"),
        (
            {"vary": ["tip_mass.mass_g=1,2"], "outputs": "static_load_N@60"},
            "static_load_N@60deg: statics know the plain leg only",
        ),
        (
            {"vary": ["k0=9,10"], "outputs": "energy_J,energy_J"},
            "the output energy_J is named twice",
        ),
    ],
)
def test_wrong_options_are_one_line(words, said):
    words = {"vary": [], **words}
    with pytest.raises(BadInput, match=said) as refused:
        typed(*words.pop("vary"), **words)
    assert "\n" not in str(refused.value)


def test_a_spring_that_softens_may_be_swept():
    plan = typed("k2=-0.1,0.5")
    assert [plan.point(case) for case in range(plan.count)] == [(-0.1,), (0.5,)]
