"""Camera twin: renders the leg in the present configuration of the plant."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rfca_rig.twins.image_noise import ImageDisturbance
from rfca_rig.twins.leg_picture import render_leg
from rfca_rig.vision.camera_model import CameraModel
from rfca_rig.vision.leg_marks import MarkPlan

__all__ = ["CameraTwin", "ImageDisturbance", "StandingLeg", "render_leg"]

Floats = NDArray[np.float64]


class StandingLeg(Protocol):
    """The present configuration of a plant's leg, as far as a camera sees it."""

    def link_angles_rad(self) -> Floats:
        """Absolute angles (n,) of the links in rad, from the shaft outwards, measured from +y, positive downwards."""
        ...

    def link_lengths_m(self) -> Floats:
        """Lengths (n,) of the links in m, from the shaft outwards."""
        ...

    def ground_depth_m(self) -> float:
        """Depth of the plate below the shaft axis in m."""
        ...


class CameraTwin:
    """Each picture gets new random disturbances from `random`; `disturbance` sets their kinds and sizes."""

    def __init__(
        self, leg: StandingLeg, plan: MarkPlan, camera: CameraModel, disturbance: ImageDisturbance, random: np.random.Generator
    ) -> None:
        self._leg = leg
        self._plan = plan
        self._camera = camera
        self._disturbance = disturbance
        self._random = random

    def expose(self) -> NDArray[np.uint8]:
        """The image (rows, columns, 3) uint8 in BGR order of the leg in its present configuration."""
        leg = self._leg
        angles_rad, lengths_m, ground_m = leg.link_angles_rad(), leg.link_lengths_m(), leg.ground_depth_m()
        return render_leg(angles_rad, lengths_m, self._plan, self._camera, self._disturbance, self._random, ground_m)
