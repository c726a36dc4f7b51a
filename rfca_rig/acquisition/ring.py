"""A ring of records in shared memory: one process writes, any number of processes read, and nobody waits for anybody."""

from dataclasses import dataclass
from multiprocessing.shared_memory import SharedMemory

import numpy as np
from numpy.typing import NDArray

from rfca_rig.acquisition.shared import attached
from rfca_rig.errors import DeviceError

Bytes = NDArray[np.uint8]
Floats = NDArray[np.float64]

MARK = 0x52464341_52494E47
HEADER_BYTES = 128
_MARK, _CAPACITY, _RECORD_BYTES, _CLAIMED, _PUBLISHED, _REFUSED, _REFUSED_BYTES = range(7)


@dataclass(frozen=True)
class RingBlock:
    """What was new: `records` (m, bytes of a record), when each was read from the wire (m,), and how many went by unread before."""

    t_s: Floats
    records: Bytes
    overrun: int


class Ring:
    """The memory and its counters: a header of 64 bit words, one time stamp per record, the records.

    Record n lies in slot n modulo capacity. The writer first claims numbers, then fills their slots, then publishes them; a
    reader copies what is published, and afterwards drops whatever the writer has claimed again meanwhile. So a reader that is
    too slow loses the oldest records, knows how many, and never sees half of one.
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
        self.capacity, self.record_bytes = self._header[_CAPACITY], self._header[_RECORD_BYTES]
        self._t_s: Floats = np.frombuffer(everything, np.float64, self.capacity, HEADER_BYTES)
        slots = np.frombuffer(everything, np.uint8, self.capacity * self.record_bytes, HEADER_BYTES + 8 * self.capacity)
        self._slots: Bytes = slots.reshape(self.capacity, self.record_bytes)

    @staticmethod
    def create(capacity: int, record_bytes: int) -> "Ring":
        """A new and empty one; its maker calls `remove` in the end."""
        memory = SharedMemory(create=True, size=HEADER_BYTES + capacity * (8 + record_bytes))
        header = _everything(memory)[:HEADER_BYTES].cast("Q")
        header[_CAPACITY], header[_RECORD_BYTES], header[_MARK] = capacity, record_bytes, MARK
        header.release()
        return Ring(memory)

    @staticmethod
    def attach(name: str) -> "Ring":
        """Another process's ring. Raises DeviceError where there is none of that name."""
        return Ring(attached(name))

    @property
    def published(self) -> int:
        """Records written since the ring was made."""
        return int(self._header[_PUBLISHED])

    @property
    def refused(self) -> tuple[int, int]:
        """How many datagrams were no whole records, and how many bytes the last of them had."""
        return int(self._header[_REFUSED]), int(self._header[_REFUSED_BYTES])

    def write(self, t_s: float, records: Bytes) -> None:
        """Adds `records` (m, bytes of a record), all read at `t_s`. For the one writer only."""
        for begin in range(0, len(records), self.capacity):
            self._write(t_s, records[begin : begin + self.capacity])

    def _write(self, t_s: float, records: Bytes) -> None:
        first, end = self.published, self.published + len(records)
        self._header[_CLAIMED] = end
        at = first % self.capacity
        before_wrap = min(len(records), self.capacity - at)
        self._slots[at : at + before_wrap] = records[:before_wrap]
        self._slots[: len(records) - before_wrap] = records[before_wrap:]
        self._t_s[at : at + before_wrap] = t_s
        self._t_s[: len(records) - before_wrap] = t_s
        self._header[_PUBLISHED] = end

    def refuse(self, size: int) -> None:
        """Counts a datagram of that many bytes that was no whole records. For the one writer only."""
        self._header[_REFUSED_BYTES] = size
        self._header[_REFUSED] += 1

    def copied(self, first: int, end: int) -> tuple[Floats, Bytes, int]:
        """Stamps and records from `first` to before `end`, and how many of the first of them have been overwritten by now."""
        slots = np.arange(first, end) % self.capacity
        t_s, records = self._t_s[slots], self._slots[slots]
        gone = int(self._header[_CLAIMED]) - self.capacity - first
        return t_s, records, min(max(gone, 0), end - first)

    def close(self) -> None:
        """Lets go of the memory, which stays for others. May be called any number of times."""
        if self._memory.buf is not None:
            self._header.release()
            del self._t_s, self._slots
            self._memory.close()

    def remove(self) -> None:
        """For its maker: closes, and takes the memory away; who is attached keeps what it sees until it closes too."""
        self.close()
        self._memory.unlink()


def _everything(memory: SharedMemory) -> memoryview:
    if memory.buf is None:
        raise DeviceError(f"shared memory {memory.name} is closed")
    return memory.buf


class RingReader:
    """One reader's place in a ring; begins with what is written next, or with the oldest record still there."""

    def __init__(self, ring: Ring, from_oldest: bool = False) -> None:
        self._ring = ring
        self._next = max(ring.published - ring.capacity, 0) if from_oldest else ring.published
        self.overrun = 0

    def read(self) -> RingBlock:
        """Everything that was published since the last call; never waits."""
        published = self._ring.published
        first = max(self._next, published - self._ring.capacity)
        t_s, records, gone = self._ring.copied(first, published)
        overrun = first - self._next + gone
        self._next = published
        self.overrun += overrun
        return RingBlock(t_s[gone:], records[gone:], overrun)
