"""Plans of every experiment, as hypothesis draws them."""

from dataclasses import replace

from hypothesis import strategies as st

from rfca_rig.protocol.experiments import (
    CheckSettings,
    Fatigue,
    Flapping,
    PlannedCondition,
    StaticStages,
    fatigue_plan,
    flapping_plan,
    static_plan,
)
from rfca_rig.protocol.plan import SettleCriterion
from tests.protocol.test_plans import RIG

SETTLE = SettleCriterion(0.1, 0.001, 0.5, 10.0)
HEIGHTS = st.sampled_from([0.155, 0.2, 0.215, 0.235])
SPEEDS = st.sampled_from([1.0, 2.433, 3.249, 15.0])
ANGLES = st.tuples(
    st.sampled_from([0.9, 1.1, 1.5, 1.9, 2.3]), st.sampled_from(["loading", "unloading"])
)
RIGS = st.sampled_from([RIG, replace(RIG, first_strokes=(0.5, 0.75))])


@st.composite
def flapping_plans(draw):
    conditions = draw(
        st.lists(st.builds(PlannedCondition, HEIGHTS, SPEEDS), min_size=1, max_size=4)
    )
    return flapping_plan(
        Flapping("f", conditions, draw(st.integers(1, 3)), 3.5, 3.0, SETTLE), draw(RIGS)
    )


@st.composite
def static_plans(draw):
    heights = draw(st.lists(HEIGHTS, min_size=1, max_size=3))
    return static_plan(
        StaticStages(
            "s", heights, draw(st.lists(ANGLES, min_size=1, max_size=5)), 0.4, SETTLE, 0.5
        ),
        draw(RIGS),
    )


@st.composite
def fatigue_plans(draw):
    every = st.integers(1, 12)
    check = CheckSettings(
        draw(every),
        draw(st.lists(st.sampled_from([1.2, 1.7, 2.2]), min_size=1, max_size=3)),
        0.4,
        0.0,
        0.5,
        0.05,
    )
    cycles = draw(st.integers(1, 40))
    return fatigue_plan(
        Fatigue("w", 0.2228, 6.0, cycles, draw(every), 3.5, 3.0, SETTLE, check), draw(RIGS)
    )


PLANS = st.one_of(flapping_plans(), static_plans(), fatigue_plans())
