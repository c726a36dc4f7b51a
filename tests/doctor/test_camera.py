"""The camera of a rig file: its calibration, and one photo of the leg as it hangs."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from rfca_rig.clock import WallClock
from rfca_rig.description.rig_file import read_rig
from rfca_rig.doctor.rig_checks import check_camera
from rfca_rig.drivers.roles import Photo
from rfca_rig.errors import DeviceError
from rfca_rig.twins.camera import ImageDisturbance, render_leg
from tests.doctor.said import colours, whole

CALIBRATION = Path(__file__).parents[2] / "calibration"
TEXT = (CALIBRATION / "twin.toml").read_text().replace('kind = "twin"', 'kind = "real"')
HEAD = TEXT.partition("[camera]")[0]
EYE = read_rig(CALIBRATION / "twin.toml").eye()
HANGING = np.full(7, np.pi / 3)


def findings(folder, text=TEXT):
    shutil.copy(CALIBRATION / "twin-camera.toml", folder)
    (folder / "rig.toml").write_text(text)
    return {one.subject: one for one in check_camera(read_rig(folder / "rig.toml"), WallClock())}


@pytest.fixture
def shows(monkeypatch):
    """`shows(image)` has every OpenCV camera show that; an error is raised instead."""

    class Camera:
        image = None

        def __init__(self, *_):
            """Opens at once."""

        def photo(self):
            if isinstance(Camera.image, Exception):
                raise Camera.image
            return Photo(Camera.image, 0.0, "p")

        def close(self):
            """Nothing is held open."""

        def identity(self):
            return {}

    monkeypatch.setattr("rfca_rig.bench.sensors.OpenCvCamera", Camera)
    return lambda image: setattr(Camera, "image", image)


def hanging(**disturbance):
    lengths = np.array(EYE.link_lengths_m)
    return render_leg(
        HANGING,
        lengths,
        EYE.plan,
        EYE.camera,
        ImageDisturbance(**disturbance),
        np.random.default_rng(1),
    )


def test_a_leg_in_the_picture_is_green(tmp_path, shows):
    shows(hanging(noise_counts=1.0))
    found = findings(tmp_path)
    assert colours(found.values()) == {"camera file": "green", "camera": "green"}
    assert whole(found["camera"]).startswith("8 of 8 marks found")


def test_a_hidden_mark_is_yellow_and_named(tmp_path, shows):
    shows(hanging(hidden_mark=4, hidden_share=0.9))
    seen = findings(tmp_path)["camera"]
    assert seen.colour == "yellow"
    assert "7 of 8 marks found: mark at hinge 5: not seen" in whole(seen)


@pytest.mark.parametrize(
    ("image", "said"),
    [
        (DeviceError("camera 0 gives no picture"), "camera 0 gives no picture"),
        (np.zeros((8, 8, 3), np.uint8), "a photo of 8 x 8 pixels"),
    ],
)
def test_a_camera_that_cannot_be_used_is_red(tmp_path, shows, image, said):
    shows(image)
    seen = findings(tmp_path)["camera"]
    assert seen.colour == "red"
    assert said in whole(seen)


def test_a_calibration_that_cannot_be_used_is_red_and_the_camera_is_left_alone(tmp_path):
    found = findings(tmp_path, TEXT.replace("twin-camera.toml", "nowhere.toml"))
    assert colours(found.values()) == {"camera file": "red"}
    assert "nowhere.toml: not there" in whole(found["camera file"])


def test_a_folder_for_photos_is_there_or_red(tmp_path):
    text = (
        f'{HEAD}[camera]\ndevice = "photo-folder"\nfolder = "in"\ncalibration_file = '
        '"twin-camera.toml"\n'
    )
    assert findings(tmp_path, text)["camera"].colour == "red"
    (tmp_path / "in").mkdir()
    assert findings(tmp_path, text)["camera"].colour == "green"


def test_a_rig_without_a_camera_has_nothing_to_be_found(tmp_path):
    assert findings(tmp_path, HEAD) == {}
