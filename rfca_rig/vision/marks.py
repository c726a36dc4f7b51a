"""Detects red round marks on black in the redness of a picture, with an accuracy of a small part of
a pixel.

Every mark is measured twice: first alone, then with the shape that the whole marks of the photo
share. The shared shape gives partly hidden marks a correct centre. Pixel (0, 0) is the centre of
the first pixel.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.vision.rim import (
    GLARE,
    SMOOTHING_PX,
    Levels,
    MarkOutline,
    Rays,
    Shape,
    Whiteness,
    cast_rays,
    color_bleed_share,
    fit_outlines,
    follow_rim,
    is_oblique,
    likely_circle,
    measure_glare,
    measure_levels,
    measure_whiteness,
    rim_points,
    slopes_of,
)

Pixels = NDArray[np.uint8]
Floats = NDArray[np.float64]

# Diameter of a mark in the picture that is searched for patches; larger pictures are reduced first.
SEARCH_DIAMETER_PX = 14.0
MIN_COUNTS = 8.0
# Shares of the brightest red thing's redness at which patches are searched: marks in shadow have a
# tenth of it, a cable may have more.
SHARES = (0.5, 0.2, 0.08)
BRIGHTEST_PERCENTILE = 99.97
# Widths of the cuts that are closed, in diameters: a glint may cut a mark in two, but a cable
# beside a mark must not join it.
GAP_SHARES = (0.2, 0.35)
# Patches nearer to each other than this share of a diameter are one mark.
SAME_SHARE = 0.25
RED_PEAK_PERCENTILE = 97.0
# Counts in proportion to the light, for the counts 0 to 255 of the sRGB curve (IEC 61966-2-1).
_CODED = np.arange(256) / 255.0
LIGHT_OF_COUNTS = (
    255.0 * np.where(_CODED <= 0.04045, _CODED / 12.92, ((_CODED + 0.055) / 1.055) ** 2.4)
).astype(np.float32)
# Whiteness up to which surroundings count as black, as a share of the mark's redness.
DARK_SHARE = 0.5
# Limits of a patch's sides, in diameters.
SMALLEST = 0.25
LARGEST = 2.2


@dataclass(frozen=True)
class Patch:
    """A red patch: its middle (x, y) px and its box's sides px."""

    middle_px: tuple[float, float]
    sides_px: tuple[float, float]


def redness(image_bgr: Pixels | NDArray[np.float32]) -> NDArray[np.float32]:
    """Red minus the larger of green and blue, in counts (height, width). White glints and grey
    things have none.
    """
    blue, green, red = cv2.split(image_bgr)
    return np.asarray(cv2.subtract(red, cv2.max(green, blue), dtype=cv2.CV_32F), np.float32)


def whiteness(image_bgr: Pixels) -> NDArray[np.float32]:
    """The smaller of green and blue, in counts (height, width): glints have it, red things do
    not.
    """
    return np.asarray(cv2.min(image_bgr[..., 0], image_bgr[..., 1]), np.float32)


def is_on_black(image_bgr: Pixels) -> bool:
    """Whether a cutout (height, width, 3) shows a red thing on black: then its rim is searched in
    the red channel alone.

    It has less noise than a difference of channels, and JPEG, which stores colours at half the
    resolution, keeps most of its sharpness. In front of something light the red channel has no rim,
    and redness is used.
    """
    peak = float(np.percentile(redness(image_bgr), RED_PEAK_PERCENTILE))
    return float(np.median(whiteness(image_bgr))) < DARK_SHARE * peak


