"""One end of the connection between the guardian and its parent. Neither side can block the other."""

import select
import socket

from rfca_rig.guardian.records import GuardianRecord, encode, split_records

# Limit of the send queue, about 8000 frames.
MAX_QUEUED_BYTES = 1 << 18
READ_BYTES = 1 << 16


class GuardianLink:
    """Non-blocking record stream. `flush` sends what the socket accepts and keeps the rest; `take` returns what has arrived."""

    def __init__(self, end: socket.socket) -> None:
        end.setblocking(False)
        self._end = end
        self._waiting = bytearray()
        self._received = bytearray()
        self.is_cut = False

    def fileno(self) -> int:
        return self._end.fileno()

    def put(self, record: GuardianRecord, may_be_dropped: bool = False) -> bool:
        """Queues a record for the next `flush`. Returns False if it was dropped, because the queue is full."""
        if may_be_dropped and len(self._waiting) > MAX_QUEUED_BYTES:
            self.flush()
            if len(self._waiting) > MAX_QUEUED_BYTES:
                return False
        self._waiting += encode(record)
        return True

    def flush(self) -> None:
        try:
            while self._waiting:
                del self._waiting[: self._end.send(self._waiting)]
        except BlockingIOError:
            return
        except OSError:
            # What the other side sent before can still be received.
            self.is_cut = True
            self._waiting.clear()

    def take(self) -> list[GuardianRecord]:
        """All records that have arrived, in order. Sets `is_cut` if no more can arrive."""
        try:
            while received := self._end.recv(READ_BYTES):
                self._received += received
            self.is_cut = True
        except BlockingIOError:
            pass
        except OSError:
            self.is_cut = True
        records, size = split_records(self._received)
        del self._received[:size]
        return records

    def wait(self, timeout_s: float) -> None:
        """Waits until data has arrived or can be sent, for `timeout_s` at most."""
        select.select([self._end], [self._end] if self._waiting else [], [], max(timeout_s, 0.0))

    def close(self) -> None:
        self._end.close()
