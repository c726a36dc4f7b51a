"""Unordered parallel map with batching and retry, and its executor on local processes.

Short tasks are sent in batches of about one second, longer with many workers, so that transport
costs little beside the work. A result that has arrived is never computed again. If a worker is
lost, its tasks are submitted once more, one by one. A task that ends its worker twice, or raises,
is reported as failed.

Each local process has its own `ProcessPoolExecutor` of one thread. The loss of one then breaks no
other, and it is known which task it had.
"""

import os
import signal
import traceback
from abc import abstractmethod
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from math import ceil
from multiprocessing import active_children, get_context, parent_process
from multiprocessing.process import BaseProcess
from queue import Empty, SimpleQueue
from threading import Lock, Thread, local
from typing import Any, Generic, ParamSpec, TypeVar

from rfca_rig.clock import Clock, WallClock
from rfca_rig.errors import RigError
from rfca_rig.executors.cores import ONE_THREAD
from rfca_rig.subprocesses import safe_path

P = ParamSpec("P")
T = TypeVar("T")

Item = TypeVar("Item")
Result = TypeVar("Result")

# Least duration of a batch in s.
BATCH_S = 1.0
# Further duration per worker: submitting a batch takes some milliseconds of one core.
BATCH_PER_WORKER_S = 0.01
# Interval in s at which the executor is checked while no result arrives.
LOOK_EVERY_S = 2.0
# Number of lost workers from which a task counts as failed.
MAX_LOST_WORKERS = 2


class WorkerLost(Exception):
    """The worker process of a task was killed, or ended itself. `times` counts this worker and
    earlier ones lost over the same task.
    """

    def __init__(self, words: str, times: int = 1) -> None:
        super().__init__(words)
        self.times = times


class TaskExecutor(Executor):
    """Executor whose futures fail with WorkerLost if their worker was lost; other futures are not
    affected.

    Functions must be importable by name on the workers, arguments and results picklable. A lost
    task is not submitted again before `retry_delay_s` has passed. If several workers end together,
    the task must not be blamed for the next one as well.
    """

    retry_delay_s = 0.0

    @property
    @abstractmethod
    def workers(self) -> int:
        """Present number of workers, at least 1; it may change at any time."""

    @property
    def at_once(self) -> int:
        """Number of tasks to submit before the first returns: one running and one waiting for
        each worker.
        """
        return 2 * self.workers

    def look(self) -> None:
        """Called at intervals while no result arrives. Raises RigError if none can arrive any
        more.
        """


class InProcessExecutor(TaskExecutor):
    """Executes each task at once, in this process."""

    @property
    def workers(self) -> int:
        return 1

    @property
    def at_once(self) -> int:
        return 1

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


@dataclass(frozen=True)
class TaskFailure:
    """A task without result: the reason in one line, and the traceback if there is one."""

    reason: str
    trace: str = ""


@dataclass(frozen=True)
class _Back(Generic[Result]):
    """Results of a batch, in its order, and its duration."""

    results: list[Result | TaskFailure]
    seconds: float


def map_unordered(
    executor: TaskExecutor,
    work: Callable[[Item], Result],
    items: Sequence[Item],
    clocks: Callable[[], Clock] = WallClock,
    batch_s: float = BATCH_S,
) -> Iterator[tuple[Item, Result | TaskFailure]]:
    """Applies `work` to all items in parallel.

    Parameters
    ----------
    executor : TaskExecutor
        Where the tasks run.
    work : callable
        Importable by name, or a `partial` of such a function. Its result may depend on the item
        only, seeds included. The results then do not depend on the number or place of the workers.
    items : sequence
        The arguments, one per task.
    clocks : callable
        Creates the clocks that time the batches.
    batch_s : float
        Least duration of a batch in s; 0 for batches of one item.

    Yields
    ------
    item, result
        In order of completion; `TaskFailure` in place of the result of a failed task.

    Raises
    ------
    RigError
        If the executor has failed.
    """
    clock = clocks()
    pending = _PendingTasks(len(items), batch_s, executor.retry_delay_s)
    running: dict[Future[_Back[Result]], Sequence[int]] = {}
    finished: SimpleQueue[Future[_Back[Result]]] = SimpleQueue()
    try:
        while running or pending:
            while pending.has_ready(clock.now_s()) and len(running) < executor.at_once:
                numbers = pending.batch(clock.now_s(), executor.workers)
                future = executor.submit(
                    partial(_run_batch, work, clocks), [items[number] for number in numbers]
                )
                running[future] = numbers
                future.add_done_callback(finished.put)
            if (batch := _next(finished, executor)) is not None:
                numbers = running.pop(batch)
                yield from (
                    (items[number], result)
                    for number, result in pending.outcome(clock.now_s(), numbers, batch)
                )
    # The consumer may stop early; tasks that have not started are then cancelled.
    finally:
        for future in running:
            future.cancel()


def _next(
    finished: "SimpleQueue[Future[_Back[Result]]]", executor: TaskExecutor
) -> Future[_Back[Result]] | None:
    """The next finished batch; None if none finished for a while."""
    try:
        return finished.get(timeout=LOOK_EVERY_S)
    except Empty:
        executor.look()
        return None


