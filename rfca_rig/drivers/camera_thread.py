"""A camera on a thread of its own, so that the loop that commands the drive goes on while a photo is exposed and carried over."""

import queue
import threading

from rfca_rig.drivers.roles import Camera, Photo
from rfca_rig.errors import DeviceError


class CameraThread:
    """Implements `Photographer` with any `Camera`. One photo is under way at a time.

    A camera that never answers keeps its thread, which ends with the process; everybody else goes on without it.
    """

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._identity = camera.identity()
        self._asked: queue.SimpleQueue[bool] = queue.SimpleQueue()
        self._answers: queue.SimpleQueue[Photo | Exception] = queue.SimpleQueue()
        self._under_way = False
        self._thread = threading.Thread(target=self._work, name="camera", daemon=True)
        self._thread.start()

    def begin(self) -> None:
        self._answer()  # too late for whoever asked
        if self._under_way:
            raise DeviceError("the camera has not answered since an earlier photo; unplug it and plug it in again before the next run")
        self._under_way = True
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
        self._under_way = False
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
        except Exception as error:  # raised again on the loop's thread, by `taken`
            return error

    def close(self) -> None:
        self._answer()
        self._asked.put(False)
        if not self._under_way:
            self._thread.join()

    def identity(self) -> dict[str, str]:
        return self._identity
