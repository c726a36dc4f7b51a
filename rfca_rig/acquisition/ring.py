"""Lock-free ring buffer of records in shared memory: one writer, any number of readers, none of
which waits.

Shared memory is created with all its pages, and attached by name without the attaching process
removing it at its end.
"""

import errno
import multiprocessing
import os
import sys
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.shared_memory import SharedMemory

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import NO_MORE_PROCESSES, DeviceError
from rfca_rig.subprocesses import safe_path

Bytes = NDArray[np.uint8]
Floats = NDArray[np.float64]

# Spells "RFCARING" in ASCII, to recognise the memory.
MARK = 0x52464341_52494E47
# Room for 16 words of 64 bits, of which seven are used.
HEADER_BYTES = 128
_MARK, _CAPACITY, _RECORD_BYTES, _CLAIMED, _PUBLISHED, _REFUSED, _REFUSED_BYTES = range(7)


def create_shared_memory(size_bytes: int) -> SharedMemory:
    """New shared memory with all its pages reserved; the creator unlinks it. Raises DeviceError
    where the system has no room for it.
    """
    try:
        # Its tracker is a process. Where that cannot be started after the memory is there, nobody
        # removes the memory.
        with safe_path():
            resource_tracker.ensure_running()
        memory = SharedMemory(create=True, size=size_bytes)
    except OSError as error:
        raise DeviceError(_describe_no_room(size_bytes, error)) from error
    try:
        # Without it a full file system of shared memory kills the process at the first write, with
        # the motor on.
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(memory._fd, 0, size_bytes)  # type: ignore[attr-defined]
    except OSError as error:
        memory.close()
        memory.unlink()
        raise DeviceError(_describe_no_room(size_bytes, error)) from error
    return memory


def _describe_no_room(size_bytes: int, error: OSError) -> str:
    if error.errno == errno.EAGAIN:
        return NO_MORE_PROCESSES
    needed = f"rfca-rig needs {max(size_bytes / 1e6, 0.1):.1f} MB of shared memory (/dev/shm)"
    return (
        f"{needed}, which the system refuses: {error.strerror}; in a container start it with "
        "--shm-size=256m"
    )


def attach_shared_memory(name: str) -> SharedMemory:
    """Opens the shared memory `name` of another process, which stays its owner.

    Before Python 3.13 an attaching process is registered as an owner too: when it ends, its
    resource tracker removes the memory although others use it (python/cpython#82300). Children of
    the owner share its tracker and must not unregister it. Raises DeviceError if there is no such
    memory.
    """
    try:
        if sys.version_info >= (3, 13):
            return SharedMemory(name, track=False)
        with safe_path():
            memory = SharedMemory(name)
    except FileNotFoundError as error:
        raise DeviceError(
            f"there is no shared memory called {name}; has the acquisition ended?"
        ) from error
    except OSError as error:
        reason = NO_MORE_PROCESSES if error.errno == errno.EAGAIN else error.strerror
        raise DeviceError(f"shared memory {name} cannot be opened: {reason}") from error
    # A child started by multiprocessing shares the owner's tracker, whose entry must stay.
    if multiprocessing.parent_process() is None:
        resource_tracker.unregister(memory._name, "shared_memory")  # type: ignore[attr-defined]
    return memory


@dataclass(frozen=True)
class RingBlock:
    """New records.

    `records` (m, bytes of a record), `t_s` (m,) when each was read from the wire, `overrun` how
    many were lost unread before them.
    """

    t_s: Floats
    records: Bytes
    overrun: int


