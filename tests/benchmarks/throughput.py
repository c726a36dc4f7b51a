"""Simulations through the executor, as share of the kernel's own rate.

Run: python -m tests.benchmarks.throughput [--short]

Two workers simulate strokes, each in a loop of its own: that is the kernel's own rate. Then the
same strokes, cut into cases of 5, 50 and 500 ms, are handed to the same workers: two processes of
this machine, or two workers of a Dask scheduler that lives in this process. Shown are medians over
rounds of both. Two shares of the same time are disturbed less by what else the machine does: `busy`
is the share of the workers' time in which they simulate, too low where others make them wait; `cpu`
is the share that simulating has in the processor time of workers and of this process, scheduler
included, which knows nothing of waiting. `head` is this process's own for each case.
"""

import argparse
import os
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass

import numpy as np

from rfca_rig.executors.cluster import connect_to_scheduler, import_distributed
from rfca_rig.executors.mapping import BATCH_S, TaskExecutor, map_unordered, process_executor
from rfca_rig.model.stroke import simulate_stroke_at_speed
from rfca_rig.progress import ignore_named_progress
from tests.executors.work import facts
from tests.model.legs import PAPER

T_S = np.arange(1, 1401) * 1e-3
HANDS = 2
CASE_MS = (5, 50, 500)
CASES = 100_000
CASE_CPU_S = 37.0  # of an exam


@dataclass(frozen=True)
class Simulated:
    """So many strokes by a process: seconds and processor time that they took, and the process's
    own at the end.
    """

    strokes: int
    seconds: float
    cpu_s: float
    process: int
    at_cpu_s: float


def simulated(strokes: int) -> Simulated:
    begin = time.perf_counter()
    cpu = time.process_time()
    for _ in range(strokes):
        simulate_stroke_at_speed(PAPER, 0.215, 2.433, T_S)
    end = time.perf_counter()
    at = time.process_time()
    return Simulated(strokes, end - begin, at - cpu, os.getpid(), at)


def nothing(number: int) -> int:
    return number


@dataclass(frozen=True)
class Round:
    """Strokes per second, shares of the workers' time and of all processor time that simulating
    had, this process's for each case.
    """

    rate: float
    busy: float
    cpu: float
    head_s: float


def measured(executor: TaskExecutor, strokes: int, cases: int, batch_s: float = BATCH_S) -> Round:
    """`cases` of so many strokes each."""
    begin = time.perf_counter()
    head = time.process_time()
    results = [
        result
        for _, result in map_unordered(executor, simulated, [strokes] * cases, batch_s=batch_s)
    ]
    took = time.perf_counter() - begin
    head = time.process_time() - head
    busy = sum(result.seconds for result in results) / (HANDS * took)
    return Round(strokes * cases / took, busy, _share_of_cpu(results, head), head / cases)


def _share_of_cpu(results: Sequence[Simulated], head_s: float) -> float:
    """Of the processor time from the end of each process's first case to that of its last, and
    of this process's.
    """
    simulating = 0.0
    all_ = head_s
    for process in {result.process for result in results}:
        own = sorted(
            (result for result in results if result.process == process),
            key=lambda result: result.at_cpu_s,
        )
        simulating += sum(result.cpu_s for result in own[1:])
        all_ += own[-1].at_cpu_s - own[0].at_cpu_s
    return simulating / all_


