"""Camera opened by OpenCV: USB (UVC) cameras, and other video devices of the system."""

from collections.abc import Callable
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from rfca_rig.clock import Clock
from rfca_rig.drivers.roles import Photo
from rfca_rig.errors import DeviceError

# Number of frames that camera drivers may buffer; these are older than the call and are discarded.
STORED_FRAMES = 4
# Frames to discard after opening, until exposure and white balance have settled.
FIRST_FRAMES = 10


class Capture(Protocol):
    """The methods of cv2.VideoCapture that are used."""

    def isOpened(self) -> bool: ...

    def set(self, property_id: int, value: float, /) -> bool: ...

    def get(self, property_id: int, /) -> float: ...

    def grab(self) -> bool: ...

    def retrieve(self) -> tuple[bool, Any]: ...

    def release(self) -> None: ...


class OpenCvCamera:
    """Implements `Camera`. Autofocus is switched off: it changes the image scale, and with it the calibration."""

    def __init__(
        self, number: int, size_px: tuple[int, int], clock: Clock, open_capture: Callable[[int], Capture] = cv2.VideoCapture
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
            raise DeviceError(f"camera {number} does not open; check its cable, that nothing else uses it, and its number")
        self._set_up()

    def _set_up(self) -> None:
        self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, self._size_px[0])
        self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self._size_px[1])
        self._capture.set(cv2.CAP_PROP_AUTOFOCUS, 0)
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        # OpenCV ignores settings that a camera does not support, so the size is read back.
        given = (round(self._capture.get(cv2.CAP_PROP_FRAME_WIDTH)), round(self._capture.get(cv2.CAP_PROP_FRAME_HEIGHT)))
        if given != self._size_px:
            self.close()
            raise DeviceError(
                f"camera {self._number} gives pictures of {given[0]} x {given[1]}, not {self._size_px[0]} x {self._size_px[1]}; "
                "choose a size that it has, the one it was calibrated with"
            )
        for _ in range(FIRST_FRAMES):
            self._grab()

    def photo(self) -> Photo:
        """A photo (rows, columns, 3) in BGR order. Raises DeviceError if none arrives, or it is broken."""
        for _ in range(STORED_FRAMES):
            self._grab()
        self._grab()
        host_s = self._clock.now_s()
        self._taken += 1
        return Photo(self._retrieve(), host_s, f"photo-{self._taken:03d}")

    def _grab(self) -> None:
        if not self._capture.grab():
            raise DeviceError(f"camera {self._number} gives no picture; check its cable and power")

    def _retrieve(self) -> NDArray[np.uint8]:
        is_ok, image = self._capture.retrieve()
        if not is_ok or image is None or image.shape != (self._size_px[1], self._size_px[0], 3) or image.dtype != np.uint8:
            raise DeviceError(f"camera {self._number} gave a broken picture; check its cable, or try a smaller size")
        return np.ascontiguousarray(image)

    def close(self) -> None:
        self._capture.release()

    def identity(self) -> dict[str, str]:
        return {"camera": f"OpenCV camera {self._number}", "camera_size_px": f"{self._size_px[0]} x {self._size_px[1]}"}
