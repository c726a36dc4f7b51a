"""A camera's file: what was written is read back, and what is wrong in it is named."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rfca_rig.description.camera_file import (
    camera_file,
    plane_section,
    read_camera_file,
    write_camera_file,
)
from rfca_rig.errors import BadInput
from rfca_rig.vision.board import BoardPhoto, RefusedPhoto
from rfca_rig.vision.camera_calibration import CameraCalibration, PlanePose

TURN = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])


def calibration(focal_px=2345.6789, name="a.jpg") -> CameraCalibration:
    return CameraCalibration(
        size_px=(4000, 3000),
        matrix=np.array([[focal_px, 0.0, 2001.25], [0.0, focal_px + 1.0, 1499.5], [0.0, 0.0, 1.0]]),
        distortion=np.array([-0.12, 0.08, 6e-4, -4e-5, 0.0]),
        focal_std_px=np.array([0.5, 0.6]),
        centre_std_px=np.array([0.7, 0.8]),
        error_px=0.123,
        photos=(BoardPhoto(name, (4000, 3000), np.zeros((54, 2)), np.zeros((54, 2)), 2.5),),
        errors_px=np.array([0.12]),
        refused=(RefusedPhoto("b.jpg", 'is "blurred"\nby a line'),),
    )


def written(tmp_path, made=None, plane=True):
    path = tmp_path / "camera.toml"
    pose = PlanePose(TURN, np.array([0.01, -0.02, 0.85]), 0.2, np.array([1e-4, 2e-4]), 3e-4)
    if plane:
        section = plane_section(pose, "p.jpg", "board at 20, -15 mm")
    else:
        section = None
    write_camera_file(
        path, camera_file(made or calibration(), "10x7,25,18,4x4", section), ["a camera"]
    )
    return path


def test_the_model_is_read_back(tmp_path):
    camera = read_camera_file(written(tmp_path)).model()
    assert camera.image_size_px == (4000, 3000)
    assert camera.matrix == pytest.approx(calibration().matrix, abs=1e-6)
    assert camera.distortion == pytest.approx(calibration().distortion, rel=1e-6)
    assert camera.rotation == pytest.approx(TURN, abs=1e-9)
    assert camera.translation_m == pytest.approx([0.01, -0.02, 0.85], abs=1e-9)


def test_photos_and_what_was_refused_are_read_back(tmp_path):
    file = read_camera_file(written(tmp_path))
    assert (file.photos[0].name, file.photos[0].corners, file.photos[0].edge_px) == (
        "a.jpg",
        54,
        2.5,
    )
    assert (file.refused[0].name, file.refused[0].why) == ("b.jpg", 'is "blurred"\nby a line')
    assert file.plane.tilt_std_deg == pytest.approx(np.degrees([1e-4, 2e-4]), rel=1e-5)


@settings(max_examples=30)
@given(st.text(min_size=1, max_size=20), st.floats(10.0, 1e5))
def test_any_name_and_any_focal_length_survive(tmp_path_factory, name, focal_px):
    file = read_camera_file(written(tmp_path_factory.mktemp("c"), calibration(focal_px, name)))
    assert file.photos[0].name == name
    assert file.camera.focal_px[0] == pytest.approx(focal_px, rel=1e-6)


@given(st.tuples(*[st.floats(-3.0, 3.0)] * 3))
def test_any_turn_survives_its_digits(tmp_path_factory, vector):
    import cv2

    turn = cv2.Rodrigues(np.array(vector))[0]
    pose = PlanePose(turn, np.array([0.0, 0.0, 1.0]), 0.2, np.zeros(2), 0.0)
    path = tmp_path_factory.mktemp("c") / "c.toml"
    write_camera_file(path, camera_file(calibration(), "b", plane_section(pose, "p", "o")), [])
    assert read_camera_file(path).model().rotation == pytest.approx(turn, abs=2e-7)


@pytest.mark.parametrize(
    ("find", "put", "line"),
    [
        (r"focal_px = .*", "", r"camera.toml:3: camera.focal_px: missing"),
        (
            r"focal_px = \[2345",
            "focal_px = [-2345",
            r"camera.toml:5: camera.focal_px\[1\]: should be greater than 0",
        ),
        (
            r"rotation = \[\[0.0",
            "rotation = [[0.5",
            r"camera.toml:\d+: plane.rotation: should be three rows of a rotation",
        ),
        (
            r"distortion = ",
            "distorsion = ",
            r"camera.toml:\d+: camera.distorsion: unknown key; did you mean distortion\?",
        ),
        (
            r"image_size_px = \[4000",
            "image_size_px = [0",
            r"camera.toml:\d+: camera.image_size_px\[1\]: should be greater than or equal to 16",
        ),
    ],
)
def test_what_is_wrong_is_named_with_its_line(tmp_path, find, put, line):
    path = written(tmp_path)
    path.write_text(re.sub(find, put, path.read_text(), count=1))
    with pytest.raises(BadInput, match=line):
        read_camera_file(path)
