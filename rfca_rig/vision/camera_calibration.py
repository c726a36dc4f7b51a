"""Calibrates the camera's matrix and distortion from photos of a ChArUco board (Zhang 2000;
OpenCV's model of five coefficients).

The pose of the plane of motion relative to the camera comes from one photo of the board held in
this plane or parallel to it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.vision.board import BoardPhoto, RefusedPhoto
from rfca_rig.vision.camera_model import CameraModel

Floats = NDArray[np.float64]

MIN_PHOTOS = 6
# Standard deviation of the tangent of the tilt, in the direction in which it varies most; 0.17 is
# 10 degrees.
MIN_TILT_SPREAD = 0.17
# A photo whose error exceeds the median by this factor is rejected.
OUTLIER_FACTOR = 4.0
# No photo is rejected for a smaller error.
GOOD_ERROR_PX = 0.25
# Index of k3 in the distortion.
K3 = 4
Side = Literal["right", "left"]

# A larger error of the photo is not due to the camera: another zoom, focus or board is.
MAX_OFF_PX = 1.5


@dataclass(frozen=True, eq=False)
class CameraCalibration:
    """`matrix` (3, 3), `distortion` (5,) = k1 k2 p1 p2 k3; `focal_std_px` and `centre_std_px` (2,)
    are standard deviations.

    `error_px` is the root mean square reprojection error of a corner over all `photos`; `errors_px`
    (n,) is that of each photo.
    """

    size_px: tuple[int, int]
    matrix: Floats
    distortion: Floats
    focal_std_px: Floats
    centre_std_px: Floats
    error_px: float
    photos: tuple[BoardPhoto, ...]
    errors_px: Floats
    refused: tuple[RefusedPhoto, ...]

    def covered_px(self) -> Floats:
        """Left, top, right, bottom (4,) px of the part of the picture in which corners were
        seen; the lens is extrapolated beyond.
        """
        px = np.vstack([photo.px for photo in self.photos])
        return np.concatenate([px.min(axis=0), px.max(axis=0)])

    def camera(self, rotation: Floats, translation_m: Floats) -> CameraModel:
        """The camera model with the pose of the plane of motion: rotation (3, 3) and translation
        (3,).
        """
        return CameraModel(self.matrix, self.distortion, self.size_px, rotation, translation_m)


def calibrate(found: Sequence[BoardPhoto | RefusedPhoto]) -> CameraCalibration:
    """Calibrate the camera that took the photos; rejected ones are in `refused`.

    Raises BadInput where too few photos remain, or where all show the board from about the same
    side, so that focal length and distance cannot be separated.
    """
    refused = [photo for photo in found if isinstance(photo, RefusedPhoto)]
    photos, other_size = _split_by_size([photo for photo in found if isinstance(photo, BoardPhoto)])
    refused += other_size
    _check_enough(photos, refused)
    _check_tilts(photos)
    fit = _fit(photos)
    # One round of rejection: photos that fit none of the others, such as those of a bent board,
    # would bias all parameters.
    limit_px = max(OUTLIER_FACTOR * float(np.median(fit.errors_px)), GOOD_ERROR_PX)
    why = (
        "its corners lie {:.2f} px off, those of the others {:.2f} px: the board was bent, "
        "moved or another one"
    )
    outliers = [
        RefusedPhoto(photo.name, why.format(error_px, float(np.median(fit.errors_px))))
        for photo, error_px in zip(photos, fit.errors_px, strict=True)
        if error_px > limit_px
    ]
    if not outliers:
        return _calibration(photos, fit, refused)
    refused += outliers
    left_out = {outlier.name for outlier in outliers}
    photos = [photo for photo in photos if photo.name not in left_out]
    _check_enough(photos, refused)
    _check_tilts(photos)
    return _calibration(photos, _fit(photos), refused)


def _split_by_size(photos: list[BoardPhoto]) -> tuple[list[BoardPhoto], list[RefusedPhoto]]:
    """The photos of the most frequent size, and the others as refused ones."""
    sizes = [photo.size_px for photo in photos]
    usual = max(sizes, key=sizes.count, default=(0, 0))
    why = (
        "is {0[0]} x {0[1]} pixels, the others {1[0]} x {1[1]}: take all with one setting of "
        "the camera, held one way"
    )
    others = [
        RefusedPhoto(photo.name, why.format(photo.size_px, usual))
        for photo in photos
        if photo.size_px != usual
    ]
    return [photo for photo in photos if photo.size_px == usual], others


def _check_enough(photos: Sequence[BoardPhoto], refused: Sequence[RefusedPhoto]) -> None:
    if len(photos) < MIN_PHOTOS:
        if refused:
            first = f"; {refused[0].name} {refused[0].why}"
        else:
            first = ""
        raise BadInput(
            f"{len(photos)} usable photos of the board, {MIN_PHOTOS} are needed, 15 are "
            f"good; {len(refused)} refused{first}"
        )


def _check_tilts(photos: Sequence[BoardPhoto]) -> None:
    tilts = np.array([_tilt(photo) for photo in photos])
    # The largest principal standard deviation: one direction of tilt is enough.
    spread = float(np.sqrt(np.linalg.eigvalsh(np.cov(tilts.T))[-1]))
    if spread < MIN_TILT_SPREAD:
        raise BadInput(
            f"all {len(photos)} photos show the board from about the same side, within "
            f"{np.degrees(np.arctan(spread)):.1f} degrees: "
            "focal length and distance cannot be distinguished; tilt it 20 to 40 degrees "
            "left, right, up and down"
        )


def _tilt(photo: BoardPhoto) -> Floats:
    """Tangent of the board's tilt along the picture's two directions (2,), before the camera is
    known.

    The board's vanishing line lies f / tan(tilt) from the picture's centre; the focal length f is
    taken as the picture's longer side, which for usual lenses is right to a factor of two.
    """
    longer = float(max(photo.size_px))
    to_picture = cv2.findHomography(
        photo.on_board_m, (photo.px - 0.5 * np.array(photo.size_px)) / longer
    )[0]
    line = np.linalg.inv(to_picture)[2]
    return np.asarray(line[:2] / line[2], np.float64)


@dataclass(frozen=True, eq=False)
class _Fit:
    matrix: Floats
    distortion: Floats
    std: Floats
    error_px: float
    errors_px: Floats


def _fit(photos: Sequence[BoardPhoto]) -> _Fit:
    """Fit with k3 only where it differs from zero by three standard deviations; else it distorts
    areas in which no corner was seen.
    """
    # The standard deviations begin with fx, fy, cx, cy.
    whole = _solve(photos, 0)
    if abs(whole.distortion[K3]) > 3.0 * whole.std[4 + K3]:
        return whole
    return _solve(photos, cv2.CALIB_FIX_K3)


def _solve(photos: Sequence[BoardPhoto], flags: int) -> _Fit:
    on_board = [
        np.column_stack([photo.on_board_m, np.zeros(len(photo.px))]).astype(np.float32)
        for photo in photos
    ]
    px = [photo.px.astype(np.float32) for photo in photos]
    try:
        solved = cv2.calibrateCameraExtended(
            on_board, px, photos[0].size_px, np.empty(0), np.empty(0), flags=flags
        )
    except cv2.error as error:
        raise BadInput(
            f"no camera fits the {len(photos)} photos ({error.err}); take new ones with "
            "the board at more tilts"
        ) from None
    error_px = float(solved[0])
    matrix = _numbers(solved[1])
    std = _numbers(solved[5])
    errors_px = _numbers(solved[7])
    if not np.isfinite(error_px) or not np.all(np.isfinite(matrix)):
        raise BadInput(
            f"no camera fits the {len(photos)} photos; take new ones with the board at more tilts"
        )
    return _Fit(matrix.reshape(3, 3), _numbers(solved[2])[:5], std, error_px, errors_px)


def _numbers(given: Any) -> Floats:
    return np.asarray(given, np.float64).ravel()


def _calibration(
    photos: Sequence[BoardPhoto], fit: _Fit, refused: Sequence[RefusedPhoto]
) -> CameraCalibration:
    return CameraCalibration(
        size_px=photos[0].size_px,
        matrix=fit.matrix,
        distortion=fit.distortion,
        focal_std_px=fit.std[:2],
        centre_std_px=fit.std[2:4],
        error_px=fit.error_px,
        photos=tuple(photos),
        errors_px=fit.errors_px,
        refused=tuple(refused),
    )


@dataclass(frozen=True)
class BoardPlacement:
    """Position of the board in the photo.

    - `corner_m`: (y, z) of its upper left corner relative to the shaft axis, z up.
    - `reach`: side of the picture to which +y points, the side to which the leg reaches.
    - `turned_rad`: angle of the board's upper edge from the horizontal, positive clockwise in the
      picture.
    - `nearer_m`: how much nearer to the camera than the marks the printed face was.
    """

    corner_m: tuple[float, float] = (0.0, 0.0)
    reach: Side = "right"
    turned_rad: float = 0.0
    nearer_m: float = 0.0


@dataclass(frozen=True, eq=False)
class PlanePose:
    """`rotation` (3, 3) and `translation_m` (3,) from plane to camera frame; `error_px` of the
    board's corners, root mean square.

    `tilt_std_rad` (2,), about the picture's two directions, and `distance_std_m` are standard
    deviations of the plane's pose.
    """

    rotation: Floats
    translation_m: Floats
    error_px: float
    tilt_std_rad: Floats
    distance_std_m: float


def find_plane(
    photo: BoardPhoto, matrix: Floats, distortion: Floats, place: BoardPlacement
) -> PlanePose:
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
            f"{photo.name}: the board's corners lie {error_px:.2f} px off, at most "
            f"{MAX_OFF_PX:g}: take it with the zoom, focus and board "
            "of the other photos"
        )
    axes, origin_m = _plane_on_board(place)
    return PlanePose(turn @ axes, turn @ origin_m + shift, error_px, std[:2], float(std[5]))


def _board_pose(
    on_board: Floats, px: Floats, matrix: Floats, distortion: Floats
) -> tuple[Floats, Floats, float, Floats]:
    """Rotation (3, 3), translation (3,), error, and standard deviations (6,) of the turns about
    the camera's axes and shifts along them.
    """
    start = cv2.solvePnP(on_board, px, matrix, distortion, flags=cv2.SOLVEPNP_IPPE)
    rotation, translation = cv2.solvePnPRefineLM(
        on_board, px, matrix, distortion, start[1], start[2]
    )
    turn = np.asarray(cv2.Rodrigues(rotation)[0], np.float64)
    shift = np.asarray(translation, np.float64).ravel()
    in_camera = on_board @ turn.T + shift
    middle = in_camera.mean(axis=0)
    # Derivatives are taken at a zero turn about the board's middle: there turns and shifts hardly
    # depend on each other.
    seen, jacobian = cv2.projectPoints(in_camera - middle, np.zeros(3), middle, matrix, distortion)
    error = np.ravel(seen.reshape(-1, 2) - px)
    jacobian = jacobian[:, :6]
    covariance = float(error @ error) / (len(error) - 6) * np.linalg.inv(jacobian.T @ jacobian)
    # Twice the mean over both coordinates is the mean squared distance.
    return turn, shift, float(np.sqrt(2.0 * np.mean(error**2))), np.sqrt(np.diag(covariance))


def _plane_on_board(placement: BoardPlacement) -> tuple[Floats, Floats]:
    """The plane's axes x, y, z as columns (3, 3) in the board's frame (right, down, away from
    the camera), and its origin (3,) there.
    """
    cosine = np.cos(placement.turned_rad)
    sine = np.sin(placement.turned_rad)
    # In the frame of a board that is turned clockwise, the horizontal is turned the other way.
    level = np.array([cosine, -sine, 0.0])
    up = np.array([-sine, -cosine, 0.0])
    along = level if placement.reach == "right" else -level
    axes = np.column_stack([np.cross(along, up), along, up])
    behind = np.array([0.0, 0.0, placement.nearer_m])
    return axes, behind - axes[:, 1] * placement.corner_m[0] - axes[:, 2] * placement.corner_m[1]


def with_origin_at(camera: CameraModel, shaft_px: tuple[float, float]) -> CameraModel:
    """The same camera with the plane's origin moved to the point of the plane that is seen at
    `shaft_px`.
    """
    y_m, z_m = camera.on_plane(np.array(shaft_px))
    moved_m = camera.rotation @ np.array([0.0, y_m, z_m])
    return CameraModel(
        camera.matrix,
        camera.distortion,
        camera.image_size_px,
        camera.rotation,
        camera.translation_m + moved_m,
    )
