"""The cameras of rig files, put together as the engine takes them."""

import threading
from contextlib import ExitStack
from pathlib import Path

import cv2
import numpy as np
import pytest

from rfca_rig.bench.sensors import DelayedCamera, make_camera
from rfca_rig.clock import TwinClock, WallClock
from rfca_rig.description.camera_file import OpenCvCameraSection, PhotoFolderSection
from rfca_rig.description.rig_file import read_rig
from rfca_rig.drivers.roles import Photo
from rfca_rig.errors import DeviceError

EYE = read_rig(Path(__file__).parents[2] / "calibration" / "twin.toml").eye()


def test_a_photo_folder_s_camera_tells_the_person_and_takes_what_comes(tmp_path, capsys):
    section = PhotoFolderSection(
        device="photo-folder", calibration_file="c.toml", folder=str(tmp_path), photo_limit_s=10.0
    )
    with ExitStack() as stack:
        camera = make_camera(section, EYE, WallClock(), stack)
        camera.begin()
        assert camera.fetch_photo() is None
        threading.Timer(
            0.3, cv2.imwrite, (str(tmp_path / "a.png"), np.full((4, 4, 3), 9, np.uint8))
        ).start()
        photo = None
        wait = threading.Event()
        for _ in range(1000):
            if photo := camera.fetch_photo():
                break
            wait.wait(0.01)
        assert (photo.name, int(photo.image[0, 0, 0])) == ("a.png", 9)
    assert capsys.readouterr().err == "REAL take the photo now\n"


def test_a_camera_that_does_not_open_is_known_before_anything_moves():
    with ExitStack() as stack, pytest.raises(DeviceError, match="camera 99 does not open"):
        make_camera(
            OpenCvCameraSection(device="opencv", calibration_file="c.toml", number=99),
            EYE,
            WallClock(),
            stack,
        )


class Counting:
    """A camera without delay, whose photos bear the time."""

    def __init__(self, clock):
        self._clock = clock

    def photo(self):
        return Photo(np.zeros((2, 2, 3), np.uint8), self._clock.now_s(), "p")

    def close(self):
        """Nothing is held open."""

    def identity(self):
        return {}


def test_a_delayed_camera_exposes_when_asked_and_answers_later():
    clock = TwinClock()
    camera = DelayedCamera(Counting(clock), clock, 0.2)
    clock.wait_until(1.0)
    camera.begin()
    clock.wait_until(1.19)
    assert camera.fetch_photo() is None
    clock.wait_until(1.2)
    assert camera.fetch_photo().host_s == 1.0
    assert camera.fetch_photo() is None
