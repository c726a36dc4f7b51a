"""A bounded queue of bytes in shared memory: one process writes, one reads, and neither ever
waits for the other.
"""

from multiprocessing.shared_memory import SharedMemory

from rfca_rig.acquisition.ring import attach_shared_memory, create_shared_memory
from rfca_rig.errors import RigError

# "RFCAQUEU" in ASCII: marks the memory as a queue of blocks.
MARK = 0x52464341_51554555
HEADER_BYTES = 128
_MARK, _SIZE, _PUT, _TAKEN, _ACKNOWLEDGED, _COMPLAINED = range(6)


class BlockQueue:
    """Bytes that were put stay in memory until taken. A counter is advanced only after the bytes
    that it counts are there.

    Two further words lead back from the taker, so that the putter learns of them without a system
    call.
    """

    def __init__(self, memory: SharedMemory) -> None:
        if memory.buf is None:
            raise RigError(f"shared memory {memory.name} is closed")
        self._memory = memory
        self._header = memory.buf[:HEADER_BYTES].cast("Q")
        if self._header[_MARK] != MARK:
            self._header.release()
            memory.close()
            raise RigError(f"shared memory {memory.name} is not a queue of blocks")
        self.name = memory.name
        self.size = self._header[_SIZE]
        self._bytes = memory.buf[HEADER_BYTES : HEADER_BYTES + self.size]

    @staticmethod
    def create(size: int) -> "BlockQueue":
        """A new, empty queue of `size` bytes; its maker calls `remove` in the end. Raises
        DeviceError where there is no room.
        """
        memory = create_shared_memory(HEADER_BYTES + size)
        if memory.buf is not None:
            with memory.buf[:HEADER_BYTES].cast("Q") as header:
                # The mark last: a process that attaches earlier sees no queue, and not one without
                # a size.
                header[_SIZE] = size
                header[_MARK] = MARK
        return BlockQueue(memory)

    @staticmethod
    def attach(name: str) -> "BlockQueue":
        """Another process's queue. Raises DeviceError where there is none of that name."""
        return BlockQueue(attach_shared_memory(name))

    @property
    def waiting(self) -> int:
        """Number of bytes put and not taken."""
        # Both counters only grow, so no lock is needed: each has one writer, and an old value is
        # merely cautious.
        return int(self._header[_PUT] - self._header[_TAKEN])

    @property
    def acknowledged(self) -> int:
        """Stages that the taker has brought to disk."""
        return int(self._header[_ACKNOWLEDGED])

    @property
    def has_complained(self) -> bool:
        return bool(self._header[_COMPLAINED])

    def put(self, content: bytes) -> bool:
        """Puts all of `content`, or returns False where there is not room for all. For the one
        putter only.
        """
        if len(content) > self.size - self.waiting:
            return False
        at = self._header[_PUT] % self.size
        before_wrap = min(len(content), self.size - at)
        self._bytes[at : at + before_wrap] = content[:before_wrap]
        self._bytes[: len(content) - before_wrap] = content[before_wrap:]
        # Only now: the taker must never see bytes that are not written yet.
        self._header[_PUT] += len(content)
        return True

    def look(self) -> bytes:
        """All waiting bytes, which go on waiting. For the one taker only."""
        at = self._header[_TAKEN] % self.size
        length = self.waiting
        before_wrap = min(length, self.size - at)
        return bytes(self._bytes[at : at + before_wrap]) + bytes(
            self._bytes[: length - before_wrap]
        )

    def consume(self, length: int) -> None:
        """Frees `length` of the bytes looked at. For the one taker only."""
        self._header[_TAKEN] += length

    def tell(self, acknowledged: int, complained: bool) -> None:
        """Publishes both words for the putter. For the one taker only."""
        self._header[_ACKNOWLEDGED] = acknowledged
        self._header[_COMPLAINED] = complained

    def close(self) -> None:
        """Detaches from the memory, which stays for the other process. May be called any number
        of times.
        """
        if self._memory.buf is not None:
            self._header.release()
            self._bytes.release()
            self._memory.close()

    def remove(self) -> None:
        """For its maker: detaches, and removes the memory."""
        self.close()
        self._memory.unlink()
