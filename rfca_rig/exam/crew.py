"""Processes that share the work of an exam, each with one thread on a core of its own."""

import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context, parent_process
from multiprocessing.process import BaseProcess
from multiprocessing.queues import SimpleQueue
from threading import Thread
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")

Told = Callable[[str, int, int], None]
"""Is told what is being done, how many of it are done, and of how many."""


def silent(what: str, done: int, of: int) -> None:
    """Tells nobody."""


class Here(Executor):
    """Does the work at once, in this process."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


@contextmanager
def crew(workers: int) -> Iterator[Executor]:
    """`workers` processes; with 0 of them the work is done here.

    What is handed to a process must be importable by name. Processes end with the block, in the middle of their work where the block
    ends with an exception, and when this process dies.
    """
    if workers == 0:
        yield Here()
        return
    others = set(active_children())
    context = get_context("spawn")
    cores: SimpleQueue[int] = context.SimpleQueue()
    for core in _cores(workers):
        cores.put(core)
    with _one_thread_each(), ProcessPoolExecutor(workers, context, _begin, (cores,)) as pool:
        try:
            yield pool
        except BaseException:
            _end(set(active_children()) - others)
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _cores(workers: int) -> list[int]:
    """A core for each process, in turn where there are more processes than cores; none on systems that place processes themselves."""
    if not hasattr(os, "sched_getaffinity"):
        return []
    mine = sorted(os.sched_getaffinity(0))
    return [mine[i % len(mine)] for i in range(workers)]


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Linear algebra counts its threads when it is loaded: what a new process inherits must say it."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value


def _begin(cores: "SimpleQueue[int]") -> None:
    """In each process before anything else. ^C reaches all processes of a terminal, and only the first should answer it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ.update(dict.fromkeys(THREADS, "1"))
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {cores.get()})
    Thread(target=_leave_with_parent, daemon=True).start()


def _leave_with_parent() -> None:
    """A process whose parent was killed would wait for work for ever."""
    parent: Any = parent_process()
    parent.join()
    os._exit(1)


def _end(processes: set[BaseProcess]) -> None:
    for process in processes:
        process.terminate()
