"""Force inputs: places where a force outside the catalogue could enter, and its effect on the rows.

Every place answers for one condition with the change of its rows per bump of the force, around the
nominal motion. One simulation is made for every bump of torque in every hinge. Forces on all
hinges, or from outside on the leg, are superposed from these.

A prescribed shaft moves on whatever torque acts on it. So a torque on the shaft and a fault of the
torque channel are one place.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.diagnosis.leg.strokes import DynamicCondition
from rfca_rig.diagnosis.residual_force.spline_force import (
    Change,
    SplineBasis,
    bump_in_hinge,
    bump_in_turn,
    make_basis,
    simulate_forced_stroke,
)
from rfca_rig.errors import SimulationFailed
from rfca_rig.executors.parallel import map_in_processes, split_results
from rfca_rig.model.motion import ShaftMotion
from rfca_rig.model.stroke import SimulatedStroke

Floats = NDArray[np.float64]

# large against the integrator's error, small against what bends the leg
TRIED_NM = 0.1
TRIED_RAD = 0.004
TRIED_M = 2e-4

CHANNELS = {
    "fy_N": "fy_N",
    "fz_N": "fz_N",
    "shaft": "tx_Nm",
}  # the signal that a place which is one adds to


@dataclass(frozen=True)
class NominalCondition:
    """One condition with the model as it is: its own stroke, and the responses that a force is
    superposed from.

    Parameters
    ----------
    flap
        The condition, with m rows.
    supposed
        Input of the simulator.
    stroke
        The simulated stroke.
    bumps
        Basis of a force over time, of `count` bumps.
    in_hinge
        (m, count, hinges) change of the rows per bump of a torque that resists one hinge.
    """

    flap: DynamicCondition
    supposed: ModelPoint
    stroke: SimulatedStroke
    bumps: SplineBasis
    in_hinge: Floats

    def rows(self, stroke: SimulatedStroke) -> Floats:
        """Rows (m,) of a stroke, signal after signal."""
        return self.rows_of({signal: getattr(stroke, signal) for signal in self.flap.signals})

    def rows_of(self, channels: Mapping[str, Floats]) -> Floats:
        """Rows of channels over n samples, (n,) or several (n, k) of each; channels that are not
        given are zero.
        """
        if channels:
            nothing = np.zeros_like(next(iter(channels.values())))
        else:
            nothing = np.zeros(len(self.flap.t_s))
        counts = self.flap.counts.reshape(-1, *[1] * (nothing.ndim - 1))
        binned = [
            np.add.reduceat(channels.get(signal, nothing), self.flap.first) / counts
            for signal in self.flap.signals
        ]
        return np.concatenate(binned)

    def change_to(self, stroke: SimulatedStroke | None, size: float) -> Floats:
        """Change of the rows (m,) per unit of what changed the stroke; zero where the model has
        no answer.
        """
        if stroke is None:
            return self.rows_of({})
        return (self.rows(stroke) - self.rows(self.stroke)) / size


def nominal_conditions(
    flaps: Sequence[DynamicCondition], supposed: ModelPoint
) -> tuple[NominalCondition, ...]:
    """The conditions at an input of the simulator, with the responses of all hinges. Raises
    SimulationFailed.
    """
    hinges = len(supposed.rig.leg.link_lengths_m) - 1
    bare = [
        NominalCondition(
            flap,
            supposed,
            simulate_forced_stroke(flap, supposed, ()),
            make_basis(flap),
            np.empty(0),
        )
        for flap in flaps
    ]
    jobs = [
        (condition, number, hinge)
        for condition in bare
        for number in range(condition.bumps.count)
        for hinge in range(1, hinges + 1)
    ]
    # One map for all conditions, so that no core waits at the end of each.
    columns = map_in_processes(lambda job: _hinge_response(*job), jobs)
    of_conditions = split_results(columns, [condition.bumps.count * hinges for condition in bare])
    conditions = []
    for condition, own_columns in zip(bare, of_conditions, strict=True):
        responses = np.stack(own_columns, axis=-1)
        conditions.append(
            replace(condition, in_hinge=responses.reshape(-1, condition.bumps.count, hinges))
        )
    return tuple(conditions)


def _hinge_response(condition: NominalCondition, number: int, hinge: int) -> Floats:
    change = bump_in_hinge(condition.bumps, number, TRIED_NM, hinge)
    return condition.change_to(try_stroke(condition, condition.supposed, (change,)), TRIED_NM)


def try_stroke(
    here: NominalCondition,
    supposed: ModelPoint,
    changes: tuple[Change, ...] = (),
    motion: ShaftMotion | None = None,
) -> SimulatedStroke | None:
    """The stroke of the condition under these changes; None where the model has none."""
    try:
        return simulate_forced_stroke(here.flap, supposed, changes, motion)
    except SimulationFailed:
        return None


@dataclass(frozen=True)
class ForceInput:
    """A place where a force may enter.

    Parameters
    ----------
    id, words
        The place.
    unit, size
        Of the force: its unit, and a plausible size.
    response
        Change of the m rows of a condition per bump, (m, count).
    """

    id: str
    words: str
    unit: str
    size: float
    response: Callable[[NominalCondition], Floats]

    def responses(self, conditions: Sequence[NominalCondition]) -> list[Floats]:
        """Response (m, count) of each condition."""
        return [self.response(condition) for condition in conditions]


def list_force_inputs(hinges: int) -> tuple[ForceInput, ...]:
    """All places of a leg with so many hinges; the one with the same torque in all hinges first."""
    single = [
        ForceInput(f"hinge{i + 1}", f"a torque in hinge {i + 1} alone", "N m", 0.05, _hinge(i))
        for i in range(1, hinges + 1)
    ]
    return (
        ForceInput(
            "hinges",
            "a torque in all hinges alike",
            "N m",
            0.05,
            lambda condition: condition.in_hinge.sum(axis=2),
        ),
        *single,
        ForceInput("tip_down", "a force on the tip, downwards", "N", 1.0, _pull(of_tip, down=True)),
        ForceInput(
            "tip_along",
            "a force along the floor where the leg touches",
            "N",
            1.0,
            _pull(of_touching, down=False),
        ),
        ForceInput(
            "floor_height", "a floor of another height under the tip", "m", 1e-3, _floor_height
        ),
        ForceInput(
            "shaft_angle", "a leg that turns otherwise than the shaft", "rad", 0.01, _shaft_angle
        ),
        ForceInput("fy_N", "something in the fy channel alone", "N", 1.0, _channel("fy_N")),
        ForceInput("fz_N", "something in the fz channel alone", "N", 1.0, _channel("fz_N")),
        ForceInput(
            "shaft",
            "a torque on the shaft, or something in the tx channel alone",
            "N m",
            0.05,
            _channel(CHANNELS["shaft"]),
        ),
    )


def _hinge(hinge: int) -> Callable[[NominalCondition], Floats]:
    return lambda condition: condition.in_hinge[:, :, hinge - 1]


def _channel(signal: str) -> Callable[[NominalCondition], Floats]:
    return lambda condition: condition.rows_of({signal: condition.bumps.at(condition.flap.t_s)})


def _shaft_angle(condition: NominalCondition) -> Floats:
    """Response (m, count) to a shaft angle. The first bump is a wrong start angle, which every
    hypothesis may have, so it is zero.
    """
    motion = condition.flap.turn.motion(condition.supposed, float(condition.flap.t_s[-1]))
    bent = [
        bump_in_turn(motion, condition.bumps, number, TRIED_RAD)
        for number in range(1, condition.bumps.count)
    ]
    columns = [
        condition.change_to(try_stroke(condition, condition.supposed, (), turn), TRIED_RAD)
        for turn in bent
    ]
    return np.column_stack([condition.rows_of({}), *columns])


def _floor_height(condition: NominalCondition) -> Floats:
    """Response (m, count) to the height of the floor, as if the leg followed a slow change at once.

    It is exact for a floor that is higher all the time.
    """
    higher = try_stroke(
        condition,
        replace(condition.supposed, height_offset_m=condition.supposed.height_offset_m - TRIED_M),
    )
    if higher is None:
        return np.zeros((len(condition.rows_of({})), condition.bumps.count))
    # The change of the whole stroke, weighted over time by each bump.
    windows = condition.bumps.at(condition.flap.t_s)
    changes = {
        s: (getattr(higher, s) - getattr(condition.stroke, s))[:, None] / TRIED_M * windows
        for s in condition.flap.signals
    }
    return condition.rows_of(changes)


def of_tip(stroke: SimulatedStroke) -> Floats:
    """All of a force on the last link end, as shares (n, links) for n samples."""
    shares = np.zeros_like(stroke.normal_N)
    shares[:, -1] = 1.0
    return shares


def of_touching(stroke: SimulatedStroke) -> Floats:
    """Shares (n, links) of the link ends in a force from the floor: as they press; all of it on
    the tip while none presses.
    """
    pressed = np.maximum(stroke.normal_N, 0.0)
    total = pressed.sum(axis=1, keepdims=True)
    return np.where(total > 0.0, pressed / np.maximum(total, 1e-9), of_tip(stroke))


def _pull(
    shares_of: Callable[[SimulatedStroke], Floats], down: bool
) -> Callable[[NominalCondition], Floats]:
    """A force from outside, downwards or along +y: its torques about the hinges, and its direct
    part in the reading at the mount.
    """

    def response(here: NominalCondition) -> Floats:
        arms = arms_of(here, shares_of(here.stroke), down)
        windows = here.bumps.at(here.flap.t_s)
        # The arms change during the stroke, so torque courses are expressed in the same bumps
        # before they are superposed. Sizes (count, k, hinges) of the bumps (n, count) that are
        # closest to courses (n, k, hinges), by least squares.
        courses = windows[:, :, None] * arms[:, None, 1:]
        flat = np.linalg.lstsq(windows, courses.reshape(len(courses), -1), rcond=None)[0]
        levers = np.asarray(flat.reshape(windows.shape[1], *courses.shape[1:]))
        torque = -windows * arms[:, :1]
        if down:
            fy = 0.0 * windows
            fz = windows
        else:
            fy = -windows
            fz = 0.0 * windows
        direct_part = here.rows_of(
            {"fy_N": fy, "fz_N": fz, "tx_Nm": torque + here.supposed.rig.sensor.below_shaft_m * fy}
        )
        # `in_hinge` is for a torque that resists a hinge, and these torques act along the turn,
        # hence the minus.
        return np.asarray(direct_part - np.einsum("mji,jki->mk", here.in_hinge, levers))

    return response


def arms_of(here: NominalCondition, shares: Floats, down: bool) -> Floats:
    """Lever arms (n, links) of a force on the link ends: way of the pulled point per radian that
    all links from i on turn.

    `shares` (n, links) divide the force between the ends.
    """
    q = here.stroke.q_rad
    length = np.array(here.supposed.rig.leg.link_lengths_m)
    # A link at angle q extends L sin q downwards and L cos q along the floor; these are the
    # derivatives.
    reach = length * (np.cos(q) if down else -np.sin(q))
    beyond = np.cumsum(shares[:, ::-1], axis=1)[
        :, ::-1
    ]  # of the force, what acts on ends at or behind each link
    return np.asarray(np.cumsum((beyond * reach)[:, ::-1], axis=1)[:, ::-1])