def red_patches(image_bgr: Pixels, expected_diameter_px: float) -> tuple[Patch, ...]:
    """Connected red patches of about a mark's size in a photo (height, width, 3), in picture order.

    Patches are searched at several thresholds, relative to the reddest part of the photo. Shadows
    make marks darker than others, and a mark and a cable beside it are separate at some thresholds
    only.
    """
    shrink = max(1, int(expected_diameter_px / SEARCH_DIAMETER_PX))
    small = _shrink(image_bgr, shrink)
    diameter = expected_diameter_px / shrink
    red = np.asarray(
        cv2.GaussianBlur(redness(small), (0, 0), max(0.6, diameter / 14.0)), np.float32
    )
    brightest = float(np.percentile(red, BRIGHTEST_PERCENTILE))
    thresholds = sorted({max(MIN_COUNTS, share * brightest) for share in SHARES}, reverse=True)
    sizes = [max(3, round(gap * diameter) | 1) for gap in GAP_SHARES]
    # Only the part of the photo with red things, and room to close gaps at its edges: components
    # cost as much for black pixels.
    corner, part = _crop_to_red(red, thresholds[-1], max(sizes))
    patches: list[Patch] = []
    for threshold in thresholds:
        mask = (part > threshold).astype(np.uint8)
        for size in sizes:
            closed = cv2.morphologyEx(
                mask, cv2.MORPH_CLOSE, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
            )
            _, _, boxes, middles = cv2.connectedComponentsWithStats(
                np.asarray(closed, np.uint8), connectivity=8
            )
            # Component 0 is the background.
            components = (
                _patch(box, middle + corner, shrink)
                for box, middle in zip(boxes[1:], middles[1:], strict=True)
            )
            patches += [
                patch for patch in components if _has_size_of_mark(patch, expected_diameter_px)
            ]
    return _without_repeats(patches, expected_diameter_px)


def _crop_to_red(
    red: NDArray[np.float32], threshold: float, room: int
) -> tuple[Floats, NDArray[np.float32]]:
    """First place (x, y) and the part of a picture (height, width) with all that is above the
    threshold and `room` pixels around.
    """
    x, y, width, height = cv2.boundingRect((red > threshold).astype(np.uint8))
    left = max(0, x - room)
    top = max(0, y - room)
    return np.array([left, top], np.float64), red[top : y + height + room, left : x + width + room]


def _without_repeats(patches: list[Patch], diameter_px: float) -> tuple[Patch, ...]:
    """Of patches at nearly the same place, the one whose size is nearest to a mark's, from top
    to bottom.
    """
    unique: list[Patch] = []
    for patch in sorted(
        patches, key=lambda patch: sum(abs(np.log(side / diameter_px)) for side in patch.sides_px)
    ):
        if all(
            np.hypot(*np.subtract(patch.middle_px, other.middle_px)) > SAME_SHARE * diameter_px
            for other in unique
        ):
            unique.append(patch)
    return tuple(sorted(unique, key=lambda patch: patch.middle_px[::-1]))


