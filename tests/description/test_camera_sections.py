"""[camera] in a rig file: what it names, what it refuses, and where its files are looked for."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from rfca_rig.description.camera_file import PhotoFolderSection
from rfca_rig.description.rig_file import read_rig
from rfca_rig.errors import BadInput
from rfca_rig.vision.leg_marks import PlannedMark

CALIBRATION = Path(__file__).parents[2] / "calibration"
TWIN = (CALIBRATION / "twin.toml").read_text()
BEFORE = TWIN.partition("[camera]\n")[0]
CAMERA = TWIN.partition("[camera]\n")[2]


def rig(folder, camera=CAMERA, calibration=True):
    if calibration:
        shutil.copy(CALIBRATION / "twin-camera.toml", folder)
    (folder / "rig.toml").write_text(f"{BEFORE}[camera]\n{camera}" if camera else BEFORE)
    return read_rig(folder / "rig.toml")


def test_the_shipped_twin_has_a_camera_before_the_leg():
    shipped = read_rig(CALIBRATION / "twin.toml")
    eye = shipped.eye()
    assert eye.link_lengths_m == tuple(length / 1e3 for length in shipped.leg.link_lengths_mm)
    assert len(eye.plan.marks) == 8
    width, height = eye.camera.image_size_px
    corners = eye.camera.on_plane(np.array([[0.0, 0.0], [width, height]]))
    assert corners[0] == pytest.approx(
        [-0.22, 0.05], abs=0.03
    )  # z up: the picture's upper edge is above the shaft
    assert corners[1] == pytest.approx([0.29, -0.27], abs=0.03)
    assert -(eye.camera.rotation.T @ eye.camera.translation_m)[0] == pytest.approx(
        1.1, abs=0.05
    )  # on the side x points to


def test_a_rig_without_a_camera_has_no_eye_and_asks_for_no_photos(tmp_path):
    blind = rig(tmp_path, camera="")
    assert blind.camera is None
    assert blind.eye() is None
    assert blind.facts().photo_limit_s == 0.0
    assert rig(tmp_path).facts().photo_limit_s == 5.0


def test_files_count_from_the_rig_file_s_folder(tmp_path):
    camera = (
        'device = "photo-folder"\nfolder = "incoming"\ncalibration_file = '
        '"twin-camera.toml"\nphoto_limit_s = 30.0\n'
    )
    section = rig(tmp_path, camera).camera
    assert isinstance(section, PhotoFolderSection)
    assert (section.folder, section.calibration_file) == (
        str(tmp_path / "incoming"),
        str(tmp_path / "twin-camera.toml"),
    )


def test_marks_may_be_elsewhere(tmp_path):
    marks = (
        "[camera.marks]\ndiameter_mm = 6.0\nplaces = [{ link = 1, along_mm = 10.0 }, { link "
        "= 7, along_mm = 5.0, across_mm = -2.0 }]\n"
    )
    plan = rig(tmp_path, CAMERA + marks).eye().plan
    assert plan.diameter_m == 0.006
    assert plan.marks == (PlannedMark(1, 0.010), PlannedMark(7, 0.005, -0.002))


@pytest.mark.parametrize(
    ("camera", "said"),
    [
        (
            'device = "webcam"\ncalibration_file = "c.toml"\n',
            r"rig.toml:\d+: camera: 'device' should be one of 'opencv', 'photo-folder'",
        ),
        ('device = "opencv"\n', r"rig.toml:\d+: camera.calibration_file: missing"),
        (
            CAMERA + "[camera.marks]\nplaces = [{ link = 8, along_mm = 0.0 }]\n",
            r"camera.marks.places: names a link beyond the leg's 7",
        ),
        (
            CAMERA + "photo_limit_s = 0.0\n",
            r"rig.toml:\d+: camera.photo_limit_s: should be greater than 0",
        ),
    ],
)
def test_what_cannot_be_used_is_one_line(tmp_path, camera, said):
    with pytest.raises(BadInput, match=said):
        rig(tmp_path, camera)


def test_marks_out_of_order_are_one_line(tmp_path):
    camera = (
        CAMERA
        + "[camera.marks]\nplaces = [{ link = 3, along_mm = 0.0 }, { link = 2, along_mm = 0.0 }]\n"
    )
    with pytest.raises(BadInput, match="list the marks in their order from the shaft outwards"):
        rig(tmp_path, camera).eye()


def test_a_calibration_that_is_missing_or_knows_no_plane_is_one_line(tmp_path):
    with pytest.raises(
        BadInput, match=r"twin-camera.toml: not there; \[camera\] of the rig file names it"
    ):
        rig(tmp_path, calibration=False).eye()
    described = rig(tmp_path)
    path = tmp_path / "twin-camera.toml"
    path.write_text(path.read_text().partition("[plane]")[0])
    with pytest.raises(BadInput, match=r"twin-camera.toml: the camera file has no \[plane\]"):
        described.eye()


def test_a_calibration_with_z_downwards_is_refused(tmp_path):
    described = rig(tmp_path)
    path = tmp_path / "twin-camera.toml"
    path.write_text(path.read_text().replace("z up", "z down"))
    with pytest.raises(
        BadInput, match=r"twin-camera.toml:\d+: plane.axes: should be 'y along the ground, z up'"
    ):
        described.eye()
