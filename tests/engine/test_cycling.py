"""Cycle after cycle on the twin: each is counted once, ends in the air, and is a row of the
numbers that its samples hold.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rfca_rig.drivers.roles import ForceSamples, SensorScale, ShaftSamples
from rfca_rig.engine.interfaces import StopLevel
from rfca_rig.engine.run import Supervision, run_plan
from rfca_rig.engine.stages import (
    BEFORE_START_RAD,
    MAX_TURNS,
    MOVE_TICK_S,
    CycleProfile,
    CycleTally,
    check_turns,
)
from rfca_rig.errors import Stopped, Tripped
from rfca_rig.protocol.plan import Cycles, MoveShaft, Plan, SetHeight
from rfca_rig.recording.tables import cycle_table
from tests.engine.rigs import nothing, recorder_on, twin_rig

TURN = 2.0 * math.pi
HEIGHT_M = 0.2228
SPEED_RAD_S = 6.0


def turned(turning, ends_soon_after=None):
    """Follows the commanded speed; the numbers of the cycles, the angle at the end, and the
    largest and the last speed.
    """
    angle = 0.25
    speeds = []
    numbers = []
    while not turning.is_over:
        speeds.append(turning.speed_rad_s(angle))
        angle += speeds[-1] * MOVE_TICK_S
        if turning.count_if_complete(angle):
            numbers.append(turning.number)
            if turning.number == ends_soon_after:
                turning.end_after_next()
    return numbers, angle, max(speeds), speeds[-1]


@settings(max_examples=30)
@given(st.integers(1, 10**6), st.integers(1, 5), st.floats(2.0, 20.0))
def test_the_shaft_turns_as_often_as_asked_and_stops_in_the_air_before_the_start(
    first, count, speed
):
    numbers, angle, fastest, last = turned(
        CycleProfile(0.25, Cycles(HEIGHT_M, speed, first, count))
    )
    assert numbers == list(range(first, first + count))
    assert angle == pytest.approx(
        0.25 + TURN * count - BEFORE_START_RAD, abs=0.05 + last * MOVE_TICK_S
    )
    assert angle < 0.25 + TURN * count
    assert fastest == pytest.approx(speed)
    assert last < 0.25 * speed


@settings(max_examples=30)
@given(st.integers(2, 6), st.integers(1, 5))
def test_a_stop_that_is_wished_for_comes_with_the_end_of_the_next_cycle(count, wished_after):
    numbers, _, _, last = turned(
        CycleProfile(0.25, Cycles(HEIGHT_M, SPEED_RAD_S, 1, count)), wished_after
    )
    assert numbers == list(range(1, min(count, wished_after + 1) + 1))
    assert last < 0.25 * SPEED_RAD_S


def samples(random, count, begin_s):
    time_s = begin_s + 1e-3 * np.arange(1, count + 1)
    counts = random.integers(-(10**8), 10**8, (count, 6)).astype(np.int32)
    force = ForceSamples(time_s, time_s, np.arange(count), np.zeros(count, np.uint32), counts)
    return ShaftSamples(time_s, time_s, 3.0 * time_s, np.full(count, 3.0), np.zeros(count)), force


def test_a_tally_is_what_all_samples_of_the_cycle_together_say():
    random = np.random.default_rng(1)
    tally = CycleTally(SensorScale(1e6, 2e6, 1e3))
    for cycle in (1, 2):
        ticks = [samples(random, 5, 0.005 * (10 * cycle + tick)) for tick in range(10)]
        for shaft, force in ticks:
            tally.take(shaft, force)
        done = tally.cycle(cycle)
        counts = np.concatenate([force.counts for _, force in ticks]).astype(float)
        assert done.peak_force_N == pytest.approx(np.linalg.norm(counts[:, :3], axis=1).max() / 1e6)
        assert done.peak_moment_Nm == pytest.approx(
            np.linalg.norm(counts[:, 3:], axis=1).max() / 2e6
        )
        assert done.min_fz_N == pytest.approx(counts[:, 2].min() / 1e6)
        assert done.mean_speed_rad_s == pytest.approx(3.0)
        assert (done.number, done.host_s) == (cycle, pytest.approx(0.005 * (10 * cycle + 10)))


@pytest.mark.parametrize("turns", [MAX_TURNS - 1, -MAX_TURNS + 1])
def test_a_drive_may_turn_as_far_as_it_can_tell(turns):
    check_turns(TURN * turns)


def test_a_drive_that_has_turned_further_is_to_be_switched_off_and_on():
    with pytest.raises(
        Stopped,
        match="switch the drive off and on again, check its zero, then go on with rfca-rig resume",
    ):
        check_turns(TURN * (MAX_TURNS + 1))


def plan_of(cycles):
    """Those cycles and the way home, of a rig whose leg hangs at the start already."""
    facts = twin_rig().facts()
    home = MoveShaft(facts.start_angle_rad, 3.0, forwards=True)
    stages = (
        SetHeight(HEIGHT_M),
        replace(home, forwards=False),
        Cycles(HEIGHT_M, SPEED_RAD_S, 1, cycles),
        home,
    )
    return Plan("cycles", "fatigue", stages, facts.limits, facts.rates)


def test_cycles_on_the_twin_are_counted_in_rows_and_a_wish_ends_them_between_two(tmp_path):
    supervision = Supervision()
    with recorder_on(twin_rig(), tmp_path / "run") as (bench, recorder, kept):
        row_after_row = recorder.cycle

        def counted(cycle):
            row_after_row(cycle)
            if cycle.number == 1:
                supervision.stop_request.ask(StopLevel.SAFE_POINT, "enough")

        recorder.cycle = counted
        with pytest.raises(Stopped, match="enough, at a safe point"):
            run_plan(plan_of(50), bench, recorder, nothing, supervision)
        table = cycle_table(kept.so_far())
    assert table.numbers.tolist() == [1, 2]
    assert np.all((table.peak_force_N > 40.0) & (table.peak_force_N < 60.0))
    assert np.all((table.min_fz_N < -35.0) & (-table.min_fz_N <= table.peak_force_N))
    assert np.all(table.peak_moment_Nm > 5.0)
    assert table.mean_speed_rad_s[1] == pytest.approx(
        SPEED_RAD_S, rel=0.1
    )  # it slows down at its end


def test_a_trip_among_cycles_keeps_those_that_were_counted(tmp_path):
    with recorder_on(twin_rig(), tmp_path / "run") as (bench, recorder, kept):
        row_after_row = recorder.cycle

        def counted(cycle):
            row_after_row(cycle)
            bench.sensor.stop()

        recorder.cycle = counted
        with pytest.raises(Tripped):
            run_plan(plan_of(5), bench, recorder, nothing)
        kept.keeper.finish("tripped")
        found = kept.so_far()
    assert cycle_table(found).numbers.tolist() == [1]
    assert [stage.cut_short for stage in found.raw] == ["tripped"]
