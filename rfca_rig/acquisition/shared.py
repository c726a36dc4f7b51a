"""Attaching to shared memory by name, without the attaching process removing it at its end."""

import multiprocessing
import sys
from multiprocessing import resource_tracker
from multiprocessing.shared_memory import SharedMemory

from rfca_rig.errors import DeviceError


def attach_shared_memory(name: str) -> SharedMemory:
    """Opens the shared memory `name` of another process, which stays its owner.

    Before Python 3.13 an attaching process is registered as an owner too: when it ends, its resource tracker removes the memory
    although others use it (python/cpython#82300). Children of the owner share its tracker and must not unregister it. Raises
    DeviceError if there is no such memory.
    """
    try:
        if sys.version_info >= (3, 13):
            return SharedMemory(name, track=False)
        memory = SharedMemory(name)
    except FileNotFoundError as error:
        raise DeviceError(f"there is no shared memory called {name}; has the acquisition ended?") from error
    # A child started by multiprocessing shares the owner's tracker, whose entry must stay.
    if multiprocessing.parent_process() is None:
        resource_tracker.unregister(memory._name, "shared_memory")  # type: ignore[attr-defined]
    return memory
