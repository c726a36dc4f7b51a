"""Photos of a ChArUco board through the twin's camera, as a lab takes them to calibrate its own.

A ray from every pixel meets the plane of the board, whose sheet is sampled there. Nothing of the
calibration is used.
"""

from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from rfca_rig.twins.image_noise import ImageDisturbance, Light, render_sensor_image
from rfca_rig.vision.board import MARGIN_M, Board, board_picture
from rfca_rig.vision.camera_model import CameraModel

Floats = NDArray[np.float64]

# Resolution of the sheet that is sampled: three times that of the embedded twin's camera.
SHEET_PX_PER_M = 10_000.0
# Standard deviation of the blur before sampling, in pixels of the camera. Without it, edges of the
# board would alias.
ANTIALIASING_PX = 0.5
# Rays are traced for one pixel in a block of so many, and interpolated linearly. Lens distortion
# bends them by less than 0.001 px within a block of the embedded twin's camera.
BLOCK_PX = 8
# Linear light of the sheet's black and white, and of the room around it.
BLACK = 0.02
WHITE = 0.65
ROOM = 0.1
# Board in the middle, then tilted about its horizontal and its vertical axis in degrees. The middle
# of the board moves by these shares of the picture's half width and half height.
TILTS_AND_MIDDLES = (
    (0.0, 0.0, 0.0, 0.0),
    (30.0, 0.0, -0.45, 0.4),
    (-30.0, 5.0, 0.45, -0.4),
    (0.0, 32.0, 0.45, 0.4),
    (5.0, -32.0, -0.45, -0.4),
    (25.0, 25.0, 0.0, 0.45),
    (-25.0, 25.0, 0.0, -0.45),
    (25.0, -25.0, 0.5, 0.0),
    (-22.0, -28.0, -0.5, 0.0),
    (12.0, 8.0, 0.5, 0.45),
    (-12.0, 10.0, -0.5, 0.45),
    (10.0, -12.0, 0.5, -0.45),
    (-10.0, -10.0, -0.5, -0.45),
    (35.0, 0.0, 0.2, 0.1),
    (0.0, 36.0, -0.2, -0.1),
)


@dataclass(frozen=True)
class BoardPose:
    """Where the board is, in the frame of the plane of motion: x towards one side of it, y along
    the ground, z up.

    Parameters
    ----------
    corner_m
        Its upper left corner, (3,).
    right, down
        Unit vectors along its edges, (3,).
    """

    corner_m: Floats
    right: Floats
    down: Floats


def poses_for_calibration(board: Board, camera: CameraModel) -> list[BoardPose]:
    """Poses that fill the picture, tilted all ways, with the middle of the board near the plane of
    motion.
    """
    width_px, height_px = camera.image_size_px
    half_px = 0.5 * np.array([width_px, height_px])
    right, down = _axes_of_picture(camera)
    poses = []
    for about_right_deg, about_down_deg, across, below in TILTS_AND_MIDDLES:
        middle_m = np.concatenate([[0.0], camera.on_plane(half_px * [1.0 + across, 1.0 + below])])
        turn_right, _ = cv2.Rodrigues(np.radians(about_right_deg) * right)
        turn_down, _ = cv2.Rodrigues(np.radians(about_down_deg) * down)
        turn = turn_down @ turn_right
        poses.append(_centre(board, middle_m, turn @ right, turn @ down))
    return poses


def pose_in_plane(camera: CameraModel, corner_m: tuple[float, float]) -> BoardPose:
    """The board in the plane of the marks, its upper left corner at (y, z) from the shaft axis."""
    right, down = _axes_of_picture(camera)
    return BoardPose(np.array([0.0, *corner_m]), right, down)


def _axes_of_picture(camera: CameraModel) -> tuple[Floats, Floats]:
    """Right and down in the picture as directions of the plane: along the ground and to the ground,
    with the sign with which this camera sees them.
    """
    to_right = np.sign(camera.rotation[0, 1])
    return np.array([0.0, to_right, 0.0]), np.array([0.0, 0.0, -1.0])


def _centre(board: Board, middle_m: Floats, right: Floats, down: Floats) -> BoardPose:
    width_m, height_m = board.size_m()
    return BoardPose(middle_m - 0.5 * width_m * right - 0.5 * height_m * down, right, down)


def photograph_board(
    board: Board,
    camera: CameraModel,
    pose: BoardPose,
    disturbance: ImageDisturbance,
    random: np.random.Generator,
) -> NDArray[np.uint8]:
    """The photo, (rows, columns, 3) uint8 in BGR order.

    Parameters
    ----------
    board
        What is printed on the sheet.
    camera
        The camera before the plane of motion.
    pose
        Where the sheet is held.
    disturbance
        Defocus and noise of the camera.
    random
        Source of the noise.
    """
    seen = _camera_before_board(camera, pose)
    across_m, below_m = _trace_rays(seen)
    px_per_m = float(camera.matrix[0, 0]) / float(camera.translation_m[2])
    blur_sheet_px = ANTIALIASING_PX * SHEET_PX_PER_M / px_per_m
    sheet = cv2.GaussianBlur(
        board_picture(board, SHEET_PX_PER_M).astype(np.float32) / 255.0, (0, 0), blur_sheet_px
    )
    grey = cv2.remap(
        BLACK + (WHITE - BLACK) * sheet,
        ((across_m + MARGIN_M) * SHEET_PX_PER_M - 0.5).astype(np.float32),
        ((below_m + MARGIN_M) * SHEET_PX_PER_M - 0.5).astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=ROOM,
    )
    light = cast(Light, cv2.merge([grey, grey, grey]))
    return render_sensor_image(light, disturbance, random)


def _camera_before_board(camera: CameraModel, pose: BoardPose) -> CameraModel:
    """The camera with the board in place of the plane: (y, z) are right and up on the board."""
    right = camera.rotation @ pose.right
    up = camera.rotation @ -pose.down
    return CameraModel(
        camera.matrix,
        camera.distortion,
        camera.image_size_px,
        np.column_stack([np.cross(right, up), right, up]),
        camera.rotation @ pose.corner_m + camera.translation_m,
    )


def _trace_rays(seen: CameraModel) -> tuple[Floats, Floats]:
    """Right and down on the board at every pixel, each (rows, columns) in m."""
    width_px, height_px = seen.image_size_px
    # One block more on either side, because interpolation needs two.
    columns = np.arange(-1, -(-width_px // BLOCK_PX) + 1)
    rows = np.arange(-1, -(-height_px // BLOCK_PX) + 1)
    u_px, v_px = np.meshgrid(
        (columns + 0.5) * BLOCK_PX - 0.5, (rows + 0.5) * BLOCK_PX - 0.5, indexing="xy"
    )
    on_board_m = seen.on_plane(np.stack([u_px, v_px], axis=-1))
    size = (len(columns) * BLOCK_PX, len(rows) * BLOCK_PX)
    inside = (slice(BLOCK_PX, BLOCK_PX + height_px), slice(BLOCK_PX, BLOCK_PX + width_px))
    across_m = cv2.resize(on_board_m[..., 0], size, interpolation=cv2.INTER_LINEAR)[inside]
    up_m = cv2.resize(on_board_m[..., 1], size, interpolation=cv2.INTER_LINEAR)[inside]
    return np.asarray(across_m), np.asarray(-up_m)
