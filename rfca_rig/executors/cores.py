"""Number of cores that a process may use for its threads. A worker uses one, as the other
workers need the rest.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from rfca_rig.errors import BadInput

VARIABLE = "RFCA_RIG_THREADS"
# More threads than any machine of a laboratory has cores; each takes 8 MB of address space for its
# stack.
MAX_THREADS = 1024
ONE_THREAD = {
    VARIABLE: "1",
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
}
"""Environment of a worker. Linear algebra reads its part when it is loaded, so it must be set
before the process begins."""
# A limit of processes below this is one on purpose. Systems allow thousands to each user.
FEW_PROCESSES = 1024


def use_one_thread_if_processes_are_few() -> None:
    """Where this user may have few processes (`ulimit -u`), set one thread for this process and
    those that it starts.

    OpenBLAS prints four lines and ends the process with SIGINT where it cannot start its threads.
    Settings of the user stay. Call it before linear algebra is loaded.
    """
    if sys.platform == "win32":
        return
    import resource  # noqa: PLC0415 - not on Windows

    if hasattr(resource, "RLIMIT_NPROC"):
        limit = resource.getrlimit(resource.RLIMIT_NPROC)[0]
    else:
        limit = resource.RLIM_INFINITY
    if limit != resource.RLIM_INFINITY and limit < FEW_PROCESSES:
        for name, value in ONE_THREAD.items():
            os.environ.setdefault(name, value)
        # OpenCV prints a line of its own for each thread that it cannot start.
        os.environ.setdefault("OPENCV_FOR_THREADS_NUM", "1")


def cores() -> int:
    """Number of cores that this process may use, or RFCA_RIG_THREADS if it is set. Raises
    BadInput for one that is no such number.
    """
    setting = os.environ.get(VARIABLE, "")
    if not setting:
        return machine_cores()
    if not (
        setting.isascii()
        and setting.isdecimal()
        and len(setting) <= 4
        and 1 <= int(setting) <= MAX_THREADS
    ):
        raise BadInput(
            f"{VARIABLE}={setting}: should be a number of threads from 1 to {MAX_THREADS}; unset "
            "it to use all cores"
        )
    return int(setting)


def machine_cores() -> int:
    """Number of cores that this process and its children may use; in a batch job only those of
    the job.
    """
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def single_threaded_blas() -> Iterator[None]:
    """Limits linear algebra to one thread, in the whole process; the last digits of results then do
    not depend on the number of cores.

    BLAS threads wait for each other by spinning. Beside other threads, or another program, they
    cost many times what they save.
    """
    # Every command imports this module, and few need this package.
    from threadpoolctl import threadpool_limits  # noqa: PLC0415

    with threadpool_limits(limits=1, user_api="blas"):
        yield
