"""Simulates the static experiment in time: the shaft moves to each stage and stops, the leg
settles, then it is read.

The state at rest depends on how the leg came there. When a shaft that turned at 1 rad/s stops
within some milliseconds, the sliding tip is thrown back by some micrometres against the ties to the
ground, and its friction falls below mu N by a newton or more. Only a shaft that creeps, or slows
down softly, leaves it at the limit, as in `follow_static_path`. A static table that was measured
with fast moves must be compared with these states.

Effects of the rig act here as in a stroke; those with memory keep it from stage to stage. Effects
of the sensor are applied to its channels at rest: a lag or a shifted clock has no effect there, a
drift counts from the beginning of the table.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.model.catalogue import set_up
from rfca_rig.model.chain import Tolerance
from rfca_rig.model.kernel.laws import SLIP
from rfca_rig.model.motion import ShaftMotion
from rfca_rig.model.parameters import GRAVITY_M_S2, RigModel
from rfca_rig.model.stroke import SimulatedStroke, simulate_stroke

Floats = NDArray[np.float64]

AT_THE_LIMIT = 1.0 - 1e-6  # share of mu N from which on friction counts as fully used

# Longer steps than in a stroke: a hold takes a third of them, and the readings change by 1 % of a
# sensor's noise.
AT_REST = Tolerance(longest_s=0.02)
STILL_AFTER_S = 0.1  # rest of the shaft after a reading, longer than any clock is shifted


class Touch(Enum):
    """Contact state of the end of a link."""

    AIR = "air"
    STUCK = "stuck"
    SLIDING = "sliding"


@dataclass(frozen=True)
class StaticState:
    """The leg held at one shaft angle, forces in the sensor's axes and signs.

    `q_rad` (n,) absolute link angles; `hinge_angles_rad` (n - 1,) of hinges 2..n; `normal_N`,
    `tangential_N` (n,) and `touch` (n,) at the end of each link, as they act on the leg (up, and
    along +y). SLIDING means that friction is at its limit mu N. `jumped` if the leg has passed a
    place without equilibrium since the state before; never set for a path that is simulated in
    time.
    """

    q_rad: Floats
    fy_N: float
    fz_N: float
    tx_Nm: float
    shaft_torque_Nm: float
    normal_N: Floats
    tangential_N: Floats
    touch: tuple[Touch, ...]
    jumped: bool

    @property
    def shaft_angle_rad(self) -> float:
        return float(self.q_rad[0])

    @property
    def hinge_angles_rad(self) -> Floats:
        return np.diff(self.q_rad)


def make_static_state(
    rig: RigModel,
    q_rad: Floats,
    shaft_torque_Nm: float,
    normal_N: Floats,
    tangential_N: Floats,
    jumped: bool,
) -> StaticState:
    """The state of a plain leg at rest with angles `q_rad` (n,) and ground forces (n,); the
    mount carries ground forces and weight.
    """
    fy = -float(tangential_N.sum())
    weight = sum(rig.leg.link_masses_kg) * GRAVITY_M_S2
    return StaticState(
        q_rad=q_rad,
        fy_N=fy,
        fz_N=weight - float(normal_N.sum()),
        tx_Nm=shaft_torque_Nm + rig.sensor.below_shaft_m * fy,
        shaft_torque_Nm=shaft_torque_Nm,
        normal_N=normal_N,
        tangential_N=tangential_N,
        touch=touches(rig.ground.friction_coefficient, normal_N, tangential_N),
        jumped=jumped,
    )


def touches(mu: float, normal_N: Floats, tangential_N: Floats) -> tuple[Touch, ...]:
    """Contact state of each end (n,) for its normal and tangential force (n,), with mu the
    friction coefficient at rest.
    """
    return tuple(_touch(mu, N, F) for N, F in zip(normal_N, tangential_N, strict=True))


def _touch(mu: float, normal: float, tangential: float) -> Touch:
    if normal == 0.0:
        return Touch.AIR
    if abs(tangential) >= AT_THE_LIMIT * mu * abs(normal):
        return Touch.SLIDING
    return Touch.STUCK


@dataclass(frozen=True)
class StageMoves:
    """Moves of the shaft between stages: to `speed_rad_s` and back to rest within `ramp_s` each,
    then `hold_s` before the reading.

    On the ground the slowest vibration of the paper's leg has died out after 0.3 s; in the air it
    swings for 2 s. Raises BadInput where one of them is not above 0.
    """

    speed_rad_s: float
    ramp_s: float
    hold_s: float = 1.0

    def __post_init__(self) -> None:
        if not min(self.speed_rad_s, self.ramp_s, self.hold_s) > 0.0:
            raise BadInput(
                f"moves between static stages with speed_rad_s {self.speed_rad_s:g}, "
                f"ramp_s {self.ramp_s:g}, hold_s {self.hold_s:g}: "
                "each must be above 0"
            )


def simulate_static_stages(
    rig: RigModel, height_m: float, shaft_angles_rad: Sequence[float] | Floats, moves: StageMoves
) -> list[StaticState]:
    """Simulates all stages in time, some ten milliseconds of computing per stage.

    Parameters
    ----------
    rig, height_m
        The rig, and the height of the shaft above the ground.
    shaft_angles_rad
        (s,) angles of the motor in the order of the stages; a compliant drive leaves the leg behind
        them.
    moves
        How the shaft moves, first from rest at the leg's start angle.

    Returns
    -------
    list of StaticState
        One per stage, at the end of its hold.

    Raises
    ------
    SimulationFailed
        Where the integrator cannot go on.
    """
    motion, read_s = make_stage_motion(rig.leg.start_angle_rad, shaft_angles_rad, moves)
    # Samples at rest before and after each reading, between which effects of the sensor
    # interpolate.
    around_s = np.array([-0.5 * moves.hold_s, 0.0, STILL_AFTER_S])
    simulated = simulate_stroke(
        rig, height_m, motion, (read_s[:, None] + around_s).ravel(), AT_REST
    )
    mu = friction_at_rest(rig, height_m, motion)
    return [_state(simulated, row, mu) for row in range(1, len(simulated.t_s), len(around_s))]


def friction_at_rest(rig: RigModel, height_m: float, motion: ShaftMotion) -> float:
    """The friction coefficient of a point that does not slip, effects included."""
    setup = set_up(rig, height_m, motion)
    # Laws of the slip have one factor at rest; those of the load (LOAD) are not included.
    factors = [
        use.law(0.0, (0.0,) * 4, use.parameters)[0] for use in setup.laws if use.place == SLIP
    ]
    return float(setup.chain().mu * np.prod(factors))


def _state(simulated: SimulatedStroke, row: int, mu: float) -> StaticState:
    normal = simulated.normal_N[row]
    tangential = simulated.tangential_N[row]
    return StaticState(
        q_rad=simulated.q_rad[row],
        fy_N=float(simulated.fy_N[row]),
        fz_N=float(simulated.fz_N[row]),
        tx_Nm=float(simulated.tx_Nm[row]),
        shaft_torque_Nm=float(simulated.shaft_torque_Nm[row]),
        normal_N=normal,
        tangential_N=tangential,
        touch=touches(mu, normal, tangential),
        jumped=False,
    )


def make_stage_motion(
    start_rad: float, angles_rad: Sequence[float] | Floats, moves: StageMoves
) -> tuple[ShaftMotion, Floats]:
    """Motion of a shaft from angle to angle (m,), and the times (m,) of the readings, shortly after
    which it moves on.

    A move too short to reach its speed within the ramps stays slower.
    """
    pieces: list[tuple[float, list[float]]] = []
    last_angle = start_rad
    for angle in angles_rad:
        pieces += _move(last_angle, float(angle), moves)
        pieces.append((moves.hold_s + STILL_AFTER_S, [float(angle), 0.0, 0.0, 0.0]))
        last_angle = float(angle)
    breaks = np.concatenate([[0.0], np.cumsum([seconds for seconds, _ in pieces])])
    holds = np.array([row[1] == row[2] == 0.0 for _, row in pieces])
    return ShaftMotion(breaks, np.array([row for _, row in pieces]), breaks[:-1]), breaks[1:][
        holds
    ] - STILL_AFTER_S


def _move(start: float, end: float, moves: StageMoves) -> list[tuple[float, list[float]]]:
    """(seconds, coefficients) of the pieces of one move."""
    distance = end - start
    ramp_s = moves.ramp_s
    if distance == 0.0:
        return []
    # Trapezoidal speed over time; a short move is a triangle with a lower peak.
    speed = np.sign(distance) * min(moves.speed_rad_s, abs(distance) / ramp_s)
    even_s = distance / speed - ramp_s
    ramped = 0.5 * speed * ramp_s
    half_acceleration = 0.5 * speed / ramp_s
    return [
        (ramp_s, [start, 0.0, half_acceleration, 0.0]),
        *([(even_s, [start + ramped, speed, 0.0, 0.0])] if even_s > 1e-9 else []),
        (ramp_s, [end - ramped, speed, -half_acceleration, 0.0]),
    ]
