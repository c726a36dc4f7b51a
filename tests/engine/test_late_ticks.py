"""A computer that is late now and then: a stroke keeps its length, and nothing trips for want of
time.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from rfca_rig.clock import Clock
from rfca_rig.engine.run import run_plan
from tests.engine.rigs import nothing, one_condition, recorder_on, twin_rig


@dataclass
class Hesitant:
    """Every tenth wait takes 8 ms longer than it should, as on a busy machine."""

    clock: Clock
    waits: int = 0

    def now_s(self) -> float:
        return self.clock.now_s()

    def start_time(self):
        return self.clock.start_time()

    def wait_until(self, t_s: float) -> None:
        self.waits += 1
        self.clock.wait_until(t_s + (0.008 if self.waits % 10 == 0 else 0.0))


def swept(tmp_path, hesitant: bool) -> tuple[float, float]:
    """Time and angle that one stroke took."""
    rig = twin_rig()
    with recorder_on(rig, tmp_path) as (bench, recorder, _):
        clock = Hesitant(bench.clock) if hesitant else bench.clock
        run_plan(one_condition(rig), replace(bench, clock=clock), recorder, nothing)
    shaft = recorder.strokes[0].streams["shaft"]
    return float(shaft.t_s[-1]), float(np.ptp(shaft.columns["shaft_angle_rad"].data))


@pytest.mark.slow
def test_a_stroke_is_as_long_and_as_wide_as_on_a_computer_that_is_never_late(tmp_path):
    in_time = swept(tmp_path / "a", False)
    late = swept(tmp_path / "b", True)
    assert late == pytest.approx(in_time, abs=0.03)


@pytest.mark.slow
def test_the_longest_gap_between_commands_is_known(tmp_path):
    """Ticks of 2 to 10 ms, now and then 8 ms late."""
    rig = twin_rig()
    for folder, late_s in (("a", 0.0), ("b", 0.008)):
        with recorder_on(rig, tmp_path / folder) as (bench, recorder, _):
            run_plan(
                one_condition(rig),
                replace(bench, clock=Hesitant(bench.clock) if late_s else bench.clock),
                recorder,
                nothing,
            )
        assert recorder.worst_gap_s == pytest.approx(0.010 + late_s, abs=1e-6)
