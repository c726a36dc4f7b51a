"""Redness of a picture, and the red patches that could be marks."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.uint8]
Floats = NDArray[np.float64]

# Diameter of a mark in the picture that is searched for patches; larger pictures are reduced first.
SEARCH_DIAMETER_PX = 14.0
MIN_COUNTS = 8.0
# Shares of the brightest red thing's redness at which patches are searched: marks in shadow have a tenth of it, a cable may have more.
SHARES = (0.5, 0.2, 0.08)
BRIGHTEST_PERCENTILE = 99.97
# Widths of the cuts that are closed, in diameters: a glint may cut a mark in two, but a cable beside a mark must not join it.
GAP_SHARES = (0.2, 0.35)
# Patches nearer to each other than this share of a diameter are one mark.
SAME_SHARE = 0.25
RED_PEAK_PERCENTILE = 97.0
# Whiteness up to which surroundings count as black, as a share of the mark's redness.
DARK_SHARE = 0.5
# Limits of a patch's sides, in diameters.
SMALLEST, LARGEST = 0.25, 2.2


@dataclass(frozen=True)
class Patch:
    """A red patch: its middle (x, y) px and its box's sides px."""

    middle_px: tuple[float, float]
    sides_px: tuple[float, float]


def redness(image_bgr: Pixels) -> NDArray[np.float32]:
    """Red minus the larger of green and blue, in counts (height, width). White glints and grey things have none."""
    blue, green, red = cv2.split(image_bgr.astype(np.float32))
    return np.asarray(red - cv2.max(green, blue), np.float32)


def whiteness(image_bgr: Pixels) -> NDArray[np.float32]:
    """The smaller of green and blue, in counts (height, width): glints have it, red things do not."""
    return np.asarray(cv2.min(image_bgr[..., 0], image_bgr[..., 1]), np.float32)


def rim_picture(image_bgr: Pixels) -> NDArray[np.float32]:
    """The picture (height, width) in which the rim of a red thing is searched, for a cutout around it.

    On black this is the red channel alone. It has less noise than a difference of channels, and JPEG, which stores colours at half the
    resolution, keeps most of its sharpness. In front of something light the red channel has no rim, and redness is used.
    """
    peak = float(np.percentile(redness(image_bgr), RED_PEAK_PERCENTILE))
    if float(np.median(whiteness(image_bgr))) < DARK_SHARE * peak:
        return np.asarray(image_bgr[..., 2], np.float32)
    return redness(image_bgr)


def red_patches(image_bgr: Pixels, expected_diameter_px: float) -> tuple[Patch, ...]:
    """Connected red patches of about a mark's size in a photo (height, width, 3), in picture order.

    Patches are searched at several thresholds, relative to the reddest part of the photo. Shadows make marks darker than others, and a
    mark and a cable beside it are separate at some thresholds only.
    """
    shrink = max(1, int(expected_diameter_px / SEARCH_DIAMETER_PX))
    small = _shrink(image_bgr, shrink)
    diameter = expected_diameter_px / shrink
    red = cv2.GaussianBlur(redness(small), (0, 0), max(0.6, diameter / 14.0))
    brightest = float(np.percentile(red, BRIGHTEST_PERCENTILE))
    patches: list[Patch] = []
    for threshold in sorted({max(MIN_COUNTS, share * brightest) for share in SHARES}, reverse=True):
        found = (red > threshold).astype(np.uint8)
        for gap in GAP_SHARES:
            size = max(3, round(gap * diameter) | 1)
            closed = cv2.morphologyEx(found, cv2.MORPH_CLOSE, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)))
            _, _, boxes, middles = cv2.connectedComponentsWithStats(np.asarray(closed, np.uint8), connectivity=8)
            # Component 0 is the background.
            own = (_patch(box, middle, shrink) for box, middle in zip(boxes[1:], middles[1:], strict=True))
            patches += [patch for patch in own if _has_size_of_mark(patch, expected_diameter_px)]
    return _without_repeats(patches, expected_diameter_px)


def _without_repeats(patches: list[Patch], diameter_px: float) -> tuple[Patch, ...]:
    """Of patches at nearly the same place, the one whose size is nearest to a mark's, from top to bottom."""
    unique: list[Patch] = []
    for patch in sorted(patches, key=lambda patch: sum(abs(np.log(side / diameter_px)) for side in patch.sides_px)):
        if all(np.hypot(*np.subtract(patch.middle_px, other.middle_px)) > SAME_SHARE * diameter_px for other in unique):
            unique.append(patch)
    return tuple(sorted(unique, key=lambda patch: patch.middle_px[::-1]))


def _shrink(image_bgr: Pixels, shrink: int) -> Pixels:
    if shrink == 1:
        return image_bgr
    height, width = image_bgr.shape[:2]
    whole = image_bgr[: height - height % shrink, : width - width % shrink]
    return np.asarray(cv2.resize(whole, (width // shrink, height // shrink), interpolation=cv2.INTER_AREA), np.uint8)


def _patch(box: NDArray[np.int32], middle: Floats, shrink: int) -> Patch:
    # The centre of a small pixel is the centre of the large ones that it stands for.
    x, y = (float(value) * shrink + (shrink - 1) / 2 for value in middle)
    return Patch((x, y), (float(box[cv2.CC_STAT_WIDTH] * shrink), float(box[cv2.CC_STAT_HEIGHT] * shrink)))


def _has_size_of_mark(patch: Patch, diameter_px: float) -> bool:

    return (
        max(patch.sides_px) > 2 * SMALLEST * diameter_px
        and min(patch.sides_px) > SMALLEST * diameter_px
        and max(patch.sides_px) < LARGEST * diameter_px
    )
