"""Pose of the leg for the page: the current shape, and the shape that the model predicts at the commanded angle."""

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
from rfca_rig.view.scenes import Scene, SceneStroke

BY_MODEL, BY_PHOTO, STRAIGHT = "model at measured shaft angle", "photo", "shaft only"
# Decimals of a metre: micrometres.
UM = 6


@dataclass(frozen=True)
class LegMoment:
    """State of the leg at one moment.

    `shaft_rad` is the measured angle, `planned_rad` the commanded one, `hinge_deg` (6,) the hinge angles from a photo,
    `force_N` the measured fy and fz.
    """

    scene: Scene
    shaft_rad: float
    planned_rad: float | None = None
    hinge_deg: Floats | None = None
    force_N: tuple[float, float] | None = None


class Legs:
    """Poses of one leg. They are straight until `prepare` has computed the model's shapes, on a thread of its own.

    Without a nominal model, as in some imported campaigns, there is no leg.
    """

    def __init__(self, nominal: Mapping[str, Any]) -> None:
        self._rig = _read_model(nominal)
        self._shapes: LegShapes | None = None
        self._prepared: set[SceneStroke] = set()

    @property
    def description(self) -> dict[str, object] | None:
        """Lengths of the links and their thickness in m; None where the leg is unknown."""
        if self._rig is None:
            return None
        leg = self._rig.leg
        return {"link_lengths_m": list(leg.link_lengths_m), "link_thickness_m": 2.0 * leg.link_radius_m}

    @property
    def start_rad(self) -> float | None:
        """Start angle of strokes in the nominal model; None without a model."""
        return None if self._rig is None else self._rig.leg.start_angle_rad

    @property
    def ramp_s(self) -> float:
        """Time in s in which the drive of the nominal model comes to speed; 0 without a model."""
        return 0.0 if self._rig is None else self._rig.drive.ramp_s

    def prepare(self, scenes: Iterable[Scene]) -> None:
        """Computes the shapes of all strokes, which takes seconds. Where the model fails for a stroke, the leg is shown hanging."""
        if self._rig is None:
            return
        shapes = LegShapes(self._rig)
        try:
            # A trial: it compiles the model, and shows whether this one can be computed at all.
            shapes.hanging(0.0)
        except RigError:
            return
        self._shapes = shapes
        # Repeats share one stroke; dict.fromkeys removes duplicates and keeps the order of the plan.
        for stroke in dict.fromkeys(scene.stroke for scene in scenes if scene.stroke is not None):
            try:
                shapes.prepare(stroke.height_m, stroke.speed_rad_s, stroke.sweep_deg)
                self._prepared.add(stroke)
            except RigError:
                continue

    def message(self, moment: LegMoment) -> dict[str, object] | None:
        """Message for the page; None where the leg or the rack's height is unknown."""
        if self._rig is None or moment.scene.height_m is None:
            return None
        leg, source = self._leg(self._rig, moment)
        ghost = None if moment.planned_rad is None or self._shapes is None else self._at(self._shapes, moment.scene, moment.planned_rad)
        return {
            "kind": "leg",
            "height_m": round(moment.scene.height_m, UM),
            "shaft_rad": round(moment.shaft_rad % tau, 5),
            "leg": _as_lists(leg),
            "ghost": None if ghost is None else _as_lists(ghost),
            "source": source,
            "force": None if moment.force_N is None else [round(value, 3) for value in moment.force_N],
        }

    def _leg(self, rig: RigModel, moment: LegMoment) -> tuple[Floats, str]:
        if self._shapes is None:
            lengths_m = np.array(rig.leg.link_lengths_m)
            return leg_points(np.full(len(lengths_m), moment.shaft_rad), lengths_m), STRAIGHT
        if moment.hinge_deg is not None:
            return self._shapes.from_hinge_angles(moment.shaft_rad, moment.hinge_deg), BY_PHOTO
        return self._at(self._shapes, moment.scene, moment.shaft_rad), BY_MODEL

    def _at(self, shapes: LegShapes, scene: Scene, shaft_rad: float) -> Floats:
        stroke = scene.stroke
        if stroke is None or stroke not in self._prepared:
            return shapes.hanging(shaft_rad)
        return shapes.at_shaft(stroke.height_m, shaft_rad, stroke.speed_rad_s)


def _read_model(nominal: Mapping[str, Any]) -> RigModel | None:
    try:
        # A model section that this version cannot read costs the picture of the leg, not the whole view.
        return nominal_model(nominal) if nominal else None
    except RigError:
        return None


def _as_lists(points: Floats) -> list[list[float]]:
    return [[round(y, UM), round(z, UM)] for y, z in points.tolist()]
