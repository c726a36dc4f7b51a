"""Effects that a pendulum may lack, and plausible ranges of their sizes.

The torques of pendulums differ by a factor of ten thousand, so the ranges of the catalogue, which suit a leg, are no use. Here the range of
a parameter follows from its unit and from the recordings: torques, speeds, inertias and masses of the rig.
"""

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.swings import SwingProblem
from rfca_rig.diagnosis.candidate_effects import select_candidates
from rfca_rig.diagnosis.pendulums.windows import usual_torque_Nm
from rfca_rig.errors import BadInput
from rfca_rig.mechanism.laws import LARGEST, SMALLEST
from rfca_rig.model.catalogue import catalogue, lab_texts
from rfca_rig.model.effect import OF_PENDULUMS, Effect, Parameter
from rfca_rig.model.parameters import PresentEffect
from rfca_rig.model.pendulum import Pendulum, make_driven_pendulum

Floats = NDArray[np.float64]

OF_TORQUE = ("torque_scale", "torque_delay", "torque_lag", "joint_load_friction", "angle_lag")
OF_SPEED = ("speed_lag",)
OF_TWO_JOINTS = ("joint_friction_of_one",)
ALSO = ("fluid_drag", "hinge_viscous_damping", "gravity_tilt")


def candidates_of(problem: SwingProblem, without: Collection[str]) -> list[Effect]:
    """The effects that are looked for, with ranges that suit the rig.

    Effects of a lab's own are looked for where the pendulum has a place for them. Effects of the torque need a driven run, those of one
    joint need two joints, and those of the speed channel need a recorded speed.
    """
    links, windows = problem.pendulum.links, problem.windows
    is_shown_by = {
        OF_TORQUE: any(window.trace.powered for window in windows) and any(link.driven for link in links),
        OF_TWO_JOINTS: len(links) > 1,
        OF_SPEED: any(len(window.measured) > 1 for window in windows),
    }
    idle = [effect_id for ids, is_shown in is_shown_by.items() if not is_shown for effect_id in ids]
    own, _ = own_effects(problem.pendulum)
    known = [effect for effect in catalogue().values() if effect.where == OF_PENDULUMS or effect.id in (*ALSO, *own)]
    ranges = plausible_ranges(problem)
    return [_with_ranges(effect, ranges) for effect in select_candidates(known, without) if effect.id not in idle]


def plausible_ranges(problem: SwingProblem) -> Mapping[str, tuple[float, float]]:
    """Plausible range of a parameter by the unit that ends its name, from the nominal values of the rig and its recordings."""
    links = problem.pendulum.links
    torque, torques = _extent(usual_torque_Nm(problem.pendulum, problem.windows))
    speed, speeds = _extent(np.sqrt(np.mean([window.speed_rad_s**2 for window in problem.windows], axis=0)))
    inertia, inertias = _extent(np.array([link.inertia_kg_m2 for link in links]))
    lengths_m, mass_kg = [link.length_m for link in links], sum(link.mass_kg for link in links)
    usual = {
        "_Nm": (torque, torques),
        "_Nm_s_per_rad": (torque / speeds, torques / speed),
        # A link that swings about its end feels a drag torque of c w^2 L^4 / 4.
        "_N_s2_per_m3": (4.0 * torque / (speeds**2 * sum(lengths_m) ** 4), 4.0 * torques / (speed**2 * min(lengths_m) ** 4)),
        "_kg_m2": (inertia, inertias),
        "mass_kg": (mass_kg, 3.0 * mass_kg),  # an added mass may well be more than the pendulum
    }
    return {unit: (SMALLEST * low, LARGEST * high) for unit, (low, high) in usual.items()}


def _extent(values: Floats) -> tuple[float, float]:
    """Smallest and largest of values (n,); a joint that hardly moves or bears counts as a tenth of the largest."""
    largest = max(float(values.max()), 1e-12)
    return max(float(values.min()), 0.1 * largest), largest


def _with_ranges(effect: Effect, ranges: Mapping[str, tuple[float, float]]) -> Effect:
    """The effect with these ranges; a parameter that does not depend on the rig keeps that of the catalogue."""

    def scale(parameter: Parameter) -> Parameter:
        found = [extent for unit, extent in ranges.items() if parameter.name.endswith(unit)]
        return replace(parameter, low=found[0][0], high=found[0][1]) if found else parameter

    return replace(effect, parameters=tuple(map(scale, effect.parameters)))


def own_effects(pendulum: Pendulum) -> tuple[tuple[str, ...], Mapping[str, str]]:
    """Ids of the effects of a lab's own that this pendulum has a place for, and by id why it has none for the others."""
    fitting, refused = [], {}
    for effect in (catalogue()[name] for name in lab_texts(catalogue())):
        try:
            # Trial simulation set-up: only the effect itself knows whether it has a place here.
            make_driven_pendulum(pendulum, [PresentEffect(effect.id, tuple((p.name, _middle(p)) for p in effect.parameters))])
            fitting.append(effect.id)
        except BadInput as error:
            refused[effect.id] = str(error)
    return tuple(fitting), refused


def _middle(parameter: Parameter) -> float:
    """A plausible value: no effect acts at its neutral one."""
    middle = 0.5 * (parameter.low + parameter.high) or parameter.high
    return float(round(middle)) if parameter.whole else middle
