"""Work handed to processes of this machine: the same results as here, and what becomes of it
when a process is lost.
"""

import os
import signal
import threading
import time
from concurrent.futures import Future
from pathlib import Path

import pytest

from rfca_rig.clock import TwinClock
from rfca_rig.errors import RigError
from rfca_rig.executors.mapping import (
    InProcessExecutor,
    TaskExecutor,
    TaskFailure,
    WorkerLost,
    map_unordered,
    process_executor,
)
from tests.executors import work


@pytest.fixture(scope="module")
def two():
    with process_executor(2) as processes:
        yield processes


def kill_the_one_at(path: Path) -> None:
    """The process that has begun the piece whose file this is, as soon as it has."""
    until = time.monotonic() + 60.0
    while not (path.is_file() and path.read_text().endswith("\n")):
        assert time.monotonic() < until
        time.sleep(0.02)
    os.kill(int(path.read_text().split()[0]), signal.SIGKILL)


def begun(folder: Path) -> dict[int, int]:
    """How often each piece was begun."""
    return {int(path.name): len(path.read_text().splitlines()) for path in folder.iterdir()}


def test_the_same_bits_here_and_in_processes(two):
    seeds = range(12)
    here = work.digest(dict(map_unordered(InProcessExecutor(), work.stroke, seeds)))
    assert work.digest(dict(map_unordered(two, work.stroke, seeds))) == here


def test_processes_use_one_thread_each(two):
    assert {told for _, told in map_unordered(two, work.threads, range(4))} == {(1, "1")}


def test_what_raises_is_told_with_its_trace_and_the_rest_is_done(two):
    results = dict(map_unordered(two, work.fails_at_three, range(6)))
    failed = results.pop(3)
    assert results == {number: 10 * number for number in (0, 1, 2, 4, 5)}
    assert (
        isinstance(failed, TaskFailure)
        and failed.reason == "ZeroDivisionError: three"
        and "fails_at_three" in failed.trace
    )


@pytest.mark.slow
def test_a_piece_that_ends_its_process_twice_is_given_up_and_the_rest_is_done(two):
    results = dict(map_unordered(two, work.kills_at_three, range(6)))
    failed = results.pop(3)
    assert results == {number: 10 * number for number in (0, 1, 2, 4, 5)}
    assert isinstance(failed, TaskFailure) and failed.reason.startswith(
        "2 workers were lost over it"
    )


@pytest.mark.slow
def test_a_result_that_cannot_travel_is_the_fault_of_its_piece_only(two):
    results = dict(map_unordered(two, work.returns_what_cannot_travel, range(6)))
    assert isinstance(results.pop(3), TaskFailure) and results == {
        number: number for number in (0, 1, 2, 4, 5)
    }


def test_a_killed_process_costs_the_piece_that_it_had(two, tmp_path):
    killer = threading.Thread(target=kill_the_one_at, args=(tmp_path / "2",))
    killer.start()
    pieces = [(tmp_path, number) for number in range(6)]
    results = {
        number: result
        for (_, number), result in map_unordered(two, work.waits_to_be_killed_at_two, pieces)
    }
    killer.join()
    assert results == {number: 10 * number for number in range(6)}
    assert begun(tmp_path) == {0: 1, 1: 1, 2: 2, 3: 1, 4: 1, 5: 1}


def test_nothing_is_left_running_when_the_block_ends_with_an_error(tmp_path):
    def stops_in_the_middle() -> None:
        with process_executor(1) as process:
            for _ in map_unordered(process, work.slow, [(tmp_path, number) for number in range(4)]):
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stops_in_the_middle()
    pids = {int(line) for path in tmp_path.iterdir() for line in path.read_text().split()}
    until = time.monotonic() + 60.0
    while any(
        Path(f"/proc/{pid}").exists()
        and "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()
        for pid in pids
    ):
        assert time.monotonic() < until
        time.sleep(0.05)


class Recorded(TaskExecutor):
    """Does the work here, on a clock on which each piece takes 10 ms, and remembers how many
    came at once.
    """

    def __init__(self, lost: int = 0, error: Exception | None = None) -> None:
        self.sizes: list[int] = []
        self.lost = lost
        self.error = error or WorkerLost("gone")

    @property
    def workers(self) -> int:
        return 1

    def submit(self, fn, /, *args, **kwargs):
        self.sizes.append(len(args[0]))
        future: Future = Future()
        if self.lost:
            self.lost -= 1
            future.set_exception(self.error)
        else:
            future.set_result(fn(*args, **kwargs))
        return future


class Ticking(TwinClock):
    """On which a batch takes as long as a tenth of a second."""

    def now_s(self) -> float:
        return 0.1


def test_short_pieces_travel_in_batches_of_a_second_and_the_last_ones_are_shared_out():
    executor = Recorded()
    assert sorted(map_unordered(executor, work.fails_at_three, range(4, 504), Ticking)) == [
        (number, 10 * number) for number in range(4, 504)
    ]
    assert executor.sizes[:2] == [1, 1] and max(executor.sizes) == 100 and executor.sizes[-1] == 1
    assert sum(executor.sizes) == 500


def test_a_lost_batch_is_done_again_piece_by_piece_and_no_piece_is_blamed_for_it():
    executor = Recorded()
    results = {}
    for number, result in map_unordered(executor, work.fails_at_three, range(4, 104), Ticking):
        results[number] = result
        if len(executor.sizes) == 4:
            executor.lost = 1
    lost = max(executor.sizes[4:7])
    assert lost > 1 and results == {number: 10 * number for number in range(4, 104)}
    assert sum(executor.sizes) == 100 + lost


def test_lost_work_waits_until_the_crew_is_calm(monkeypatch):
    monkeypatch.setattr("rfca_rig.executors.mapping.LOOK_EVERY_S", 0.01)

    class Second(TwinClock):
        """Each look at it takes a second."""

        def now_s(self) -> float:
            self.wait_until(super().now_s() + 1.0)
            return super().now_s()

    executor = Recorded(lost=1)
    executor.retry_delay_s = 30.0
    began = [
        (number, result)
        for number, result in map_unordered(executor, work.fails_at_three, range(4, 10), Second)
    ]
    assert [number for number, _ in began] == [5, 6, 7, 8, 9, 4] and dict(began)[4] == 40


def test_a_crew_that_is_no_more_ends_the_work():
    executor = Recorded(lost=1, error=RigError("the scheduler is gone"))
    with pytest.raises(RigError, match="the scheduler is gone"):
        list(map_unordered(executor, work.fails_at_three, range(3)))
