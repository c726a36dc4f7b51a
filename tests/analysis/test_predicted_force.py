"""The expected force of a stroke: the model's own prediction, and what its uncertainty leaves."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.analysis.compare import compare_condition
from rfca_rig.analysis.predicted_force import CHANNELS, predict_force
from rfca_rig.analysis.repeats import STDS_OF_95
from rfca_rig.analysis.valley_uncertainty import predict_valley
from rfca_rig.bench.expectation import predict_loads
from rfca_rig.errors import SimulationFailed
from rfca_rig.model.stroke import simulate_stroke_at_speed
from rfca_rig.protocol.plan import Flap
from tests.analysis.test_valley_uncertainty import CONDITION, RIG
from tests.engine.rigs import one_condition, twin_rig

HEIGHT_M = 0.215
SPEED_RAD_S = 2.433
DURATION_S = 1.38
KNOWN_TO = {"friction_coefficient": 0.05, "k0_relative": 0.03, "height_mm": 0.2}


def predicted(known_to, rig=RIG):
    return predict_force(rig, known_to, HEIGHT_M, SPEED_RAD_S, DURATION_S)


def simulated(rig, t_s):
    stroke = simulate_stroke_at_speed(rig, HEIGHT_M, SPEED_RAD_S, t_s)
    return np.column_stack([getattr(stroke, name) for name in CHANNELS])


def test_it_is_the_stroke_of_the_model_and_its_peak_is_what_the_plan_expects():
    rig = twin_rig()
    plan = one_condition(rig)
    (flap,) = [stage for stage in plan.stages if isinstance(stage, Flap)]
    force = predict_force(rig.model(), {}, flap.height_m, flap.speed_rad_s, flap.stroke_s)
    stroke = simulate_stroke_at_speed(rig.model(), flap.height_m, flap.speed_rad_s, force.t_s)
    for column, name in enumerate(CHANNELS):
        np.testing.assert_array_equal(force.values[:, column], getattr(stroke, name))
    load = predict_loads(plan, rig.model())[flap]
    assert np.hypot(force.values[:, 0], force.values[:, 1]).max() == load.force_N
    assert np.abs(force.values[:, 2]).max() == load.torque_Nm
    assert (force.t_s[0], force.low, force.high) == (0.0, None, None)


def test_a_value_that_is_off_by_its_uncertainty_stays_within_the_band():
    force = predicted(KNOWN_TO)
    for sign in (-STDS_OF_95, STDS_OF_95):
        friction = RIG.ground.friction_coefficient + sign * KNOWN_TO["friction_coefficient"]
        other = simulated(
            replace(RIG, ground=replace(RIG.ground, friction_coefficient=friction)), force.t_s
        )
        assert (other >= force.low - 1e-9).all() and (other <= force.high + 1e-9).all()
        assert np.abs(other - force.values).max() > 5.0


def test_no_edge_of_the_band_is_a_force_that_no_value_gives():
    """A valley that comes a little earlier does not make the peak after it higher."""
    force = predicted({"height_mm": 0.2})
    peaks = [
        simulate_stroke_at_speed(RIG, HEIGHT_M + 1e-3 * by_mm, SPEED_RAD_S, force.t_s).fz_N.max()
        for by_mm in (-0.392, 0.0, 0.392)
    ]
    assert force.high[:, 1].max() == pytest.approx(max(peaks), abs=0.5)


def test_at_the_valley_the_band_is_the_interval_of_the_predicted_valley():
    known_to = {name: 0.1 * std for name, std in KNOWN_TO.items()}
    force = predicted(known_to)
    valley = predict_valley(
        compare_condition(RIG, CONDITION, "commanded"), RIG, known_to, "commanded"
    )
    at = int(np.searchsorted(force.t_s, valley.time.predicted))
    assert force.values[at, 1] == pytest.approx(valley.fz.predicted, abs=0.02)
    half_N = STDS_OF_95 * valley.fz.std
    assert force.high[at, 1] - force.values[at, 1] == pytest.approx(half_N, rel=0.1)
    assert force.values[at, 1] - force.low[at, 1] == pytest.approx(half_N, rel=0.1)


def test_independent_values_add_in_quadrature():
    both, friction, k0 = (
        predicted(known_to)
        for known_to in (
            {"friction_coefficient": 0.05, "k0_relative": 0.03},
            {"friction_coefficient": 0.05},
            {"k0_relative": 0.03},
        )
    )
    above = np.hypot(friction.high - friction.values, k0.high - k0.values)
    np.testing.assert_allclose(both.high - both.values, above, atol=1e-9)
    assert above.max() > 2.0


def test_what_cannot_be_simulated_has_no_prediction():
    buried = replace(RIG, leg=replace(RIG.leg, link_masses_kg=(np.nan,) * 7))
    with pytest.raises(SimulationFailed):
        predicted(KNOWN_TO, buried)
