"""One end of the way between a guardian and the process it guards. Neither can make the other wait."""

import select
import socket

from rfca_rig.guardian.records import GuardianRecord, encode, split

MOST_WAITING_BYTES = 1 << 18  # some 8000 frames
READ_BYTES = 1 << 16


class GuardianLink:
    """`flush` sends what the other side has room for, and keeps the rest; `take` gives what has come."""

    def __init__(self, end: socket.socket) -> None:
        end.setblocking(False)
        self._end = end
        self._waiting = bytearray()
        self._received = bytearray()
        self.is_cut = False

    def fileno(self) -> int:
        return self._end.fileno()

    def put(self, record: GuardianRecord, may_be_dropped: bool = False) -> bool:
        """Goes out with the next `flush`. False where it was dropped, because too much waits already."""
        if may_be_dropped and len(self._waiting) > MOST_WAITING_BYTES:
            self.flush()
            if len(self._waiting) > MOST_WAITING_BYTES:
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
            self.is_cut = True  # what the other side said before can still be taken
            self._waiting.clear()

    def take(self) -> list[GuardianRecord]:
        """Everything that came, in order; `is_cut` is true afterwards where nothing more can come."""
        try:
            while received := self._end.recv(READ_BYTES):
                self._received += received
            self.is_cut = True
        except BlockingIOError:
            pass
        except OSError:
            self.is_cut = True
        records, size = split(self._received)
        del self._received[:size]
        return records

    def wait(self, timeout_s: float) -> None:
        """Until something came or can be sent, for so long at most."""
        select.select([self._end], [self._end] if self._waiting else [], [], max(timeout_s, 0.0))

    def close(self) -> None:
        self._end.close()
