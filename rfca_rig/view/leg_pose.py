"""The leg for the page: as it is bent now, and where the model expects it."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import tau
from typing import Any

import numpy as np

from rfca_rig.description.nominal_model import nominal_model
from rfca_rig.errors import RigError
from rfca_rig.model.parameters import RigModel
from rfca_rig.view.decimation import Floats
from rfca_rig.view.leg_shape import LegShapes, leg_points
from rfca_rig.view.scenes import Scene, Stroked

BY_MODEL, BY_PHOTO, STRAIGHT = "model at measured shaft angle", "photo", "shaft only"
UM = 6  # decimals of a metre


@dataclass(frozen=True)
class LegMoment:
    """What is known of the leg at one moment. `planned_rad` is where the shaft should be, `hinge_deg` (6,) what a photo showed."""

    scene: Scene
    shaft_rad: float
    planned_rad: float | None = None
    hinge_deg: Floats | None = None
    force_N: tuple[float, float] | None = None


class Legs:
    """Draws the leg straight until the model's shapes are computed, which `prepare` does, on a thread of its own.

    Without a nominal model, as of a campaign that brings none, there is no leg.
    """

    def __init__(self, nominal: Mapping[str, Any]) -> None:
        self._rig = _model(nominal)
        self._shapes: LegShapes | None = None
        self._prepared: set[Stroked] = set()

    @property
    def described(self) -> dict[str, object] | None:
        """Sizes for the page; None where the leg is unknown."""
        if self._rig is None:
            return None
        leg = self._rig.leg
        return {"link_lengths_m": list(leg.link_lengths_m), "link_thickness_m": 2.0 * leg.link_radius_m}

    @property
    def start_rad(self) -> float | None:
        """Where strokes are believed to begin."""
        return None if self._rig is None else self._rig.leg.start_angle_rad

    @property
    def ramp_s(self) -> float:
        """In which the drive is believed to come to speed."""
        return 0.0 if self._rig is None else self._rig.drive.ramp_s

    def prepare(self, scenes: Iterable[Scene]) -> None:
        """Takes seconds. A stroke that the model cannot compute is done without: the leg hangs there."""
        if self._rig is None:
            return
        shapes = LegShapes(self._rig)
        try:
            shapes.hanging(0.0)
        except RigError:
            return
        self._shapes = shapes
        for stroke in dict.fromkeys(scene.stroke for scene in scenes if scene.stroke is not None):
            try:
                shapes.prepare(stroke.height_m, stroke.speed_rad_s, stroke.sweep_deg)
                self._prepared.add(stroke)
            except RigError:
                continue

    def message(self, moment: LegMoment) -> dict[str, object] | None:
        """As the page takes it; None where nobody knows what the leg is like, or where it hangs."""
        if self._rig is None or moment.scene.height_m is None:
            return None
        leg, source = self._leg(self._rig, moment)
        ghost = None if moment.planned_rad is None or self._shapes is None else self._at(self._shapes, moment.scene, moment.planned_rad)
        return {
            "kind": "leg",
            "height_m": round(moment.scene.height_m, UM),
            "shaft_rad": round(moment.shaft_rad % tau, 5),
            "leg": _listed(leg),
            "ghost": None if ghost is None else _listed(ghost),
            "source": source,
            "force": None if moment.force_N is None else [round(value, 3) for value in moment.force_N],
        }

    def _leg(self, rig: RigModel, moment: LegMoment) -> tuple[Floats, str]:
        if self._shapes is None:
            lengths_m = np.array(rig.leg.link_lengths_m)
            return leg_points(np.full(len(lengths_m), moment.shaft_rad), lengths_m), STRAIGHT
        if moment.hinge_deg is not None:
            return self._shapes.of_hinges(moment.shaft_rad, moment.hinge_deg), BY_PHOTO
        return self._at(self._shapes, moment.scene, moment.shaft_rad), BY_MODEL

    def _at(self, shapes: LegShapes, scene: Scene, shaft_rad: float) -> Floats:
        stroke = scene.stroke
        if stroke is None or stroke not in self._prepared:
            return shapes.hanging(shaft_rad)
        return shapes.at_shaft(stroke.height_m, shaft_rad, stroke.speed_rad_s)


def _model(nominal: Mapping[str, Any]) -> RigModel | None:
    try:
        return nominal_model(nominal) if nominal else None
    except RigError:
        return None


def _listed(points: Floats) -> list[list[float]]:
    return [[round(y, UM), round(z, UM)] for y, z in points.tolist()]
