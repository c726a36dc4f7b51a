"""Photos of static stages: lossless PNG files, and their way to the recorder.

A thread sends them, so that the control loop never waits.
"""

import importlib
import queue
import threading
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rfca_rig.recording.atomic import write_atomically
from rfca_rig.recording.layout import PHOTOS

# PNG compression, 0 to 9: camera noise hardly compresses, and a higher level takes many times longer.
PACKING = 1
Picture = NDArray[np.uint8]


def next_photo(folder: Path) -> int:
    """Number of the run's next photo."""
    return max((int(file.stem) for file in (folder / PHOTOS).glob("*.png") if file.stem.isdecimal()), default=0) + 1


def photo_name(number: int) -> str:
    """Path of a photo in the run's folder."""
    return f"{PHOTOS}/{number:03d}.png"


def write_picture(path: Path, picture: Picture) -> None:
    """Returns when the picture (rows, columns, 3) is on disk. Raises RigError, DiskFull."""
    path.parent.mkdir(parents=True, exist_ok=True)
    # Imported only here: the recorder of a run without camera starts sooner.
    cv2 = importlib.import_module("cv2")
    encoded = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, PACKING])[1]
    write_atomically(path, encoded.tobytes())


@dataclass(frozen=True)
class AnnouncedPhoto:
    """Path and shape (rows, columns, 3) of a photo whose bytes come next."""

    name: str
    shape: tuple[int, ...]

    def receive(self, parent: Connection) -> Picture:
        """The photo (rows, columns, 3). Raises EOFError, OSError where the sender dies meanwhile."""
        return np.frombuffer(parent.recv_bytes(), np.uint8).reshape(self.shape)


class PhotoSender:
    """`send` queues a photo; `finish` returns when all are sent, or the recorder is gone."""

    def __init__(self, child: Connection) -> None:
        self._child = child
        self._waiting: queue.SimpleQueue[tuple[AnnouncedPhoto, Picture] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="photos", daemon=True)

    def start(self) -> None:
        """Starts the thread, if that is not done. Raises RuntimeError where the system allows no further one."""
        # With the first photo: runs without a camera have no such thread.
        if not self._thread.ident:
            self._thread.start()

    def send(self, name: str, picture: Picture) -> None:
        """Queues a picture (rows, columns, 3), which the caller must not change any more."""
        self.start()
        self._waiting.put((AnnouncedPhoto(name, picture.shape), np.ascontiguousarray(picture)))

    def finish(self, within_s: float) -> None:
        """Ends the thread after the photos that are queued."""
        if self._thread.ident:
            self._waiting.put(None)
            self._thread.join(within_s)

    def _work(self) -> None:
        while (queued := self._waiting.get()) is not None:
            announced, picture = queued
            try:
                self._child.send(announced)
                self._child.send_bytes(picture.data.cast("B"))
            except OSError:
                # The control loop notices by itself that the recorder is gone.
                return
