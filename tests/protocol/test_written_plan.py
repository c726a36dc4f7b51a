"""A plan as a run keeps it is the plan, to the last bit."""

import json

import pytest
from hypothesis import given

from rfca_rig.errors import BadInput
from rfca_rig.protocol.written_plan import plan_of, plan_texts
from tests.protocol.random_plans import PLANS
from tests.protocol.test_plans import flapping


@given(PLANS)
def test_a_plan_comes_back_as_it_was(plan):
    assert plan_of(plan.title, plan_texts(plan)) == plan


@pytest.mark.parametrize(
    ("name", "text"),
    [("plan", "["), ("plan", '[{"stage": "Jump"}]'), ("plan", '[{"stage": "Flap"}]'), ("limits", "{}"), ("experiment", "walk")],
)
def test_a_plan_that_cannot_be_read_is_one_line(name, text):
    with pytest.raises(BadInput, match="its plan cannot be read"):
        plan_of("f", {**plan_texts(flapping()), name: text})


def test_a_run_of_a_version_that_kept_no_rates_says_so():
    with pytest.raises(BadInput, match="rates"):
        plan_of("f", {name: text for name, text in plan_texts(flapping()).items() if name != "rates"})


def test_every_stage_stands_with_its_kind_and_label():
    said = json.loads(plan_texts(flapping())["plan"])
    assert {stage["stage"] for stage in said} == {"SetHeight", "MoveShaft", "Rest", "Flap"}
    assert all(stage["label"] for stage in said)
