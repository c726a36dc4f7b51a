"""A leg that is pushed back far: if a plan does it all the same, the force limit ends it."""

import numpy as np
import pytest

from rfca_rig.bench.expectation import predict_loads
from rfca_rig.engine.run import run_plan
from rfca_rig.errors import BadInput, Tripped
from rfca_rig.protocol.check import check_plan
from rfca_rig.protocol.experiments import StaticStages, static_plan
from rfca_rig.protocol.plan import SettleCriterion
from tests.engine.rigs import nothing, recorder_on, twin_rig

SETTLE = SettleCriterion(0.3, 0.01, 0.1, 3.0)


def pushed_back(to_deg: float):
    angles = ((float(np.radians(135.0)), "loading"), (float(np.radians(to_deg)), "unloading"))
    return static_plan(StaticStages("back", (0.235,), angles, 0.4, SETTLE, 0.1), twin_rig().facts())


def test_the_check_refuses_it_with_stage_force_and_limit():
    plan = pushed_back(60.0)
    said = (
        r"hold 2 at 60.0 deg, 235 mm, unloading: the model expects 3\d\d N and .* limits are "
        r"300 N and 25 N m; .*turn the shaft back less"
    )
    with pytest.raises(BadInput, match=said):
        check_plan(plan, predict_loads(plan, twin_rig().model()))


def test_a_small_step_back_passes():
    plan = pushed_back(133.0)
    check_plan(plan, predict_loads(plan, twin_rig().model()))


@pytest.mark.slow
def test_the_force_limit_trips_in_flight_and_what_was_measured_is_kept(tmp_path):
    with recorder_on(twin_rig(), tmp_path / "run") as (bench, recorder, _):
        with pytest.raises(Tripped, match=r"force 30\d\.\d N, limit 300 N"):
            run_plan(pushed_back(60.0), bench, recorder, nothing)
        bench.clock.wait_until(bench.clock.now_s() + 1.0)
        assert abs(bench.motor.read().torque_Nm[-1]) == 0.0
    assert [stage.direction for stage in recorder.stages] == ["loading"]
