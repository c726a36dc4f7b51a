"""Photos on their way from the control process to the recorder, sent by a thread, so that nobody waits until they are through."""

import queue
import threading
from dataclasses import dataclass
from multiprocessing.connection import Connection

import numpy as np

from rfca_rig.recording.picture import Picture


@dataclass(frozen=True)
class AnnouncedPhoto:
    """A photo of that path and shape, whose bytes come next."""

    name: str
    shape: tuple[int, ...]

    def received(self, parent: Connection) -> Picture:
        """Raises EOFError, OSError where the sender dies meanwhile."""
        return np.frombuffer(parent.recv_bytes(), np.uint8).reshape(self.shape)


class PhotoSender:
    """`send` hands over, `finish` returns when all are through, or nobody is there to take them."""

    def __init__(self, child: Connection) -> None:
        self._child = child
        self._waiting: queue.SimpleQueue[tuple[AnnouncedPhoto, Picture] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="photos", daemon=True)

    def send(self, name: str, picture: Picture) -> None:
        """The caller leaves the picture alone."""
        if not self._thread.ident:
            self._thread.start()
        self._waiting.put((AnnouncedPhoto(name, picture.shape), np.ascontiguousarray(picture)))

    def finish(self, within_s: float) -> None:
        """Takes no more."""
        if self._thread.ident:
            self._waiting.put(None)
            self._thread.join(within_s)

    def _work(self) -> None:
        while (given := self._waiting.get()) is not None:
            announced, picture = given
            try:
                self._child.send(announced)
                self._child.send_bytes(picture.data.cast("B"))
            except OSError:
                return  # a recorder that is gone is noticed by the control loop