class _PendingTasks:
    """Tasks still to submit, by number: fresh ones, and lost ones that are submitted alone."""

    def __init__(self, count: int, batch_s: float, calm_s: float) -> None:
        self._batch_s = batch_s
        self._calm_s = calm_s
        self._fresh = deque(range(count))
        # Time from which a lost task may be submitted again, and its number.
        self._alone: deque[tuple[float, int]] = deque()
        self._lost: Counter[int] = Counter()
        self._seconds_each = max(batch_s, 1e-6)

    def __bool__(self) -> bool:
        return bool(self._fresh or self._alone)

    def has_ready(self, now_s: float) -> bool:
        """Whether any task can be submitted now."""
        return bool(self._fresh) or self._is_calm(now_s)

    def _is_calm(self, now_s: float) -> bool:
        return bool(self._alone) and self._alone[0][0] <= now_s

    def batch(self, now_s: float, workers: int) -> Sequence[int]:
        """The next batch: as many tasks as fill its duration, fewer near the end so that all
        workers get some.
        """
        if self._is_calm(now_s):
            return [self._alone.popleft()[1]]
        seconds = self._batch_s and max(self._batch_s, BATCH_PER_WORKER_S * workers)
        # A quarter of an equal share at most, so that the workers finish at about the same time.
        size = min(round(seconds / self._seconds_each), ceil(len(self._fresh) / (4 * workers)))
        return [self._fresh.popleft() for _ in range(max(1, size))]

    def outcome(
        self, now_s: float, numbers: Sequence[int], future: "Future[_Back[Result]]"
    ) -> Iterator[tuple[int, Result | TaskFailure]]:
        """Final results of a batch; lost tasks are queued again."""
        try:
            back = future.result()
        except CancelledError:
            raise RigError(
                "the work was cancelled from outside; the same command goes on where it stood"
            ) from None
        except WorkerLost as lost:
            yield from self._after_loss(now_s, numbers, lost)
        # Raised by the executor itself: exceptions of the work arrive as text.
        except RigError:
            raise
        # A result that cannot be pickled. Which task it belongs to shows when they run one by one.
        except Exception as error:
            if len(numbers) == 1:
                yield numbers[0], describe_failure(error)
            else:
                self._alone.extend((now_s, number) for number in numbers)
        else:
            self._seconds_each = max(back.seconds, 1e-6) / len(numbers)
            yield from zip(numbers, back.results, strict=True)

    def _after_loss(
        self, now_s: float, numbers: Sequence[int], lost: WorkerLost
    ) -> Iterator[tuple[int, TaskFailure]]:
        """Queues lost tasks again. Only a task that ran alone is counted, as in a batch the
        cause is unknown.
        """
        if len(numbers) == 1:
            self._lost[numbers[0]] += lost.times
        for number in numbers:
            if self._lost[number] < MAX_LOST_WORKERS:
                self._alone.append((now_s + self._calm_s, number))
            else:
                yield number, TaskFailure(f"{self._lost[number]} workers were lost over it: {lost}")


def _run_batch(
    work: Callable[[Item], Result], clocks: Callable[[], Clock], items: Sequence[Item]
) -> _Back[Result]:
    """Runs in the worker: executes a batch."""
    clock = clocks()
    return _Back([_try_task(work, item) for item in items], clock.now_s())


def _try_task(work: Callable[[Item], Result], item: Item) -> Result | TaskFailure:
    try:
        return work(item)
    except Exception as error:
        return describe_failure(error)


def describe_failure(error: BaseException) -> TaskFailure:
    """Converts an exception to text, as not every exception can be pickled."""
    return TaskFailure(
        " ".join("".join(traceback.format_exception_only(error)).split()),
        "".join(traceback.format_exception(error)),
    )


@contextmanager
def process_executor(workers: int) -> Iterator[TaskExecutor]:
    """Executor on `workers` processes; with 0 the tasks run in this process.

    Functions must be importable by name. The processes end with the block, during a task if the
    block ends with an exception, and when this process dies. A lost process is replaced.
    """
    if workers == 0:
        yield InProcessExecutor()
        return
    others = set(active_children())
    with _one_thread_each(), safe_path():
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

    def _run_in_process(
        self, fn: Callable[..., T], args: tuple[Any, ...], kwargs: dict[str, Any]
    ) -> T:
        """Runs in a thread: executes the task in this thread's process."""
        try:
            # The lock keeps a process from being started after `stop_starting_processes`.
            with self._start_lock:
                if self._is_over:
                    raise WorkerLost("the work was stopped")
                pool: ProcessPoolExecutor | None = getattr(self._of_thread, "pool", None)
                if pool is None:
                    # Spawn, as a forked copy of a process with threads may deadlock.
                    pool = self._of_thread.pool = ProcessPoolExecutor(
                        1, get_context("spawn"), initialise_worker
                    )
                    self._pools.append(pool)
                future = pool.submit(fn, *args, **kwargs)
            return future.result()
        except BrokenProcessPool:
            # A broken pool cannot be used again; the next task of this thread starts a new one.
            self._of_thread.pool = None
            raise WorkerLost(
                "its process was ended from outside, perhaps for want of memory"
            ) from None

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
    """Sets the thread limits that new processes inherit, as linear algebra reads them when it is
    loaded.
    """
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value


def initialise_worker() -> None:
    """Initialises each process. ^C reaches all processes of a terminal, but only the main one
    should react; SIGTERM ends them at once, as a copy would otherwise interrupt like the main one.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    Thread(target=_exit_with_parent, daemon=True).start()


def _exit_with_parent() -> None:
    """Ends this process when its parent ends; it would otherwise wait for tasks for ever."""
    parent: Any = parent_process()
    parent.join()
    os._exit(1)


def _end(processes: set[BaseProcess]) -> None:
    for process in processes:
        process.terminate()
