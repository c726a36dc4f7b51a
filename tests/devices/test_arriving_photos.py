"""A folder into which a camera puts its photos."""

import cv2
import numpy as np
import pytest

from rfca_rig.drivers.camera import ArrivingPhotos
from rfca_rig.errors import BadInput, DeviceError


def picture(shade):
    return np.full((8, 12, 3), shade, np.uint8)


class Clock:
    """Time that passes while somebody waits; at some times something happens."""

    def __init__(self, **happens):
        self._now_s = 0.0
        self._happens = {
            float(at.removeprefix("at_").replace("_", ".")): what for at, what in happens.items()
        }

    def now_s(self):
        return self._now_s

    def wait_until(self, t_s):
        for at_s in [at_s for at_s in self._happens if at_s <= t_s]:
            self._happens.pop(at_s)()
        self._now_s = max(self._now_s, t_s)


def writes(path, shade):
    return lambda: cv2.imwrite(str(path), picture(shade))


def test_the_first_that_comes_is_taken_and_what_was_there_is_left(tmp_path):
    cv2.imwrite(str(tmp_path / "old.png"), picture(1))
    clock = Clock(at_1_0=writes(tmp_path / "b.png", 2), at_3_0=writes(tmp_path / "a.png", 3))
    camera = ArrivingPhotos(tmp_path, clock, 10.0)
    first = camera.photo()
    second = camera.photo()
    assert (first.name, int(first.image[0, 0, 0]), second.name, int(second.image[0, 0, 0])) == (
        "b.png",
        2,
        "a.png",
        3,
    )
    assert (first.host_s, second.host_s) == (
        pytest.approx(1.0, abs=0.2),
        pytest.approx(3.0, abs=0.2),
    )
    assert camera.identity() == {"camera": f"photos arriving in folder {tmp_path.name}"}


def test_one_that_is_still_being_written_is_waited_for(tmp_path):
    content = cv2.imencode(".png", picture(7))[1].tobytes()
    half = lambda: (tmp_path / "a.png").write_bytes(content[: len(content) // 2])  # noqa: E731
    whole = lambda: (tmp_path / "a.png").write_bytes(content)  # noqa: E731
    photo = ArrivingPhotos(tmp_path, Clock(at_1_0=half, at_2_0=whole), 10.0).photo()
    assert photo.host_s == pytest.approx(2.0, abs=0.2)
    assert int(photo.image[0, 0, 0]) == 7


def test_none_within_the_limit_is_one_line_with_the_reason(tmp_path):
    with pytest.raises(DeviceError, match=r"no new photo came within 3 s$"):
        ArrivingPhotos(tmp_path, Clock(), 3.0).photo()
    broken = lambda: (tmp_path / "a.png").write_bytes(b"not a picture")  # noqa: E731
    with pytest.raises(
        DeviceError, match=r"no new photo came within 3 s; .*a.png: neither JPEG, PNG nor TIFF"
    ):
        ArrivingPhotos(tmp_path, Clock(at_1_0=broken), 3.0).photo()


def test_a_folder_that_is_not_there_is_known_before_anything_moves(tmp_path):
    with pytest.raises(BadInput, match="cannot be read"):
        ArrivingPhotos(tmp_path / "nowhere", Clock(), 3.0)
