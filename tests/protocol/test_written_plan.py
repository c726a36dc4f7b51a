"""A plan as a run keeps it is the plan, to the last bit."""

import json

import pytest
from hypothesis import given

from rfca_rig.errors import BadInput
from rfca_rig.protocol.written_plan import parse_plan, serialize_plan
from tests.protocol.random_plans import PLANS
from tests.protocol.test_plans import flapping


@given(PLANS)
def test_a_plan_comes_back_as_it_was(plan):
    assert parse_plan(plan.title, serialize_plan(plan)) == plan


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("plan", "["),
        ("plan", '[{"stage": "Jump"}]'),
        ("plan", '[{"stage": "Flap"}]'),
        ("limits", "{}"),
        ("experiment", "walk"),
    ],
)
def test_a_plan_that_cannot_be_read_is_one_line(name, text):
    with pytest.raises(BadInput, match="its plan cannot be read"):
        parse_plan("f", {**serialize_plan(flapping()), name: text})


def test_a_run_of_a_version_that_kept_no_rates_says_so():
    with pytest.raises(BadInput, match="rates"):
        parse_plan(
            "f",
            {name: text for name, text in serialize_plan(flapping()).items() if name != "rates"},
        )


def test_every_stage_stands_with_its_kind_and_label():
    said = json.loads(serialize_plan(flapping())["plan"])
    assert {stage["stage"] for stage in said} == {"SetHeight", "MoveShaft", "Rest", "Flap"}
    assert all(stage["label"] for stage in said)
