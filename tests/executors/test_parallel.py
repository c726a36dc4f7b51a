"""Maps on all cores of one command: in threads, and in copies of the process."""

import multiprocessing
import os
import threading
import time
from dataclasses import dataclass

import numpy as np
import pytest

from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.executors import parallel
from rfca_rig.executors.cores import VARIABLE, cores
from rfca_rig.executors.parallel import map_in_processes, map_in_threads, split_evenly
from tests.waiting import wait_for

needs_copies = pytest.mark.skipif(
    not parallel.CAN_COPY, reason="this system makes no copies of a process"
)


@dataclass(frozen=True)
class Found:
    by: object
    values: np.ndarray


@pytest.fixture(autouse=True)
def _three_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "3")


@pytest.mark.parametrize("apply", [map_in_threads, map_in_processes])
def test_results_come_in_the_order_of_the_items(apply) -> None:
    assert apply(lambda number: number**2, range(20)) == [number**2 for number in range(20)]
    assert apply(lambda number: number, []) == []


@needs_copies
def test_copies_and_this_process_work_at_once_and_use_one_core_each(tmp_path) -> None:
    here = tmp_path / str(os.getpid())

    def look(_: int) -> tuple[int, int, bool]:
        (tmp_path / str(os.getpid())).touch()
        # Each process keeps its first item until another one has begun, this one too, so no process
        # can do all the work alone.
        wait_for(lambda: here.exists() and len(list(tmp_path.iterdir())) > 1)
        return os.getpid(), cores(), threading.current_thread() is threading.main_thread()

    places = map_in_processes(look, range(12))
    assert os.getpid() in {pid for pid, *_ in places}
    assert 1 < len({pid for pid, *_ in places}) <= 3
    assert {(count, is_main) for _, count, is_main in places} == {(1, True)}
    assert cores() == 3


@needs_copies
def test_after_an_error_no_process_takes_a_further_item(tmp_path) -> None:
    failing = tmp_path / "4"

    def work(number: int) -> None:
        (tmp_path / str(number)).touch()
        if number == 4:
            raise BadInput("4")
        if number > 4:
            wait_for(failing.exists)
            time.sleep(0.2)

    with pytest.raises(BadInput, match="4"):
        map_in_processes(work, range(100))
    assert len(list(tmp_path.iterdir())) < 20


@needs_copies
def test_an_interruption_ends_the_copies() -> None:
    here = os.getpid()

    def interrupt(_: int) -> None:
        if os.getpid() == here:
            raise KeyboardInterrupt
        time.sleep(60.0)

    with pytest.raises(KeyboardInterrupt):
        map_in_processes(interrupt, range(6))
    assert not multiprocessing.active_children()


def test_one_core_needs_no_copy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "1")
    assert map_in_processes(lambda _: os.getpid(), range(3)) == [os.getpid()] * 3


@needs_copies
def test_a_result_refers_to_the_shared_objects_themselves() -> None:
    # A function without a name that another process could import it by.
    law = lambda x: 2.0 * x  # noqa: E731
    found = map_in_processes(lambda number: Found(law, np.full(3, number)), range(4), shared=(law,))
    assert all(one.by is law for one in found)
    assert [one.values.tolist() for one in found] == [[float(number)] * 3 for number in range(4)]


@pytest.mark.parametrize("apply", [map_in_threads, map_in_processes])
@pytest.mark.parametrize(
    "error", [SimulationFailed("no rest pose"), BadInput("rig.toml: no such leg")]
)
def test_errors_reach_the_caller(apply, error: Exception) -> None:
    def fail(number: int) -> int:
        if number == 2:
            raise error
        return number

    with pytest.raises(type(error), match=str(error)):
        apply(fail, range(4))


@needs_copies
def test_the_work_is_done_here_where_a_copy_is_killed() -> None:
    here = os.getpid()

    def die_in_a_copy(number: int) -> int:
        if number == 1 and os.getpid() != here:
            os._exit(9)
        return number

    assert map_in_processes(die_in_a_copy, range(6)) == list(range(6))


def test_the_work_is_done_here_where_no_process_may_be_started(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse() -> int:
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.setattr(os, "fork", refuse)
    assert map_in_processes(lambda _: os.getpid(), range(4)) == [os.getpid()] * 4


def test_items_are_split_in_order_into_groups_of_about_the_same_size():
    assert split_evenly("abcdefg", 3) == ["ab", "cd", "efg"]
    assert split_evenly("ab", 8) == ["a", "b"]
