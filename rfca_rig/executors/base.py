"""Abstract executor that knows its number of workers, and the in-process one."""

from abc import abstractmethod
from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


class WorkerLost(Exception):
    """The worker process of a task was killed, or ended itself. `times` counts this worker and earlier ones lost over the same task."""

    def __init__(self, words: str, times: int = 1) -> None:
        super().__init__(words)
        self.times = times


class TaskExecutor(Executor):
    """Executor whose futures fail with WorkerLost if their worker was lost; other futures are not affected.

    Functions must be importable by name on the workers, arguments and results picklable. A lost task is not submitted again before
    `retry_delay_s` has passed. If several workers end together, the task must not be blamed for the next one as well.
    """

    retry_delay_s = 0.0

    @property
    @abstractmethod
    def workers(self) -> int:
        """Present number of workers, at least 1; it may change at any time."""

    @property
    def at_once(self) -> int:
        """Number of tasks to submit before the first returns: one running and one waiting for each worker."""
        return 2 * self.workers

    def look(self) -> None:
        """Called at intervals while no result arrives. Raises RigError if none can arrive any more."""


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
