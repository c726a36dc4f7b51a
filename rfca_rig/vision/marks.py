"""Red round marks on black, found to a small part of a pixel.

Every mark is measured twice: first alone, then with the shape that the whole marks of the photo share, which is what lets a partly
hidden one keep its middle. Pixel (0, 0) is the middle of the first pixel.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.vision.outline import MarkOutline, Shape, fit_outline, likely_circle
from rfca_rig.vision.red_mask import Patch, Pixels, red_patches, redness, rim_picture, whiteness
from rfca_rig.vision.rim import GLARE, SMOOTHING_PX, Rays, beside_glare, cast, levels, rim_points, spill, turned_away

Floats = NDArray[np.float64]

LEAST_ROUNDNESS = 0.4
WHOLE = 0.9
MOST_SPILL = 0.08  # a disc that touches another red thing may be either of the two
LEAST_CONTRAST_COUNTS = 10.0
SIZE_SPREAD = 0.4
BORDER_PX = 2.0  # of the photo: a rim found so close to it is the photo's
PIXEL_FLOOR_PX = 0.02  # what pixels leave, however sharp the photo, and the blocks of JPEG, in which whole rims err together
COVER_ERROR = 0.012  # of the radius: the rim near a cover's edge is pulled along with it


@dataclass(frozen=True)
class Mark:
    """A red disc: middle px (2,) with std_px (2,) (along x, along y), diameter_px, roundness, contrast.

    Roundness is the share of the rim that is seen and round: 1 for a whole mark, 0.5 for one half hidden.
    Contrast is how much redder than its surroundings the mark is, in counts of the picture.
    """

    px: Floats
    std_px: Floats
    diameter_px: float
    roundness: float
    contrast: float

    @property
    def whole(self) -> bool:
        """Nothing noticeable of the mark is hidden."""
        return self.roundness >= WHOLE


@dataclass(frozen=True)
class _Cutout:
    """What rims are sought in around a patch, its redness and whiteness, smoothed by less than a pixel, and where the first pixel is.

    `inside_px` (2, 2) are the first and last place of the cutout, (x, y), that are well inside of the photo.
    """

    rims: NDArray[np.float32]
    red: NDArray[np.float32]
    white: NDArray[np.float32]
    corner_px: Floats
    inside_px: Floats


def find_marks(image_bgr_uint8: Pixels, expected_diameter_px: float) -> tuple[Mark, ...]:
    """Red round marks of about the expected diameter in a photo (height, width, 3), in picture order.

    Raises BadInput for a picture of another kind, and for marks too small to measure.
    """
    if image_bgr_uint8.ndim != 3 or image_bgr_uint8.shape[2] != 3 or image_bgr_uint8.dtype != np.uint8:
        raise BadInput(f"photo: expected 8 bit colour (height, width, 3), not {image_bgr_uint8.dtype} {image_bgr_uint8.shape}")
    if not expected_diameter_px >= 6.0:
        raise BadInput(f"photo: marks of {expected_diameter_px:.1f} px are too small to measure, at least 6 px; move the camera closer")
    patches = red_patches(image_bgr_uint8, expected_diameter_px)
    cutouts = [_cutout(image_bgr_uint8, patch, expected_diameter_px) for patch in patches]
    alone = [_first_look(cutout, patch, expected_diameter_px / 2) for cutout, patch in zip(cutouts, patches, strict=True)]
    shape = _shared_shape([found for found in alone if found], expected_diameter_px / 2)
    marks = [_mark(cutout, found, shape) for cutout, found in zip(cutouts, alone, strict=True) if found]
    return _each_once([mark for mark in marks if mark])


def _cutout(image: Pixels, patch: Patch, diameter_px: float) -> _Cutout:
    reach = 1.3 * diameter_px + max(patch.sides_px) / 2 + 4
    x, y = patch.middle_px
    left, top = max(0, int(x - reach)), max(0, int(y - reach))
    piece = image[top : int(y + reach) + 2, left : int(x + reach) + 2]
    pictures = (rim_picture(piece), redness(piece), whiteness(piece))
    rims, red, white = (np.asarray(cv2.GaussianBlur(picture, (0, 0), SMOOTHING_PX), np.float32) for picture in pictures)
    corner = np.array([left, top], dtype=np.float64)
    last = np.array(image.shape[1::-1], dtype=np.float64) - 1.0
    return _Cutout(rims, red, white, corner, np.stack([BORDER_PX - corner, last - BORDER_PX - corner]))


def _first_look(cutout: _Cutout, patch: Patch, radius_px: float) -> MarkOutline | None:
    """The patch's outline, whatever its shape; its middle in the cutout."""
    points, _ = _rim(cutout, np.array(patch.middle_px) - cutout.corner_px, radius_px)
    circle = likely_circle(points, radius_px, SIZE_SPREAD, np.random.default_rng(0))
    if circle is None:
        return None
    return _measured(cutout, circle[:2], Shape(float(circle[2])))


