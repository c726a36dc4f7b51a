"""Shape of the leg at one moment: from the model at the shaft's angle, or from hinge angles of a photo.

Points are (y, z) in metres from the shaft, y along the ground, z down, so that the floor is at z = height.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.model.catalogue import set_up
from rfca_rig.model.chain import find_rest_state
from rfca_rig.model.motion import ramp_to_speed
from rfca_rig.model.parameters import RigModel
from rfca_rig.model.stroke import simulate_stroke_at_speed

Floats = NDArray[np.float64]

TURN_RAD = 2.0 * math.pi
# Sampling of precomputed strokes: between two samples the leg bends by less than the width of a line on any screen.
ROWS_PER_S = 2000.0
# Rack height at which no part of the leg reaches the floor: a model "without floor" needs no code of its own.
IN_THE_AIR_M = 1e3


@dataclass(frozen=True)
class StrokeShapes:
    """Link angles of one stroke over the shaft angle: `shaft_rad` (m,) strictly ascending, `q_rad` (m, n) absolute, for n links."""

    shaft_rad: Floats
    q_rad: Floats

    def covers(self, shaft_rad: float) -> bool:
        return bool(self.shaft_rad[0] <= shaft_rad <= self.shaft_rad[-1])

    def at(self, shaft_rad: float) -> Floats:
        """Link angles (n,) rad at a shaft angle, linearly interpolated."""
        row = int(np.clip(np.searchsorted(self.shaft_rad, shaft_rad), 1, len(self.shaft_rad) - 1))
        before, after = self.shaft_rad[row - 1], self.shaft_rad[row]
        weight = (shaft_rad - before) / (after - before)
        return np.asarray((1.0 - weight) * self.q_rad[row - 1] + weight * self.q_rad[row])


class LegShapes:
    """Shapes of one rig's leg as points (links + 1, 2) in m, shaft first. `prepare` computes a stroke once; the rest is a look-up.

    The first `prepare` or `hanging` of a process compiles the model. Never call it in the process whose loop drives a motor.
    """

    def __init__(self, rig: RigModel) -> None:
        self._rig = rig
        self._lengths_m = np.array(rig.leg.link_lengths_m)
        self._strokes: dict[tuple[float, float], StrokeShapes] = {}
        self._hanging: dict[float, Floats] = {}

    def prepare(self, height_m: float, speed_rad_s: float, sweep_deg: float) -> None:
        """Simulates the stroke of a condition, for `at_shaft`. Raises BadInput, SimulationFailed."""
        self._strokes[_condition(height_m, speed_rad_s)] = stroke_shapes(self._rig, height_m, speed_rad_s, sweep_deg)

    def at_shaft(self, height_m: float, shaft_rad: float, speed_rad_s: float) -> Floats:
        """Shape (links + 1, 2) m in the stroke of a condition at a shaft angle, modulo whole turns.

        Where the stroke was not prepared, or does not pass this angle (as on the way back over the top), the leg hangs in the air.
        """
        stroke = self._strokes.get(_condition(height_m, speed_rad_s))
        if stroke is None:
            return self.hanging(shaft_rad)
        in_turn_rad = _in_turn_from(float(stroke.shaft_rad[0]), shaft_rad)
        if not stroke.covers(in_turn_rad):
            return self.hanging(shaft_rad)
        return leg_points(stroke.at(in_turn_rad), self._lengths_m)

    def hanging(self, shaft_rad: float) -> Floats:
        """Shape (links + 1, 2) m of the leg at rest under its own weight, without a floor."""
        # Equilibria are computed at whole degrees, cached, and interpolated: one for each frame would be too slow.
        degrees = np.degrees(shaft_rad)
        below = float(np.floor(degrees))
        weight = degrees - below
        hinges = (1.0 - weight) * self._hanging_hinges(below) + weight * self._hanging_hinges(below + 1.0)
        return leg_points(shaft_rad + hinges, self._lengths_m)

    def from_hinge_angles(self, shaft_rad: float, hinge_deg: Floats) -> Floats:
        """Shape (links + 1, 2) m with the hinge angles (links - 1,) deg of a photo, hinge 2 first."""
        # A hinge angle is that of a link relative to the previous one: sums give absolute angles.
        return leg_points(shaft_rad + np.concatenate([[0.0], np.cumsum(np.radians(hinge_deg))]), self._lengths_m)

    def _hanging_hinges(self, degrees: float) -> Floats:
        """Link angles at rest relative to the shaft, (links,) rad."""
        turned = degrees % 360.0
        if turned not in self._hanging:
            self._hanging[turned] = hanging_angles(self._rig, float(np.radians(turned))) - np.radians(turned)
        return self._hanging[turned]


def leg_points(q_rad: Floats, lengths_m: Floats) -> Floats:
    """Points (n + 1, 2) m of shaft, hinges and tip, for links with absolute angles (n,) rad and lengths (n,) m."""
    steps = lengths_m[:, None] * np.column_stack([np.cos(q_rad), np.sin(q_rad)])
    return np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])


def stroke_shapes(rig: RigModel, height_m: float, speed_rad_s: float, sweep_deg: float) -> StrokeShapes:
    """Simulates a stroke from rest through `sweep_deg`: m samples, link angles (m, n).

    Raises BadInput, SimulationFailed.
    """
    end_s = np.radians(sweep_deg) / speed_rad_s + rig.drive.ramp_s
    stroke = simulate_stroke_at_speed(rig, height_m, speed_rad_s, np.arange(0.0, end_s, 1.0 / ROWS_PER_S))
    shaft_rad = stroke.shaft_angle_rad
    # A compliant shaft may be thrown back by the contact. Only samples at a new maximum count, so that shapes are a function of the angle.
    forward = np.concatenate([[True], shaft_rad[1:] > np.maximum.accumulate(shaft_rad)[:-1]])
    return StrokeShapes(shaft_rad[forward], stroke.q_rad[forward])


def hanging_angles(rig: RigModel, shaft_rad: float) -> Floats:
    """Absolute link angles (n,) rad of the leg at rest in the air. Raises SimulationFailed."""
    setup = set_up(rig, IN_THE_AIR_M, ramp_to_speed(shaft_rad, 0.0, rig.drive.ramp_s, 0.0))
    chain = setup.chain()
    return find_rest_state(chain, shaft_rad, setup.compile_laws(chain)).q[: chain.length.size]


def _condition(height_m: float, speed_rad_s: float) -> tuple[float, float]:
    """Key of a condition: rounded to 10 um and 1e-4 rad/s, so that rounding errors of floats do not matter."""
    return round(height_m, 5), round(speed_rad_s, 4)


def _in_turn_from(start_rad: float, shaft_rad: float) -> float:
    """The same angle in the turn that begins one degree before `start_rad`."""
    # One degree of margin: a shaft that stands a little before the start would otherwise count as a whole turn ahead.
    begin_rad = start_rad - float(np.radians(1.0))
    return begin_rad + (shaft_rad - begin_rad) % TURN_RAD