class Ring:
    """The shared memory and its counters: a header of 64 bit words, one time stamp per record, the
    records.

    Record n is in slot n modulo capacity. The writer first claims numbers, then fills their slots,
    then publishes them. A reader copies published records, and afterwards drops those whose slots
    the writer has claimed in the meantime. A slow reader therefore loses the oldest records, knows
    how many, and never sees a half-written one.
    """

    def __init__(self, memory: SharedMemory) -> None:
        self._memory = memory
        everything = _everything(memory)
        self._header = everything[:HEADER_BYTES].cast("Q")
        if self._header[_MARK] != MARK:
            self._header.release()
            memory.close()
            raise DeviceError(f"shared memory {memory.name} is not a ring of records")
        self.name = memory.name
        self.capacity = self._header[_CAPACITY]
        self.record_bytes = self._header[_RECORD_BYTES]
        self._t_s: Floats = np.frombuffer(everything, np.float64, self.capacity, HEADER_BYTES)
        slots = np.frombuffer(
            everything,
            np.uint8,
            self.capacity * self.record_bytes,
            HEADER_BYTES + 8 * self.capacity,
        )
        self._slots: Bytes = slots.reshape(self.capacity, self.record_bytes)

    @staticmethod
    def create(capacity: int, record_bytes: int) -> "Ring":
        """Creates an empty ring; the creator calls `remove` in the end. Raises DeviceError where
        the system has no room for it.
        """
        memory = create_shared_memory(HEADER_BYTES + capacity * (8 + record_bytes))
        header = _everything(memory)[:HEADER_BYTES].cast("Q")
        # The mark is written last: a process that sees it also sees the sizes.
        header[_CAPACITY] = capacity
        header[_RECORD_BYTES] = record_bytes
        header[_MARK] = MARK
        header.release()
        return Ring(memory)

    @staticmethod
    def attach(name: str) -> "Ring":
        """Opens the ring of another process. Raises DeviceError if there is none of that name."""
        return Ring(attach_shared_memory(name))

    @property
    def published(self) -> int:
        """Number of records written since the ring was created."""
        return int(self._header[_PUBLISHED])

    @property
    def refused(self) -> tuple[int, int]:
        """Number of datagrams that were not whole records, and the length of the last one in
        bytes.
        """
        return int(self._header[_REFUSED]), int(self._header[_REFUSED_BYTES])

    def write(self, t_s: float, records: Bytes) -> None:
        """Adds `records` (m, bytes of a record), all read at time `t_s`. Only for the single
        writer.
        """
        # In pieces of at most one capacity, so that a piece never overwrites itself.
        for begin in range(0, len(records), self.capacity):
            self._write(t_s, records[begin : begin + self.capacity])

    def _write(self, t_s: float, records: Bytes) -> None:
        first = self.published
        end = self.published + len(records)
        # Claim before writing, publish after it: a reader can thus detect which of its copies are
        # stale.
        self._header[_CLAIMED] = end
        at = first % self.capacity
        before_wrap = min(len(records), self.capacity - at)
        self._slots[at : at + before_wrap] = records[:before_wrap]
        self._slots[: len(records) - before_wrap] = records[before_wrap:]
        self._t_s[at : at + before_wrap] = t_s
        self._t_s[: len(records) - before_wrap] = t_s
        self._header[_PUBLISHED] = end

    def refuse(self, size: int) -> None:
        """Counts a datagram of `size` bytes that was not whole records. Only for the single
        writer.
        """
        self._header[_REFUSED_BYTES] = size
        self._header[_REFUSED] += 1

    def copy_records(self, first: int, end: int) -> tuple[Floats, Bytes, int]:
        """Copies the records `first`..`end` - 1.

        Returns
        -------
        t_s : ndarray, shape (m,)
            Times when they were read, m = end - first.
        records : ndarray, shape (m, bytes of a record)
            The records.
        gone : int
            How many of the first ones have been overwritten by now, and must be dropped.
        """
        slots = np.arange(first, end) % self.capacity
        t_s = self._t_s[slots]
        records = self._slots[slots]
        # Read after the copy: slots claimed up to now may hold mixed data.
        gone = int(self._header[_CLAIMED]) - self.capacity - first
        return t_s, records, min(max(gone, 0), end - first)

    def close(self) -> None:
        """Detaches from the memory, which stays for others. May be called any number of times."""
        if self._memory.buf is not None:
            self._header.release()
            # Arrays that still refer to the buffer would keep it from being closed.
            del self._t_s, self._slots
            self._memory.close()

    def remove(self) -> None:
        """For the creator: closes and removes the memory. Processes that are attached can use it
        until they close it.
        """
        self.close()
        self._memory.unlink()


def _everything(memory: SharedMemory) -> memoryview:
    if memory.buf is None:
        raise DeviceError(f"shared memory {memory.name} is closed")
    return memory.buf


class RingReader:
    """Read position of one reader. It starts at the next record written, or at the oldest one
    still there.
    """

    def __init__(self, ring: Ring, from_oldest: bool = False) -> None:
        self._ring = ring
        if from_oldest:
            self._next = max(ring.published - ring.capacity, 0)
        else:
            self._next = ring.published
        self.overrun = 0

    def read(self) -> RingBlock:
        """All records published since the last call; never waits."""
        published = self._ring.published
        first = max(self._next, published - self._ring.capacity)
        t_s, records, gone = self._ring.copy_records(first, published)
        overrun = first - self._next + gone
        self._next = published
        self.overrun += overrun
        return RingBlock(t_s[gone:], records[gone:], overrun)
