"""Plans: what they contain, how long they take, and what their check refuses."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from rfca_rig.errors import BadInput
from rfca_rig.protocol.check import Load, check_plan
from rfca_rig.protocol.experiments import (
    Flapping,
    PlannedCondition,
    RigFacts,
    StaticStages,
    flapping_plan,
    static_plan,
)
from rfca_rig.protocol.plan import (
    Flap,
    Hold,
    HoldTiming,
    Limits,
    MoveShaft,
    Rates,
    Rest,
    SetHeight,
    SettleCriterion,
    turn_to,
    whole_turns,
)

LIMITS = Limits(300.0, 25.0, 20.0, 0.3, 0.1, 0.05, 0.5, 0.2, 2.0, 0.1, 80.0, 0.05, 0.1)
RIG = RigFacts(0.25, 0.7, 0.05, LIMITS, Rates(7000.0, 1000.0))
SETTLE = SettleCriterion(0.1, 0.001, 0.5, 10.0)
CONDITIONS = (
    PlannedCondition(0.215, 2.0),
    PlannedCondition(0.215, 3.0),
    PlannedCondition(0.235, 2.5),
)


def flapping(**changes):
    return flapping_plan(replace(Flapping("f", CONDITIONS, 4, 3.5, 3.0, SETTLE), **changes), RIG)


def static(angles=((1.0, "loading"), (1.5, "loading"), (1.4, "unloading"))):
    return static_plan(StaticStages("s", (0.215, 0.235), angles, 0.4, SETTLE, 0.5), RIG)


def test_every_condition_is_flapped_as_often_as_asked():
    counted = {(flap.height_m, flap.speed_rad_s): 0 for flap in flapping().flaps}
    for flap in flapping().flaps:
        counted[flap.height_m, flap.speed_rad_s] += 1
    assert counted == {(0.215, 2.0): 4, (0.215, 3.0): 4, (0.235, 2.5): 4}


def test_the_rack_moves_once_per_height_and_only_with_the_shaft_parked():
    for plan in (flapping(), static()):
        heights = [i for i, stage in enumerate(plan.stages) if isinstance(stage, SetHeight)]
        assert heights[0] == 0
        assert [plan.stages[i].height_m for i in heights] == [0.215, 0.235]
        for i in heights[1:]:
            assert plan.stages[i - 1] == MoveShaft(
                RIG.parked_angle_rad, plan.stages[i - 1].speed_rad_s
            )


def test_a_bent_leg_is_never_taken_backwards_to_the_start():
    stages = static().stages
    for before, after in pairwise(stages):
        if (
            isinstance(before, Hold)
            and isinstance(after, MoveShaft)
            and after.angle_rad == RIG.start_angle_rad
        ):
            assert after.forwards


def test_duration_and_size_follow_from_the_stages():
    plan = flapping(conditions=(PlannedCondition(0.2, 2.0),), repeats=1)
    stroke_s = 3.5 / 2.0 + 0.025
    assert plan.flaps[0].stroke_s == pytest.approx(stroke_s)
    assert plan.recorded_bytes == pytest.approx(
        (0.2 + stroke_s) * (7000 * 48 + 1000 * 32), rel=1e-6
    )
    assert plan.duration_s > 0.2 + stroke_s + SETTLE.limit_s


@pytest.mark.parametrize(
    ("angle", "start", "forwards", "way"),
    [
        (0.2, 0.5, False, -0.3),
        (0.2, 0.5, True, 2 * np.pi - 0.3),
        (0.2, 6.4, True, 2 * np.pi + 0.2 - 6.4),
        (3.0, 12.0, False, 3.0 + 2 * np.pi - 12.0),
    ],
)
def test_the_way_to_an_angle(angle, start, forwards, way):
    assert turn_to(angle, start, forwards) == pytest.approx(way)


def test_angles_of_a_stage_are_those_of_the_plan_whatever_turn_the_shaft_is_in():
    turn_rad = 2.0 * np.pi
    hold = Hold(0.2, 1, "loading", 3.5, SETTLE, HoldTiming(0.1, 0.1))
    stroke = Flap(0.2, 2.0, 1, 0.05, 3.5)
    for turns in (-2, 0, 1, 5000):
        ahead_rad = turns * turn_rad
        over_the_top = MoveShaft(0.25, 2.0, forwards=True)
        assert whole_turns(over_the_top, ahead_rad + 2.0) == pytest.approx(ahead_rad + turn_rad)
        assert whole_turns(MoveShaft(0.25, 2.0), ahead_rad + 0.9) == pytest.approx(ahead_rad)
        # The nearest way to 3.5 rad is backwards, to 3.5 rad less a turn.
        assert whole_turns(MoveShaft(3.5, 2.0), ahead_rad) == pytest.approx(ahead_rad - turn_rad)
        assert whole_turns(hold, ahead_rad + 3.5) == pytest.approx(ahead_rad)
        assert whole_turns(stroke, ahead_rad + 0.25) == pytest.approx(ahead_rad)
        assert whole_turns(Rest(SETTLE), ahead_rad + 0.25) is None


def test_a_good_plan_passes():
    plan = flapping()
    check_plan(plan, {flap: Load(299.0, 24.0) for flap in plan.flaps})


@pytest.mark.parametrize(
    ("plan", "load", "said"),
    [
        (
            flapping(conditions=(PlannedCondition(0.215, 25.0),)),
            Load(1.0, 1.0),
            "25 rad/s is above the rig's limit of 20 rad/s",
        ),
        (flapping(return_speed_rad_s=21.0), Load(1.0, 1.0), "21 rad/s is above"),
        (flapping(), Load(301.0, 1.0), "expects 301 N"),
        (flapping(), Load(1.0, 25.5), "25.5 N m"),
        (static(((3.2, "loading"),)), Load(1.0, 1.0), "between 0 and 180 degrees"),
        (replace(flapping(), stages=()), Load(1.0, 1.0), "nothing to record"),
    ],
)
def test_a_plan_beyond_the_rig_is_refused_before_anything_moves(plan, load, said):
    with pytest.raises(BadInput, match=said):
        check_plan(plan, {stage: load for stage in plan.stages if isinstance(stage, Flap)})


def test_a_hold_lasts_as_long_as_its_parts_and_its_photo():
    stages = StaticStages("s", (0.215,), ((1.0, "loading"),), 0.4, SETTLE, 0.5, dwell_s=2.0)
    with_camera = replace(RIG, photo_limit_s=5.0)
    assert static_plan(stages, RIG).holds[0].duration_s == pytest.approx(SETTLE.limit_s + 2.0 + 0.5)
    assert static_plan(stages, with_camera).holds[0].duration_s == pytest.approx(
        SETTLE.limit_s + 2.0 + 5.0
    )
    assert [static_plan(stages, rig).photos for rig in (RIG, with_camera)] == [0, 1]
    assert static_plan(replace(stages, photo=False), with_camera).photos == 0
