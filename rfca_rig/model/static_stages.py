"""The static experiment in time: the shaft moves to each stage at a speed and stops, the leg settles, then it is read.

At rest the leg remembers how it came there. When a shaft that turned at 1 rad/s stops within some milliseconds, the sliding tip is
thrown back by some micrometres against the ties to the ground, and its friction falls below mu N by a newton or more; only a shaft that
creeps, or slows down softly, leaves it at the limit, as `static_path` has it. A static table that was measured with brisk moves is
to be held against these states.

Effects of the rig act here as they do in a stroke, those that remember from stage to stage. The sensor's are applied to what it feels
at rest: a lag or a shifted clock leaves no trace there, a drift counts from the beginning of the table.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.model.chain import Tolerance
from rfca_rig.model.laws import SLIP
from rfca_rig.model.motion import ShaftMotion
from rfca_rig.model.parameters import RigModel
from rfca_rig.model.setup import set_up
from rfca_rig.model.static_state import StaticState, touches
from rfca_rig.model.stroke import SimulatedStroke, stroke_following

Floats = NDArray[np.float64]

AT_REST = Tolerance(longest_s=0.02)  # a hold takes a third of the steps; what is read changes by 1 % of a sensor's noise
STILL_AFTER_S = 0.1  # the shaft rests on after a reading, longer than any clock is shifted


@dataclass(frozen=True)
class StageMoves:
    """How the shaft goes from stage to stage: to `speed_rad_s` and back to rest within `ramp_s` each, then `hold_s` before the reading.

    On the ground the slowest vibration of the paper's leg has died out after 0.3 s; in the air it swings for 2 s. Raises
    BadInput where one of them is not above 0.
    """

    speed_rad_s: float
    ramp_s: float
    hold_s: float = 1.0

    def __post_init__(self) -> None:
        if not min(self.speed_rad_s, self.ramp_s, self.hold_s) > 0.0:
            raise BadInput(
                f"moves between static stages with speed_rad_s {self.speed_rad_s:g}, ramp_s {self.ramp_s:g}, hold_s {self.hold_s:g}: "
                "each must be above 0"
            )


def static_stages(rig: RigModel, height_m: float, shaft_angles_rad: Sequence[float] | Floats, moves: StageMoves) -> list[StaticState]:
    """The states at `shaft_angles_rad`, one after the other from rest at the leg's start angle, each read at the end of its hold.

    A dynamic simulation of the whole table, some ten milliseconds a stage. The angles are those of the motor, behind which a soft drive
    leaves the leg. Raises SimulationFailed where the integrator cannot go on.
    """
    motion, read_s = staged_motion(rig.leg.start_angle_rad, shaft_angles_rad, moves)
    around_s = np.array([-0.5 * moves.hold_s, 0.0, STILL_AFTER_S])  # effects of the sensor see it at rest before and after
    held = stroke_following(rig, height_m, motion, (read_s[:, None] + around_s).ravel(), AT_REST)
    mu = friction_at_rest(rig, height_m, motion)
    return [_state(held, row, mu) for row in range(1, len(held.t_s), len(around_s))]


def friction_at_rest(rig: RigModel, height_m: float, motion: ShaftMotion) -> float:
    """The friction coefficient that a point which does not slip is held with, effects included."""
    setup = set_up(rig, height_m, motion)
    factors = [use.law(0.0, (0.0,) * 4, use.parameters)[0] for use in setup.laws if use.place == SLIP]
    return float(setup.chain().mu * np.prod(factors))


def _state(held: SimulatedStroke, row: int, mu: float) -> StaticState:
    normal, tangential = held.normal_N[row], held.tangential_N[row]
    return StaticState(
        q_rad=held.q_rad[row],
        fy_N=float(held.fy_N[row]),
        fz_N=float(held.fz_N[row]),
        tx_Nm=float(held.tx_Nm[row]),
        shaft_torque_Nm=float(held.shaft_torque_Nm[row]),
        normal_N=normal,
        tangential_N=tangential,
        touch=touches(mu, normal, tangential),
        jumped=False,
    )


def staged_motion(start_rad: float, angles_rad: Sequence[float] | Floats, moves: StageMoves) -> tuple[ShaftMotion, Floats]:
    """A shaft that goes from angle to angle, and the times (m,) of the readings, shortly after which it moves on.

    A move too short to reach its speed within the ramps stays slower.
    """
    pieces: list[tuple[float, list[float]]] = []
    here = start_rad
    for angle in angles_rad:
        pieces += _move(here, float(angle), moves)
        pieces.append((moves.hold_s + STILL_AFTER_S, [float(angle), 0.0, 0.0, 0.0]))
        here = float(angle)
    breaks = np.concatenate([[0.0], np.cumsum([seconds for seconds, _ in pieces])])
    holds = np.array([row[1] == row[2] == 0.0 for _, row in pieces])
    return ShaftMotion(breaks, np.array([row for _, row in pieces]), breaks[:-1]), breaks[1:][holds] - STILL_AFTER_S


def _move(here: float, there: float, moves: StageMoves) -> list[tuple[float, list[float]]]:
    """(seconds, coefficients) of the pieces of one move."""
    way, ramp_s = there - here, moves.ramp_s
    if way == 0.0:
        return []
    speed = np.sign(way) * min(moves.speed_rad_s, abs(way) / ramp_s)
    even_s, ramped = way / speed - ramp_s, 0.5 * speed * ramp_s
    half_acceleration = 0.5 * speed / ramp_s
    return [
        (ramp_s, [here, 0.0, half_acceleration, 0.0]),
        *([(even_s, [here + ramped, speed, 0.0, 0.0])] if even_s > 1e-9 else []),
        (ramp_s, [there - ramped, speed, -half_acceleration, 0.0]),
    ]
