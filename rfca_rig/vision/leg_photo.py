"""Reads one photo of the leg: detects and identifies the marks, and computes the angles."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.vision.camera_model import CameraModel
from rfca_rig.vision.hinge_angles import HingeAngles, hinge_angles
from rfca_rig.vision.identify import IdentifiedMarks, identify
from rfca_rig.vision.leg_marks import MarkPlan, mark_positions
from rfca_rig.vision.marks import Mark, Pixels, find_marks_and_rejected

Floats = NDArray[np.float64]
Colour = tuple[int, int, int]

# Colours in OpenCV's order: blue, green, red.
WHOLE = (80, 220, 80)
PARTLY = (60, 220, 240)
EXTRA = (240, 120, 240)
TEXT = (240, 240, 240)
# Fractional bits of OpenCV's drawing coordinates, for rings that are accurate to a part of a pixel.
FINE_BITS = 4
# Width of a photo at which lines are one pixel wide; larger photos get thicker lines.
WIDTH_OF_PLAIN_PEN_PX = 1200.0


def draw_overlay(
    photo: Pixels,
    identified: IdentifiedMarks,
    camera: CameraModel,
    plan: MarkPlan,
    angles: HingeAngles | None = None,
) -> Pixels:
    """A copy of the photo (height, width, 3) with the reading drawn over it.

    Green rings are identified marks, yellow ones are partly hidden; purple crosses do not belong to
    the leg. Every doubt is in words.
    """
    picture = np.ascontiguousarray(photo).copy()
    pen = max(1.0, photo.shape[1] / WIDTH_OF_PLAIN_PEN_PX)
    _axis(picture, camera, pen)
    _chain(picture, identified, pen)
    for index, mark in enumerate(identified.marks):
        if mark is not None:
            _ring(picture, mark, plan.name(index).replace("mark at ", "").replace(" mark", ""), pen)
    for mark in identified.extra:
        _cross(picture, mark, pen)
    _lines(
        picture,
        _angle_words(angles)
        + [f"{doubt.kind}: {doubt.words}" for doubt in identified.doubts if doubt.kind != "extra"],
        pen,
    )
    return picture


def _axis(picture: Pixels, camera: CameraModel, pen: float) -> None:
    """Draw the shaft axis of the calibration, and the direction of +y."""
    start, end = camera.project(np.array([[0.0, 0.0], [0.02, 0.0]]))
    cv2.arrowedLine(
        picture, _whole(start), _whole(end), TEXT, round(pen), cv2.LINE_AA, tipLength=0.2
    )


def _chain(picture: Pixels, identified: IdentifiedMarks, pen: float) -> None:
    for before, after in zip(identified.marks, identified.marks[1:], strict=False):
        if before is not None and after is not None:
            cv2.line(
                picture,
                _fine(before.px),
                _fine(after.px),
                WHOLE,
                round(pen),
                cv2.LINE_AA,
                FINE_BITS,
            )


def _ring(picture: Pixels, mark: Mark, label: str, pen: float) -> None:
    colour: Colour = WHOLE if mark.whole else PARTLY
    cv2.circle(
        picture,
        _fine(mark.px),
        round(mark.diameter_px / 2 * 2**FINE_BITS),
        colour,
        round(pen),
        cv2.LINE_AA,
        FINE_BITS,
    )
    arm = mark.diameter_px / 8
    for way in (np.array([arm, 0.0]), np.array([0.0, arm])):
        cv2.line(
            picture,
            _fine(mark.px - way),
            _fine(mark.px + way),
            colour,
            round(pen),
            cv2.LINE_AA,
            FINE_BITS,
        )
    if mark.whole:
        words = label
    else:
        words = f"{label} ({mark.roundness:.0%} seen, +-{mark.std_px.max():.2f} px)"
    _write(picture, words, mark.px + np.array([0.8, -0.5]) * mark.diameter_px, colour, pen)


def _cross(picture: Pixels, mark: Mark, pen: float) -> None:
    arm = 0.7 * mark.diameter_px
    for way in (np.array([arm, arm]), np.array([arm, -arm])):
        cv2.line(
            picture,
            _fine(mark.px - way),
            _fine(mark.px + way),
            EXTRA,
            round(pen),
            cv2.LINE_AA,
            FINE_BITS,
        )
    _write(picture, "not the leg's", mark.px + np.array([0.9, 0.2]) * mark.diameter_px, EXTRA, pen)


def _angle_words(angles: HingeAngles | None) -> list[str]:
    if angles is None:
        return []
    pairs = zip(angles.hinge_rad, angles.hinge_std_rad, strict=True)
    words = [
        _describe_angle(number, angle, std) for number, (angle, std) in enumerate(pairs, start=1)
    ]
    return [", ".join(words)]


def _describe_angle(number: int, angle: float | None, std: float | None) -> str:
    name = "shaft" if number == 1 else f"hinge {number}"
    if angle is None or std is None:
        return f"{name} ?"
    return f"{name} {np.degrees(angle):.2f}+-{np.degrees(std):.2f}"


def _lines(picture: Pixels, lines: Sequence[str], pen: float) -> None:
    for row, line in enumerate(lines):
        _write(picture, line, np.array([8.0, 18.0 + 18.0 * row]) * pen, TEXT, pen)


def _write(picture: Pixels, words: str, at_px: Floats, colour: Colour, pen: float) -> None:
    cv2.putText(
        picture,
        words,
        _whole(at_px),
        cv2.FONT_HERSHEY_SIMPLEX,
        0.42 * pen,
        colour,
        round(pen),
        cv2.LINE_AA,
    )


def _whole(px: Floats) -> tuple[int, int]:
    return round(float(px[0])), round(float(px[1]))


def _fine(px: Floats) -> tuple[int, int]:
    return round(float(px[0]) * 2**FINE_BITS), round(float(px[1]) * 2**FINE_BITS)


@dataclass(frozen=True, eq=False)
class PhotoSetup:
    """Everything that reading a photo needs: the calibrated camera, the positions of the marks
    on the leg, the link lengths (n,).
    """

    camera: CameraModel
    plan: MarkPlan
    link_lengths_m: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class LegPhoto:
    """Marks and angles from a photo, and the photo (rows, columns, 3) with these drawn over it."""

    identified: IdentifiedMarks
    angles: HingeAngles
    overlay: Pixels


def read_marks(image: Pixels, eye: PhotoSetup) -> IdentifiedMarks:
    """The marks in a photo (rows, columns, 3) uint8.

    Raises BadInput where it does not have the size that the camera was calibrated with.
    """
    size_px = (image.shape[1], image.shape[0])
    if size_px != eye.camera.image_size_px:
        width, height = eye.camera.image_size_px
        raise BadInput(
            f"a photo of {size_px[0]} x {size_px[1]} pixels, the camera was calibrated "
            f"with {width} x {height}"
        )
    # Expected size: marks of a leg that hangs straight down, about the middle of its range of
    # motion.
    down = np.full(len(eye.link_lengths_m), 0.5 * np.pi)
    diameters_px = eye.camera.disc_diameter_px(
        mark_positions(down, eye.link_lengths_m, eye.plan), eye.plan.diameter_m
    )
    marks, rejected = find_marks_and_rejected(image, float(np.median(diameters_px)))
    return identify(marks, eye.camera, eye.plan, eye.link_lengths_m, rejected=rejected)


def read_leg_photo(image: Pixels, eye: PhotoSetup) -> LegPhoto:
    """Read a photo (rows, columns, 3) uint8 by itself. Raises BadInput as `read_marks` does."""
    identified = read_marks(image, eye)
    angles = hinge_angles(identified, eye.camera, eye.plan, eye.link_lengths_m)
    return LegPhoto(
        identified, angles, draw_overlay(image, identified, eye.camera, eye.plan, angles)
    )
