"""A camera on a thread of its own: asked and looked at again, it keeps nobody waiting, whatever
it does.
"""

import threading

import numpy as np
import pytest

from rfca_rig.drivers.camera import CameraThread
from rfca_rig.drivers.roles import Photo
from rfca_rig.errors import DeviceError

LONGEST_S = 60.0


class Held:
    """A camera whose next photo comes when the test lets it; `answers` are photos' names, or
    errors to raise.
    """

    def __init__(self, *answers):
        self._answers = iter(answers)
        self.go = threading.Semaphore(0)
        self.asked = threading.Semaphore(0)
        self.closed = threading.Event()

    def photo(self):
        self.asked.release()
        self.go.acquire()
        answer = next(self._answers)
        if isinstance(answer, Exception):
            raise answer
        return Photo(np.zeros((2, 2, 3), np.uint8), 0.0, answer)

    def close(self):
        self.closed.set()

    def identity(self):
        return {"camera": "held"}


def waited_for(photographer):
    """What comes in the end; raises what comes instead."""
    wait = threading.Event()
    for _ in range(round(LONGEST_S / 0.002)):
        if photo := photographer.fetch_photo():
            return photo
        wait.wait(0.002)
    raise AssertionError("nothing came")


def test_a_photo_comes_once_and_only_when_it_is_there():
    camera = Held("first", "second")
    photographer = CameraThread(camera)
    assert photographer.fetch_photo() is None
    for name in ("first", "second"):
        photographer.begin()
        assert camera.asked.acquire(timeout=LONGEST_S)
        assert photographer.fetch_photo() is None
        camera.go.release()
        assert waited_for(photographer).name == name
        assert photographer.fetch_photo() is None
    assert photographer.identity() == {"camera": "held"}
    photographer.close()
    photographer.close()
    assert camera.closed.is_set()


def test_one_photo_at_a_time():
    camera = Held("first")
    photographer = CameraThread(camera)
    photographer.begin()
    with pytest.raises(DeviceError, match="has not answered since an earlier photo"):
        photographer.begin()
    camera.go.release()
    assert waited_for(photographer).name == "first"


def test_a_photo_that_came_too_late_is_not_the_next_one():
    camera = Held("late", "next")
    photographer = CameraThread(camera)
    photographer.begin()
    camera.go.release()
    while photographer._answers.empty():
        pass
    photographer.begin()
    camera.go.release()
    assert waited_for(photographer).name == "next"


@pytest.mark.parametrize("error", [DeviceError("no picture"), ValueError("a mistake in a driver")])
def test_what_the_camera_raised_is_raised_again_and_it_can_be_asked_anew(error):
    camera = Held(error, "second")
    photographer = CameraThread(camera)
    photographer.begin()
    camera.go.release()
    with pytest.raises(type(error), match=str(error)):
        waited_for(photographer)
    photographer.begin()
    camera.go.release()
    assert waited_for(photographer).name == "second"


def test_a_camera_that_never_answers_keeps_nobody_from_leaving():
    photographer = CameraThread(Held("never"))
    photographer.begin()
    leaving = threading.Thread(target=photographer.close)
    leaving.start()
    leaving.join(LONGEST_S)
    assert not leaving.is_alive()
