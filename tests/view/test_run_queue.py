"""The run's end of the view: whole ticks or none, words before the ticks after them,
stop_request that only grow.
"""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.engine.interfaces import StopLevel
from rfca_rig.recording.journal import block_size, frame_block
from rfca_rig.view.run_queue import MAX_WAITING, Stamp, tick_block, ticks_of
from tests.engine.rigs import one_condition, twin_rig
from tests.view.seen import counts_of, tick, watched

SECONDS = 3.0


def ticks(count, seed=1, rows=30):
    random = np.random.default_rng(seed)
    for number in range(1, count + 1):
        yield tick(0.002 * number, random.integers(-(10**8), 10**8, (rows, 6)))


def test_a_tick_comes_out_as_it_went_in():
    given = next(ticks(1))
    block = tick_block(given, Stamp(12.5, 3))
    assert block_size(block) == len(frame_block(block))
    seen = ticks_of([block, block])
    assert (
        seen.lost,
        seen.wall_s[1],
        seen.now_s[1],
        seen.target_rad[1],
        seen.temperature_C[1],
    ) == (3, 12.5, 0.002, 1.0, 30.0)
    assert (seen.shaft_samples[1], seen.force_records[1]) == (1, 30)
    np.testing.assert_array_equal(seen.counts, np.tile(given.force.counts, (2, 1)))
    np.testing.assert_array_equal(seen.force_device_s, np.tile(given.force.device_s, 2))
    np.testing.assert_array_equal(seen.shaft[2], np.tile(given.shaft.angle_rad, 2))


def test_where_the_view_is_behind_whole_ticks_are_left_out_and_counted():
    with watched(queue_bytes=20_000) as both:
        for one in ticks(50):
            both.run_queue.tick(one)
        lost = both.run_queue.lost
        assert 0 < lost < 50 * 30 and lost % 30 == 0
        both.run.beat()
        both.run_queue.tick(next(ticks(1)))
        both.run.beat()
        values = {line.name: line.value for line in both.run.source._health.list_lines()}
        assert values["lost to the view"] == f"{lost} records"


def test_a_view_that_is_gone_costs_neither_memory_nor_words():
    with watched(queue_bytes=2_000) as both:
        for one in ticks(20):
            both.run_queue.tick(one)
            both.clock.wait_until(both.clock.now_s() + 1.0)
        for number in range(3 * MAX_WAITING):
            both.run_queue.line(f"line {number}")
        assert len(both.run_queue._owed) == MAX_WAITING


def test_words_that_had_no_room_come_later_and_in_their_order():
    with watched(queue_bytes=20_000) as both:
        for one in ticks(50):
            both.run_queue.tick(one)
        for number in range(5):
            both.run_queue.line(f"line {number}")
        both.run.beat()
        both.run_queue.tick(next(ticks(1)))
        both.run.beat()
        assert both.run.source.state()["said"] == [f"line {number}" for number in range(5)]


@pytest.mark.parametrize(
    ("how", "level"), [("safe point", StopLevel.SAFE_POINT), ("now", StopLevel.TORQUE_OFF)]
)
def test_a_stop_that_the_page_asks_for_is_a_wish_at_the_next_tick(how, level):
    with watched() as both:
        assert both.run.stop(how)
        assert both.stop_request.level is StopLevel.GO_ON
        both.run_queue.tick(tick(0.002, counts_of(1.0)))
        assert both.stop_request.level is level and "in the view" in both.stop_request.why
        assert len(both.told) == 1
        assert both.run.source.state()["stop_asked"] == how


def test_a_wish_is_never_taken_back_and_an_end_is_no_longer_wished_for():
    with watched() as both:
        both.run.stop("now")
        assert both.run.stop("safe point")
        both.run_queue.energising()
        assert both.stop_request.level is StopLevel.TORQUE_OFF
        both.run_queue.end("done", "")
        both.run.beat()
        assert not both.run.stop("now")


def test_an_unknown_way_to_stop_is_none():
    with watched() as both, pytest.raises(LookupError):
        both.run.stop("gently")


def test_stages_are_known_by_their_place_also_when_the_same_comes_again():
    once = one_condition(twin_rig(), 2)
    with watched(given=replace(once, stages=(*once.stages, *once.stages))) as both:
        numbers = []
        for stage in both.plan.stages:
            both.run_queue.stage(stage, None, None)
            both.run.beat()
            numbers.append(both.run.source.state()["stage"])
        assert numbers == list(range(len(both.plan.stages)))


def test_a_pause_goes_to_the_run_and_its_state_to_the_page():
    with watched() as both:
        run = both.run
        assert run.source.state()["pause"] is None
        assert run.pause(True) and not run.pause(True)
        assert not both.stop_request.is_pause_asked
        both.run_queue.tick(tick(0.002, counts_of(1.0)))
        assert both.stop_request.is_pause_asked and both.stop_request.level is StopLevel.GO_ON
        assert run.source.state()["pause"] == "asked"
        both.run_queue.pause(True)
        run.beat()
        assert run.source.state()["pause"] == "paused"
        assert run.pause(False) and not run.pause(False)
        both.run_queue.tick(tick(0.004, counts_of(1.0)))
        assert not both.stop_request.is_pause_asked
        both.run_queue.pause(False)
        run.beat()
        assert run.source.state()["pause"] is None
        # For the terminal, in the order of what happened.
        assert [line.split(":")[0] for line in both.told] == [
            "the view asks for a pause, once the leg is in the air after a stage",
            "paused",
            "the view asks to go on",
            "the pause is over",
        ]


def test_a_stop_goes_before_a_pause_and_is_not_lost_with_it():
    with watched() as both:
        both.run.pause(True)
        both.run.stop("safe point")
        both.run_queue.tick(tick(0.002, counts_of(1.0)))
        assert both.stop_request.level is StopLevel.SAFE_POINT and both.stop_request.is_pause_asked
        # A run that is to stop is not asked to go on.
        assert not both.run.pause(False)
