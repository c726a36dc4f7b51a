"""Pose of the leg for the page: the current shape, and the shape that the model predicts at the
commanded angle.
"""

import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from rfca_rig.description.model_file import nominal_model
from rfca_rig.errors import RigError
from rfca_rig.model.catalogue import set_up
from rfca_rig.model.chain import find_rest_state
from rfca_rig.model.motion import ramp_to_speed
from rfca_rig.model.parameters import RigModel
from rfca_rig.model.stroke import simulate_stroke_at_speed
from rfca_rig.view.pyramid import Floats
from rfca_rig.view.run_facts import Scene, SceneStroke

TURN_RAD = 2.0 * math.pi
# Sampling of precomputed strokes: between two samples the leg bends by less than the width of a
# line on any screen.
ROWS_PER_S = 2000.0
# Rack height at which no part of the leg reaches the floor: a model "without floor" needs no code
# of its own.
IN_THE_AIR_M = 1e3

BY_MODEL = "model at measured shaft angle"
BY_PHOTO = "photo"
STRAIGHT = "shaft only"
# Decimals of a metre: micrometres.
UM = 6


@dataclass(frozen=True)
class StrokeShapes:
    """Link angles of one stroke over the shaft angle: `shaft_rad` (m,) strictly ascending,
    `q_rad` (m, n) absolute, for n links.
    """

    shaft_rad: Floats
    q_rad: Floats

    def covers(self, shaft_rad: float) -> bool:
        return bool(self.shaft_rad[0] <= shaft_rad <= self.shaft_rad[-1])

    def at(self, shaft_rad: float) -> Floats:
        """Link angles (n,) rad at a shaft angle, linearly interpolated."""
        row = int(np.clip(np.searchsorted(self.shaft_rad, shaft_rad), 1, len(self.shaft_rad) - 1))
        before = self.shaft_rad[row - 1]
        after = self.shaft_rad[row]
        weight = (shaft_rad - before) / (after - before)
        return np.asarray((1.0 - weight) * self.q_rad[row - 1] + weight * self.q_rad[row])


class LegShapes:
    """Shapes of one rig's leg as points (links + 1, 2) in m, shaft first. `prepare` computes a
    stroke once; the rest is a look-up.

    The first `prepare` or `hanging` of a process compiles the model. Never call it in the process
    whose loop drives a motor.
    """

    def __init__(self, rig: RigModel) -> None:
        self._rig = rig
        self._lengths_m = np.array(rig.leg.link_lengths_m)
        self._strokes: dict[tuple[float, float], StrokeShapes] = {}
        self._hanging: dict[float, Floats] = {}

    def prepare(self, height_m: float, speed_rad_s: float, sweep_deg: float) -> None:
        """Simulates the stroke of a condition, for `at_shaft`. Raises BadInput,
        SimulationFailed.
        """
        self._strokes[_condition(height_m, speed_rad_s)] = stroke_shapes(
            self._rig, height_m, speed_rad_s, sweep_deg
        )

    def at_shaft(self, height_m: float, shaft_rad: float, speed_rad_s: float) -> Floats:
        """Shape (links + 1, 2) m in the stroke of a condition at a shaft angle, modulo whole turns.

        Where the stroke was not prepared, or does not pass this angle (as on the way back over the
        top), the leg hangs in the air.
        """
        stroke = self._strokes.get(_condition(height_m, speed_rad_s))
        if stroke is None:
            return self.hanging(shaft_rad)
        # The same angle in the turn that begins one degree before the stroke's start. One degree of
        # margin: a shaft that stands a little before the start would otherwise count as a whole
        # turn ahead.
        begin_rad = float(stroke.shaft_rad[0]) - float(np.radians(1.0))
        in_turn_rad = begin_rad + (shaft_rad - begin_rad) % TURN_RAD
        if not stroke.covers(in_turn_rad):
            return self.hanging(shaft_rad)
        return leg_points(stroke.at(in_turn_rad), self._lengths_m)

    def hanging(self, shaft_rad: float) -> Floats:
        """Shape (links + 1, 2) m of the leg at rest under its own weight, without a floor."""
        # Equilibria are computed at whole degrees, cached, and interpolated: one for each frame
        # would be too slow.
        degrees = np.degrees(shaft_rad)
        below = float(np.floor(degrees))
        weight = degrees - below
        hinges = (1.0 - weight) * self._hanging_hinges(below) + weight * self._hanging_hinges(
            below + 1.0
        )
        return leg_points(shaft_rad + hinges, self._lengths_m)

    def from_hinge_angles(self, shaft_rad: float, hinge_deg: Floats) -> Floats:
        """Shape (links + 1, 2) m with the hinge angles (links - 1,) deg of a photo, hinge 2
        first.
        """
        # A hinge angle is that of a link relative to the previous one: sums give absolute angles.
        return leg_points(
            shaft_rad + np.concatenate([[0.0], np.cumsum(np.radians(hinge_deg))]), self._lengths_m
        )

    def _hanging_hinges(self, degrees: float) -> Floats:
        """Link angles at rest relative to the shaft, (links,) rad."""
        turned = degrees % 360.0
        if turned not in self._hanging:
            self._hanging[turned] = hanging_angles(
                self._rig, float(np.radians(turned))
            ) - np.radians(turned)
        return self._hanging[turned]


