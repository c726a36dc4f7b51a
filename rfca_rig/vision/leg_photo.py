"""Reads one photo of the leg: detects and identifies the marks, and computes the angles."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.vision.camera_model import CameraModel
from rfca_rig.vision.hinge_angles import HingeAngles, hinge_angles
from rfca_rig.vision.identify import IdentifiedMarks, identify
from rfca_rig.vision.leg_marks import MarkPlan, mark_positions
from rfca_rig.vision.marks import find_marks_and_rejected
from rfca_rig.vision.overlay import draw_overlay
from rfca_rig.vision.red_mask import Pixels

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PhotoSetup:
    """Everything that reading a photo needs: the calibrated camera, the positions of the marks on the leg, the link lengths (n,)."""

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
        raise BadInput(f"a photo of {size_px[0]} x {size_px[1]} pixels, the camera was calibrated with {width} x {height}")
    marks, rejected = find_marks_and_rejected(image, _usual_diameter_px(eye))
    return identify(marks, eye.camera, eye.plan, eye.link_lengths_m, rejected=rejected)


def read_leg_photo(image: Pixels, eye: PhotoSetup) -> LegPhoto:
    """Read a photo (rows, columns, 3) uint8 by itself. Raises BadInput as `read_marks` does."""
    identified = read_marks(image, eye)
    angles = hinge_angles(identified, eye.camera, eye.plan, eye.link_lengths_m)
    return LegPhoto(identified, angles, draw_overlay(image, identified, eye.camera, eye.plan, angles))


def _usual_diameter_px(eye: PhotoSetup) -> float:
    """Median diameter of the marks of a leg that hangs straight down, about the middle of its range of motion."""
    down = np.full(len(eye.link_lengths_m), 0.5 * np.pi)
    return float(np.median(eye.camera.disc_diameter_px(mark_positions(down, eye.link_lengths_m, eye.plan), eye.plan.diameter_m)))
