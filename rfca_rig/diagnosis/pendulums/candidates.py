"""Which effects a pendulum may lack, and how large each may plausibly be on it.

Pendulums differ by a factor of ten thousand in their torques, so the ranges of the catalogue, which are those of a leg, do not suit.
Here the range of a parameter follows from its unit and from what the recordings show: torques, speeds, inertias and masses of the rig.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.swings import SwingProblem
from rfca_rig.diagnosis.candidate_effects import select_candidates
from rfca_rig.diagnosis.pendulums.windows import usual_torque_Nm
from rfca_rig.errors import BadInput
from rfca_rig.model.catalogue import catalogue, lab_texts
from rfca_rig.model.effect import OF_PENDULUMS, Effect, Parameter
from rfca_rig.model.parameters import PresentEffect
from rfca_rig.model.pendulum import Pendulum, driven

Floats = NDArray[np.float64]

OF_TORQUE = ("torque_scale", "torque_delay", "torque_lag", "joint_load_friction", "angle_lag")
OF_SPEED = ("speed_lag",)
OF_TWO_JOINTS = ("joint_friction_of_one",)
ALSO = ("fluid_drag", "hinge_viscous_damping", "gravity_tilt")

# Shares of the rig's own figures. Below the first an effect is lost in the usual model error of 1 %; with more than the second the joint
# would hardly move. With a tenth and ten times these bounds the log evidence of friction changes by less than 1.
SMALLEST, LARGEST = 0.002, 0.8


@dataclass(frozen=True)
class RigScale:
    """What is usual on a rig, over its joints: the smallest and the largest of each."""

    torque_Nm: tuple[float, float]
    speed_rad_s: tuple[float, float]
    inertia_kg_m2: tuple[float, float]
    mass_kg: tuple[float, float]
    length_m: tuple[float, float]

    def range_of(self, parameter: Parameter) -> tuple[float, float]:
        """The plausible range of a parameter, by the unit in its name; as in the catalogue where that does not depend on the rig."""
        (torque, torques), (speed, speeds) = self.torque_Nm, self.speed_rad_s
        drag = (torque / (speeds**2 * self.length_m[1] ** 4), torques / (speed**2 * self.length_m[0] ** 4))
        by_unit: Mapping[str, tuple[float, float]] = {
            "_Nm": self.torque_Nm,
            "_Nm_s_per_rad": (torque / speeds, torques / speed),
            "_N_s2_per_m3": (4.0 * drag[0], 4.0 * drag[1]),  # a link that swings about its end feels c w^2 L^4 / 4
            "_kg_m2": self.inertia_kg_m2,
            "mass_kg": (self.mass_kg[0], 3.0 * self.mass_kg[1]),  # an added mass may well be more than the pendulum
        }
        unit = max((ending for ending in by_unit if parameter.name.endswith(ending)), key=len, default=None)
        return (parameter.low, parameter.high) if unit is None else (SMALLEST * by_unit[unit][0], LARGEST * by_unit[unit][1])


def scale_of(problem: SwingProblem) -> RigScale:
    """The scale of a rig, from its nominal values and from its recordings."""
    links = problem.pendulum.links
    torque_Nm = usual_torque_Nm(problem.pendulum, problem.windows)
    speed = np.sqrt(np.mean([window.speed_rad_s**2 for window in problem.windows], axis=0))
    mass, inertia = sum(link.mass_kg for link in links), [link.inertia_kg_m2 for link in links]
    lengths = [link.length_m for link in links]
    return RigScale(
        torque_Nm=_range(torque_Nm),
        speed_rad_s=_range(speed),
        inertia_kg_m2=_range(np.array(inertia)),
        mass_kg=(mass, mass),
        length_m=(min(lengths), sum(lengths)),
    )


def _range(values: Floats) -> tuple[float, float]:
    """Smallest and largest; a joint that hardly moves or bears counts as a tenth of the largest."""
    largest = max(float(values.max()), 1e-12)
    return max(float(values.min()), 0.1 * largest), largest


def candidates_of(problem: SwingProblem, without: Collection[str]) -> list[Effect]:
    """The effects that are looked for, with ranges that suit the rig.

    Effects of a lab's own are looked for where the pendulum has a place for them. Effects of the torque need a driven run, those of one
    joint two joints, those of the speed's channel a recorded speed.
    """
    powered = any(window.trace.powered for window in problem.windows) and any(link.driven for link in problem.pendulum.links)
    idle = () if powered else OF_TORQUE
    idle = idle if len(problem.pendulum.links) > 1 else (*idle, *OF_TWO_JOINTS)
    idle = idle if any(len(window.measured) > 1 for window in problem.windows) else (*idle, *OF_SPEED)
    own, _ = own_effects(problem.pendulum)
    known = (effect for effect in catalogue().values() if effect.where == OF_PENDULUMS or effect.id in (*ALSO, *own))
    scale = scale_of(problem)
    return [_scaled(effect, scale) for effect in select_candidates(known, without) if effect.id not in idle]


def own_effects(pendulum: Pendulum) -> tuple[tuple[str, ...], Mapping[str, str]]:
    """Ids of the effects of a lab's own that this pendulum has a place for, and why it has none for the others, by id."""
    fitting, refused = [], {}
    for effect in (catalogue()[name] for name in lab_texts(catalogue())):
        try:
            driven(pendulum, [PresentEffect(effect.id, tuple((p.name, _middle(p)) for p in effect.parameters))])
            fitting.append(effect.id)
        except BadInput as error:
            refused[effect.id] = str(error)
    return tuple(fitting), refused


def _middle(parameter: Parameter) -> float:
    """A plausible value: no effect acts at its neutral one."""
    middle = 0.5 * (parameter.low + parameter.high) or parameter.high
    return float(round(middle)) if parameter.whole else middle


def _scaled(effect: Effect, scale: RigScale) -> Effect:
    ranges = [scale.range_of(parameter) for parameter in effect.parameters]
    parameters = tuple(replace(p, low=low, high=high) for p, (low, high) in zip(effect.parameters, ranges, strict=True))
    return replace(effect, parameters=parameters)
