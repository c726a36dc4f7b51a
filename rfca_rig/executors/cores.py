"""How many cores one process may use for its own threads. A worker of an executor uses one: the others are taken by its mates."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

from threadpoolctl import threadpool_limits

VARIABLE = "RFCA_RIG_THREADS"
ONE_THREAD = {VARIABLE: "1", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Environment of a worker. Linear algebra reads its part when it is loaded, so it must stand there before the process begins."""


def cores() -> int:
    """The cores that this process may run on, or as many as RFCA_RIG_THREADS says."""
    said = os.environ.get(VARIABLE, "")
    return int(said) if said.isdecimal() and int(said) else machine_cores()


def machine_cores() -> int:
    """The cores that this process and its children may run on: of a batch job only its own."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def algebra_on_one_thread() -> Iterator[None]:
    """Linear algebra keeps to the thread that asks for it, in the whole process, and its last digits to no number of cores.

    Its threads wait for each other by spinning: beside threads of one's own, or another program, they cost many times what they save.
    """
    with threadpool_limits(limits=1, user_api="blas"):
        yield
