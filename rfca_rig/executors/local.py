"""Executor on local processes, each with one thread.

Each process has its own `ProcessPoolExecutor`. The loss of one then breaks no other, and it is known which task it had.
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

from rfca_rig.executors.cores import ONE_THREAD
from rfca_rig.executors.mapping import InProcessExecutor, TaskExecutor, WorkerLost

P = ParamSpec("P")
T = TypeVar("T")


@contextmanager
def process_executor(workers: int) -> Iterator[TaskExecutor]:
    """Executor on `workers` processes; with 0 the tasks run in this process.

    Functions must be importable by name. The processes end with the block, during a task if the block ends with an exception, and when
    this process dies. A lost process is replaced.
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
            processes.stop_starting_processes()
            # Only processes started here, not other children of this process.
            _end(set(active_children()) - others)
            raise
        finally:
            processes.shutdown()


class ProcessExecutor(TaskExecutor):
    """One thread per process passes it its tasks and waits for the results."""

    def __init__(self, workers: int) -> None:
        self._threads = ThreadPoolExecutor(workers, thread_name_prefix="hand")
        self._workers = workers
        self._of_thread = local()
        self._pools: list[ProcessPoolExecutor] = []
        self._start_lock = Lock()
        self._is_over = False

    @property
    def workers(self) -> int:
        return self._workers

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        return self._threads.submit(self._run_in_process, fn, args, kwargs)

    def _run_in_process(self, fn: Callable[..., T], args: tuple[Any, ...], kwargs: dict[str, Any]) -> T:
        """Runs in a thread: executes the task in this thread's process."""
        try:
            # The lock keeps a process from being started after `stop_starting_processes`.
            with self._start_lock:
                if self._is_over:
                    raise WorkerLost("the work was stopped")
                pool: ProcessPoolExecutor | None = getattr(self._of_thread, "pool", None)
                if pool is None:
                    # Spawn, as a forked copy of a process with threads may deadlock.
                    pool = self._of_thread.pool = ProcessPoolExecutor(1, get_context("spawn"), _initialise)
                    self._pools.append(pool)
                future = pool.submit(fn, *args, **kwargs)
            return future.result()
        except BrokenProcessPool:
            # A broken pool cannot be used again; the next task of this thread starts a new one.
            self._of_thread.pool = None
            raise WorkerLost("its process was ended from outside, perhaps for want of memory") from None

    def stop_starting_processes(self) -> None:
        """From now on no process is started."""
        with self._start_lock:
            self._is_over = True

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        self._threads.shutdown(wait, cancel_futures=cancel_futures or self._is_over)
        for pool in self._pools:
            pool.shutdown(wait)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Sets the thread limits that new processes inherit, as linear algebra reads them when it is loaded."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value


def _initialise() -> None:
    """Initialises each process. ^C reaches all processes of a terminal, but only the main one should react."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=_exit_with_parent, daemon=True).start()


def _exit_with_parent() -> None:
    """Ends this process when its parent ends; it would otherwise wait for tasks for ever."""
    parent: Any = parent_process()
    parent.join()
    os._exit(1)


def _end(processes: set[BaseProcess]) -> None:
    for process in processes:
        process.terminate()
