"""Ordered parallel map within one command, on all cores that it may use: in threads, or in copies of this process.

Threads suit tasks of compiled code, which releases the interpreter's lock. Tasks with much Python hold that lock, and two of them take as
long as one after the other. A copy of the process has a lock of its own, and all that the process had in memory; only the results travel.
It costs 20 to 90 ms to make, so it is worth it for tasks of about as long.
"""

import io
import os
import pickle
import sys
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from typing import Any, TypeVar

from rfca_rig.executors.cores import ONE_THREAD, cores
from rfca_rig.executors.mapping import initialise_worker

Item = TypeVar("Item")
Result = TypeVar("Result")

# Elsewhere the system's own libraries do not survive a copy of their process (macOS), or there is no such call (Windows).
CAN_COPY = sys.platform == "linux"


def map_in_threads(work: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
    """Applies `work` to all items, in threads where there are several cores; raises what `work` raises."""
    workers = min(cores(), len(items))
    if workers < 2:
        return [work(item) for item in items]
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(work, items))


def map_in_processes(work: Callable[[Item], Result], items: Sequence[Item], shared: Sequence[object] = ()) -> list[Result]:
    """Applies `work` to all items in copies of this process, in threads where the system cannot make copies.

    Parameters
    ----------
    work
        Any function. What it changes in memory is lost, and it must not print. In a copy, `cores()` is 1.
    items
        Its arguments.
    shared
        Objects of this process that results may contain, such as the effects of a hypothesis. They are not copied back: a result refers
        to the very same object.

    Returns
    -------
    list
        The results, in the order of the items. Everything in them but `shared` can be pickled.

    Raises
    ------
    Exception
        What `work` raises, for the first item that fails.

    Notes
    -----
    A copy has only the thread that made it, so no other thread may hold a lock that `work` needs. The callers use threads only within
    `map_in_threads`, which is over before.
    """
    workers = min(cores(), len(items))
    if workers < 2 or not CAN_COPY:
        return map_in_threads(work, items)
    try:
        # Newer interpreters warn of every copy of a process with threads; see the notes.
        with warnings.catch_warnings(), ProcessPoolExecutor(workers, get_context("fork"), _begin_copy, (work, items, shared)) as pool:
            warnings.simplefilter("ignore", DeprecationWarning)
            return [_Reader(io.BytesIO(result), shared).load() for result in pool.map(_work_on, range(len(items)))]
    # No more processes may be started, or one was ended from outside, perhaps for want of memory.
    except (OSError, BrokenProcessPool):
        return map_in_threads(work, items)


_task: tuple[Callable[[Any], Any], Sequence[Any], Sequence[object]]


def _begin_copy(work: Callable[[Any], Any], items: Sequence[Any], shared: Sequence[object]) -> None:
    """Runs in each copy. Arguments are not pickled on the way, because memory is shared."""
    global _task  # noqa: PLW0603 - the pool passes nothing else on to its tasks
    _task = work, items, shared
    initialise_worker()
    os.environ.update(ONE_THREAD)


def _work_on(number: int) -> bytes:
    work, items, shared = _task
    out = io.BytesIO()
    _Writer(out, shared).dump(work(items[number]))
    return out.getvalue()


class _Writer(pickle.Pickler):
    def __init__(self, file: io.BytesIO, shared: Sequence[object]) -> None:
        super().__init__(file, pickle.HIGHEST_PROTOCOL)
        self._numbers = {id(one): number for number, one in enumerate(shared)}

    def persistent_id(self, obj: object) -> int | None:
        return self._numbers.get(id(obj))


class _Reader(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, shared: Sequence[object]) -> None:
        super().__init__(file)
        self._shared = shared

    def persistent_load(self, pid: int) -> object:
        return self._shared[pid]