def own_rate(executor: TaskExecutor, strokes: int) -> float:
    """Strokes per second of workers that nobody interrupts: each does its share in one piece."""
    return sum(
        result.strokes / result.seconds
        for _, result in map_unordered(executor, simulated, [strokes // (2 * HANDS)] * HANDS)
    )


def pieces_per_s(executor: TaskExecutor, count: int) -> tuple[float, float]:
    """Pieces of no work, one at a time: how many a second, and seconds of this process's
    processor for each.
    """
    begin = time.perf_counter()
    head = time.process_time()
    for _ in map_unordered(executor, nothing, range(count), batch_s=0.0):
        pass
    return count / (time.perf_counter() - begin), (time.process_time() - head) / count


@contextmanager
def dask_workers(hands: int) -> Iterator[TaskExecutor]:
    """Workers of a scheduler, in processes of their own."""
    asked = {
        "n_workers": hands,
        "threads_per_worker": 1,
        "processes": True,
        "dashboard_address": "127.0.0.1:0",
        "silence_logs": 60,
    }
    with (
        import_distributed().LocalCluster(**asked) as cluster,
        connect_to_scheduler(
            cluster.scheduler_address, None, facts, ignore_named_progress, print
        ) as workers,
    ):
        yield workers


EXECUTORS: dict[str, Callable[[int], AbstractContextManager[TaskExecutor]]] = {
    "local pool": process_executor,
    "Dask": dask_workers,
}


def strokes_of(case_ms: int, stroke_s: float) -> int:
    return max(1, round(1e-3 * case_ms / stroke_s))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true", help="one short round: whether it works")
    short = parser.parse_args().short
    # A share of so short a time says nothing; that it comes out at all says that it works.
    if short:
        rounds = 1
        seconds = 0.1
        pieces = 50
        cases_ms = CASE_MS[:2]
    else:
        rounds = 9
        seconds = 10.0
        pieces = 5000
        cases_ms = CASE_MS
    simulated(5)
    stroke_s = min(simulated(20).cpu_s / 20 for _ in range(5))
    print(f"one stroke {1e3 * stroke_s:.2f} ms of processor time")
    for name, hired in EXECUTORS.items():
        with hired(HANDS) as hands:
            measured(hands, 1, 20)  # compiled code is loaded
            for case_ms in cases_ms:
                for batch_s in (BATCH_S, 0.0) if case_ms < 500 else (BATCH_S,):
                    _print_share(
                        name,
                        hands,
                        strokes_of(case_ms, stroke_s),
                        (case_ms, batch_s),
                        (rounds, seconds),
                    )
            _print_limits(name, hands, pieces)


def _print_share(
    name: str, hands: TaskExecutor, strokes: int, case: tuple[int, float], length: tuple[int, float]
) -> None:
    case_ms, batch_s = case
    rounds, seconds = length
    cases = max(2 * HANDS, round(HANDS * 1e3 * seconds / case_ms))
    found: list[tuple[float, Round]] = []
    for _ in range(rounds):
        before = own_rate(hands, strokes * cases)
        there = measured(hands, strokes, cases, batch_s)
        after = own_rate(hands, strokes * cases)
        found.append((2.0 * there.rate / (before + after), there))
    share, busy, cpu, head_s = (
        statistics.median(each)
        for each in zip(*((ratio, r.busy, r.cpu, r.head_s) for ratio, r in found), strict=True)
    )
    spread = (
        f"{100 * min(ratio for ratio, _ in found):.0f} to "
        f"{100 * max(ratio for ratio, _ in found):.0f}"
    )
    how = "in batches" if batch_s else "one by one"
    shares = (
        f"{100 * share:5.1f} % of the kernel's rate ({spread}), busy {100 * busy:5.1f} %, cpu "
        f"{100 * cpu:5.1f} %"
    )
    print(f"{name:10s} {case_ms:4d} ms {how}: {shares}, head {1e3 * head_s:6.3f} ms a case")


def _print_limits(name: str, hands: TaskExecutor, count: int) -> None:
    per_s, head_s = max((pieces_per_s(hands, count) for _ in range(3)), key=lambda found: found[0])
    print(f"{name}: {per_s:.0f} pieces of no work a second, head {1e3 * head_s:.2f} ms a piece")
    for cores in (10, 100, 1000):
        hours = CASES * CASE_CPU_S / cores / 3600.0
        pieces = cores / CASE_CPU_S
        print(
            f"   {cores:5d} cores: {CASES} cases in {hours:6.1f} h, {pieces:5.1f} a "
            f"second, head busy {100 * head_s * pieces:.1f} %"
        )
    print(
        f"   the head is full at {CASE_CPU_S / head_s:.0f} cores with cases of "
        f"{CASE_CPU_S:.0f} s, at {1.0 / head_s:.0f} with pieces of 1 s"
    )


if __name__ == "__main__":
    main()
