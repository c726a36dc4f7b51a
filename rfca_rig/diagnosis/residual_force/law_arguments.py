"""Arguments that a force at a place may depend on: ranges over the recordings, knots, and the law
that the model has there already.

Ranges come from the simulated motion, which has no noise, never from a differentiated recording.

A torque in a joint of a mechanism may depend on its speed, or on its position.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.diagnosis.leg.simulator import select_strokes
from rfca_rig.diagnosis.leg.strokes import DynamicCondition
from rfca_rig.diagnosis.mechanisms.nuisances import MechanismInput
from rfca_rig.diagnosis.mechanisms.windows import MechanismSimulator, Motions
from rfca_rig.diagnosis.residual_force.law import Course, LawArgument
from rfca_rig.diagnosis.simulator import Dataset
from rfca_rig.errors import BadInput
from rfca_rig.mechanism.laws import compute_own_law, make_tabulated_effect, name_argument
from rfca_rig.mechanism.load import Mechanism
from rfca_rig.model.hinge_springs import bending_torque_Nm
from rfca_rig.model.parameters import LawTable
from rfca_rig.model.stroke import SimulatedStroke
from rfca_rig.model.tabulated_law import effect_of_table, kind_of

Floats = NDArray[np.float64]

# Of the usual torque of the joint; sizes of a tenth to ten times of it are compared, as they are
# for a leg.
PLAUSIBLE_SHARE = 0.1

# Knots of a law that may change sign with its argument stand denser around zero, where friction
# changes: even in asinh(u / (0.05 of the largest)). 15 knots are 10 to 40 % of the argument apart.
# With 11, 15 or 21 of them the law takes away 74.5, 75.3 and 75.3 % of the held-out misfit of a
# quadratic hinge damping, and 81.6, 82.2 and 82.0 % of that of a friction that differs by
# direction.
SIGNED_KNOTS = 15
PLAIN_KNOTS = 9
NEAR_ZERO = 0.05
# share of the time at either end of the range that is left to a constant: bounces of a single
# millisecond
SELDOM = 1e-3
PRESSED = 0.05  # of the largest load: a tip that hardly touches shows nothing of friction

SIGNED = ("rate_rad_s", "slip_m_s")
ZERO_AT_ZERO = (
    "rate_rad_s",
)  # what resists a turn is not there without one: a steady torque is a spring's or a weight's
PLAUSIBLE = {
    "N m": 0.1,
    "N": 2.0,
    "": 0.3,
}  # size of a law's value, in its unit: some percent of what the paper's leg does in a stroke


def make_joint_argument(
    mechanism: Mechanism, joint: int, quantity: str, usual_torque: float
) -> LawArgument:
    """A law of the joint's "speed" or "position"; `usual_torque` [N m or N] is that of the joint in
    the recordings.

    A force that resists motion is zero at rest: a steady torque depends on the position.
    """
    by_speed = quantity == "speed"
    slides = bool(mechanism.is_slide[joint])
    unit = ("m" if slides else "rad") + ("/s" if by_speed else "")
    return LawArgument(
        place=mechanism.joints[joint],
        name=name_argument(mechanism, joint, quantity),
        unit=unit,
        value_unit="N" if slides else "N m",
        plausible=PLAUSIBLE_SHARE * usual_torque,
        is_signed=by_speed,
        zero_at_zero=by_speed,
        effect_of=partial(make_tabulated_effect, mechanism),
    )


def courses_of_motions(
    dataset: Dataset,
    motions: Sequence[Motions],
    supposed: MechanismInput,
    place: str,
    argument: str,
) -> list[Course]:
    """The simulated argument over all windows. Raises SimulationFailed."""
    simulator = _simulator(dataset)
    plant = simulator.plant(supposed)
    joint = simulator.mechanism.joints.index(place)
    argument_courses = []
    for started_window in (window for part in motions for window in part.windows):
        motion = simulator.roll(plant, started_window.window)
        if argument.startswith("speed"):
            values = motion.speed
        else:
            values = motion.position - plant.zero_offset
        argument_courses.append(
            Course(
                started_window.window.t_s, values[:, [joint]], np.ones((len(values), 1), dtype=bool)
            )
        )
    return argument_courses


def own_law_of_joint(
    dataset: Dataset, supposed: MechanismInput, place: str, argument: str, u: Floats
) -> Floats | None:
    """Torque or force (k,) of the mechanism in the joint with these values and effects, at `u`
    (k,); None where it has none.
    """
    simulator = _simulator(dataset)
    joint = simulator.mechanism.joints.index(place)
    return compute_own_law(simulator.plant(supposed), joint, argument.startswith("speed"), u)


def turning_rate(
    dataset: Dataset, supposed: MechanismInput, table: LawTable, share: float
) -> float:
    """This share of the greatest rate of the argument. Below it the direction of the argument
    counts as none.
    """
    motions = [part for part in dataset.parts if isinstance(part, Motions)]
    argument_courses = courses_of_motions(dataset, motions, supposed, table.place, table.argument)
    return (
        share
        * max(
            float(np.abs(np.gradient(course.values, course.t_s, axis=0)).max())
            for course in argument_courses
        )
        + 1e-12
    )


def response_to_branch(
    dataset: Dataset,
    part: Motions,
    supposed: MechanismInput,
    knot: int,
    size: float,
    turning: float,
) -> Floats:
    """Response (m,) of the rows of a condition to a unit of the branches at one knot, by a
    difference of this `size`.

    The law itself acts already.
    """
    simulator = _simulator(dataset)
    plant = simulator.plant(supposed)
    *others, law = plant.laws
    branch = size * (np.arange(len(law.knots)) == knot)
    moved = replace(plant, laws=(*others, replace(law, branches=branch, turning=turning)))
    rows = [
        (simulator.predict(moved, window) - simulator.predict(plant, window)).ravel() / size
        for window in part.windows
    ]
    return np.concatenate(rows)


def _simulator(dataset: Dataset) -> MechanismSimulator:
    assert isinstance(dataset.simulator, MechanismSimulator)
    return dataset.simulator


def make_argument(place: str, argument: str) -> LawArgument:
    """The argument of a law at a place of a leg. Raises BadInput where there is none."""
    kind = kind_of(place, argument)
    return LawArgument(
        place,
        argument,
        kind.argument_unit,
        kind.unit,
        PLAUSIBLE[kind.unit],
        argument in SIGNED,
        argument in ZERO_AT_ZERO,
        effect_of_table,
    )


def arguments_at(place: str, supposed: Any) -> tuple[str, ...]:
    """Arguments that are tried at a place. In a leg with measured curves no law can follow the
    torque of the spring.
    """
    if place.startswith("hinge"):
        return (
            "rate_rad_s",
            "angle_rad",
            *(() if supposed.rig.leg.torque_splines else ("spring_torque_Nm",)),
        )
    known = {"floor_friction": ("slip_m_s", "load_N"), "floor_normal": ("depth_m",)}
    if place in known:
        return known[place]
    return (f"reading_{place.split('_')[1]}", "time_s", "shaft_angle_rad")


def courses(dataset: Dataset, supposed: Any, place: str, argument: str) -> list[Course]:
    """The simulated argument over every moving condition. Raises SimulationFailed, and BadInput
    where none moves.
    """
    motions = [part for part in dataset.parts if isinstance(part, Motions)]
    if motions:
        return courses_of_motions(dataset, motions, supposed, place, argument)
    argument_courses = [
        course_of_stroke(flap, supposed, place, argument) for flap in select_strokes(dataset.parts)
    ]
    if not argument_courses:
        raise BadInput(
            f"no recording moves, so that a law of {argument} at {place} cannot be "
            "measured; record strokes"
        )
    return argument_courses


def find_visited_range(found: Sequence[Course]) -> tuple[float, float]:
    """Range of the argument, without a thousandth of the time at either end."""
    counted = np.concatenate([course.values[course.counts] for course in found])
    if counted.size:
        low, high = np.quantile(counted, [SELDOM, 1.0 - SELDOM])
    else:
        low = 0.0
        high = 0.0
    return float(low), float(high)


def place_knots(visited: tuple[float, float], is_signed: bool) -> Floats:
    """Knots (k,) over a range, ascending."""
    low, high = visited
    if not is_signed:
        return np.linspace(low, high, PLAIN_KNOTS)
    scale = NEAR_ZERO * max(abs(low), abs(high))
    first = np.arcsinh(low / scale)
    last = np.arcsinh(high / scale)
    spacing = (last - first) / (SIGNED_KNOTS - 1)
    # The range hardly crosses zero, so zero needs no knot of its own.
    if first > -spacing or last < spacing:
        return np.asarray(scale * np.sinh(np.linspace(first, last, SIGNED_KNOTS)))
    # Two pieces that meet at zero, so that zero is a knot: a law known to be zero there needs it.
    below = np.linspace(first, 0.0, round(-first / spacing) + 1)
    above = np.linspace(0.0, last, round(last / spacing) + 1)
    return np.asarray(scale * np.sinh(np.append(below, above[1:])))


def compute_nominal_law(
    dataset: Dataset, supposed: Any, place: str, argument: str, u: Floats
) -> Floats | None:
    """The law that the model has at the place already, without base effects.

    Parameters
    ----------
    dataset, supposed
        The recordings, and the input of the simulator.
    place, argument
        The place and the argument.
    u
        (k,) values of the argument.

    Returns
    -------
    (k,) or None
        In the unit of the whole law; None where the model has none.
    """
    if isinstance(dataset.parts[0], Motions):
        return own_law_of_joint(dataset, replace(supposed, effects=()), place, argument, u)
    leg = supposed.rig.leg
    ground = supposed.rig.ground
    laws: dict[str, Callable[[], Floats]] = {
        "rate_rad_s": lambda: leg.hinge_damping_Nm_s_per_rad * u,
        "angle_rad": lambda: bending_torque_Nm(leg, u),
        "slip_m_s": lambda: np.full_like(u, ground.friction_coefficient),
        "load_N": lambda: np.full_like(u, ground.friction_coefficient),
        "depth_m": lambda: ground.stiffness_N_per_m1p5 * np.maximum(u, 0.0) ** 1.5,
    }
    if argument in laws:
        return laws[argument]()
    return None


def add_own_law(place: str, own: Floats, values: Floats) -> Floats:
    """The whole law (k,) from `own` (k,) and the table `values` (k,): a share of the friction
    coefficient, elsewhere a force.
    """
    return np.asarray(own * (1.0 + values) if place == "floor_friction" else own + values)


def course_of_stroke(
    flap: DynamicCondition, supposed: ModelPoint, place: str, argument: str
) -> Course:
    """The argument over one simulated stroke."""
    stroke = flap.stroke(supposed)
    rig = supposed.rig
    if place.startswith("hinge"):
        angle = np.diff(stroke.q_rad, axis=1)
        rate = np.diff(stroke.w_rad_s, axis=1)
        torque = np.abs(bending_torque_Nm(rig.leg, angle))
        values = {"rate_rad_s": rate, "angle_rad": angle, "spring_torque_Nm": torque}[argument]
        if place != "hinges":
            values = values[:, int(place.removeprefix("hinge")) - 2][:, None]
        return Course(stroke.t_s, values, np.ones(values.shape, dtype=bool))
    if place.startswith("floor"):
        values, counts = _at_floor(flap, supposed, stroke)[argument]
    else:
        values = {"time_s": stroke.t_s, "shaft_angle_rad": stroke.shaft_angle_rad}.get(
            argument, getattr(stroke, place)
        )
        counts = np.ones(len(stroke.t_s), dtype=bool)
    return Course(stroke.t_s, values[:, None], counts[:, None])


def _at_floor(
    flap: DynamicCondition, supposed: ModelPoint, stroke: SimulatedStroke
) -> dict[str, tuple[Floats, NDArray[np.bool_]]]:
    """Slip speed, load and depth of the tip (n,), and where each counts."""
    q = stroke.q_rad
    w = stroke.w_rad_s
    length = np.array(supposed.rig.leg.link_lengths_m)
    load = stroke.normal_N[:, -1]
    slip = -(np.sin(q) * w) @ length - supposed.rig.friction_lever_m * w[:, -1]
    depth = (
        np.sin(q) @ length
        + supposed.rig.leg.link_radius_m
        - flap.height_m
        - supposed.height_offset_m
    )
    pressed = load > PRESSED * load.max()
    return {
        "slip_m_s": (slip, pressed),
        "load_N": (load, load > 0.0),
        "depth_m": (depth, depth > 0.0),
    }
