"""Many pieces of work handed to an executor, and their results as they come.

Short ones travel in batches of about a second, of more where workers are many, so that the way there and back costs little beside the
work; a result that came is never computed again. A worker that is lost costs what it had in hands, which is handed out once more, piece
by piece. A piece that ends its worker twice, or raises, is told as failed.
"""

import traceback
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, Future
from dataclasses import dataclass
from functools import partial
from math import ceil
from queue import Empty, SimpleQueue
from typing import Generic, TypeVar

from rfca_rig.clock import Clock, WallClock
from rfca_rig.errors import RigError
from rfca_rig.executors.base import TaskExecutor, WorkerLost

Item = TypeVar("Item")
Result = TypeVar("Result")

BATCH_S = 1.0  # what a batch takes at least,
BATCH_PER_WORKER_S = 0.01  # and for each worker: to hand a batch out takes some milliseconds of one core
LOOK_EVERY_S = 2.0  # how often the executor is looked at while nothing comes
LOST_TOO_OFTEN = 2  # workers that a piece of work may end


@dataclass(frozen=True)
class Failed:
    """Why there is no result, in a line, and the trace of it where there is one."""

    reason: str
    trace: str = ""


@dataclass(frozen=True)
class _Back(Generic[Result]):
    """What a batch brings back, in its order, and what it took."""

    results: list[Result | Failed]
    seconds: float


def map_unordered(
    executor: TaskExecutor,
    work: Callable[[Item], Result],
    items: Sequence[Item],
    clocks: Callable[[], Clock] = WallClock,
    batch_s: float = BATCH_S,
) -> Iterator[tuple[Item, Result | Failed]]:
    """Each item with what `work` made of it, in order of completion.

    `work` is importable by name, or a `partial` of such; what it returns may depend on its item only, seeds included: then the results
    depend neither on the number of workers nor on where they are. `clocks` times the batches, of `batch_s` or more; 0 for none. Raises
    RigError where the executor is no more.
    """
    clock = clocks()
    rest = _Rest(len(items), batch_s, executor.calm_after_loss_s)
    running: dict[Future[_Back[Result]], Sequence[int]] = {}
    finished: SimpleQueue[Future[_Back[Result]]] = SimpleQueue()
    try:
        while running or rest:
            while rest.has_ready(clock.now_s()) and len(running) < executor.at_once:
                numbers = rest.batch(clock.now_s(), executor.workers)
                future = executor.submit(partial(_together, work, clocks), [items[number] for number in numbers])
                running[future] = numbers
                future.add_done_callback(finished.put)
            if (back := _next(finished, executor)) is not None:
                numbers = running.pop(back)
                yield from ((items[number], result) for number, result in rest.outcome(clock.now_s(), numbers, back))
    finally:
        for future in running:
            future.cancel()


def _next(finished: "SimpleQueue[Future[_Back[Result]]]", executor: TaskExecutor) -> Future[_Back[Result]] | None:
    """None where nothing came for a while."""
    try:
        return finished.get(timeout=LOOK_EVERY_S)
    except Empty:
        executor.look()
        return None


class _Rest:
    """What is still to hand out, by number: pieces that nobody has had, and those that were lost, to be done alone."""

    def __init__(self, count: int, batch_s: float, calm_s: float) -> None:
        self._batch_s, self._calm_s = batch_s, calm_s
        self._fresh = deque(range(count))
        self._alone: deque[tuple[float, int]] = deque()  # and when they may be handed out again
        self._lost: Counter[int] = Counter()
        self._seconds_each = max(batch_s, 1e-6)

    def __bool__(self) -> bool:
        return bool(self._fresh or self._alone)

    def has_ready(self, now_s: float) -> bool:
        """Whether anything can be handed out now."""
        return bool(self._fresh) or self._is_calm(now_s)

    def _is_calm(self, now_s: float) -> bool:
        return bool(self._alone) and self._alone[0][0] <= now_s

    def batch(self, now_s: float, workers: int) -> Sequence[int]:
        """The next to hand out: as much as takes the time of a batch, fewer where the others would be left with none."""
        if self._is_calm(now_s):
            return [self._alone.popleft()[1]]
        seconds = self._batch_s and max(self._batch_s, BATCH_PER_WORKER_S * workers)
        size = min(round(seconds / self._seconds_each), ceil(len(self._fresh) / (4 * workers)))
        return [self._fresh.popleft() for _ in range(max(1, size))]

    def outcome(self, now_s: float, numbers: Sequence[int], future: "Future[_Back[Result]]") -> Iterator[tuple[int, Result | Failed]]:
        """What has come back for good; what was lost waits for another turn."""
        try:
            back = future.result()
        except CancelledError:
            raise RigError("the work was cancelled from outside; the same command goes on where it stood") from None
        except WorkerLost as lost:
            yield from self._after_loss(now_s, numbers, lost)
        except RigError:  # the executor's own: what the work raises has come back as text
            raise
        except Exception as error:  # a result that cannot travel: whose it is shows when they are done one by one
            if len(numbers) == 1:
                yield numbers[0], failure(error)
            else:
                self._alone.extend((now_s, number) for number in numbers)
        else:
            self._seconds_each = max(back.seconds, 1e-6) / len(numbers)
            yield from zip(numbers, back.results, strict=True)

    def _after_loss(self, now_s: float, numbers: Sequence[int], lost: WorkerLost) -> Iterator[tuple[int, Failed]]:
        """In a batch nobody knows whose fault it was."""
        if len(numbers) == 1:
            self._lost[numbers[0]] += lost.times
        for number in numbers:
            if self._lost[number] < LOST_TOO_OFTEN:
                self._alone.append((now_s + self._calm_s, number))
            else:
                yield number, Failed(f"{self._lost[number]} workers were lost over it: {lost}")


def _together(work: Callable[[Item], Result], clocks: Callable[[], Clock], items: Sequence[Item]) -> _Back[Result]:
    """Where the work is done."""
    clock = clocks()
    return _Back([_tried(work, item) for item in items], clock.now_s())


def _tried(work: Callable[[Item], Result], item: Item) -> Result | Failed:
    try:
        return work(item)
    except Exception as error:
        return failure(error)


def failure(error: BaseException) -> Failed:
    """As text: not every exception survives the way from one process to another."""
    return Failed(" ".join("".join(traceback.format_exception_only(error)).split()), "".join(traceback.format_exception(error)))
