"""Photos of a board through the twin's camera: corners lie where the camera sees them, and a
calibration with them finds that camera.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rfca_rig.bench.board_session import PLANE_CORNER_MM, PLANE_PHOTO, write_board_photos
from rfca_rig.description.rig_file import read_rig
from rfca_rig.drivers.photo_files import read_picture
from rfca_rig.errors import BadInput
from rfca_rig.twins.board_photos import photograph_board, pose_in_plane, poses_for_calibration
from rfca_rig.twins.image_noise import ImageDisturbance
from rfca_rig.vision.board import find_board, parse_board
from rfca_rig.vision.camera_calibration import BoardPlacement, calibrate, find_plane

ROOT = Path(__file__).parents[2]
RIG = read_rig(ROOT / "calibration" / "twin.toml")
CAMERA = RIG.eye().camera
BOARD = parse_board("10x7,25,18")
SHARP = ImageDisturbance(noise_counts=0.0)


def corners_in_plane_m(pose):
    """Corners of the board in the frame of the plane of motion, (n, 3)."""
    corners = BOARD.corners_m()
    return pose.corner_m + corners[:, :1] * pose.right + corners[:, 1:] * pose.down


@pytest.mark.slow
@pytest.mark.parametrize("number", [0, 5, 9])
def test_corners_are_seen_where_the_camera_projects_them(number):
    pose = poses_for_calibration(BOARD, CAMERA)[number]
    photo = photograph_board(BOARD, CAMERA, pose, SHARP, np.random.default_rng(1))
    seen = find_board(photo, BOARD, "board")
    wanted = dict(
        zip(
            map(tuple, np.round(BOARD.corners_m(), 6).tolist()),
            CAMERA.project(corners_in_plane_m(pose)),
            strict=True,
        )
    )
    expected_px = np.array(
        [wanted[tuple(corner)] for corner in np.round(seen.on_board_m, 6).tolist()]
    )
    assert len(seen.px) >= 50
    assert np.abs(seen.px - expected_px).max() < 0.15
    assert np.abs((seen.px - expected_px).mean(axis=0)).max() < 0.03


def test_every_pose_shows_the_whole_board():
    width_px, height_px = CAMERA.image_size_px
    for pose in [*poses_for_calibration(BOARD, CAMERA), pose_in_plane(CAMERA, (0.02, 0.015))]:
        px = CAMERA.project(corners_in_plane_m(pose))
        assert np.all((px > 0.0) & (px < [width_px, height_px]))
        assert np.cross(pose.right, pose.down) @ np.cross(pose.right, pose.down) == (
            pytest.approx(1.0)
        )


@pytest.mark.slow
def test_a_calibration_finds_the_twins_camera_and_its_plane(tmp_path):
    files = write_board_photos(RIG, BOARD, tmp_path / "board")
    found = [find_board(read_picture(file), BOARD, file.name) for file in files]
    made = calibrate(found)
    assert not made.refused
    focal_px = made.matrix[[0, 1], [0, 1]]
    true_focal_px = CAMERA.matrix[[0, 1], [0, 1]]
    assert np.abs((focal_px - true_focal_px) / made.focal_std_px).max() < 4.0
    corner_m = (1e-3 * PLANE_CORNER_MM[0], 1e-3 * PLANE_CORNER_MM[1])
    pose = find_plane(
        found[-1], made.matrix, made.distortion, BoardPlacement(corner_m, "right", 0.0, 0.0)
    )
    assert files[-1].name == PLANE_PHOTO
    # Where it sees points of the plane: within 0.2 px, a twentieth of a degree of a link.
    points_m = np.array([[0.02, 0.01], [0.15, -0.1], [0.28, -0.02]])
    seen = made.camera(pose.rotation, pose.translation_m)
    assert np.abs(seen.project(points_m) - CAMERA.project(points_m)).max() < 0.2


@pytest.mark.slow
def test_the_same_seed_gives_the_same_photos(tmp_path):
    first = write_board_photos(RIG, BOARD, tmp_path / "a", seed=3)
    again = write_board_photos(RIG, BOARD, tmp_path / "b", seed=3)
    other = write_board_photos(RIG, BOARD, tmp_path / "c", seed=4)
    assert first[0].read_bytes() == again[0].read_bytes() != other[0].read_bytes()


def test_a_real_rig_takes_no_photos_of_its_own(tmp_path):
    real = RIG.model_copy(update={"rig": replace_kind(RIG.rig)})
    with pytest.raises(BadInput, match="kind twin"):
        write_board_photos(real, BOARD, tmp_path / "board")
    assert not (tmp_path / "board").exists()


def test_a_camera_on_the_other_side_is_refused(tmp_path, monkeypatch):
    """Half a turn about the vertical: what was on the right is on the left."""
    setup = RIG.eye()
    turned = replace(setup.camera, rotation=setup.camera.rotation @ np.diag([-1.0, -1.0, 1.0]))
    monkeypatch.setattr(type(RIG), "eye", lambda _: replace(setup, camera=turned))
    with pytest.raises(BadInput, match="to the left of the picture"):
        write_board_photos(RIG, BOARD, tmp_path / "board")
    assert not (tmp_path / "board").exists()


def replace_kind(section):
    return section.model_copy(update={"kind": "real"})
