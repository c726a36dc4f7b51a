"""A shaft that was left in mid-stroke, its leg bent on the ground: what remains of the plan
brings it home without harm.
"""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.engine.run import run_plan
from rfca_rig.errors import Tripped
from rfca_rig.protocol.plan import MoveShaft, SetHeight
from rfca_rig.protocol.written_plan import PlanProgress, make_remaining_plan
from tests.engine.rigs import nothing, one_condition, recorder_on, twin_rig

HEIGHT_M = 0.235  # where a leg that is pushed back wedges


class Standing:
    """A rack that stands at the height already."""

    def set_height(self, height_m):
        pass


class Braked:
    """A motor that does not let go when it is told to, so that the leg is still bent when the
    run goes on.
    """

    def __init__(self, motor):
        self._motor = motor
        self.angle_rad = np.nan

    def disable(self):
        pass

    def read(self):
        samples = self._motor.read()
        if len(samples.angle_rad):
            self.angle_rad = samples.angle_rad[-1]
        return samples

    def __getattr__(self, name):
        return getattr(self._motor, name)


def home_from_mid_stroke(folder, forwards):
    """The first two stages of what remains, with the shaft bent to 135 degrees; the largest
    force of each tick from then on.
    """
    plan = one_condition(twin_rig(), repeats=2)
    rack, home = make_remaining_plan(plan, PlanProgress(strokes=1)).stages[:2]
    assert home.forwards
    there = (SetHeight(HEIGHT_M), replace(home, forwards=False), MoveShaft(np.radians(135.0), 0.4))
    with recorder_on(twin_rig(), folder) as (bench, recorder, _):
        run_plan(replace(plan, stages=there[:1]), bench, recorder, nothing)
        stuck = replace(bench, rack=Standing(), motor=Braked(bench.motor))
        read = bench.sensor.read
        force_N = []

        def felt():
            samples = read()
            if len(samples.counts):
                force_N.append(
                    np.linalg.norm(samples.counts[:, :3], axis=1).max()
                    / bench.sensor.scale().counts_per_N
                )
            return samples

        def from_now_on(stage):
            if stage is rack:
                force_N.clear()

        bench.sensor.read = felt
        run_plan(
            replace(plan, stages=(*there, rack, replace(home, forwards=forwards))),
            stuck,
            recorder,
            from_now_on,
        )
        assert stuck.motor.angle_rad == pytest.approx(
            home.angle_rad + 2.0 * np.pi * forwards, abs=0.05
        )
        bench.motor.disable()
    return force_N


@pytest.mark.slow
def test_it_goes_on_forwards_and_the_force_only_falls(tmp_path):
    force_N = home_from_mid_stroke(tmp_path / "run", forwards=True)
    assert force_N[0] > 40.0
    assert max(force_N) < 1.02 * force_N[0]


def test_backwards_it_would_wedge(tmp_path):
    with pytest.raises(Tripped, match="L-01"):
        home_from_mid_stroke(tmp_path / "run", forwards=False)
