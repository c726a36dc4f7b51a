"""Ordered parallel map within one command, on all cores that it may use: in threads, or in this
process and copies of it.

Threads suit tasks of compiled code, which releases the interpreter's lock. Tasks with much Python
hold that lock, and two of them take as long as one after the other. A copy of the process has a
lock of its own, and all that the process had in memory; only the results travel. It costs 10 to 20
ms to make, so it is worth it for tasks of about as long.
"""

import gc
import io
import os
import pickle
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from itertools import pairwise
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from rfca_rig.executors.cores import ONE_THREAD, VARIABLE, cores
from rfca_rig.executors.mapping import initialise_worker

Item = TypeVar("Item")
Result = TypeVar("Result")

# Elsewhere the system's own libraries do not survive a copy of their process (macOS), or there is
# no such call (Windows).
CAN_COPY = sys.platform == "linux"


def map_in_threads(work: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
    """Applies `work` to all items, in threads where there are several cores; raises what `work`
    raises.
    """
    workers = min(cores(), len(items))
    if workers < 2:
        return [work(item) for item in items]
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(work, items))


def split_evenly(items: Sequence[Item], most: int) -> list[Sequence[Item]]:
    """The items in order in groups of about the same size, at most `most` of them, none empty."""
    count = min(most, len(items))
    edges = [len(items) * number // count for number in range(count + 1)]
    return [items[first:last] for first, last in pairwise(edges)]


def split_results(results: Sequence[Result], sizes: Iterable[int]) -> list[Sequence[Result]]:
    """The results of a map over several groups of items, group by group; `sizes` are their
    numbers of items.
    """
    groups = []
    first = 0
    for size in sizes:
        groups.append(results[first : first + size])
        first += size
    return groups


def map_in_processes(
    work: Callable[[Item], Result], items: Sequence[Item], shared: Sequence[object] = ()
) -> list[Result]:
    """Applies `work` to all items in this process and copies of it, in threads where the system
    cannot make copies.

    Parameters
    ----------
    work
        Any function. What it changes in memory is lost where a copy does it, and it must not print.
        Meanwhile `cores()` is 1.
    items
        Its arguments.
    shared
        Objects of this process that results may contain, such as the effects of a hypothesis. They
        are not copied back: a result refers to the very same object.

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
    A copy has only the thread that made it, so no other thread may hold a lock that `work` needs.
    The callers use threads only within `map_in_threads`, which is over before.
    """
    copies = min(cores(), len(items)) - 1
    if copies < 1 or not CAN_COPY:
        return map_in_threads(work, items)
    context = get_context("fork")
    running = []
    # All processes share the position in this file. Who moves it on by one takes the item that was
    # passed: no lock can be left behind.
    position = os.memfd_create("items")
    try:
        # Newer interpreters warn of every copy of a process with threads; see the notes.
        with warnings.catch_warnings(), suppress(OSError):
            warnings.simplefilter("ignore", DeprecationWarning)
            for _ in range(copies):
                ours, theirs = context.Pipe(duplex=False)
                copy = context.Process(
                    target=_run_copy, args=(work, items, shared, position, theirs), daemon=True
                )
                # Where no more processes may be started, those that run do the work.
                copy.start()
                theirs.close()
                running.append((copy, ours))
        with _use_one_core():
            results, errors = _work_on(work, items, position)
        for _, ours in running:
            # A copy that was ended from outside, perhaps for want of memory, leaves its items to
            # this process.
            with suppress(EOFError, OSError):
                done, failed = _Reader(io.BytesIO(ours.recv_bytes()), shared).load()
                results = results | done
                errors = errors | failed
    except BaseException:
        for copy, _ in running:
            copy.terminate()
        raise
    finally:
        os.close(position)
        for copy, ours in running:
            ours.close()
            copy.join()
    if errors:
        raise errors[min(errors)]
    return [
        results[number] if number in results else work(item) for number, item in enumerate(items)
    ]


def _run_copy(
    work: Callable[[Any], Any],
    items: Sequence[Any],
    shared: Sequence[object],
    position: int,
    connection: "Connection[bytes, bytes]",
) -> None:
    """Runs in each copy. Arguments are not pickled on the way, because memory is shared."""
    # The search for unused circles would visit all objects of the first process, and so copy their
    # memory.
    gc.freeze()
    initialise_worker()
    os.environ.update(ONE_THREAD)
    out = io.BytesIO()
    _Writer(out, shared).dump(_work_on(work, items, position))
    # At the end, because the first process reads nothing while it works itself.
    connection.send_bytes(out.getvalue())


def _work_on(
    work: Callable[[Any], Any], items: Sequence[Any], position: int
) -> tuple[dict[int, Any], dict[int, Exception]]:
    """Takes one item after the other; returns results and errors by number. After an error no
    process takes a further item.
    """
    results: dict[int, Any] = {}
    while (number := os.lseek(position, 1, os.SEEK_CUR) - 1) < len(items):
        try:
            results[number] = work(items[number])
        # It is raised in the first process.
        except Exception as error:
            os.lseek(position, len(items), os.SEEK_SET)
            return results, {number: error}
    return results, {}


@contextmanager
def _use_one_core() -> Iterator[None]:
    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[VARIABLE]
        else:
            os.environ[VARIABLE] = before


class _Writer(pickle.Pickler):
    def __init__(self, file: io.BytesIO, shared: Sequence[object]) -> None:
        super().__init__(file, pickle.HIGHEST_PROTOCOL)
        self._numbers = {id(item): number for number, item in enumerate(shared)}

    def persistent_id(self, obj: object) -> int | None:
        return self._numbers.get(id(obj))


class _Reader(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, shared: Sequence[object]) -> None:
        super().__init__(file)
        self._shared = shared

    def persistent_load(self, pid: int) -> object:
        return self._shared[pid]