def leg_points(q_rad: Floats, lengths_m: Floats) -> Floats:
    """Points (n + 1, 2) m of shaft, hinges and tip, for links with absolute angles (n,) rad and
    lengths (n,) m.
    """
    steps = lengths_m[:, None] * np.column_stack([np.cos(q_rad), np.sin(q_rad)])
    return np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])


def stroke_shapes(
    rig: RigModel, height_m: float, speed_rad_s: float, sweep_deg: float
) -> StrokeShapes:
    """Simulates a stroke from rest through `sweep_deg`: m samples, link angles (m, n).

    Raises BadInput, SimulationFailed.
    """
    end_s = np.radians(sweep_deg) / speed_rad_s + rig.drive.ramp_s
    stroke = simulate_stroke_at_speed(
        rig, height_m, speed_rad_s, np.arange(0.0, end_s, 1.0 / ROWS_PER_S)
    )
    shaft_rad = stroke.shaft_angle_rad
    # A compliant shaft may be thrown back by the contact. Only samples at a new maximum count, so
    # that shapes are a function of the angle.
    forward = np.concatenate([[True], shaft_rad[1:] > np.maximum.accumulate(shaft_rad)[:-1]])
    return StrokeShapes(shaft_rad[forward], stroke.q_rad[forward])


def hanging_angles(rig: RigModel, shaft_rad: float) -> Floats:
    """Absolute link angles (n,) rad of the leg at rest in the air. Raises SimulationFailed."""
    setup = set_up(rig, IN_THE_AIR_M, ramp_to_speed(shaft_rad, 0.0, rig.drive.ramp_s, 0.0))
    chain = setup.chain()
    return find_rest_state(chain, shaft_rad, setup.compile_laws(chain)).q[: chain.length.size]


def _condition(height_m: float, speed_rad_s: float) -> tuple[float, float]:
    """Key of a condition: rounded to 10 um and 1e-4 rad/s, so that rounding errors of floats do
    not matter.
    """
    return round(height_m, 5), round(speed_rad_s, 4)


@dataclass(frozen=True)
class LegMoment:
    """State of the leg at one moment.

    `shaft_rad` is the measured angle, `planned_rad` the commanded one, `hinge_deg` (6,) the hinge
    angles from a photo, `force_N` the measured fy and fz.
    """

    scene: Scene
    shaft_rad: float
    planned_rad: float | None = None
    hinge_deg: Floats | None = None
    force_N: tuple[float, float] | None = None


class Legs:
    """Poses of one leg. They are straight until `prepare` has computed the model's shapes, on a
    thread of its own.

    Without a nominal model, as in some imported campaigns, there is no leg.
    """

    def __init__(self, nominal: Mapping[str, Any]) -> None:
        self._rig: RigModel | None = None
        if nominal:
            # A model section that this version cannot read costs the picture of the leg, not the
            # whole view.
            with suppress(RigError):
                self._rig = nominal_model(nominal)
        self._shapes: LegShapes | None = None
        self._prepared: set[SceneStroke] = set()

    @property
    def description(self) -> dict[str, object] | None:
        """Lengths of the links and their thickness in m; None where the leg is unknown."""
        if self._rig is None:
            return None
        leg = self._rig.leg
        return {
            "link_lengths_m": list(leg.link_lengths_m),
            "link_thickness_m": 2.0 * leg.link_radius_m,
        }

    @property
    def start_rad(self) -> float | None:
        """Start angle of strokes in the nominal model; None without a model."""
        if self._rig is None:
            return None
        return self._rig.leg.start_angle_rad

    @property
    def ramp_s(self) -> float:
        """Time in s in which the drive of the nominal model comes to speed; 0 without a model."""
        if self._rig is None:
            return 0.0
        return self._rig.drive.ramp_s

    def prepare(self, scenes: Iterable[Scene]) -> None:
        """Computes the shapes of all strokes, which takes seconds. Where the model fails for a
        stroke, the leg is shown hanging.
        """
        if self._rig is None:
            return
        shapes = LegShapes(self._rig)
        try:
            # A trial: it compiles the model, and shows whether this one can be computed at all.
            shapes.hanging(0.0)
        except RigError:
            return
        self._shapes = shapes
        # Repeats share one stroke; dict.fromkeys removes duplicates and keeps the order of the
        # plan.
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
        ghost = None
        if moment.planned_rad is not None and self._shapes is not None:
            ghost = _as_lists(self._at(self._shapes, moment.scene, moment.planned_rad))
        force = None
        if moment.force_N is not None:
            force = [round(value, 3) for value in moment.force_N]
        return {
            "kind": "leg",
            "height_m": round(moment.scene.height_m, UM),
            "leg": _as_lists(leg),
            "ghost": ghost,
            "source": source,
            "force": force,
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


def _as_lists(points: Floats) -> list[list[float]]:
    return [[round(y, UM), round(z, UM)] for y, z in points.tolist()]
