"""The photos of a run, written to its folder by a thread, so that nobody waits for a picture to be packed and to reach the disk."""

import queue
import threading
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import RigError
from rfca_rig.recording.atomic import write_atomically

FOLDER = "photos"
PACKING = 1  # of 0 to 9: noise hardly packs, and more takes many times longer


class PhotoStore:
    """`keep` hands a picture over, `finish` waits until all are on disk. Pictures are PNG, which loses nothing."""

    def __init__(self, run_folder: Path) -> None:
        self._run_folder = run_folder
        self._kept = 0
        self._faults: dict[str, str] = {}
        self._waiting: queue.SimpleQueue[tuple[str, NDArray[np.uint8]] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="photos", daemon=True)
        self._thread.start()

    def keep(self, image: NDArray[np.uint8]) -> str:
        """The path, from the run's folder, at which the picture (rows, columns, 3) uint8 will be. The caller leaves the picture alone."""
        self._kept += 1
        name = f"{FOLDER}/{self._kept:03d}.png"
        self._waiting.put((name, image))
        return name

    def finish(self) -> dict[str, str]:
        """Returns when every picture is on disk, or is not: what kept those, by path. Takes no more pictures."""
        self._waiting.put(None)
        self._thread.join()
        return self._faults

    def _work(self) -> None:
        while (given := self._waiting.get()) is not None:
            name, image = given
            try:
                self._write(self._run_folder / name, image)
            except (RigError, OSError) as error:
                self._faults[name] = str(error)

    def _write(self, path: Path, image: NDArray[np.uint8]) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        packed = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, PACKING])[1]
        write_atomically(path, packed.tobytes())
