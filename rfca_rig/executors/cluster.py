"""Executor on the workers of a Dask scheduler.

dask.distributed transports tasks and results, detects lost workers, and knows which ones are idle.
"""

import importlib
import logging
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, partial
from math import inf
from pathlib import Path
from secrets import token_hex
from typing import Any, ParamSpec, TypeVar
from weakref import ref

from rfca_rig.clock import Clock, WallClock
from rfca_rig.errors import BadInput, RigError
from rfca_rig.executors.environment import EnvironmentCheck, Facts, check_worker, detect_processor
from rfca_rig.executors.mapping import TaskExecutor, WorkerLost
from rfca_rig.progress import ProgressReport

P = ParamSpec("P")
T = TypeVar("T")

CONNECT_S = 10.0
# The scheduler is asked for its workers at most every so many seconds.
COUNT_EVERY_S = 2.0
# Interval in s between two checks for the first worker.
FIRST_WORKER_S = 2.5


@cache
def import_distributed() -> Any:
    """The package `distributed`. Raises BadInput if it is not installed.

    Its log messages on lost workers and late heartbeats are suppressed, as the executor reports
    them itself.
    """
    try:
        package = importlib.import_module("distributed")
    except ImportError:
        raise BadInput(
            '--cluster needs dask.distributed: pip install "rfca-rig[cluster]"'
        ) from None
    for name in (
        "distributed",
        "distributed.client",
        "distributed.scheduler",
        "tornado.application",
        "asyncio",
    ):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    return package


@dataclass(frozen=True)
class WorkerStartup:
    """Start-up of the workers: the number expected, and a progress callback for the number present.

    `still_coming` is called while there are no workers; it raises RigError if none will come.
    """

    expected: int
    report_progress: ProgressReport
    still_coming: Callable[[], None]


class DaskExecutor(TaskExecutor):
    """Executor on the workers of a scheduler, each with one thread."""

    # The jobs of an array whose time limit is reached end within this time.
    retry_delay_s = 5.0

    def __init__(
        self,
        client: Any,
        terms: EnvironmentCheck,
        facts: Callable[[], Facts],
        hiring: WorkerStartup,
        clock: Clock,
    ) -> None:
        self._client = client
        self._terms = terms
        self._facts = facts
        self._hiring = hiring
        self._clock = clock
        # Not pure: Dask would otherwise return one result for two tasks with equal arguments.
        self._executor = client.get_executor(pure=False)
        self._counted_s = -inf
        self._count = 0

    @property
    def workers(self) -> int:
        return max(1, self.count())

    @property
    def at_once(self) -> int:
        """One task per worker: a waiting one would be blamed as well if its worker is lost."""
        return self.workers

    def count(self) -> int:
        """Number of workers, at most two seconds old."""
        if self._clock.now_s() - self._counted_s > COUNT_EVERY_S:
            self._counted_s = self._clock.now_s()
            self._count = len(self._threads())
            self._hiring.report_progress(
                "workers", self._count, max(self._count, self._hiring.expected)
            )
        return self._count

    def look(self) -> None:
        if self._client.status != "running":
            raise RigError("the scheduler is gone; the same command goes on where it stood")
        if self.count() == 0:
            self._hiring.still_coming()

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        remote = self._executor.submit(
            partial(_check_and_run, self._terms, self._facts, fn), *args, **kwargs
        )
        future: Future[T] = Future()
        future.add_done_callback(partial(_cancel_too, ref(remote)))
        remote.add_done_callback(partial(self._hand_over, future))
        return future

    def _hand_over(self, future: Future[T], remote: Future[T]) -> None:
        """Copies the outcome of the Dask future to the local one."""
        if remote.cancelled():
            future.cancel()
            future.set_running_or_notify_cancel()
        elif future.set_running_or_notify_cancel():
            error = remote.exception()
            if isinstance(error, import_distributed().KilledWorker):
                # Count the workers again at once, so that no worker gets two tasks.
                self._counted_s = -inf
                future.set_exception(
                    WorkerLost(
                        "its process was ended from outside, perhaps for want of memory",
                        error.allowed_failures + 1,
                    )
                )
            elif error is not None:
                future.set_exception(error)
            else:
                future.set_result(remote.result())

    def check(self, notice: Callable[[str], None]) -> None:
        """Checks the environment of all present workers.

        Raises BadInput for the first that differs. `notice` is called if the processors differ.
        """
        for address, threads in self._threads().items():
            if threads != 1:
                raise BadInput(
                    f"the worker at {address} has {threads} threads; start workers with "
                    "--nthreads 1, as many as there are cores"
                )
        try:
            kinds = self._client.run(_check_worker, self._terms, self._facts)
        except RigError:
            raise
        # Anything that keeps a worker from answering, such as another Python or a missing rfca_rig.
        except Exception as error:
            raise BadInput(
                f"a worker cannot run this rfca-rig: {type(error).__name__}: {error}; "
                "install the same one there"
            ) from None
        unlike = sorted({*kinds.values(), detect_processor()})
        if len(unlike) > 1:
            notice(
                f"processors differ ({', '.join(unlike)}): results may depend on the "
                "worker in their last digits"
            )

    def wait_for_first(self) -> None:
        """Waits for the first worker; others join the work as they come."""
        while self.count() == 0:
            self._hiring.still_coming()
            with suppress(TimeoutError):
                self._client.wait_for_workers(1, timeout=FIRST_WORKER_S)
                self._counted_s = -inf

    def _threads(self) -> dict[str, int]:
        """Number of threads of each worker, by its address."""
        try:
            return dict(self._client.nthreads())
        except OSError:
            raise RigError(
                "the scheduler is gone; the same command goes on where it stood"
            ) from None


