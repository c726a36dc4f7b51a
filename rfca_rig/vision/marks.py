"""Detects red round marks on black, with an accuracy of a small part of a pixel.

Every mark is measured twice: first alone, then with the shape that the whole marks of the photo share. The shared shape gives partly
hidden marks a correct centre. Pixel (0, 0) is the centre of the first pixel.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.vision.outline import MarkOutline, Shape, fit_outline, likely_circle
from rfca_rig.vision.red_mask import Patch, Pixels, red_patches, redness, rim_picture, whiteness
from rfca_rig.vision.rim import (
    GLARE,
    SMOOTHING_PX,
    Rays,
    cast_rays,
    color_bleed_share,
    is_beside_glare,
    is_oblique,
    measure_levels,
    rim_points,
)

Floats = NDArray[np.float64]

MIN_ROUNDNESS = 0.4
WHOLE = 0.9
# Largest share of rays that stay red beyond the rim: a disc that touches another red thing may be either of the two.
MAX_SPILL = 0.08
MIN_CONTRAST_COUNTS = 10.0
# Range of a mark's radius around the expected one, as a share.
SIZE_SPREAD = 0.4
# A rim this close to the border of the photo is that of the photo.
BORDER_PX = 2.0
# Error that remains however sharp the photo is: pixels, and the blocks of JPEG, in which whole rims err together.
PIXEL_FLOOR_PX = 0.02
# Error of the centre of a half hidden mark, in radii: the rim near a cover's edge is shifted along with it.
COVER_ERROR = 0.012


@dataclass(frozen=True)
class Mark:
    """A red disc: centre `px` (2,) with standard deviations `std_px` (2,) along x and y, diameter, roundness, contrast.

    Roundness is the share of the rim that is seen and round: 1 for a whole mark, 0.5 for one half hidden.
    Contrast is the difference in redness between the mark and its surroundings, in counts of the picture.
    """

    px: Floats
    std_px: Floats
    diameter_px: float
    roundness: float
    contrast: float

    @property
    def whole(self) -> bool:
        """Whether practically nothing of the mark is hidden."""
        return self.roundness >= WHOLE


@dataclass(frozen=True)
class _Cutout:
    """Smoothed pictures (h, w) around a patch: the one in which rims are searched, redness and whiteness.

    `corner_px` (2,) is the position of the first pixel in the photo. `inside_px` (2, 2) are the first and last position (x, y) of the
    cutout that are well inside the photo.
    """

    rims: NDArray[np.float32]
    red: NDArray[np.float32]
    white: NDArray[np.float32]
    corner_px: Floats
    inside_px: Floats


def find_marks(image_bgr_uint8: Pixels, expected_diameter_px: float) -> tuple[Mark, ...]:
    """Find red round marks of about the expected diameter.

    Parameters
    ----------
    image_bgr_uint8 : (height, width, 3) uint8 array
        The photo, in OpenCV's order of channels.
    expected_diameter_px : float
        Usual diameter of a mark in the photo, at least 6 px.

    Returns
    -------
    tuple of Mark
        From top to bottom, then from left to right.

    Raises
    ------
    BadInput
        For a picture of another kind, and for marks that are too small to measure.
    """
    if image_bgr_uint8.ndim != 3 or image_bgr_uint8.shape[2] != 3 or image_bgr_uint8.dtype != np.uint8:
        raise BadInput(f"photo: expected 8 bit colour (height, width, 3), not {image_bgr_uint8.dtype} {image_bgr_uint8.shape}")
    if not expected_diameter_px >= 6.0:
        raise BadInput(f"photo: marks of {expected_diameter_px:.1f} px are too small to measure, at least 6 px; move the camera closer")
    patches = red_patches(image_bgr_uint8, expected_diameter_px)
    cutouts = [_cutout(image_bgr_uint8, patch, expected_diameter_px) for patch in patches]
    alone = [_fit_alone(cutout, patch, expected_diameter_px / 2) for cutout, patch in zip(cutouts, patches, strict=True)]
    shape = _estimate_shape([found for found in alone if found], expected_diameter_px / 2)
    marks = [_mark(cutout, found, shape) for cutout, found in zip(cutouts, alone, strict=True) if found]
    return _without_duplicates([mark for mark in marks if mark])


def _cutout(image: Pixels, patch: Patch, diameter_px: float) -> _Cutout:
    # Room for the rays of a mark anywhere in the patch, and a few pixels for the smoothing.
    reach = 1.3 * diameter_px + max(patch.sides_px) / 2 + 4
    x, y = patch.middle_px
    left, top = max(0, int(x - reach)), max(0, int(y - reach))
    piece = image[top : int(y + reach) + 2, left : int(x + reach) + 2]
    pictures = (rim_picture(piece), redness(piece), whiteness(piece))
    rims, red, white = (np.asarray(cv2.GaussianBlur(picture, (0, 0), SMOOTHING_PX), np.float32) for picture in pictures)
    corner = np.array([left, top], dtype=np.float64)
    last = np.array(image.shape[1::-1], dtype=np.float64) - 1.0
    return _Cutout(rims, red, white, corner, np.stack([BORDER_PX - corner, last - BORDER_PX - corner]))


def _fit_alone(cutout: _Cutout, patch: Patch, radius_px: float) -> MarkOutline | None:
    """First outline of a patch, with a free shape; its centre is in cutout coordinates."""
    points, _ = _rim(cutout, np.array(patch.middle_px) - cutout.corner_px, radius_px)
    # A fixed seed: the same photo always gives the same marks.
    circle = likely_circle(points, radius_px, SIZE_SPREAD, np.random.default_rng(0))
    if circle is None:
        return None
    return _measure(cutout, circle[:2], Shape(float(circle[2])))


def _measure(cutout: _Cutout, middle: Floats, shape: Shape) -> MarkOutline | None:
    points, rays = _rim(cutout, middle, shape.radius_px, square=True)
    return fit_outline(points, middle, shape, len(rays.directions)) if len(points) else None


def _rim(cutout: _Cutout, middle: Floats, radius_px: float, square: bool = False) -> tuple[Floats, Rays]:
    """Rim points (n, 2) as seen from a centre, and their rays; points beside a glare, at the border or askew are rejected."""
    rays = cast_rays(cutout.rims, middle, radius_px)
    white = cast_rays(cutout.white, middle, radius_px)
    level = measure_levels(rays, white, radius_px)
    points = rim_points(rays, level.half)
    spoilt = is_beside_glare(points, white, radius_px, GLARE * max(MIN_CONTRAST_COUNTS, level.contrast))
    spoilt |= ((points.px < cutout.inside_px[0]) | (points.px > cutout.inside_px[1])).any(axis=1)
    if square:
        spoilt |= is_oblique(points, middle, cutout.rims)
    return points.px[~spoilt], rays


def _estimate_shape(found: Sequence[MarkOutline], radius_px: float) -> Shape:
    """Median shape of the whole marks, as a prior of a few per cent; the expected circle where fewer than three marks are whole."""
    whole = [outline for outline in found if outline.seen >= WHOLE]
    if len(whole) < 3:
        return Shape(radius_px)
    bend = np.median([outline.bend for outline in whole], axis=0)
    return Shape(float(np.median([outline.radius_px for outline in whole])), (float(bend[0]), float(bend[1])), 0.04, 0.006)


def _mark(cutout: _Cutout, found: MarkOutline, shape: Shape) -> Mark | None:
    outline = _measure(cutout, found.middle_px, shape)
    if outline is None:
        return None
    rays, red = (cast_rays(picture, outline.middle_px, outline.radius_px) for picture in (cutout.rims, cutout.red))
    level = measure_levels(rays, cast_rays(cutout.white, outline.middle_px, outline.radius_px), outline.radius_px)
    roundness = outline.seen
    if color_bleed_share(red, outline.radius_px) > MAX_SPILL or roundness < MIN_ROUNDNESS or level.contrast < MIN_CONTRAST_COUNTS:
        return None
    # Errors that the scatter of the rim points does not show; the second term grows with the hidden share.
    systematic = PIXEL_FLOOR_PX + COVER_ERROR * outline.radius_px * (1.0 - roundness) / 0.5
    std = np.sqrt(np.diag(outline.covariance_px2) + systematic**2)
    return Mark(outline.middle_px + cutout.corner_px, std, 2 * outline.radius_px, roundness, level.contrast)


def _without_duplicates(marks: Sequence[Mark]) -> tuple[Mark, ...]:
    """Keep one of marks that were found twice (a glint can cut one in two): the one with the larger visible share."""
    unique: list[Mark] = []
    for mark in sorted(marks, key=lambda mark: -mark.roundness):
        if all(np.linalg.norm(mark.px - other.px) > 0.5 * other.diameter_px for other in unique):
            unique.append(mark)
    return tuple(sorted(unique, key=lambda mark: (mark.px[1], mark.px[0])))
