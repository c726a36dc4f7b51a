"""The list that is checked, printed and timed is the list that is run: for any plan, on a rig
that simply obeys.
"""

from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings

from rfca_rig.cli.commands.measure.plan import _rows
from rfca_rig.clock import TwinClock
from rfca_rig.engine.interfaces import Bench
from rfca_rig.engine.run import run_plan
from rfca_rig.errors import Trip, Tripped
from rfca_rig.protocol.experiments import StaticStages, static_plan
from tests.engine.obedient import Motor, Nowhere, Sensor
from tests.protocol.random_plans import PLANS, SETTLE
from tests.protocol.test_plans import RIG


@pytest.mark.long
@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(plan=PLANS)
def test_what_is_run_is_what_was_planned_in_no_more_than_the_time_that_was_told(plan):
    clock = TwinClock()
    carried_out = []
    motor = Motor(clock)
    sensor = Sensor(clock)
    run_plan(plan, Bench(motor, sensor, motor, clock, is_real=False), Nowhere(), carried_out.append)
    assert carried_out == list(plan.stages)
    assert len(_rows(plan, {})) == len(carried_out)
    assert clock.now_s() <= plan.duration_s + 1.0


def test_a_stage_in_which_the_shaft_told_nothing_is_no_measurement():
    """Shorter than the time for which an encoder may be silent, and yet nothing that could be
    recorded.
    """
    clock = TwinClock()

    class Mute(Motor):
        is_mute = False

        def read(self):
            told = super().read()
            if self.is_mute:
                return replace(told, **{name: values[:0] for name, values in vars(told).items()})
            return told

    motor = Mute(clock)

    class Muting(Nowhere):
        def begin(self, _stage):
            motor.is_mute = True

        def hold(self, stage, recorded):
            raise AssertionError(f"{stage.label} counts as measured: {recorded}")

    plan = static_plan(StaticStages("s", (0.215,), ((1.0, "loading"),), 0.4, SETTLE, 0.08), RIG)
    with pytest.raises(
        Tripped, match=r"no report of the shaft's angle in the 0\.08 s of hold 1"
    ) as found:
        run_plan(
            plan, Bench(motor, Sensor(clock), motor, clock, is_real=False), Muting(), lambda _: None
        )
    assert found.value.code == Trip.READING_OLD
