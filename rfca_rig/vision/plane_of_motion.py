"""Pose of the plane of motion relative to the camera, from one photo of the board held in this plane or parallel to it."""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.vision.board import BoardPhoto
from rfca_rig.vision.camera_model import CameraModel

Floats = NDArray[np.float64]
Side = Literal["right", "left"]

# A larger error of the photo is not due to the camera: another zoom, focus or board is.
MAX_OFF_PX = 1.5


@dataclass(frozen=True)
class BoardPlacement:
    """Position of the board in the photo.

    - `corner_m`: (y, z) of its upper left corner relative to the shaft axis, z up.
    - `reach`: side of the picture to which +y points, the side to which the leg reaches.
    - `turned_rad`: angle of the board's upper edge from the horizontal, positive clockwise in the picture.
    - `nearer_m`: how much nearer to the camera than the marks the printed face was.
    """

    corner_m: tuple[float, float] = (0.0, 0.0)
    reach: Side = "right"
    turned_rad: float = 0.0
    nearer_m: float = 0.0


@dataclass(frozen=True, eq=False)
class PlanePose:
    """`rotation` (3, 3) and `translation_m` (3,) from plane to camera frame; `error_px` of the board's corners, root mean square.

    `tilt_std_rad` (2,), about the picture's two directions, and `distance_std_m` are standard deviations of the plane's pose.
    """

    rotation: Floats
    translation_m: Floats
    error_px: float
    tilt_std_rad: Floats
    distance_std_m: float


def find_plane(photo: BoardPhoto, matrix: Floats, distortion: Floats, place: BoardPlacement) -> PlanePose:
    """Pose of the plane with the smallest reprojection error of the board's corners.

    Parameters
    ----------
    photo : BoardPhoto
        Corners of the board in the photo.
    matrix, distortion : (3, 3) and (5,) arrays
        The calibrated camera.
    place : BoardPlace
        How the board was held.

    Returns
    -------
    PlanePose
        Pose of the plane, with standard deviations.

    Raises
    ------
    BadInput
        Where the photo does not fit the camera; it was taken with another zoom, focus or board.
    """
    on_board = np.column_stack([photo.on_board_m, np.zeros(len(photo.px))])
    turn, shift, error_px, std = _board_pose(on_board, photo.px, matrix, distortion)
    if error_px > MAX_OFF_PX:
        raise BadInput(
            f"{photo.name}: the board's corners lie {error_px:.2f} px off, at most {MAX_OFF_PX:g}: take it with the zoom, focus and board "
            "of the other photos"
        )
    axes, origin_m = _plane_on_board(place)
    return PlanePose(turn @ axes, turn @ origin_m + shift, error_px, std[:2], float(std[5]))


def _board_pose(on_board: Floats, px: Floats, matrix: Floats, distortion: Floats) -> tuple[Floats, Floats, float, Floats]:
    """Rotation (3, 3), translation (3,), error, and standard deviations (6,) of the turns about the camera's axes and shifts along them."""
    start = cv2.solvePnP(on_board, px, matrix, distortion, flags=cv2.SOLVEPNP_IPPE)
    rotation, translation = cv2.solvePnPRefineLM(on_board, px, matrix, distortion, start[1], start[2])
    turn, shift = np.asarray(cv2.Rodrigues(rotation)[0], np.float64), np.asarray(translation, np.float64).ravel()
    in_camera = on_board @ turn.T + shift
    middle = in_camera.mean(axis=0)
    # Derivatives are taken at a zero turn about the board's middle: there turns and shifts hardly depend on each other.
    seen, jacobian = cv2.projectPoints(in_camera - middle, np.zeros(3), middle, matrix, distortion)
    error = np.ravel(seen.reshape(-1, 2) - px)
    jacobian = jacobian[:, :6]
    covariance = float(error @ error) / (len(error) - 6) * np.linalg.inv(jacobian.T @ jacobian)
    # Twice the mean over both coordinates is the mean squared distance.
    return turn, shift, float(np.sqrt(2.0 * np.mean(error**2))), np.sqrt(np.diag(covariance))


def _plane_on_board(place: BoardPlacement) -> tuple[Floats, Floats]:
    """The plane's axes x, y, z as columns (3, 3) in the board's frame (right, down, away from the camera), and its origin (3,) there."""
    cosine, sine = np.cos(place.turned_rad), np.sin(place.turned_rad)
    # In the frame of a board that is turned clockwise, the horizontal is turned the other way.
    level = np.array([cosine, -sine, 0.0])
    up = np.array([-sine, -cosine, 0.0])
    along = level if place.reach == "right" else -level
    axes = np.column_stack([np.cross(along, up), along, up])
    behind = np.array([0.0, 0.0, place.nearer_m])
    return axes, behind - axes[:, 1] * place.corner_m[0] - axes[:, 2] * place.corner_m[1]


def with_origin_at(camera: CameraModel, shaft_px: tuple[float, float]) -> CameraModel:
    """The same camera with the plane's origin moved to the point of the plane that is seen at `shaft_px`."""
    y_m, z_m = camera.on_plane(np.array(shaft_px))
    moved_m = camera.rotation @ np.array([0.0, y_m, z_m])
    return CameraModel(camera.matrix, camera.distortion, camera.image_size_px, camera.rotation, camera.translation_m + moved_m)
