"""Legs, cameras and poses that the vision tests share."""

import cv2
import numpy as np

from rfca_rig.vision.camera_model import CameraModel, Floats
from rfca_rig.vision.leg_marks import MarkPlan

LENGTHS_M = np.array([0.054, *[0.23600 / 6] * 6])
PLAN = MarkPlan.at_hinges(LENGTHS_M.tolist())


def camera(
    width_px: int = 1600,
    tilt_deg: tuple[float, float, float] = (4.0, -6.0, 1.5),
    distorted: bool = True,
) -> CameraModel:
    """About a metre in front of the plane, the leg and some room around it in the picture."""
    size = (width_px, width_px * 3 // 4)
    focal = 1.9 * width_px
    matrix = np.array(
        [
            [focal, 0, size[0] / 2 + 0.006 * width_px],
            [0, focal, size[1] / 2 - 0.004 * width_px],
            [0, 0, 1.0],
        ]
    )
    if distorted:
        lens = np.array([-0.12, 0.08, 0.0006, -0.0004, 0.01])
    else:
        lens = np.zeros(5)
    # the camera's x is the plane's y, its y the plane's -z, its z the plane's -x: a camera that
    # looks along -x
    upright = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
    turn, _ = cv2.Rodrigues(np.radians(np.array(tilt_deg, dtype=np.float64)))
    rotation = turn @ upright
    middle = np.array([0.0, 0.12, -0.09])
    return CameraModel(matrix, lens, size, rotation, np.array([0.0, 0.0, 0.85]) - rotation @ middle)


def pose(random: np.random.Generator) -> Floats:
    """Absolute link angles of a leg that is bent back on the ground more or less, hinge by hinge
    a little differently.
    """
    first = np.radians(random.uniform(10.0, 60.0))
    bend = np.radians(random.uniform(-14.0, 10.0)) * np.linspace(1.3, 0.3, 6) + np.radians(
        random.normal(0.0, 1.5, 6)
    )
    return np.concatenate([[first], first + np.cumsum(bend)])
