"""What docs/impact-test.md and the picture of convergence claim, in its cheapest form."""

import numpy as np
import pytest

from rfca_rig.model.chain import Tolerance, make_chain
from tests.benchmarks.convergence import SPEED_TOLERANCE_PER_S3, SWING_FROM, free_motion
from tests.benchmarks.impact import (
    changed,
    passes,
    peaks,
    reversed_under_load,
    table_2_errors_pct,
    with_stop,
)
from tests.model.legs import NO_GROUND_M, PAPER

HARD = changed(ground={"stiffness_N_per_m1p5": 3e6})
MORE_FRICTION = {
    "k0_Nm_per_rad": 13.85,
    "k2_per_rad2": 4.08,
    "hinge_damping_Nm_s_per_rad": 0.142,
    "start_angle_rad": np.radians(15.2),
}
ROUGH = changed(MORE_FRICTION, {"friction_coefficient": 0.6})


def test_the_calibrated_leg_presses_with_a_third_of_the_force_and_whips_with_less_than_half():
    peak = peaks(passes(PAPER, count=1), 0)
    assert (peak["loading"].fy_N, peak["loading"].fz_N) == pytest.approx((-48.0, -88.0), abs=2.0)
    assert (peak["whip"].fy_N, peak["whip"].fz_N) == pytest.approx((45.4, 135.0), abs=2.0)


@pytest.mark.slow
def test_stops_that_table_2_does_not_see_raise_the_force_of_the_impact_test():
    stopped = with_stop(25.0, 1000.0)
    assert np.abs(table_2_errors_pct(stopped) - table_2_errors_pct(PAPER)).max() < 0.05
    assert peaks(passes(stopped, count=1), 0)["loading"].size_N > 500.0


def test_a_hard_plate_makes_the_second_touchdown_a_spike_along_the_leg():
    first, second = (peaks(passes(HARD, count=2), number)["touchdown"] for number in (0, 1))
    assert second.size_N > 5.0 * first.size_N
    assert -second.fy_N / second.fz_N > 1.3


def test_a_rougher_plate_fits_table_2_as_well_and_turning_back_on_it_gives_both_measured_forces():
    assert np.abs(table_2_errors_pct(ROUGH)).mean(axis=0) == pytest.approx((2.9, 1.3), abs=0.2)
    peak = reversed_under_load(115.0, ROUGH)
    assert (peak.fy_N, peak.fz_N) == pytest.approx((188.0, -232.0), rel=0.05)


@pytest.mark.parametrize(
    ("leg", "friction", "errors_pct"),
    [
        ({}, 0.41, (2.86, 6.17)),
        (
            {
                "k0_Nm_per_rad": 5.2964,
                "k2_per_rad2": 9.2678,
                "hinge_damping_Nm_s_per_rad": 0.9273,
                "start_angle_rad": 0.2195,
            },
            0.0938,
            (2.90, 0.53),
        ),
    ],
    ids=["nothing fitted", "at best"],
)
def test_with_coulomb_friction_alone_table_2_is_met_as_stated(leg, friction, errors_pct):
    rig = changed(leg, {"drag_N_s_per_m": 0.0, "friction_coefficient": friction})
    assert np.abs(table_2_errors_pct(rig)).mean(axis=0) == pytest.approx(errors_pct, abs=0.03)


def test_the_speed_of_the_stroke_hardly_matters_to_the_loading():
    slow = peaks(passes(PAPER, speed_rad_s=2.4, count=1), 0)["loading"].size_N
    assert slow == pytest.approx(115.0, abs=2.0)


def test_half_the_step_leaves_an_eighth_of_the_error_or_less():
    chain = make_chain(PAPER, NO_GROUND_M)
    end_s = np.array([0.2])

    def swung(step_s: float) -> np.ndarray:
        tolerance = Tolerance(1e9, SPEED_TOLERANCE_PER_S3 * step_s**3)
        return free_motion(chain, SWING_FROM, end_s, tolerance, step_s, step_s)[0].q[-1]

    true = swung(4e-6)
    errors = [np.abs(swung(step_s) - true).max() for step_s in (5e-4, 2.5e-4)]
    assert np.log2(errors[0] / errors[1]) > 2.7
