"""How the leg is bent, from what is known of it at a moment: the model at the shaft's angle, or hinge angles read off a photo.

Points are (y, z) in metres from the shaft, y along the ground, z down, so that the floor is at z = height.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.model.chain import at_rest
from rfca_rig.model.motion import ramp_to_speed
from rfca_rig.model.parameters import RigModel
from rfca_rig.model.setup import set_up
from rfca_rig.model.stroke import stroke_at_speed

Floats = NDArray[np.float64]

TURN_RAD = 2.0 * math.pi
ROWS_PER_S = 2000.0  # between two rows the leg bends by less than a line's width on any screen
IN_THE_AIR_M = 1e3


@dataclass(frozen=True)
class StrokeShapes:
    """The link angles of one stroke over the shaft's angle: `shaft_rad` (m,) strictly ascending, `q_rad` (m, n) absolute."""

    shaft_rad: Floats
    q_rad: Floats

    def covers(self, shaft_rad: float) -> bool:
        return bool(self.shaft_rad[0] <= shaft_rad <= self.shaft_rad[-1])

    def at(self, shaft_rad: float) -> Floats:
        """The link angles (n,) there, between two rows in proportion."""
        row = int(np.clip(np.searchsorted(self.shaft_rad, shaft_rad), 1, len(self.shaft_rad) - 1))
        before, after = self.shaft_rad[row - 1], self.shaft_rad[row]
        share = (shaft_rad - before) / (after - before)
        return np.asarray((1.0 - share) * self.q_rad[row - 1] + share * self.q_rad[row])


class LegShapes:
    """Shapes (links + 1, 2) of one rig's leg, shaft first. Strokes are computed once, by `prepare`; the rest is a look-up.

    The first `prepare` or `hanging` of a process compiles the model: not for the process whose loop drives a motor.
    """

    def __init__(self, rig: RigModel) -> None:
        self._rig = rig
        self._lengths_m = np.array(rig.leg.link_lengths_m)
        self._strokes: dict[tuple[float, float], StrokeShapes] = {}
        self._hanging: dict[float, Floats] = {}

    def prepare(self, height_m: float, speed_rad_s: float, sweep_deg: float) -> None:
        """Computes the stroke of that condition, for `at_shaft`. Raises BadInput, SimulationFailed."""
        self._strokes[_condition(height_m, speed_rad_s)] = stroke_shapes(self._rig, height_m, speed_rad_s, sweep_deg)

    def at_shaft(self, height_m: float, shaft_rad: float, speed_rad_s: float) -> Floats:
        """The model's shape in the stroke of that speed when the shaft is at that angle, whole turns aside.

        Where that stroke was not prepared, or does not pass there, as on the way back over the top: the leg hanging in the air.
        """
        stroke = self._strokes.get(_condition(height_m, speed_rad_s))
        if stroke is None:
            return self.hanging(shaft_rad)
        in_turn_rad = _in_turn_from(float(stroke.shaft_rad[0]), shaft_rad)
        if not stroke.covers(in_turn_rad):
            return self.hanging(shaft_rad)
        return leg_points(stroke.at(in_turn_rad), self._lengths_m)

    def hanging(self, shaft_rad: float) -> Floats:
        """The leg at rest under its own weight, without any floor; between whole degrees in proportion."""
        degrees = np.degrees(shaft_rad)
        below = float(np.floor(degrees))
        share = degrees - below
        hinges = (1.0 - share) * self._hanging_hinges(below) + share * self._hanging_hinges(below + 1.0)
        return leg_points(shaft_rad + hinges, self._lengths_m)

    def of_hinges(self, shaft_rad: float, hinge_deg: Floats) -> Floats:
        """The shape with the hinge angles (links - 1,) of a photo, hinge 2 first."""
        return leg_points(shaft_rad + np.concatenate([[0.0], np.cumsum(np.radians(hinge_deg))]), self._lengths_m)

    def _hanging_hinges(self, degrees: float) -> Floats:
        """The link angles less the shaft's, (links,)."""
        turned = degrees % 360.0
        if turned not in self._hanging:
            self._hanging[turned] = hanging_angles(self._rig, float(np.radians(turned))) - np.radians(turned)
        return self._hanging[turned]


def leg_points(q_rad: Floats, lengths_m: Floats) -> Floats:
    """Shaft, hinges and tip, (n + 1, 2), of links with the absolute angles (n,) and the lengths (n,)."""
    steps = lengths_m[:, None] * np.column_stack([np.cos(q_rad), np.sin(q_rad)])
    return np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])


def stroke_shapes(rig: RigModel, height_m: float, speed_rad_s: float, sweep_deg: float) -> StrokeShapes:
    """The stroke from rest through `sweep_deg`. A soft shaft that is thrown back counts where it goes forward for the first time."""
    end_s = np.radians(sweep_deg) / speed_rad_s + rig.drive.ramp_s
    stroke = stroke_at_speed(rig, height_m, speed_rad_s, np.arange(0.0, end_s, 1.0 / ROWS_PER_S))
    shaft_rad = stroke.shaft_angle_rad
    forward = np.concatenate([[True], shaft_rad[1:] > np.maximum.accumulate(shaft_rad)[:-1]])
    return StrokeShapes(shaft_rad[forward], stroke.q_rad[forward])


def hanging_angles(rig: RigModel, shaft_rad: float) -> Floats:
    """The absolute link angles (n,) of the leg at rest in the air. Raises SimulationFailed."""
    setup = set_up(rig, IN_THE_AIR_M, ramp_to_speed(shaft_rad, 0.0, rig.drive.ramp_s, 0.0))
    chain = setup.chain()
    return at_rest(chain, shaft_rad, setup.compiled_laws(chain)).q[: chain.length.size]


def _condition(height_m: float, speed_rad_s: float) -> tuple[float, float]:
    """Height and speed to what a plan can tell apart, so that a sum of floats finds what a file wrote."""
    return round(height_m, 5), round(speed_rad_s, 4)


def _in_turn_from(start_rad: float, shaft_rad: float) -> float:
    """The same angle in the turn that begins a degree before `start_rad`."""
    begin_rad = start_rad - float(np.radians(1.0))
    return begin_rad + (shaft_rad - begin_rad) % TURN_RAD
