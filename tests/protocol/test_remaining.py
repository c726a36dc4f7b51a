"""What is left of a plan: done and remaining are the whole plan, each stage once, and the leg is
never pushed backwards.
"""

from dataclasses import replace
from itertools import takewhile

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rfca_rig.errors import BadInput
from rfca_rig.protocol.check import check_plan
from rfca_rig.protocol.experiments import Flapping, flapping_plan
from rfca_rig.protocol.plan import Approach, Cycles, Flap, Hold, MoveShaft, SetHeight
from rfca_rig.protocol.written_plan import PlanProgress, make_remaining_plan
from tests.protocol.random_plans import PLANS, static_plans
from tests.protocol.test_plans import CONDITIONS, RIG, SETTLE, flapping, static


def recorded(plan):
    """Every stroke, static stage and cycle of the plan in its order."""
    for stage in plan.stages:
        if isinstance(stage, Cycles):
            yield from (
                ("cycle", stage.height_m, stage.speed_rad_s, number)
                for number in range(stage.first, stage.last + 1)
            )
        elif isinstance(stage, Flap | Hold):
            yield stage


def done_of(records):
    """How far a plan got that recorded these."""
    cycles = [record for record in records if isinstance(record, tuple)]
    flaps, holds = (sum(isinstance(record, kind) for record in records) for kind in (Flap, Hold))
    return PlanProgress(flaps, holds, cycles[-1][-1] if cycles else 0)


@st.composite
def stopped(draw):
    """A plan, and what of it was recorded when it stopped."""
    plan = draw(PLANS)
    records = list(recorded(plan))
    return plan, records[: draw(st.integers(0, len(records)))]


@given(stopped())
def test_done_and_remaining_are_every_stage_exactly_once_and_in_order(case):
    plan, records = case
    left = make_remaining_plan(plan, done_of(records))
    assert [*records, *recorded(left)] == list(recorded(plan))
    if left.stages:
        check_plan(left, {})
    assert (left.title, left.limits, left.experiment) == (plan.title, plan.limits, plan.experiment)


@given(stopped(), st.data())
def test_a_run_may_be_stopped_any_number_of_times(case, data):
    """What remains after a second stop follows from all that is done, not from what remained
    after the first.
    """
    plan, records = case
    left = list(recorded(make_remaining_plan(plan, done_of(records))))
    more = left[: data.draw(st.integers(0, len(left)))]
    again = make_remaining_plan(plan, done_of([*records, *more]))
    assert [*records, *more, *recorded(again)] == list(recorded(plan))


@given(stopped())
def test_it_begins_with_the_rack_and_the_way_forwards_to_the_start(case):
    plan, records = case
    stages = make_remaining_plan(plan, done_of(records)).stages
    if not stages:
        assert len(records) == len(list(recorded(plan)))
        return
    rack, home = stages[:2]
    assert isinstance(rack, SetHeight)
    assert (home.angle_rad, home.forwards) == (RIG.start_angle_rad, True)
    assert (
        next(stage.height_m for stage in stages if isinstance(stage, Flap | Hold | Cycles))
        == rack.height_m
    )


@given(static_plans(), st.data())
def test_a_static_stage_is_reached_on_the_same_way_as_ever(plan, data):
    done = data.draw(st.integers(0, len(plan.holds) - 1))

    def way_to(number, stages):
        """The angles moved to, since the start, before the hold of that place."""
        place = [place for place, stage in enumerate(stages) if isinstance(stage, Hold)][number]
        moves = [stage for stage in stages[:place] if isinstance(stage, MoveShaft)]
        return list(takewhile(lambda move: move.angle_rad != RIG.start_angle_rad, reversed(moves)))

    assert way_to(0, make_remaining_plan(plan, PlanProgress(holds=done)).stages) == way_to(
        done, plan.stages
    )


def test_first_strokes_are_done_again_before_the_speed_they_are_for():
    plan = flapping_plan(
        Flapping("f", CONDITIONS, 4, 3.5, 3.0, SETTLE), replace(RIG, first_strokes=(0.5, 0.75))
    )
    left = make_remaining_plan(plan, PlanProgress(strokes=5)).stages
    until_flap = list(takewhile(lambda stage: not isinstance(stage, Flap), left))
    assert [stage.speed_rad_s for stage in until_flap if isinstance(stage, Approach)] == [1.5, 2.25]
    assert until_flap[-2] == MoveShaft(RIG.start_angle_rad, 3.0, forwards=True)


@pytest.mark.parametrize(
    "done", [PlanProgress(holds=1), PlanProgress(strokes=13), PlanProgress(cycle=3)]
)
def test_what_is_not_what_the_plan_begins_with_is_refused(done):
    with pytest.raises(BadInput, match="are not what the plan begins with"):
        make_remaining_plan(flapping(), done)


def test_a_height_that_is_done_is_not_set_up_again():
    racks = [
        stage.height_m
        for stage in make_remaining_plan(static(), PlanProgress(holds=3)).stages
        if isinstance(stage, SetHeight)
    ]
    assert racks == [0.235]
