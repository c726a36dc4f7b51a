"""What the model expects of what remains of a plan: the rig can take it wherever the run had
stopped.
"""

from pathlib import Path

import pytest

from rfca_rig.bench.expectation import predict_loads
from rfca_rig.description.protocol_file import read_plan
from rfca_rig.description.rig_file import read_rig
from rfca_rig.protocol.check import check_plan
from rfca_rig.protocol.plan import Cycles, Flap, Hold
from rfca_rig.protocol.written_plan import PlanProgress, make_remaining_plan

ROOT = Path(__file__).parents[2]
RIG = read_rig(ROOT / "calibration" / "twin.toml")


def plan_of(name):
    return read_plan(ROOT / "protocols" / f"{name}.toml", RIG.facts())


@pytest.mark.parametrize(
    ("name", "done"),
    [
        *(("table2", PlanProgress(strokes=strokes)) for strokes in (0, 7, 10, 19)),
        *(("static-angle", PlanProgress(holds=holds)) for holds in (0, 5, 7, 8, 15)),
        *(("bending", PlanProgress(holds=holds)) for holds in (0, 5, 7)),
        ("impact", PlanProgress(strokes=3)),
        ("fatigue", PlanProgress(strokes=2, holds=6, cycle=10_777)),
    ],
)
def test_what_remains_passes_the_check_that_the_whole_plan_passed(name, done):
    left = make_remaining_plan(plan_of(name), done)
    expected = predict_loads(left, RIG.model())
    check_plan(left, expected)
    assert all(
        stage in expected for stage in left.stages if isinstance(stage, Flap | Hold | Cycles)
    )
    assert expected[left.stages[1]].force_N > 10.0  # the way home may go through the ground


def test_a_stage_s_expected_load_does_not_depend_on_where_the_run_had_stopped():
    plan = plan_of("static-angle")
    whole = plan
    left = make_remaining_plan(plan, PlanProgress(holds=5))
    before, after = (predict_loads(some, RIG.model()) for some in (whole, left))
    for hold in left.holds:
        assert after[hold].force_N == pytest.approx(before[hold].force_N, rel=0.05)
