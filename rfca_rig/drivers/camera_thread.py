"""Camera on its own thread, so that the control loop goes on while a photo is exposed and transferred."""

import queue
import threading

from rfca_rig.drivers.roles import Camera, Photo
from rfca_rig.errors import DeviceError


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
            raise DeviceError("the camera has not answered since an earlier photo; unplug it and plug it in again before the next run")
        self._is_pending = True
        self._asked.put(True)

    def taken(self) -> Photo | None:
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
        # Any exception is passed on, and raised on the control loop's thread by `taken`.
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
