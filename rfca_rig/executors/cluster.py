"""Workers elsewhere, known to a Dask scheduler: dask.distributed carries work and results, finds lost workers, and knows who is idle."""

from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from math import inf
from pathlib import Path
from secrets import token_hex
from typing import Any, ParamSpec, TypeVar
from weakref import ref

from rfca_rig.clock import Clock, WallClock
from rfca_rig.errors import BadInput, RigError
from rfca_rig.executors.base import TaskExecutor, WorkerLost
from rfca_rig.executors.environment import EnvironmentCheck, Facts, processor, ready
from rfca_rig.executors.optional import distributed
from rfca_rig.progress import Told

P = ParamSpec("P")
T = TypeVar("T")

CONNECT_S = 10.0
COUNT_EVERY_S = 2.0
FIRST_WORKER_S = 2.5  # between two looks for the first worker


@dataclass(frozen=True)
class WorkerStartup:
    """What is known of workers to come: how many are expected, whom to tell how many there are, and `still_coming`, asked where there are
    none: it raises RigError where there will be none.
    """

    expected: int
    told: Told
    still_coming: Callable[[], None]


class DaskExecutor(TaskExecutor):
    """The workers of a scheduler, each of one thread."""

    calm_after_loss_s = 5.0  # a job array whose time is over ends within it

    def __init__(self, client: Any, terms: EnvironmentCheck, facts: Callable[[], Facts], hiring: WorkerStartup, clock: Clock) -> None:
        self._client, self._terms, self._facts, self._hiring, self._clock = client, terms, facts, hiring, clock
        self._executor = client.get_executor(pure=False)
        self._counted_s, self._count = -inf, 0

    @property
    def workers(self) -> int:
        return max(1, self.count())

    @property
    def at_once(self) -> int:
        """One piece each: one that waits at a worker would be blamed as well for what that worker dies of."""
        return self.workers

    def count(self) -> int:
        """How many workers there are now, or were a moment ago."""
        if self._clock.now_s() - self._counted_s > COUNT_EVERY_S:
            self._counted_s = self._clock.now_s()
            self._count = len(self._threads())
            self._hiring.told("workers", self._count, max(self._count, self._hiring.expected))
        return self._count

    def look(self) -> None:
        if self._client.status != "running":
            raise RigError("the scheduler is gone; the same command goes on where it stood")
        if self.count() == 0:
            self._hiring.still_coming()

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        there = self._executor.submit(partial(_as_agreed, self._terms, self._facts, fn), *args, **kwargs)
        here: Future[T] = Future()
        here.add_done_callback(partial(_cancel_too, ref(there)))
        there.add_done_callback(partial(self._hand_over, here))
        return here

    def _hand_over(self, here: Future[T], there: Future[T]) -> None:
        """The outcome there becomes the outcome here."""
        if there.cancelled():
            here.cancel()
            here.set_running_or_notify_cancel()
        elif here.set_running_or_notify_cancel():
            error = there.exception()
            if isinstance(error, distributed().KilledWorker):
                self._counted_s = -inf  # the next piece must not go where two would meet
                here.set_exception(WorkerLost("its process was ended from outside, perhaps for want of memory", error.allowed_failures + 1))
            elif error is not None:
                here.set_exception(error)
            else:
                here.set_result(there.result())

    def check(self, notice: Callable[[str], None]) -> None:
        """All workers of now are held against the terms. Raises BadInput for the first that is otherwise; tells of unlike processors."""
        for address, threads in self._threads().items():
            if threads != 1:
                raise BadInput(
                    f"the worker at {address} has {threads} threads; start workers with --nthreads 1, as many as there are cores"
                )
        try:
            kinds = self._client.run(_checked, self._terms, self._facts)
        except RigError:
            raise
        except Exception as error:  # whatever keeps a worker from answering, as another Python or no rfca_rig at all
            raise BadInput(f"a worker cannot run this rfca-rig: {type(error).__name__}: {error}; install the same one there") from None
        unlike = sorted({*kinds.values(), processor()})
        if len(unlike) > 1:
            notice(f"processors differ ({', '.join(unlike)}): results may depend on the worker in their last digits")

    def wait_for_first(self) -> None:
        """Until there is one; the others join the work as they come."""
        while self.count() == 0:
            self._hiring.still_coming()
            with suppress(TimeoutError):
                self._client.wait_for_workers(1, timeout=FIRST_WORKER_S)
                self._counted_s = -inf

    def _threads(self) -> dict[str, int]:
        """Threads of each worker by its address."""
        try:
            return dict(self._client.nthreads())
        except OSError:
            raise RigError("the scheduler is gone; the same command goes on where it stood") from None


def _as_agreed(terms: EnvironmentCheck, facts: Callable[[], Facts], fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> T:
    """In the worker: one that came late is looked at before its first work too."""
    ready(terms, facts)
    return fn(*args, **kwargs)


def _checked(terms: EnvironmentCheck, facts: Callable[[], Facts]) -> str:
    """In the worker."""
    ready(terms, facts)
    return processor()


def _cancel_too(there: "ref[Future[T]]", here: Future[T]) -> None:
    """Held loosely: while anything holds the future there, its result is kept by its worker, and computed again where that is lost."""
    if here.cancelled() and (running := there()) is not None:
        running.cancel()


@contextmanager
def workers_of(scheduler: Any, folder: Path | None, facts: Callable[[], Facts], hiring: WorkerStartup) -> Iterator[DaskExecutor]:
    """A client of `scheduler`, an address or a cluster; `folder`, where work leaves files, must be seen by workers as well."""
    try:
        client = distributed().Client(scheduler, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise BadInput(f"--cluster {scheduler}: no Dask scheduler answers there ({type(error).__name__})") from None
    with client, _token_in(folder) as token:
        shared = None if folder is None else str(folder.resolve())
        yield DaskExecutor(client, EnvironmentCheck(facts(), shared, token), facts, hiring, WallClock())


@contextmanager
def connected(
    address: str, folder: Path | None, facts: Callable[[], Facts], told: Told, notice: Callable[[str], None]
) -> Iterator[DaskExecutor]:
    """The workers of a scheduler that runs already; they stay as they are. Raises BadInput where it does not answer."""
    with workers_of(address, folder, facts, WorkerStartup(1, told, lambda: None)) as executor:
        if executor.count() == 0:
            notice(f"{address} has no workers yet; waiting for the first")
        executor.wait_for_first()
        executor.check(notice)
        yield executor


@contextmanager
def _token_in(folder: Path | None) -> Iterator[str]:
    """A file by which workers know the folder, where there is one."""
    token = f".seen-{token_hex(8)}"
    if folder is None:
        yield token
        return
    (folder / token).touch()
    try:
        yield token
    finally:
        (folder / token).unlink(missing_ok=True)
