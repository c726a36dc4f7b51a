"""Arguments of a torque in a joint of a mechanism: its speed, or its position."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.data.dataset import Dataset
from rfca_rig.diagnosis.mechanisms.nuisances import MechanismInput
from rfca_rig.diagnosis.mechanisms.windows import MechanismSimulator, Motions
from rfca_rig.diagnosis.residual_force.law import Course, LawArgument
from rfca_rig.mechanism.joint_law import compute_own_law, make_tabulated_effect, name_argument
from rfca_rig.mechanism.load import Mechanism
from rfca_rig.model.parameters import LawTable

Floats = NDArray[np.float64]

# Of the usual torque of the joint; sizes of a tenth to ten times of it are compared, as they are for a leg.
PLAUSIBLE_SHARE = 0.1


def make_joint_argument(mechanism: Mechanism, joint: int, quantity: str, usual_torque: float) -> LawArgument:
    """A law of the joint's "speed" or "position"; `usual_torque` [N m or N] is that of the joint in the recordings.

    A force that resists motion is zero at rest: a steady torque depends on the position.
    """
    by_speed, slides = quantity == "speed", bool(mechanism.is_slide[joint])
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


def courses_of_motions(dataset: Dataset, motions: Sequence[Motions], supposed: MechanismInput, place: str, argument: str) -> list[Course]:
    """The simulated argument over all windows. Raises SimulationFailed."""
    simulator = _simulator(dataset)
    plant, joint = simulator.plant(supposed), simulator.mechanism.joints.index(place)
    found = []
    for each in (each for part in motions for each in part.windows):
        motion = simulator.roll(plant, each.window)
        values = motion.speed if argument.startswith("speed") else motion.position - plant.zero_offset
        found.append(Course(each.window.t_s, values[:, [joint]], np.ones((len(values), 1), dtype=bool)))
    return found


def own_law_of_joint(dataset: Dataset, supposed: MechanismInput, place: str, argument: str, u: Floats) -> Floats | None:
    """Torque or force (k,) of the mechanism in the joint with these values and effects, at `u` (k,); None where it has none."""
    simulator = _simulator(dataset)
    joint = simulator.mechanism.joints.index(place)
    return compute_own_law(simulator.plant(supposed), joint, argument.startswith("speed"), u)


def turning_rate(dataset: Dataset, supposed: MechanismInput, table: LawTable, share: float) -> float:
    """This share of the greatest rate of the argument. Below it the direction of the argument counts as none."""
    motions = [part for part in dataset.parts if isinstance(part, Motions)]
    found = courses_of_motions(dataset, motions, supposed, table.place, table.argument)
    return share * max(float(np.abs(np.gradient(each.values, each.t_s, axis=0)).max()) for each in found) + 1e-12


def response_to_branch(dataset: Dataset, part: Motions, supposed: MechanismInput, knot: int, size: float, turning: float) -> Floats:
    """Response (m,) of the rows of a condition to a unit of the branches at one knot, by a difference of this `size`.

    The law itself acts already.
    """
    simulator = _simulator(dataset)
    plant = simulator.plant(supposed)
    *others, law = plant.laws
    branch = size * (np.arange(len(law.knots)) == knot)
    moved = replace(plant, laws=(*others, replace(law, branches=branch, turning=turning)))
    rows = [(simulator.predict(moved, each) - simulator.predict(plant, each)).ravel() / size for each in part.windows]
    return np.concatenate(rows)


def _simulator(dataset: Dataset) -> MechanismSimulator:
    assert isinstance(dataset.simulator, MechanismSimulator)
    return dataset.simulator
