"""A camera before a twin's leg: the picture drawn from how the plant stands at the moment."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rfca_rig.twins.image_noise import Disturbance
from rfca_rig.twins.leg_picture import render_leg
from rfca_rig.vision.camera_model import CameraModel
from rfca_rig.vision.leg_marks import MarkPlan

__all__ = ["CameraTwin", "Disturbance", "StandingLeg", "render_leg"]

Floats = NDArray[np.float64]


class StandingLeg(Protocol):
    """How a plant's leg stands now, as far as a camera sees it."""

    def link_angles_rad(self) -> Floats:
        """Absolute angles (n,) of the links from the shaft outwards, from +y, positive downwards."""
        ...

    def link_lengths_m(self) -> Floats:
        """(n,)"""
        ...

    def ground_depth_m(self) -> float:
        """How far the plate is below the shaft axis."""
        ...


class CameraTwin:
    """Every picture has chance disturbances of its own, from `random`; their kinds and sizes are `disturbance`'s."""

    def __init__(
        self, leg: StandingLeg, plan: MarkPlan, camera: CameraModel, disturbance: Disturbance, random: np.random.Generator
    ) -> None:
        self._leg = leg
        self._plan = plan
        self._camera = camera
        self._disturbance = disturbance
        self._random = random

    def expose(self) -> NDArray[np.uint8]:
        """The picture (rows, columns, 3) uint8, blue green red, of the leg as it stands."""
        leg = self._leg
        angles_rad, lengths_m, ground_m = leg.link_angles_rad(), leg.link_lengths_m(), leg.ground_depth_m()
        return render_leg(angles_rad, lengths_m, self._plan, self._camera, self._disturbance, self._random, ground_m)
