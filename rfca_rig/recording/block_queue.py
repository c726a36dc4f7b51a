"""A bounded queue of bytes in shared memory: one process puts, one takes, and neither ever waits for the other."""

from multiprocessing.shared_memory import SharedMemory

from rfca_rig.acquisition.shared import attached
from rfca_rig.errors import RigError

MARK = 0x52464341_51554555
HEADER_BYTES = 128
_MARK, _SIZE, _PUT, _TAKEN, _ACKNOWLEDGED, _COMPLAINED = range(6)


class BlockQueue:
    """Bytes that were put and not yet taken stay in the memory. Counters are published after what they count is there.

    Beside the bytes it carries two words back from the taker, so that the putter learns of them without asking the system.
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
        """A new and empty one of `size` bytes; its maker calls `remove` in the end."""
        memory = SharedMemory(create=True, size=HEADER_BYTES + size)
        if memory.buf is not None:
            with memory.buf[:HEADER_BYTES].cast("Q") as header:
                header[_SIZE], header[_MARK] = size, MARK
        return BlockQueue(memory)

    @staticmethod
    def attach(name: str) -> "BlockQueue":
        """Another process's queue. Raises DeviceError where there is none of that name."""
        return BlockQueue(attached(name))

    @property
    def waiting(self) -> int:
        """Bytes put and not taken."""
        return int(self._header[_PUT] - self._header[_TAKEN])

    @property
    def acknowledged(self) -> int:
        """Stages that the taker has brought to disk."""
        return int(self._header[_ACKNOWLEDGED])

    @property
    def has_complained(self) -> bool:
        return bool(self._header[_COMPLAINED])

    def put(self, content: bytes) -> bool:
        """All of it, or False where there is not room for all. For the one putter only."""
        if len(content) > self.size - self.waiting:
            return False
        at = self._header[_PUT] % self.size
        before_wrap = min(len(content), self.size - at)
        self._bytes[at : at + before_wrap] = content[:before_wrap]
        self._bytes[: len(content) - before_wrap] = content[before_wrap:]
        self._header[_PUT] += len(content)
        return True

    def look(self) -> bytes:
        """Everything that waits, which goes on waiting. For the one taker only."""
        at, length = self._header[_TAKEN] % self.size, self.waiting
        before_wrap = min(length, self.size - at)
        return bytes(self._bytes[at : at + before_wrap]) + bytes(self._bytes[: length - before_wrap])

    def took(self, length: int) -> None:
        """That many of the bytes looked at need not wait any longer. For the one taker only."""
        self._header[_TAKEN] += length

    def tell(self, acknowledged: int, complained: bool) -> None:
        """For the one taker only."""
        self._header[_ACKNOWLEDGED], self._header[_COMPLAINED] = acknowledged, complained

    def close(self) -> None:
        """Lets go of the memory, which stays for the other. May be called any number of times."""
        if self._memory.buf is not None:
            self._header.release()
            self._bytes.release()
            self._memory.close()

    def remove(self) -> None:
        """For its maker: closes, and takes the memory away."""
        self.close()
        self._memory.unlink()
