"""A stream's own time on the run's clock."""

import numpy as np

from rfca_rig.view.gauges import StreamClock


def blocks(began_s, seconds, drift=0.0, seed=1):
    """(host_s, device_s) of blocks of 10 ms, each of which arrives with a delay of its own."""
    random = np.random.default_rng(seed)
    for begin_s in np.arange(0.0, seconds, 0.01):
        device_s = begin_s + np.arange(10) * 1e-3
        yield began_s + device_s * (1.0 + drift) + random.uniform(1e-4, 5e-3), device_s


def worst_s(began_s, seconds, drift=0.0):
    """How far a time is from the true one, once the clock has settled."""
    clock = StreamClock()
    errors = []
    for host_s, device_s in blocks(began_s, seconds, drift):
        errors.append(
            np.abs(clock.run_s(host_s, device_s) - began_s - device_s * (1.0 + drift)).max()
        )
    return max(errors[100:])


def test_times_are_late_by_the_shortest_way_only():
    assert worst_s(7.0, 5.0) < 2e-4 + 1e-4


def test_clocks_that_drift_apart_are_followed():
    assert worst_s(7.0, 60.0, drift=100e-6) < 2e-3


def test_a_stream_that_was_started_anew_begins_where_it_arrives():
    clock = StreamClock()
    for host_s, device_s in blocks(3.0, 2.0):
        clock.run_s(host_s, device_s)
    host_s, device_s = next(blocks(9.0, 0.01))
    assert abs(clock.run_s(host_s, device_s)[0] - 9.0) < 6e-3


def test_records_that_overtook_each_other_change_nothing():
    clock = StreamClock()
    for host_s, device_s in blocks(3.0, 1.0):
        clock.run_s(host_s, device_s)
    late = clock.run_s(np.array([4.05]), np.array([0.98]))
    assert abs(late[0] - 3.98) < 1e-3
