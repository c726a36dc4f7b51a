"""Processes of this machine that share the work, each with one thread.

Each stands in an executor of its own, so that the end of one breaks no other, and it is known which work it had.
"""

import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import active_children, get_context, parent_process
from multiprocessing.process import BaseProcess
from threading import Lock, Thread, local
from typing import Any, ParamSpec, TypeVar

from rfca_rig.executors.base import InProcessExecutor, TaskExecutor, WorkerLost
from rfca_rig.executors.cores import ONE_THREAD

P = ParamSpec("P")
T = TypeVar("T")


@contextmanager
def process_executor(workers: int) -> Iterator[TaskExecutor]:
    """`workers` processes; with 0 of them the work is done here.

    What is handed to a process must be importable by name. Processes end with the block, in the middle of their work where the block
    ends with an exception, and when this process dies. One that is lost is replaced.
    """
    if workers == 0:
        yield InProcessExecutor()
        return
    others = set(active_children())
    with _one_thread_each():
        processes = ProcessExecutor(workers)
        try:
            yield processes
        except BaseException:
            processes.stop_hiring()
            _end(set(active_children()) - others)
            raise
        finally:
            processes.shutdown()


class ProcessExecutor(TaskExecutor):
    """A thread for each process hands it its work and waits for it."""

    def __init__(self, workers: int) -> None:
        self._threads = ThreadPoolExecutor(workers, thread_name_prefix="hand")
        self._workers = workers
        self._of_thread = local()
        self._pools: list[ProcessPoolExecutor] = []
        self._hiring = Lock()
        self._is_over = False

    @property
    def workers(self) -> int:
        return self._workers

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        return self._threads.submit(self._done, fn, args, kwargs)

    def _done(self, fn: Callable[..., T], args: tuple[Any, ...], kwargs: dict[str, Any]) -> T:
        """In the thread: the process of this thread does it."""
        try:
            with self._hiring:
                future = self._own_pool().submit(fn, *args, **kwargs)
            return future.result()
        except BrokenProcessPool:
            self._of_thread.pool = None
            raise WorkerLost("its process was ended from outside, perhaps for want of memory") from None

    def _own_pool(self) -> ProcessPoolExecutor:
        if self._is_over:
            raise WorkerLost("the work was stopped")
        pool: ProcessPoolExecutor | None = getattr(self._of_thread, "pool", None)
        if pool is None:
            pool = self._of_thread.pool = ProcessPoolExecutor(1, get_context("spawn"), _begin)
            self._pools.append(pool)
        return pool

    def stop_hiring(self) -> None:
        """After this no process is begun."""
        with self._hiring:
            self._is_over = True

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        self._threads.shutdown(wait, cancel_futures=cancel_futures or self._is_over)
        for pool in self._pools:
            pool.shutdown(wait)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Linear algebra counts its threads when it is loaded: what a new process inherits must say it."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value


def _begin() -> None:
    """In each process before anything else. ^C reaches all processes of a terminal, and only the first should answer it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=_leave_with_parent, daemon=True).start()


def _leave_with_parent() -> None:
    """A process whose parent was killed would wait for work for ever."""
    parent: Any = parent_process()
    parent.join()
    os._exit(1)


def _end(processes: set[BaseProcess]) -> None:
    for process in processes:
        process.terminate()