def _check_and_run(
    terms: EnvironmentCheck,
    facts: Callable[[], Facts],
    fn: Callable[P, T],
    /,
    *args: P.args,
    **kwargs: P.kwargs,
) -> T:
    """Runs in the worker: checks its environment before the first task, as workers may join
    late.
    """
    check_worker(terms, facts)
    return fn(*args, **kwargs)


def _check_worker(terms: EnvironmentCheck, facts: Callable[[], Facts]) -> str:
    """Runs in the worker: checks its environment; returns the processor type."""
    check_worker(terms, facts)
    return detect_processor()


def _cancel_too(remote: "ref[Future[T]]", future: Future[T]) -> None:
    """Cancels the Dask future with the local one.

    The reference is weak: as long as a Dask future is referenced, its worker keeps the result, and
    a lost result is computed again.
    """
    if future.cancelled() and (running := remote()) is not None:
        running.cancel()


@contextmanager
def connect_workers(
    scheduler: Any, folder: Path | None, facts: Callable[[], Facts], hiring: WorkerStartup
) -> Iterator[DaskExecutor]:
    """Connects to `scheduler`, an address or a cluster. `folder`, where tasks write files, must
    be visible to the workers too.
    """
    try:
        client = import_distributed().Client(scheduler, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise BadInput(
            f"--cluster {scheduler}: no Dask scheduler answers there ({type(error).__name__})"
        ) from None
    with client, _token_in(folder) as token:
        shared = None if folder is None else str(folder.resolve())
        yield DaskExecutor(
            client, EnvironmentCheck(facts(), shared, token), facts, hiring, WallClock()
        )


@contextmanager
def connect_to_scheduler(
    address: str,
    folder: Path | None,
    facts: Callable[[], Facts],
    report_progress: ProgressReport,
    notice: Callable[[str], None],
) -> Iterator[DaskExecutor]:
    """Uses the workers of a running scheduler, and leaves them running. Raises BadInput if it
    does not answer.
    """
    with connect_workers(
        address, folder, facts, WorkerStartup(1, report_progress, lambda: None)
    ) as executor:
        if executor.count() == 0:
            notice(f"{address} has no workers yet; waiting for the first")
        executor.wait_for_first()
        executor.check(notice)
        yield executor


@contextmanager
def _token_in(folder: Path | None) -> Iterator[str]:
    """Creates a file by which workers verify that they see the same folder; none if `folder` is
    None.
    """
    token = f".seen-{token_hex(8)}"
    if folder is None:
        yield token
        return
    (folder / token).touch()
    try:
        yield token
    finally:
        (folder / token).unlink(missing_ok=True)
