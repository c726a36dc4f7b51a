"""The camera model against OpenCV's own projection, against itself the other way round, and
against differences.
"""

import cv2
import numpy as np
import pytest

from rfca_rig.errors import BadInput
from rfca_rig.vision.camera_model import CameraModel
from tests.vision.scenes import camera

POINTS_M = np.random.default_rng(1).uniform([-0.05, -0.24], [0.28, 0.05], (60, 2))


def test_projects_as_opencv_does() -> None:
    model = camera()
    spatial = np.column_stack([np.random.default_rng(2).uniform(-0.05, 0.05, 60), POINTS_M])
    turn, _ = cv2.Rodrigues(model.rotation)
    expected, _ = cv2.projectPoints(
        spatial, turn, model.translation_m, model.matrix, model.distortion
    )
    np.testing.assert_allclose(model.project(spatial), expected.reshape(-1, 2), atol=1e-8)


def test_points_in_the_plane_are_those_with_no_distance_from_it() -> None:
    np.testing.assert_array_equal(
        camera().project(POINTS_M), camera().project(np.column_stack([np.zeros(60), POINTS_M]))
    )


def test_comes_back_to_the_plane() -> None:
    np.testing.assert_allclose(camera().on_plane(camera().project(POINTS_M)), POINTS_M, atol=1e-12)


def test_jacobians_agree_with_differences() -> None:
    model = camera()
    step = 1e-6
    numeric = np.stack(
        [
            (model.project(POINTS_M + way) - model.project(POINTS_M - way)) / (2 * step)
            for way in step * np.eye(2)
        ],
        axis=-1,
    )
    np.testing.assert_allclose(model.project_jacobian(POINTS_M), numeric, rtol=1e-6, atol=1e-3)
    px = model.project(POINTS_M)
    back = np.stack(
        [
            (model.on_plane(px + way) - model.on_plane(px - way)) / (2e-2)
            for way in 1e-2 * np.eye(2)
        ],
        axis=-1,
    )
    np.testing.assert_allclose(model.on_plane_jacobian(px), back, rtol=1e-5, atol=1e-10)


def test_a_circle_seen_askew_is_put_where_its_middle_is() -> None:
    model = camera(tilt_deg=(25.0, -30.0, 3.0))
    centre = np.array([0.2, -0.15])
    turn = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    rim = model.project(centre + 0.02 * np.column_stack([np.cos(turn), np.sin(turn)])).astype(
        np.float32
    )
    middle = np.array(cv2.fitEllipse(rim)[0])
    assert np.linalg.norm(model.on_plane(middle) - centre) > 5e-5
    assert np.linalg.norm(model.discs_on_plane(middle, 0.04) - centre) < 5e-6


def test_refuses_what_is_no_rotation() -> None:
    good = camera()
    mirrored = good.rotation * np.array([-1.0, 1.0, 1.0])
    with pytest.raises(BadInput, match="rotation"):
        CameraModel(good.matrix, good.distortion, good.image_size_px, mirrored, good.translation_m)


def test_refuses_a_pixel_that_the_lens_cannot_show() -> None:
    good = camera()
    bent = CameraModel(
        good.matrix,
        np.array([-0.9, 0, 0, 0, 0]),
        good.image_size_px,
        good.rotation,
        good.translation_m,
    )
    with pytest.raises(BadInput, match="lens"):
        bent.on_plane(np.array([9000.0, 9000.0]))
