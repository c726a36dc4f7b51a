"""How red a picture is, and the red patches that could be marks."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.uint8]
Floats = NDArray[np.float64]

LOOKED_AT_PX = 14.0  # the search for patches needs marks no larger than this; larger pictures are made smaller first
FAINTEST_COUNTS = 12.0
FAINTEST_SHARE = 0.2  # of the red of the brightest mark: light may fall off by so much over the picture
BRIGHTEST_PERCENTILE = 99.97
GAP_SHARE = 0.35  # of the diameter: a glint so wide may cut a mark in two
RED_PEAK_PERCENTILE = 97.0
DARK_SHARE = 0.5  # of a mark's redness: surroundings up to that are black enough
SMALLEST, LARGEST = 0.25, 2.2  # patch against mark, in lengths


@dataclass(frozen=True)
class Patch:
    """A red patch: its middle (x, y) px and its box's sides px."""

    middle_px: tuple[float, float]
    sides_px: tuple[float, float]


def redness(image_bgr: Pixels) -> NDArray[np.float32]:
    """Red above the stronger of green and blue, in counts (height, width). White glints and grey things have none."""
    blue, green, red = cv2.split(image_bgr.astype(np.float32))
    return np.asarray(red - cv2.max(green, blue), np.float32)


def whiteness(image_bgr: Pixels) -> NDArray[np.float32]:
    """The weaker of green and blue, in counts (height, width): what glints have and red things have not."""
    return np.asarray(cv2.min(image_bgr[..., 0], image_bgr[..., 1]), np.float32)


def rim_picture(image_bgr: Pixels) -> NDArray[np.float32]:
    """The picture (height, width) in which the rim of a red thing is sought, for a cutout around it.

    On black this is the red channel alone: it has less noise than a difference of channels, and JPEG, which stores colours at half the
    resolution, keeps most of its sharpness. Before something light the red channel has no rim, and redness is taken.
    """
    peak = float(np.percentile(redness(image_bgr), RED_PEAK_PERCENTILE))
    if float(np.median(whiteness(image_bgr))) < DARK_SHARE * peak:
        return np.asarray(image_bgr[..., 2], np.float32)
    return redness(image_bgr)


def red_patches(image_bgr: Pixels, expected_diameter_px: float) -> tuple[Patch, ...]:
    """Connected red patches of about a mark's size, in picture order; faint parts of a photo are judged by its brightest."""
    shrink = max(1, int(expected_diameter_px / LOOKED_AT_PX))
    small = _shrunk(image_bgr, shrink)
    diameter = expected_diameter_px / shrink
    red = cv2.GaussianBlur(redness(small), (0, 0), max(0.6, diameter / 14.0))
    threshold = max(FAINTEST_COUNTS, FAINTEST_SHARE * float(np.percentile(red, BRIGHTEST_PERCENTILE)))
    mask = _without_cuts((red > threshold).astype(np.uint8), diameter)
    _, _, boxes, middles = cv2.connectedComponentsWithStats(mask, connectivity=8)
    patches = (_patch(box, middle, shrink) for box, middle in zip(boxes[1:], middles[1:], strict=True))
    return tuple(patch for patch in patches if _of_marks_size(patch, expected_diameter_px))


def _shrunk(image_bgr: Pixels, shrink: int) -> Pixels:
    if shrink == 1:
        return image_bgr
    height, width = image_bgr.shape[:2]
    whole = image_bgr[: height - height % shrink, : width - width % shrink]
    return np.asarray(cv2.resize(whole, (width // shrink, height // shrink), interpolation=cv2.INTER_AREA), np.uint8)


def _without_cuts(mask: Pixels, diameter_px: float) -> Pixels:
    size = max(3, round(GAP_SHARE * diameter_px) | 1)
    return np.asarray(cv2.morphologyEx(mask, cv2.MORPH_CLOSE, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))), np.uint8)


def _patch(box: NDArray[np.int32], middle: Floats, shrink: int) -> Patch:
    # a small pixel's middle is the middle of the large ones it stands for
    x, y = (float(value) * shrink + (shrink - 1) / 2 for value in middle)
    return Patch((x, y), (float(box[cv2.CC_STAT_WIDTH] * shrink), float(box[cv2.CC_STAT_HEIGHT] * shrink)))


def _of_marks_size(patch: Patch, diameter_px: float) -> bool:
    return (
        max(patch.sides_px) > 2 * SMALLEST * diameter_px
        and min(patch.sides_px) > SMALLEST * diameter_px
        and max(patch.sides_px) < LARGEST * diameter_px
    )
