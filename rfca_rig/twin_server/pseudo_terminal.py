"""Pseudo terminal: a serial line that a client opens as /dev/pts/N, from the device's side."""

import os
import pty
import tty


class PseudoTerminal:
    """Raw byte stream without echo or translation. The client's side stays open here too, so that clients may come and go."""

    def __init__(self) -> None:
        self._device_side, self._client_side = pty.openpty()
        tty.setraw(self._client_side)
        os.set_blocking(self._device_side, False)
        self.path = os.ttyname(self._client_side)
        self._open = True

    def read(self) -> bytes:
        """All bytes that have arrived; never waits."""
        try:
            return os.read(self._device_side, 1 << 16)
        except BlockingIOError:
            return b""

    def write(self, data: bytes) -> int:
        """Sends bytes; returns how many fitted. The line holds a few kilobytes until the client reads."""
        try:
            return os.write(self._device_side, data)
        except BlockingIOError:
            return 0

    def close(self) -> None:
        """Closes both sides. May be called any number of times."""
        if self._open:
            self._open = False
            os.close(self._device_side)
            os.close(self._client_side)
