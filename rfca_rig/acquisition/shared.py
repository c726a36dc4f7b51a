"""Shared memory by name, without the surprise that whoever merely looked at it takes it away."""

import multiprocessing
import sys
from multiprocessing import resource_tracker
from multiprocessing.shared_memory import SharedMemory

from rfca_rig.errors import DeviceError


def attached(name: str) -> SharedMemory:
    """The memory called `name`, made by another process, which stays its owner.

    Before Python 3.13 a process that attaches is taken for an owner too: when it ends, its tracker removes the memory under
    everybody's feet (python/cpython#82300). Children of the owner share its tracker and must leave that entry alone. Raises
    DeviceError where there is no such memory.
    """
    try:
        if sys.version_info >= (3, 13):
            return SharedMemory(name, track=False)
        memory = SharedMemory(name)
    except FileNotFoundError as error:
        raise DeviceError(f"there is no shared memory called {name}; has the acquisition ended?") from error
    if multiprocessing.parent_process() is None:
        resource_tracker.unregister(memory._name, "shared_memory")  # type: ignore[attr-defined]
    return memory
