"""Cameras behind one role: a folder of photos, an OpenCV camera, and pictures that are broken."""

import os
from datetime import UTC, datetime

import cv2
import numpy as np
import pytest

from rfca_rig.clock import TwinClock
from rfca_rig.drivers.camera import OpenCvCamera
from rfca_rig.drivers.photo_files import PhotoFolder, list_photos, read_picture, read_picture_time
from rfca_rig.errors import BadInput, DeviceError
from tests.codecs.test_exif_time import tiff


def picture(shade: int = 100) -> np.ndarray:
    """Soft enough for JPEG, no two rows and columns alike."""
    ramp = np.add.outer(np.arange(48) * 2, np.arange(64)).astype(np.uint8)
    return np.dstack([ramp, np.full_like(ramp, shade), 200 - ramp])


def with_exif(path, taken: bytes) -> None:
    """Puts Exif into a JPEG that has none."""
    content = path.read_bytes()
    body = b"Exif\0\0" + tiff("<", {0x9003: taken})
    path.write_bytes(
        content[:2] + b"\xff\xe1" + (len(body) + 2).to_bytes(2, "big") + body + content[2:]
    )


@pytest.mark.parametrize("ending", [".jpg", ".png", ".tif", ".JPEG", ".tiff"])
def test_every_format_is_read(tmp_path, ending):
    cv2.imwrite(str(tmp_path / f"a{ending}"), picture())
    seen = read_picture(tmp_path / f"a{ending}")
    assert seen.dtype == np.uint8
    assert np.abs(seen.astype(int) - picture()).max() <= (
        0 if "png" in ending or "tif" in ending else 6
    )


def test_a_grey_picture_of_16_bits_is_read_as_colours_of_8(tmp_path):
    cv2.imwrite(str(tmp_path / "a.tif"), picture()[..., 0].astype(np.uint16) * 257)
    assert np.array_equal(read_picture(tmp_path / "a.tif"), np.dstack([picture()[..., 0]] * 3))


def test_how_the_camera_was_held_turns_no_picture(tmp_path):
    """Exif orientation 6 asks viewers for a quarter turn; a calibrated camera's pixels must stay
    where they are.
    """
    cv2.imwrite(str(tmp_path / "a.jpg"), picture())
    content = (tmp_path / "a.jpg").read_bytes()
    body = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0"
    (tmp_path / "a.jpg").write_bytes(
        content[:2] + b"\xff\xe1" + (len(body) + 2).to_bytes(2, "big") + body + content[2:]
    )
    assert cv2.imread(str(tmp_path / "a.jpg")).shape == (64, 48, 3)
    assert read_picture(tmp_path / "a.jpg").shape == (48, 64, 3)


@pytest.mark.parametrize("ending", [".jpg", ".png", ".tif"])
@pytest.mark.parametrize("kept", [0.0, 0.02, 0.5, 0.97])
def test_a_picture_that_was_cut_short_is_one_line(tmp_path, capfd, ending, kept):
    random = np.random.default_rng(1).integers(0, 255, (60, 80, 3), dtype=np.uint8)
    path = tmp_path / f"a{ending}"
    cv2.imwrite(str(path), random)
    content = path.read_bytes()
    path.write_bytes(content[: int(kept * len(content))])
    with pytest.raises(BadInput) as refusal:
        read_picture(path)
    assert str(refusal.value).startswith(f"{path}: ")
    assert "\n" not in str(refusal.value)
    if kept > 0.0 and ending != ".tif":
        assert "cut short: it ends before its end mark" in str(refusal.value)
    assert capfd.readouterr().err == ""


def test_a_missing_picture_and_a_text_are_named(tmp_path):
    (tmp_path / "a.jpg").write_text("this is no picture")
    with pytest.raises(BadInput, match=r"a\.jpg: neither JPEG, PNG nor TIFF; take it out"):
        read_picture(tmp_path / "a.jpg")
    with pytest.raises(BadInput, match=r"b\.jpg: cannot be read: No such file"):
        read_picture(tmp_path / "b.jpg")


@pytest.fixture
def folder(tmp_path):
    """Three photos whose names, times of change and Exif times each tell another order."""
    for at, (name, taken) in enumerate(
        [("stage-10.jpg", b"30"), ("stage-2.jpg", b"10"), ("Stage-9.jpg", b"20")]
    ):
        cv2.imwrite(str(tmp_path / name), picture(10 * at))
        with_exif(tmp_path / name, b"2024:01:01 00:00:" + taken)
        os.utime(tmp_path / name, (1e9 + at, 1e9 + at))
    (tmp_path / "notes.txt").write_text("")
    (tmp_path / "._stage-1.jpg").write_bytes(b"what a Mac leaves behind")
    return tmp_path


