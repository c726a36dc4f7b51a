"""From wherever a plan is broken off, the leg comes into the air, never backwards, and waits
there.
"""

import pytest

from rfca_rig.engine.run import stages_to_safe_point
from rfca_rig.protocol.experiments import (
    Flapping,
    PlannedCondition,
    StaticStages,
    flapping_plan,
    static_plan,
)
from rfca_rig.protocol.plan import Flap, Hold, MoveShaft, SetHeight, SettleCriterion
from tests.protocol.test_plans import RIG

SETTLE = SettleCriterion(0.3, 0.003, 0.3, 10.0)
FLAPPING = flapping_plan(
    Flapping(
        "f", (PlannedCondition(0.215, 2.4), PlannedCondition(0.235, 2.4)), 2, 3.5, 3.0, SETTLE
    ),
    RIG,
)
STATIC = static_plan(
    StaticStages("s", (0.215, 0.235), ((1.0, "loading"), (1.5, "loading")), 0.4, SETTLE, 0.5), RIG
)


@pytest.mark.parametrize("plan", [FLAPPING, STATIC], ids=["flapping", "static"])
def test_whatever_is_left_out_the_way_ends_beyond_the_floor_or_never_came_near_it(plan):
    on_the_ground = False
    for done in range(len(plan.stages) + 1):
        way = stages_to_safe_point(plan.stages[:done], plan.stages[done:])
        if done:
            on_the_ground = _still_down(plan.stages[done - 1], plan.stages[:done], on_the_ground)
        home = (True, RIG.start_angle_rad)
        waiting = (False, RIG.parked_angle_rad)
        has_moved = (
            done > 0
            and not isinstance(plan.stages[done - 1], SetHeight)
            and not _is_parking(plan.stages[:done])
        )
        assert [(stage.forwards, stage.angle_rad) for stage in way] == [home] * on_the_ground + [
            waiting
        ] * has_moved


def _still_down(last, done, before):
    """A stroke or a stage of the shaft's angle leaves the leg beyond the start angle; the move
    forwards, and only it, brings it back.
    """
    if isinstance(last, Flap | Hold):
        return True
    if isinstance(last, SetHeight):
        return False
    if isinstance(last, MoveShaft):
        return not last.forwards and not isinstance(done[-2], SetHeight) and not _is_parking(done)
    return before


def _is_parking(done):
    """From the start angle, in the air, to where the shaft waits."""
    return getattr(done[-1], "angle_rad", None) == RIG.parked_angle_rad


def test_before_anything_moved_there_is_no_way_to_go():
    assert stages_to_safe_point((), FLAPPING.stages) == ()
