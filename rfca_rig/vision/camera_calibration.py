"""The camera's matrix and distortion from photos of a ChArUco board (Zhang 2000; OpenCV's model of five coefficients)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.vision.board_photo import BoardPhoto, RefusedPhoto
from rfca_rig.vision.camera_model import CameraModel

Floats = NDArray[np.float64]

FEWEST_PHOTOS = 6
LEAST_TILT_SPREAD = 0.17  # standard deviation of the tangent of the tilt, across the widest direction; 0.17 is 10 degrees
ODD_PHOTO = 4.0  # times the median error of all photos
GOOD_ERROR_PX = 0.25  # no photo is left out for an error below that
K3 = 4


@dataclass(frozen=True, eq=False)
class CameraCalibration:
    """`matrix` (3, 3), `distortion` (5,) = k1 k2 p1 p2 k3; `focal_std_px` and `centre_std_px` (2,) one standard deviation each.

    `error_px` is the root mean square distance of a corner from where the model puts it, over all `photos`; `errors_px` (n,) of each.
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
        """Left, top, right, bottom (4,) of the part of the picture in which corners were seen; beyond it the lens is only supposed."""
        px = np.vstack([photo.px for photo in self.photos])
        return np.concatenate([px.min(axis=0), px.max(axis=0)])

    def camera(self, rotation: Floats, translation_m: Floats) -> CameraModel:
        """The camera with the plane of motion where it was found."""
        return CameraModel(self.matrix, self.distortion, self.size_px, rotation, translation_m)


def calibrate(found: Sequence[BoardPhoto | RefusedPhoto]) -> CameraCalibration:
    """The camera that took the photos; those it cannot use are in `refused`.

    Raises BadInput where too few are left, or all of them show the board from one side, so that focal length and distance
    cannot be told apart.
    """
    refused = [photo for photo in found if isinstance(photo, RefusedPhoto)]
    photos, other_size = _of_one_size([photo for photo in found if isinstance(photo, BoardPhoto)])
    refused += other_size
    _check_enough(photos, refused)
    _check_tilts(photos)
    fit = _fitted(photos)
    odd = _odd(photos, fit.errors_px)
    if not odd:
        return _calibration(photos, fit, refused)
    refused += odd
    photos = [photo for photo in photos if photo.name not in {left_out.name for left_out in odd}]
    _check_enough(photos, refused)
    _check_tilts(photos)
    return _calibration(photos, _fitted(photos), refused)


def _of_one_size(photos: list[BoardPhoto]) -> tuple[list[BoardPhoto], list[RefusedPhoto]]:
    """Those of the size that most have, and the others."""
    sizes = [photo.size_px for photo in photos]
    usual = max(sizes, key=sizes.count, default=(0, 0))
    why = "is {0[0]} x {0[1]} pixels, the others {1[0]} x {1[1]}: take all with one setting of the camera, held one way"
    others = [RefusedPhoto(photo.name, why.format(photo.size_px, usual)) for photo in photos if photo.size_px != usual]
    return [photo for photo in photos if photo.size_px == usual], others


def _check_enough(photos: Sequence[BoardPhoto], refused: Sequence[RefusedPhoto]) -> None:
    if len(photos) < FEWEST_PHOTOS:
        first = f"; {refused[0].name} {refused[0].why}" if refused else ""
        raise BadInput(f"{len(photos)} usable photos of the board, {FEWEST_PHOTOS} are needed, 15 are good; {len(refused)} refused{first}")


def _check_tilts(photos: Sequence[BoardPhoto]) -> None:
    tilts = np.array([_tilt(photo) for photo in photos])
    spread = float(np.sqrt(np.linalg.eigvalsh(np.cov(tilts.T))[-1]))
    if spread < LEAST_TILT_SPREAD:
        raise BadInput(
            f"all {len(photos)} photos show the board from about the same side, within {np.degrees(np.arctan(spread)):.1f} degrees: "
            "focal length and distance cannot be told apart; tilt it 20 to 40 degrees left, right, up and down"
        )


def _tilt(photo: BoardPhoto) -> Floats:
    """Tangent of the board's tilt along the picture's two directions (2,), before the camera is known.

    The board's vanishing line lies f / tan(tilt) from the picture's centre; the focal length f is taken as the picture's longer
    side, which for usual lenses is right to a factor of two.
    """
    longer = float(max(photo.size_px))
    to_picture = cv2.findHomography(photo.on_board_m, (photo.px - 0.5 * np.array(photo.size_px)) / longer)[0]
    line = np.linalg.inv(to_picture)[2]
    return np.asarray(line[:2] / line[2], np.float64)


@dataclass(frozen=True, eq=False)
class _Fit:
    matrix: Floats
    distortion: Floats
    std: Floats
    error_px: float
    errors_px: Floats


def _fitted(photos: Sequence[BoardPhoto]) -> _Fit:
    """The sixth-order term k3 stays only where the photos tell it from zero: else it bends the picture where no corner was seen."""
    whole = _solved(photos, 0)
    if abs(whole.distortion[K3]) > 3.0 * whole.std[4 + K3]:
        return whole
    return _solved(photos, cv2.CALIB_FIX_K3)


def _solved(photos: Sequence[BoardPhoto], flags: int) -> _Fit:
    on_board = [np.column_stack([photo.on_board_m, np.zeros(len(photo.px))]).astype(np.float32) for photo in photos]
    px = [photo.px.astype(np.float32) for photo in photos]
    try:
        solved = cv2.calibrateCameraExtended(on_board, px, photos[0].size_px, np.empty(0), np.empty(0), flags=flags)
    except cv2.error as error:
        raise BadInput(f"no camera fits the {len(photos)} photos ({error.err}); take new ones with the board at more tilts") from None
    error_px, matrix, std, errors_px = float(solved[0]), _numbers(solved[1]), _numbers(solved[5]), _numbers(solved[7])
    if not np.isfinite(error_px) or not np.all(np.isfinite(matrix)):
        raise BadInput(f"no camera fits the {len(photos)} photos; take new ones with the board at more tilts")
    return _Fit(matrix.reshape(3, 3), _numbers(solved[2])[:5], std, error_px, errors_px)


def _numbers(given: Any) -> Floats:
    return np.asarray(given, np.float64).ravel()


def _odd(photos: Sequence[BoardPhoto], errors_px: Floats) -> list[RefusedPhoto]:
    limit_px = max(ODD_PHOTO * float(np.median(errors_px)), GOOD_ERROR_PX)
    why = "its corners lie {:.2f} px off, those of the others {:.2f} px: the board was bent, moved or another one"
    return [
        RefusedPhoto(photo.name, why.format(error_px, float(np.median(errors_px))))
        for photo, error_px in zip(photos, errors_px, strict=True)
        if error_px > limit_px
    ]


def _calibration(photos: Sequence[BoardPhoto], fit: _Fit, refused: Sequence[RefusedPhoto]) -> CameraCalibration:
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