def _measured(cutout: _Cutout, middle: Floats, shape: Shape) -> MarkOutline | None:
    points, rays = _rim(cutout, middle, shape.radius_px, square=True)
    return fit_outline(points, middle, shape, len(rays.directions)) if len(points) else None


def _rim(cutout: _Cutout, middle: Floats, radius_px: float, square: bool = False) -> tuple[Floats, Rays]:
    """Rim points (n, 2) seen from a middle, and the rays they were found on; what is beside a glare, at the border or askew is left out."""
    rays = cast(cutout.rims, middle, radius_px)
    white = cast(cutout.white, middle, radius_px)
    level = levels(rays, white, radius_px)
    points = rim_points(rays, level.half)
    spoilt = beside_glare(points, white, radius_px, GLARE * max(LEAST_CONTRAST_COUNTS, level.contrast))
    spoilt |= ((points.px < cutout.inside_px[0]) | (points.px > cutout.inside_px[1])).any(axis=1)
    if square:
        spoilt |= turned_away(points, middle, cutout.rims)
    return points.px[~spoilt], rays


def _shared_shape(found: Sequence[MarkOutline], radius_px: float) -> Shape:
    """The middle value of the whole marks' shapes, believed to a few per cent; the expected one where hardly any mark is whole."""
    whole = [outline for outline in found if outline.seen >= WHOLE]
    if len(whole) < 3:
        return Shape(radius_px)
    bend = np.median([outline.bend for outline in whole], axis=0)
    return Shape(float(np.median([outline.radius_px for outline in whole])), (float(bend[0]), float(bend[1])), 0.04, 0.006)


def _mark(cutout: _Cutout, found: MarkOutline, shape: Shape) -> Mark | None:
    outline = _measured(cutout, found.middle_px, shape)
    if outline is None:
        return None
    rays, red = (cast(picture, outline.middle_px, outline.radius_px) for picture in (cutout.rims, cutout.red))
    level = levels(rays, cast(cutout.white, outline.middle_px, outline.radius_px), outline.radius_px)
    roundness = outline.seen
    if spill(red, outline.radius_px) > MOST_SPILL or roundness < LEAST_ROUNDNESS or level.contrast < LEAST_CONTRAST_COUNTS:
        return None
    own = PIXEL_FLOOR_PX + COVER_ERROR * outline.radius_px * (1.0 - roundness) / 0.5
    std = np.sqrt(np.diag(outline.covariance_px2) + own**2)
    return Mark(outline.middle_px + cutout.corner_px, std, 2 * outline.radius_px, roundness, level.contrast)


def _each_once(marks: Sequence[Mark]) -> tuple[Mark, ...]:
    """Of marks found twice (a glint can cut one in two) the one of which more is seen."""
    kept: list[Mark] = []
    for mark in sorted(marks, key=lambda mark: -mark.roundness):
        if all(np.linalg.norm(mark.px - other.px) > 0.5 * other.diameter_px for other in kept):
            kept.append(mark)
    return tuple(sorted(kept, key=lambda mark: (mark.px[1], mark.px[0])))