def test_a_folder_hands_out_its_photos_by_name_with_exif_time(folder):
    camera = PhotoFolder(folder)
    photos = [camera.photo() for _ in range(len(camera))]
    assert [photo.name for photo in photos] == ["stage-2.jpg", "Stage-9.jpg", "stage-10.jpg"]
    assert [photo.host_s for photo in photos] == [0.0, 10.0, 20.0]
    assert [round(float(photo.image[..., 1].mean()) / 10) for photo in photos] == [1, 2, 0]
    with pytest.raises(DeviceError, match="no photo after the 3 that it holds"):
        camera.photo()


def test_clocks_of_camera_and_computer_are_not_mixed(folder):
    cv2.imwrite(str(folder / "stage-11.png"), picture())
    os.utime(folder / "stage-11.png", (1e9 + 5, 1e9 + 5))
    camera = PhotoFolder(folder)
    assert [camera.photo().host_s for _ in range(4)] == [1.0, 2.0, 0.0, 5.0]
    assert camera.identity()["camera_time"] == "times of last change"


def test_a_broken_photo_is_passed_over_after_its_line(folder):
    (folder / "stage-2.jpg").write_bytes(b"")
    camera = PhotoFolder(folder)
    with pytest.raises(BadInput, match=r"stage-2\.jpg: empty file"):
        camera.photo()
    assert camera.photo().name == "Stage-9.jpg"


def test_moment_of_a_picture_without_exif_is_its_last_change(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), picture())
    os.utime(tmp_path / "a.png", (1e9, 1e9))
    assert read_picture_time(tmp_path / "a.png").at == datetime.fromtimestamp(1e9, UTC)


def test_a_folder_without_photos_or_none_at_all(tmp_path):
    with pytest.raises(BadInput, match="holds no picture"):
        list_photos(tmp_path)
    with pytest.raises(BadInput, match="No such file or directory; name the folder"):
        list_photos(tmp_path / "nowhere")


class Capture:
    """A camera that numbers its frames, and knows one size only."""

    def __init__(self, size=(64, 48), opened=True, dies_at=10**9) -> None:
        self.size = size
        self.opened = opened
        self.dies_at = dies_at
        self.exposed = 0
        self.asked: dict[int, float] = {}

    def isOpened(self):
        return self.opened

    def set(self, number, value):
        self.asked[number] = value
        return True

    def get(self, number):
        return {cv2.CAP_PROP_FRAME_WIDTH: self.size[0], cv2.CAP_PROP_FRAME_HEIGHT: self.size[1]}[
            number
        ]

    def grab(self):
        self.exposed += 1
        return self.exposed < self.dies_at

    def retrieve(self):
        return True, np.full((self.size[1], self.size[0], 3), self.exposed, np.uint8)

    def release(self):
        self.opened = False


def test_an_opencv_camera_gives_a_fresh_picture_with_focus_held():
    capture = Capture()
    clock = TwinClock()
    camera = OpenCvCamera(0, (64, 48), clock, lambda _: capture)
    before = capture.exposed
    clock.wait_until(3.0)
    photo = camera.photo()
    assert (photo.host_s, photo.name, photo.image.shape) == (3.0, "photo-001", (48, 64, 3))
    assert photo.image[0, 0, 0] - before > 4  # past all that a driver may have kept back
    assert capture.asked[cv2.CAP_PROP_AUTOFOCUS] == 0
    camera.close()
    camera.close()
    assert not capture.opened


@pytest.mark.parametrize(
    ("capture", "line"),
    [
        (Capture(opened=False), "camera 2 does not open; check its cable"),
        (Capture(size=(32, 24)), "camera 2 gives pictures of 32 x 24, not 64 x 48; choose"),
        (Capture(dies_at=3), "camera 2 gives no picture; check its cable and power"),
    ],
)
def test_an_opencv_camera_that_is_not_as_asked(capture, line):
    with pytest.raises(DeviceError, match=line):
        OpenCvCamera(2, (64, 48), TwinClock(), lambda _: capture)


def test_a_camera_that_gives_another_picture_than_it_said():
    capture = Capture()
    camera = OpenCvCamera(0, (64, 48), TwinClock(), lambda _: capture)
    capture.retrieve = lambda: (True, np.zeros((24, 32, 3), np.uint8))
    with pytest.raises(DeviceError, match="gave a broken picture"):
        camera.photo()
