"""The interval of a predicted valley: each value's effect against a simulation of its own, and what
counts as inside.
"""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.analysis.compare import compare_condition
from rfca_rig.analysis.matched_simulation import simulate_matching
from rfca_rig.analysis.repeats import Spread, group_by_condition
from rfca_rig.analysis.valley_uncertainty import PredictedQuantity, predict_valley
from rfca_rig.description.model_file import nominal_model
from rfca_rig.recording.model import Column, Stream
from tests.analysis import traces
from tests.report.recordings import BELIEVED, strokes

RIG = nominal_model(BELIEVED)
CONDITION = group_by_condition(strokes())[0]
FRICTION_STD = 0.05
HEIGHT_STD_MM = 0.2


def predicted(known_to, shaft="recorded", rig=RIG):
    compared = compare_condition(rig, CONDITION, shaft)
    return predict_valley(compared, rig, known_to, shaft)


def mean_valley(rig, condition=CONDITION, shaft="recorded"):
    valleys = [model.valley for model in simulate_matching(rig, condition, shaft)]
    return np.mean([[valley.time_s, valley.fz_N] for valley in valleys], axis=0)


def with_friction(by):
    friction = RIG.ground.friction_coefficient + by
    return replace(RIG, ground=replace(RIG.ground, friction_coefficient=friction))


@pytest.mark.parametrize("shaft", ["recorded", "average"])
def test_the_effect_of_a_value_is_half_the_difference_between_both_sides(shaft):
    valley = predicted({"friction_coefficient": FRICTION_STD}, shaft)
    ahead = mean_valley(with_friction(FRICTION_STD), shaft=shaft)
    behind = mean_valley(with_friction(-FRICTION_STD), shaft=shaft)
    assert valley.names == ("friction",)
    # Repeats whose turns hardly differ share one simulated motion.
    assert valley.effects[0] == pytest.approx(0.5 * (ahead - behind), rel=0.02, abs=2e-5)
    assert valley.fz.std == pytest.approx(abs(valley.effects[0, 1]))


def test_the_height_counts_though_it_is_no_value_of_the_model():
    valley = predicted({"height_mm": HEIGHT_STD_MM})
    higher = replace(CONDITION, height_m=CONDITION.height_m + 1e-3 * HEIGHT_STD_MM)
    lower = replace(CONDITION, height_m=CONDITION.height_m - 1e-3 * HEIGHT_STD_MM)
    difference = 0.5 * (mean_valley(RIG, higher) - mean_valley(RIG, lower))
    assert valley.effects[0] == pytest.approx(difference, rel=0.05, abs=2e-5)


def with_angle(stroke, change):
    """The stroke with another record of its shaft angle."""
    t_s, angle_rad = stroke.channel("shaft_angle_rad")
    fz = stroke.channel("fz_N")
    return traces.stroke(
        fz[0],
        fz[1],
        height_m=stroke.height_m,
        speed_rad_s=stroke.speed_rad_s,
        repeat=stroke.repeat,
        shaft_angle_rad=change(t_s, angle_rad),
    )


def test_every_repeat_counts_with_its_own_turn():
    first, second = CONDITION.strokes
    # The second shaft turns 3 % farther.
    ahead = with_angle(second, lambda _, angle_rad: angle_rad + 0.03 * (angle_rad - angle_rad[0]))
    two_turns = replace(CONDITION, strokes=(first, ahead))
    known_to = {"friction_coefficient": FRICTION_STD}
    valley = predict_valley(
        compare_condition(RIG, two_turns, "recorded"), RIG, known_to, "recorded"
    )
    sides = [mean_valley(with_friction(by), two_turns) for by in (FRICTION_STD, -FRICTION_STD)]
    assert valley.effects[0] == pytest.approx(0.5 * (sides[0] - sides[1]), rel=1e-3, abs=1e-5)
    alone = predicted(known_to)
    assert abs(valley.effects[0, 0] - alone.effects[0, 0]) > 1e-5


def shorten_angle(stroke, end_s):
    """The stroke with its shaft angle in a stream of its own, recorded until `end_s`."""
    (stream,) = stroke.streams.values()
    kept = stream.t_s <= end_s
    angle = stream.columns["shaft_angle_rad"]
    shaft = Stream(stream.t_s[kept], {"shaft_angle_rad": Column(angle.data[kept], angle.unit)})
    force = Stream(stream.t_s, {"fz_N": stream.columns["fz_N"]})
    return replace(stroke, streams={"shaft": shaft, "force": force})


@pytest.mark.parametrize(("end_s", "is_known"), [(1.25, True), (0.9, False)])
def test_nothing_is_predicted_after_the_last_recorded_angle(end_s, is_known):
    short = [shorten_angle(stroke, end_s) for stroke in CONDITION.strokes]
    condition = replace(CONDITION, strokes=tuple(short))
    compared = compare_condition(RIG, condition, "recorded")
    known_to = {"friction_coefficient": FRICTION_STD}
    valley = predict_valley(compared, RIG, known_to, "recorded")
    assert (valley.fz.predicted is not None) == is_known
    assert (valley.fz.std is not None) == is_known
    if is_known:
        whole = predicted(known_to).effects[0]
        assert valley.effects[0] == pytest.approx(whole, rel=0.02, abs=2e-5)


def test_independent_values_add_in_quadrature():
    both = predicted({"friction_coefficient": FRICTION_STD, "height_mm": HEIGHT_STD_MM})
    alone = predicted({"friction_coefficient": FRICTION_STD})
    height = predicted({"height_mm": HEIGHT_STD_MM})
    assert both.time.std == pytest.approx(np.hypot(alone.time.std, height.time.std), rel=1e-3)


def test_a_variation_without_a_valley_leaves_the_interval_unknown():
    # Twice as high, the leg no longer reaches the ground.
    valley = predicted({"height_mm": 200.0})
    assert valley.time.std is None
    assert valley.fz.half_95 is None
    assert valley.fz.is_inside is None


def test_the_interval_holds_the_scatter_of_the_measured_mean():
    quantity = PredictedQuantity(1.0, 0.03, Spread(1.05, 0.08, 4))
    assert quantity.half_95 == pytest.approx(1.96 * np.hypot(0.03, 0.04))
    assert quantity.is_inside
    assert not replace(quantity, measured=Spread(1.1, 0.08, 4)).is_inside
    # Of one repeat no scatter is known.
    assert replace(quantity, measured=Spread(1.05, None, 1)).half_95 == pytest.approx(1.96 * 0.03)


@pytest.mark.parametrize(
    "unknown",
    [
        PredictedQuantity(None, 0.03, Spread(1.0, 0.1, 5)),
        PredictedQuantity(1.0, None, Spread(1.0, 0.1, 5)),
        PredictedQuantity(1.0, 0.03, Spread(None, None, 0)),
    ],
)
def test_what_is_not_known_is_neither_inside_nor_outside(unknown):
    assert unknown.is_inside is None
