"""Cameras: one opened by OpenCV, on a thread of its own, and one that stores its photos in a
folder itself.
"""

import queue
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np

from rfca_rig.clock import Clock
from rfca_rig.drivers.photo_files import list_pictures, read_picture
from rfca_rig.drivers.roles import Camera, Photo
from rfca_rig.errors import BadInput, DeviceError

# Number of frames that camera drivers may buffer; these are older than the call and are discarded.
STORED_FRAMES = 4
# Frames to discard after opening, until exposure and white balance have settled.
FIRST_FRAMES = 10

LOOK_EVERY_S = 0.1


class Capture(Protocol):
    """The methods of cv2.VideoCapture that are used."""

    def isOpened(self) -> bool: ...

    def set(self, property_id: int, value: float, /) -> bool: ...

    def get(self, property_id: int, /) -> float: ...

    def grab(self) -> bool: ...

    def retrieve(self) -> tuple[bool, Any]: ...

    def release(self) -> None: ...


class OpenCvCamera:
    """Implements `Camera`. Autofocus is switched off: it changes the image scale, and with it
    the calibration.
    """

    def __init__(
        self,
        number: int,
        size_px: tuple[int, int],
        clock: Clock,
        open_capture: Callable[[int], Capture] = cv2.VideoCapture,
    ) -> None:
        """`number` is the camera's index in the system, `size_px` is (width, height).

        Raises DeviceError if it does not open, or not in that size.
        """
        self._number = number
        self._size_px = size_px
        self._clock = clock
        self._taken = 0
        self._capture = open_capture(number)
        if not self._capture.isOpened():
            raise DeviceError(
                f"camera {number} does not open; check its cable, that nothing else uses "
                "it, and its number"
            )
        self._set_up()

    def _set_up(self) -> None:
        self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, self._size_px[0])
        self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self._size_px[1])
        self._capture.set(cv2.CAP_PROP_AUTOFOCUS, 0)
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        # OpenCV ignores settings that a camera does not support, so the size is read back.
        given = (
            round(self._capture.get(cv2.CAP_PROP_FRAME_WIDTH)),
            round(self._capture.get(cv2.CAP_PROP_FRAME_HEIGHT)),
        )
        if given != self._size_px:
            self.close()
            raise DeviceError(
                f"camera {self._number} gives pictures of {given[0]} x {given[1]}, not "
                f"{self._size_px[0]} x {self._size_px[1]}; "
                "choose a size that it has, the one it was calibrated with"
            )
        for _ in range(FIRST_FRAMES):
            self._grab()

    def photo(self) -> Photo:
        """A photo (rows, columns, 3) in BGR order. Raises DeviceError if none arrives, or it is
        broken.
        """
        for _ in range(STORED_FRAMES):
            self._grab()
        self._grab()
        host_s = self._clock.now_s()
        self._taken += 1
        is_ok, image = self._capture.retrieve()
        if (
            not is_ok
            or image is None
            or image.shape != (self._size_px[1], self._size_px[0], 3)
            or image.dtype != np.uint8
        ):
            raise DeviceError(
                f"camera {self._number} gave a broken picture; check its cable, or try a "
                "smaller size"
            )
        return Photo(np.ascontiguousarray(image), host_s, f"photo-{self._taken:03d}")

    def _grab(self) -> None:
        if not self._capture.grab():
            raise DeviceError(f"camera {self._number} gives no picture; check its cable and power")

    def close(self) -> None:
        self._capture.release()

    def identity(self) -> dict[str, str]:
        return {
            "camera": f"OpenCV camera {self._number}",
            "camera_size_px": f"{self._size_px[0]} x {self._size_px[1]}",
        }


class CameraThread:
    """Implements `Photographer` with any `Camera`. One photo is in progress at a time.

    A camera that never answers blocks only its own daemon thread, which ends with the process.
    """

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._identity = camera.identity()
        self._asked: queue.SimpleQueue[bool] = queue.SimpleQueue()
        self._answers: queue.SimpleQueue[Photo | Exception] = queue.SimpleQueue()
        self._is_pending = False
        self._thread = threading.Thread(target=self._work, name="camera", daemon=True)
        self._thread.start()

    def begin(self) -> None:
        # A photo that arrived too late for its request is discarded.
        self._answer()
        if self._is_pending:
            raise DeviceError(
                "the camera has not answered since an earlier photo; unplug it and plug "
                "it in again before the next run"
            )
        self._is_pending = True
        self._asked.put(True)

    def fetch_photo(self) -> Photo | None:
        answer = self._answer()
        if isinstance(answer, Exception):
            raise answer
        return answer

    def _answer(self) -> Photo | Exception | None:
        try:
            answer = self._answers.get_nowait()
        except queue.Empty:
            return None
        self._is_pending = False
        return answer

    def _work(self) -> None:
        try:
            while self._asked.get():
                self._answers.put(self._photo())
        finally:
            self._camera.close()

    def _photo(self) -> Photo | Exception:
        try:
            return self._camera.photo()
        # Any exception is passed on, and raised on the control loop's thread by `fetch_photo`.
        except Exception as error:
            return error

    def close(self) -> None:
        self._answer()
        self._asked.put(False)
        if not self._is_pending:
            # Joining while a photo is in progress could wait for ever on a dead camera.
            self._thread.join()

    def identity(self) -> dict[str, str]:
        return self._identity


class ArrivingPhotos:
    """Implements `Camera`: returns the first photo that appears in the folder after the call. Older
    files are ignored.

    `host_s` is the time when the photo was found, somewhat after it was taken.
    """

    def __init__(self, folder: Path, clock: Clock, limit_s: float) -> None:
        """`limit_s` is the longest wait of a call in s. Raises BadInput if the folder does not
        exist.
        """
        self._folder = folder
        self._clock = clock
        self._limit_s = limit_s
        list_pictures(folder)

    def photo(self) -> Photo:
        """A photo (rows, columns, 3) in BGR order. Raises DeviceError if no complete one appears
        within the limit.
        """
        before = {file.name for file in list_pictures(self._folder)}
        began_s = self._clock.now_s()
        why = ""
        while self._clock.now_s() - began_s < self._limit_s:
            for file in list_pictures(self._folder):
                if file.name not in before:
                    try:
                        return Photo(read_picture(file), self._clock.now_s(), file.name)
                    except BadInput as error:
                        # The file may still be being written, so it is tried again.
                        why = f"; {error}"
            self._clock.wait_until(self._clock.now_s() + LOOK_EVERY_S)
        raise DeviceError(f"{self._folder}: no new photo came within {self._limit_s:g} s{why}")

    def close(self) -> None:
        """Does nothing: no file is held open."""

    def identity(self) -> dict[str, str]:
        return {"camera": f"photos arriving in folder {self._folder.name}"}
