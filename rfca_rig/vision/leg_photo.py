"""One photo of the leg read as a whole: marks found, told apart, angles, and what could not be told."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.vision.camera_model import CameraModel
from rfca_rig.vision.hinge_angles import HingeAngles, hinge_angles
from rfca_rig.vision.identify import Identified, identify
from rfca_rig.vision.leg_marks import MarkPlan, mark_positions
from rfca_rig.vision.marks import find_marks
from rfca_rig.vision.overlay import draw_overlay
from rfca_rig.vision.red_mask import Pixels

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Eye:
    """What a photo is read with: the calibrated camera, where the marks are on the leg, and the links' lengths (n,)."""

    camera: CameraModel
    plan: MarkPlan
    link_lengths_m: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class LegPhoto:
    """What a photo says of the leg, and the same drawn over it."""

    identified: Identified
    angles: HingeAngles
    overlay: Pixels


def read_leg_photo(image: Pixels, eye: Eye) -> LegPhoto:
    """Reads a photo (rows, columns, 3) uint8. Raises BadInput for one that is not of the size the camera was calibrated with."""
    size_px = (image.shape[1], image.shape[0])
    if size_px != eye.camera.image_size_px:
        width, height = eye.camera.image_size_px
        raise BadInput(f"a photo of {size_px[0]} x {size_px[1]} pixels, the camera was calibrated with {width} x {height}")
    identified = identify(find_marks(image, _usual_diameter_px(eye)), eye.camera, eye.plan, eye.link_lengths_m)
    angles = hinge_angles(identified, eye.camera, eye.plan, eye.link_lengths_m)
    return LegPhoto(identified, angles, draw_overlay(image, identified, eye.camera, eye.plan, angles))


def _usual_diameter_px(eye: Eye) -> float:
    """Of the marks of a leg that hangs straight down, which is about the middle of all that it does."""
    down = np.full(len(eye.link_lengths_m), 0.5 * np.pi)
    return float(np.median(eye.camera.disc_diameter_px(mark_positions(down, eye.link_lengths_m, eye.plan), eye.plan.diameter_m)))
