"""Every tick's gap is counted once, in the bin that its recording states."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rfca_rig.engine.loop_gaps import BINS_PER_DECADE, EDGES_S, GapCounter, bin_end_ms
from rfca_rig.engine.run import run_plan
from rfca_rig.recording.loop_gaps import recorded_gaps
from tests.engine.rigs import nothing, one_condition, recorder_on, twin_rig
from tests.engine.test_late_ticks import Hesitant


def counted(gaps_s):
    counter = GapCounter()
    for gap_s in gaps_s:
        counter.take(gap_s)
    return counter


@settings(max_examples=50)
@given(st.lists(st.floats(0.0, 30.0), min_size=1, max_size=60))
def test_every_gap_lies_in_its_bin_and_is_counted_once(gaps_s):
    counter = counted(gaps_s)
    histogram = counter.histogram()
    assert histogram.ticks == len(gaps_s)
    assert counter.longest_s == max(gaps_s)
    for edge_ms, count in histogram.ticks_by_edge_ms.items():
        end_ms = bin_end_ms(edge_ms) or np.inf
        # Edges are recorded with four digits.
        inside = [
            gap_s for gap_s in gaps_s if edge_ms * (1 - 1e-3) <= 1e3 * gap_s <= end_ms * (1 + 1e-3)
        ]
        assert len(inside) >= count > 0


def test_bins_are_logarithmic_from_a_tenth_of_a_millisecond_to_a_second():
    ratios = np.array(EDGES_S[1:]) / np.array(EDGES_S[:-1])
    np.testing.assert_allclose(ratios, 10.0 ** (1.0 / BINS_PER_DECADE))
    assert (EDGES_S[0], EDGES_S[-1]) == pytest.approx((1e-4, 1.0))
    assert counted([5e-5, 3.0]).histogram().ticks_by_edge_ms == {0.0: 1, 1000.0: 1}


def test_a_tick_of_a_usual_period_is_in_one_bin_whatever_its_rounding():
    for period_s in (0.002, 0.005, 0.010):
        rounded = np.nextafter(period_s, 0.0), period_s, np.nextafter(period_s, 1.0)
        assert len(counted(rounded).histogram().ticks_by_edge_ms) == 1


def test_the_words_bound_the_share_and_name_the_longest_gap_and_the_watchdog():
    counter = counted([*[0.0021] * 9990, *[0.0030] * 9, 0.007])
    provenance = {
        "loop_gaps_ms": counter.histogram().text(),
        "worst_loop_gap_ms": f"{1e3 * counter.longest_s:.3f}",
        "watchdog_ms": "100",
    }
    assert recorded_gaps(provenance).text() == (
        "99.9 % of 10000 ticks within 2.1 ms; longest 7.0 ms; the watchdog is 100 ms"
    )
    assert "watchdog" not in recorded_gaps({**provenance, "watchdog_ms": "none"}).text()


def test_the_parts_of_a_resumed_run_are_added():
    ending = {"loop_gaps_ms": '{"1.995": 40, "35.48": 2}', "worst_loop_gap_ms": "36.1"}
    provenance = {
        "resumed": json.dumps([{"event": "run resumed", "ending": ending}]),
        "loop_gaps_ms": '{"1.995": 8}',
        "worst_loop_gap_ms": "2.0",
    }
    gaps = recorded_gaps(provenance)
    assert gaps.histogram.ticks_by_edge_ms == {1.995: 48, 35.48: 2}
    assert gaps.longest_ms == 36.1


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{", "7", '{"a": 1}', '{"1.995": "3"}', '{"1.995": -3}', '{"nan": 3}', "[" * 9999],
)
def test_what_is_no_table_of_counts_is_left_out(text):
    assert recorded_gaps({"loop_gaps_ms": text, "resumed": text}) is None
    assert recorded_gaps({"worst_loop_gap_ms": "12.5"}) is None


@pytest.mark.slow
def test_the_counts_of_a_run_sum_to_its_ticks(tmp_path, monkeypatch):
    """Each tick sends one command: those of the loop are counted at the driver."""
    rig = twin_rig()
    commands = 0
    with recorder_on(rig, tmp_path) as (bench, recorder, _):
        for name in ("command_angle", "command_speed"):
            command = getattr(bench.motor, name)

            def count(*words, command=command):
                nonlocal commands
                commands += 1
                command(*words)

            monkeypatch.setattr(bench.motor, name, count)
        run_plan(one_condition(rig), replace(bench, clock=Hesitant(bench.clock)), recorder, nothing)
    histogram = recorder.gaps.histogram()
    assert histogram.ticks == commands > 1000
    # Ticks of 2, 5 and 10 ms, those that were 8 ms late, and after these the next at once.
    assert set(histogram.ticks_by_edge_ms) == {0.0, 1.995, 4.732, 10.0, 12.59, 17.78}
