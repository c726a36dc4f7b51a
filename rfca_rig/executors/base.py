"""What hands work out sees of whoever does it: an executor that knows how many hands it has."""

from abc import abstractmethod
from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


class WorkerLost(Exception):
    """The process that had the work was ended from outside, or ended itself; `times` it, and others before it."""

    def __init__(self, words: str, times: int = 1) -> None:
        super().__init__(words)
        self.times = times


class TaskExecutor(Executor):
    """An executor whose futures end in WorkerLost where a worker was lost; the others do not notice.

    Functions must be importable by name where the work is done, arguments and results picklable. Lost work is not handed out again before
    `calm_after_loss_s` have passed: where workers end together, it must not be blamed for the next one as well.
    """

    calm_after_loss_s = 0.0

    @property
    @abstractmethod
    def workers(self) -> int:
        """How many there are now, at least 1; more may come, and some may leave."""

    @property
    def at_once(self) -> int:
        """How much work to hand out before the first comes back: what they do, and a piece for each to go on with."""
        return 2 * self.workers

    def look(self) -> None:
        """Asked now and then while nothing comes back. Raises RigError where nothing will come any more."""


class InProcessExecutor(TaskExecutor):
    """Does the work at once, in this process."""

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