def _shrink(image_bgr: Pixels, shrink: int) -> Pixels:
    if shrink == 1:
        return image_bgr
    height, width = image_bgr.shape[:2]
    whole = image_bgr[: height - height % shrink, : width - width % shrink]
    return np.asarray(
        cv2.resize(whole, (width // shrink, height // shrink), interpolation=cv2.INTER_AREA),
        np.uint8,
    )


def _patch(box: NDArray[np.int32], middle: Floats, shrink: int) -> Patch:
    # The centre of a small pixel is the centre of the large ones that it stands for.
    x, y = (float(value) * shrink + (shrink - 1) / 2 for value in middle)
    return Patch(
        (x, y), (float(box[cv2.CC_STAT_WIDTH] * shrink), float(box[cv2.CC_STAT_HEIGHT] * shrink))
    )


def _has_size_of_mark(patch: Patch, diameter_px: float) -> bool:

    return (
        max(patch.sides_px) > 2 * SMALLEST * diameter_px
        and min(patch.sides_px) > SMALLEST * diameter_px
        and max(patch.sides_px) < LARGEST * diameter_px
    )


MIN_ROUNDNESS = 0.4
WHOLE = 0.9
# Largest share of rays that stay red beyond the rim: a disc that touches another red thing may be
# either of the two.
MAX_SPILL = 0.08
MIN_CONTRAST_COUNTS = 10.0
# Range of a mark's radius around the expected one, as a share.
SIZE_SPREAD = 0.4
# A rim this close to the border of the photo is that of the photo.
BORDER_PX = 2.0
# Error that remains however sharp the photo is: pixels, and the blocks of JPEG, in which whole rims
# err together.
PIXEL_FLOOR_PX = 0.02
# Smoothing of the whiteness, in diameters: glints are wider than noise.
WHITE_SMOOTHING = 0.06
# Standard deviations of the noise from which something is a glint.
GLARE_SIGMAS = 5.0
# Share of the rim from which glare is left out, and factors of the limit up to which it is used
# where less is left.
ENOUGH_RIM = 0.7
MORE_GLARE = (2.0, 4.0, np.inf)
# Error of the centre over the amplitude of the rim's slow deviations: 1.6 to 2.5 in ray-traced
# photos of six kinds of light and focus.
WAVE_ERROR = 1.7
# Error of the centre of a mark whose whole rim is beside glare, in radii.
GLARE_ERROR = 0.02
# Error of the centre of a half hidden mark, in radii: the rim near a cover's edge is shifted along
# with it.
COVER_ERROR = 0.012
# Error of the centre over its spread between ASSUMPTIONS. On 36 ray-traced legs, 26 of them with
# rods, 0, 0.5, 1, 1.25 and 1.5 leave 0.85, 0.27, 0.06, 0 and 0 % of the coordinates off by more
# than 3 deviations; their median deviation is 0.10, 0.11, 0.13, 0.14 and 0.15 px.
SPREAD_ERROR = 1.25
# Largest spread between ASSUMPTIONS, in radii: beyond, it is no measure of the error any more. The
# largest of 1,728 tuned marks has 0.083.
MAX_SPREAD = 0.1


@dataclass(frozen=True)
class Mark:
    """A red disc: centre `px` (2,) with standard deviations `std_px` (2,) along x and y, diameter,
    roundness, contrast.

    Roundness is the share of the rim that is seen and round: 1 for a whole mark, 0.5 for one half
    hidden. Contrast is the difference in redness between the mark and its surroundings, in counts
    of the picture.
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
class RejectedPatch:
    """A red patch at `px` (2,) that was found and not measured as a mark, and the reason in
    words.
    """

    px: Floats
    reason: str


@dataclass(frozen=True)
class _Assumption:
    """What a rim's place depends on and no photo tells.

    `linear`: counts are made proportional to light, as if the camera had the sRGB curve; otherwise
    they count as they are. `local`: the level inside is that of each part of the rim, otherwise a
    plane through the disc. `share`: the rim's level between outside and inside.
    """

    linear: bool
    local: bool
    share: float


# The centre of an undisturbed disc is the same under all of them. The first one gives the shape and
# what is seen of the rim.
ASSUMPTIONS = (
    _Assumption(linear=False, local=False, share=0.5),
    _Assumption(linear=False, local=True, share=0.5),
    _Assumption(linear=True, local=False, share=0.5),
    _Assumption(linear=True, local=True, share=0.5),
    _Assumption(linear=True, local=True, share=0.3),
    _Assumption(linear=True, local=True, share=0.7),
)


@dataclass(frozen=True)
class _Rim:
    """Rim points px (n, 2), the number of rays that looked for them, and the share of the points
    that are beside a glare.
    """

    px: Floats
    rays: int
    glare_share: float


@dataclass(frozen=True)
class _Cutout:
    """Smoothed pictures (h, w) around a patch: the one in which rims are searched, as it is and
    linear in light, redness and whiteness.

    `corner_px` (2,) is the position of the first pixel in the photo. `inside_px` (2, 2) are the
    first and last position (x, y) of the cutout that are well inside the photo.
    """

    rims: NDArray[np.float32]
    linear_rims: NDArray[np.float32]
    red: NDArray[np.float32]
    white: NDArray[np.float32]
    corner_px: Floats
    inside_px: Floats

    @cached_property
    def slopes(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        return slopes_of(self.rims)

    @cached_property
    def linear_slopes(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        return slopes_of(self.linear_rims)


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
    return find_marks_and_rejected(image_bgr_uint8, expected_diameter_px)[0]


def find_marks_and_rejected(
    image_bgr_uint8: Pixels, expected_diameter_px: float
) -> tuple[tuple[Mark, ...], tuple[RejectedPatch, ...]]:
    """As `find_marks` for a photo (height, width, 3), with the red patches of about a mark's
    size that were not measured, and why.
    """
    if (
        image_bgr_uint8.ndim != 3
        or image_bgr_uint8.shape[2] != 3
        or image_bgr_uint8.dtype != np.uint8
    ):
        raise BadInput(
            "photo: expected 8 bit colour (height, width, 3), not "
            f"{image_bgr_uint8.dtype} {image_bgr_uint8.shape}"
        )
    if not expected_diameter_px >= 6.0:
        raise BadInput(
            f"photo: marks of {expected_diameter_px:.1f} px are too small to measure, at "
            "least 6 px; move the camera closer"
        )
    patches = red_patches(image_bgr_uint8, expected_diameter_px)
    cutouts = [_cutout(image_bgr_uint8, patch, expected_diameter_px) for patch in patches]
    alone = _fit_alone(cutouts, patches, expected_diameter_px / 2)
    # A blurred disc's radius depends on the assumption, so each of them has its own shape.
    shapes = []
    for k in range(len(ASSUMPTIONS)):
        fits = [outlines[k] for outlines in alone if outlines]
        shapes.append(_estimate_shape(fits, expected_diameter_px / 2))
    waves = [
        outlines[0].waves_px
        for outlines in alone
        if outlines and outlines[0] and np.isfinite(outlines[0].waves_px)
    ]
    typical_waves_px = 0.0
    if waves:
        typical_waves_px = float(np.median(waves))
    results = _measure_marks(cutouts, alone, shapes, typical_waves_px)
    marks = _without_duplicates([mark for mark in results if isinstance(mark, Mark)])
    rejected = []
    for patch, result in zip(patches, results, strict=True):
        if isinstance(result, str) and not _is_on_mark(patch, marks):
            rejected.append(RejectedPatch(np.array(patch.middle_px), result))
    return marks, tuple(rejected)


def _is_on_mark(patch: Patch, marks: Sequence[Mark]) -> bool:
    return any(
        np.linalg.norm(mark.px - patch.middle_px) <= 0.5 * mark.diameter_px for mark in marks
    )


def _cutout(image: Pixels, patch: Patch, diameter_px: float) -> _Cutout:
    # Room for the rays of a mark anywhere in the patch, and a few pixels for the smoothing.
    reach = 1.3 * diameter_px + max(patch.sides_px) / 2 + 4
    x, y = patch.middle_px
    left = max(0, int(x - reach))
    top = max(0, int(y - reach))
    piece = image[top : int(y + reach) + 2, left : int(x + reach) + 2]
    light = LIGHT_OF_COUNTS[piece]
    if is_on_black(piece):
        seen = (piece[..., 2].astype(np.float32), light[..., 2])
    else:
        seen = (redness(piece), redness(light))
    # Scaled to the same brightest counts, so that limits in counts hold for both.
    brightest = [max(1.0, float(np.percentile(picture, RED_PEAK_PERCENTILE))) for picture in seen]
    pictures = (
        seen[0],
        seen[1] * np.float32(brightest[0] / brightest[1]),
        redness(piece),
        whiteness(piece),
    )
    widths = (
        SMOOTHING_PX,
        SMOOTHING_PX,
        SMOOTHING_PX,
        max(SMOOTHING_PX, WHITE_SMOOTHING * diameter_px),
    )
    rims, linear_rims, red, white = (
        np.asarray(cv2.GaussianBlur(picture, (0, 0), width), np.float32)
        for picture, width in zip(pictures, widths, strict=True)
    )
    corner = np.array([left, top], dtype=np.float64)
    last = np.array(image.shape[1::-1], dtype=np.float64) - 1.0
    return _Cutout(
        rims,
        linear_rims,
        red,
        white,
        corner,
        np.stack([BORDER_PX - corner, last - BORDER_PX - corner]),
    )


def _fit_alone(
    cutouts: Sequence[_Cutout], patches: Sequence[Patch], radius_px: float
) -> list[list[MarkOutline | None] | None]:
    """First outlines of each patch, one for each assumption, with a free shape; their centres
    are in cutout coordinates.
    """
    if not patches:
        return []
    middles = np.array(
        [patch.middle_px - cutout.corner_px for patch, cutout in zip(patches, cutouts, strict=True)]
    )
    rims = _find_rims(
        _look(cutouts, middles, radius_px, [False] * len(cutouts)),
        range(len(cutouts)),
        ASSUMPTIONS[:1] * len(cutouts),
    )
    circles = [likely_circle(rim.px, radius_px, SIZE_SPREAD) for rim in rims]
    numbers = [number for number, circle in enumerate(circles) if circle is not None]
    starts = np.array([circle[:2] for circle in circles if circle is not None]).reshape(-1, 2)
    shapes = [Shape(float(circle[2])) for circle in circles if circle is not None]
    linear = [assumption.linear for assumption in ASSUMPTIONS]
    # Of each patch two views, which its assumptions share: sampling takes most of the time.
    measured = [
        _find_rims(
            _look(
                [cutouts[number]] * 2,
                starts[[index, index]],
                shapes[index].radius_px,
                [False, True],
            ),
            linear,
            ASSUMPTIONS,
            square=True,
        )
        for index, number in enumerate(numbers)
    ]
    outlines = _fit(measured, starts, [[shape] * len(ASSUMPTIONS) for shape in shapes])
    alone: list[list[MarkOutline | None] | None] = [None] * len(cutouts)
    for number, patch_outlines in zip(numbers, outlines, strict=True):
        alone[number] = patch_outlines
    return alone


def _fit(
    rims: Sequence[Sequence[_Rim]], starts: Floats, shapes: Sequence[Sequence[Shape]]
) -> list[list[MarkOutline | None]]:
    """The outlines of patches from first centres (patches, 2): of each patch one for each rim
    and its prior shape.
    """
    flat = [rim for patch_rims in rims for rim in patch_rims]
    count = len(ASSUMPTIONS)
    outlines = fit_outlines(
        [rim.px for rim in flat],
        np.repeat(starts, count, axis=0),
        [shape for patch_shapes in shapes for shape in patch_shapes],
        [rim.rays for rim in flat],
    )
    return [outlines[first : first + count] for first in range(0, len(outlines), count)]


@dataclass(frozen=True)
class _View:
    """Patches as sampled from a centre each: rays in the pictures of rims and in whiteness, and
    the levels of the discs.
    """

    cutouts: Sequence[_Cutout]
    is_linear: Sequence[bool]
    rays: Rays
    white: Whiteness
    level: Levels
    radius_px: float


def _look(
    cutouts: Sequence[_Cutout], middles: Floats, radius_px: float, is_linear: Sequence[bool]
) -> _View:
    """Views of patches from centres (views, 2), for discs of one radius."""
    rays = cast_rays(
        [
            cutout.linear_rims if linear else cutout.rims
            for cutout, linear in zip(cutouts, is_linear, strict=True)
        ],
        middles,
        radius_px,
    )
    white = measure_whiteness(
        cast_rays([cutout.white for cutout in cutouts], middles, radius_px), radius_px
    )
    return _View(cutouts, is_linear, rays, white, measure_levels(rays, white, radius_px), radius_px)


def _find_rims(
    seen: _View, views: Iterable[int], assumptions: Sequence[_Assumption], square: bool = False
) -> list[_Rim]:
    """Rim points in views, each under an assumption; points beside a glare, at the border or askew
    are rejected.

    Where glare, such as the sheen of a glossy mark, leaves too little of the rim, its mildest parts
    are used as well.
    """
    view = np.array(list(views), np.int64)
    level = seen.level
    rays = len(seen.rays.directions)
    if any(assumption.local for assumption in assumptions):
        inside = follow_rim(level, seen.rays, seen.radius_px).inside
    else:
        inside = level.inside
    is_local = np.array([assumption.local for assumption in assumptions])
    share = np.array([assumption.share for assumption in assumptions])
    # The level at this share of the way from outside to inside; NaN where no disc is.
    outside = level.outside[view]
    at = outside + share[:, None] * (
        np.where(is_local[:, None], inside[view], level.inside[view]) - outside
    )
    points = rim_points(seen.rays, view, at)
    of_view = view[points.rim]
    limits = np.array([cutout.inside_px for cutout in seen.cutouts])[of_view]
    spoilt = np.asarray(((points.px < limits[:, 0]) | (points.px > limits[:, 1])).any(axis=1))
    if square:
        for number in np.unique(of_view):
            cutout = seen.cutouts[number]
            mask = of_view == number
            if seen.is_linear[number]:
                slopes = cutout.linear_slopes
            else:
                slopes = cutout.slopes
            spoilt[mask] |= is_oblique(points.px[mask], seen.rays.middle_px[number], slopes)
    glare = measure_glare(points, view, seen.white, seen.radius_px)
    limit = np.maximum(
        GLARE * np.maximum(MIN_CONTRAST_COUNTS, level.contrast), GLARE_SIGMAS * seen.white.noise
    )[of_view]
    ends = np.searchsorted(points.rim, np.arange(len(view) + 1))
    rims = []
    for first, last in pairwise(ends.tolist()):
        px = points.px[first:last]
        plain = ~spoilt[first:last]
        light = glare[first:last]
        most = limit[first:last]
        kept = plain & (light <= most)
        for factor in MORE_GLARE:
            if kept.sum() >= ENOUGH_RIM * rays:
                break
            kept = plain & (light <= factor * most)
        rims.append(_Rim(px[kept], rays, float((light > most)[kept].mean()) if kept.any() else 0.0))
    return rims


def _estimate_shape(outlines: Sequence[MarkOutline | None], radius_px: float) -> Shape:
    """Median shape of the whole marks, as a prior of a few per cent; the expected circle where
    fewer than three marks are whole.
    """
    whole = [outline for outline in outlines if outline and outline.seen >= WHOLE]
    if len(whole) < 3:
        return Shape(radius_px)
    bend = np.median([outline.bend for outline in whole], axis=0)
    return Shape(
        float(np.median([outline.radius_px for outline in whole])),
        (float(bend[0]), float(bend[1])),
        0.04,
        0.006,
    )


def _measure_marks(
    cutouts: Sequence[_Cutout],
    alone: Sequence[list[MarkOutline | None] | None],
    shapes: Sequence[Shape],
    typical_waves_px: float,
) -> list[Mark | str]:
    """The measured mark of each patch, or why it is none."""
    firsts = [patch_outlines[0] if patch_outlines else None for patch_outlines in alone]
    chosen = [cutout for cutout, first in zip(cutouts, firsts, strict=True) if first is not None]
    if not chosen:
        return ["no round rim"] * len(cutouts)
    starts = np.array([first.middle_px for first in firsts if first is not None])
    seen: dict[tuple[bool, float], _View] = {}
    by_assumption = []
    for shape, assumption in zip(shapes, ASSUMPTIONS, strict=True):
        key = assumption.linear, shape.radius_px
        if key not in seen:
            seen[key] = _look(chosen, starts, shape.radius_px, [assumption.linear] * len(chosen))
        by_assumption.append(
            _find_rims(seen[key], range(len(chosen)), [assumption] * len(chosen), square=True)
        )
    rims = list(zip(*by_assumption, strict=True))
    outlines = _fit(rims, starts, [shapes] * len(chosen))
    marks: list[Mark | str] = ["no round rim"] * len(cutouts)
    with_rim = [number for number, first in enumerate(firsts) if first is not None]
    for number, cutout, own_rims, measured in zip(with_rim, chosen, rims, outlines, strict=True):
        marks[number] = _mark(cutout, own_rims, measured, typical_waves_px)
    return marks


def _mark(
    cutout: _Cutout,
    rims: Sequence[_Rim],
    measured: Sequence[MarkOutline | None],
    typical_waves_px: float,
) -> Mark | str:
    """The measured mark, or why it is none."""
    outline = measured[0]
    rim = rims[0]
    if outline is None:
        return "hardly any of its rim is seen"
    contrast = _contrast(cutout, outline)
    outlines = [estimate for estimate in measured if estimate is not None]
    middles = np.array([estimate.middle_px for estimate in outlines])
    middle = middles.mean(axis=0)
    if len(outlines) == len(measured):
        spread = float(np.sqrt(((middles - middle) ** 2).sum(axis=1).mean()))
    else:
        spread = np.inf
    if reason := _find_reason(cutout, outline, contrast, spread):
        return reason
    # Errors that the scatter of the rim points does not show; the second term grows with the hidden
    # share.
    systematic = PIXEL_FLOOR_PX + outline.radius_px * (
        COVER_ERROR * (1.0 - outline.seen) / 0.5 + GLARE_ERROR * rim.glare_share
    )
    if np.isfinite(outline.waves_px):
        waves_px = outline.waves_px
    else:
        waves_px = typical_waves_px
    waves = WAVE_ERROR * np.hypot(waves_px, typical_waves_px) / np.sqrt(2.0)
    std = np.sqrt(
        np.diag(outline.covariance_px2) + systematic**2 + waves**2 + (SPREAD_ERROR * spread) ** 2
    )
    return Mark(middle + cutout.corner_px, std, 2 * outline.radius_px, outline.seen, contrast)


def _contrast(cutout: _Cutout, outline: MarkOutline) -> float:
    return float(
        _look([cutout], outline.middle_px[None], outline.radius_px, [False]).level.contrast[0]
    )


def _find_reason(cutout: _Cutout, outline: MarkOutline, contrast: float, spread_px: float) -> str:
    """Why an outline is no mark that can be measured; "" where it is one. The spread is infinite
    where an assumption gives no outline.
    """
    if (
        color_bleed_share(
            cast_rays([cutout.red], outline.middle_px[None], outline.radius_px), outline.radius_px
        )
        > MAX_SPILL
    ):
        return "it touches another red thing, or a shadow leaves only a part of it bright"
    if outline.seen < MIN_ROUNDNESS:
        return f"only {outline.seen:.0%} of its rim is seen, at least {MIN_ROUNDNESS:.0%}"
    if contrast < MIN_CONTRAST_COUNTS:
        return f"too dark, {contrast:.0f} counts of contrast, at least {MIN_CONTRAST_COUNTS:g}"
    if spread_px > MAX_SPREAD * outline.radius_px:
        most = f"at most {MAX_SPREAD * outline.radius_px:.1f} px"
        if not np.isfinite(spread_px):
            return (
                "a part of its rim is seen at some levels of brightness only: a shadow, a "
                "cover or a glint"
            )
        return (
            f"its centre moves by {spread_px:.1f} px with the level at which its rim is "
            f"taken, {most}: a shadow, a cover or a glint"
        )
    return ""


def _without_duplicates(marks: Sequence[Mark]) -> tuple[Mark, ...]:
    """Keep one of marks that were found twice (a glint can cut one in two): the one with the
    larger visible share.
    """
    unique: list[Mark] = []
    for mark in sorted(marks, key=lambda mark: -mark.roundness):
        if all(np.linalg.norm(mark.px - other.px) > 0.5 * other.diameter_px for other in unique):
            unique.append(mark)
    return tuple(sorted(unique, key=lambda mark: (mark.px[1], mark.px[0])))
