"""Who looks on sees all that the loop does, what trips it included, and can keep a motor from
being energised; time for those who watch.
"""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.clock import MAX_CATCH_UP_S, TwinClock, WatchedTwinClock
from rfca_rig.engine.interfaces import StopLevel, StopRequest
from rfca_rig.engine.run import Supervision, run_plan
from rfca_rig.errors import Stopped, Tripped
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import Flap
from tests.engine.rigs import nothing, one_condition, recorder_on, twin_rig
from tests.engine.test_stops import tapped


class Looking:
    """Remembers everything."""

    def __init__(self, stop_request=None):
        self._stop_request = stop_request
        self.stages = []
        self.ticks = []
        self.starts = []

    def stage(self, stage, expected, turns_rad):
        del turns_rad
        self.stages.append((stage, expected))

    def start(self, start_s):
        self.starts.append((start_s, self.stages[-1][0]))

    def energising(self):
        if self._stop_request is not None:
            self._stop_request.ask(StopLevel.SAFE_POINT, "stopped by a test")

    def pause(self, is_paused):
        del is_paused

    def tick(self, tick):
        self.ticks.append(tick)


def looked_at(tmp_path, plan, expected=None, stop_request=None):
    rig = twin_rig()
    looking = Looking(stop_request)
    with recorder_on(rig, tmp_path / "run") as (bench, recorder, kept):
        wiretap = tapped(bench)
        try:
            run_plan(
                plan,
                bench,
                recorder,
                nothing,
                Supervision(expected or {}, stop_request or StopRequest(), looking),
            )
        except (Stopped, Tripped) as error:
            looking.error = error
        return looking, bench, wiretap, kept.so_far()


def test_every_sample_and_every_stage_is_seen(tmp_path):
    plan = one_condition(twin_rig())
    load = Load(100.0, 10.0)
    flap = next(stage for stage in plan.stages if isinstance(stage, Flap))
    looking, bench, _, kept = looked_at(tmp_path, plan, {flap: load})
    assert looking.stages == [(stage, load if stage is flap else None) for stage in plan.stages]
    assert sum(len(tick.force.counts) for tick in looking.ticks) == bench.sensor.health().received
    seen = np.concatenate([tick.force.counts[:, 2] for tick in looking.ticks])
    fz_N = kept.strokes[0].streams["force"].columns["fz_N"].values
    recorded = np.round(fz_N * bench.sensor.scale().counts_per_N)
    assert any(
        (seen[at : at + len(recorded)] == recorded).all()
        for at in np.flatnonzero(seen == recorded[0])
    )
    assert all(
        abs(tick.target_rad - tick.shaft.angle_rad[-1]) < 0.5
        for tick in looking.ticks[1:]
        if len(tick.shaft.angle_rad)
    )


def test_the_start_of_a_stroke_is_that_of_its_recording(tmp_path):
    plan = one_condition(twin_rig(), 2)
    looking, _, _, kept = looked_at(tmp_path, plan)
    flaps = [stage for stage in plan.stages if isinstance(stage, Flap)]
    assert [stage for _, stage in looking.starts] == flaps
    for (start_s, _), stroke in zip(looking.starts, kept.strokes, strict=True):
        force = stroke.streams["force"]
        # The record that took no time to the host shows where the clocks meet.
        delays_s = force.columns["host_s"].values - force.t_s
        assert delays_s.min() == pytest.approx(start_s, abs=1e-9)


def test_the_tick_that_trips_is_seen_too(tmp_path):
    plan = one_condition(twin_rig())
    looking, bench, _, _ = looked_at(
        tmp_path, replace(plan, limits=replace(plan.limits, force_N=30.0))
    )
    assert looking.error.code == "L-01"
    scale = bench.sensor.scale().counts_per_N
    sizes = [
        np.linalg.norm(tick.force.counts[:, :3], axis=1).max(initial=0.0) / scale
        for tick in looking.ticks
    ]
    assert max(sizes[:-1]) < 30.0 < sizes[-1]


def test_a_stop_that_is_wished_for_while_the_rack_is_set_energises_nothing(tmp_path):
    looking, _, wiretap, kept = looked_at(
        tmp_path, one_condition(twin_rig()), stop_request=StopRequest()
    )
    assert isinstance(looking.error, Stopped) and not looking.ticks and not kept.strokes
    with_motion, _, moved, _ = looked_at(tmp_path / "whole", one_condition(twin_rig()))
    assert with_motion.ticks and len(wiretap.sent) < 10 < len(moved.sent)


@pytest.mark.parametrize("pace", [1.0, 4.0])
def test_a_watched_twin_takes_the_time_that_it_shows(pace):
    clock = WatchedTwinClock(pace)
    wall = clock._wall = TwinClock()
    for tick in range(1, 1001):
        clock.wait_until(0.01 * tick)
    assert clock.now_s() == pytest.approx(10.0) and wall.now_s() == pytest.approx(10.0 / pace)


def test_a_watched_twin_that_was_held_up_does_not_rush_on():
    clock = WatchedTwinClock()
    wall = clock._wall = TwinClock()
    clock.wait_until(1.0)
    wall.wait_until(6.0)
    clock.wait_until(2.0)
    clock.wait_until(3.0)
    assert wall.now_s() == pytest.approx(7.0 - MAX_CATCH_UP_S, abs=1e-9)
